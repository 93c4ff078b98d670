"""Update of Gaussian mixtures by measurements, in powers of the likelihood and with splitting.

The likelihood is applied in several powers that add up to one (progressive Bayes [1]_). Before each
the measurements are expanded to second order about every component. The curvature of a component is
the variance that its second-order terms add to all rows, in units of the noise's. The next power is
the largest for which the curvature times the sum of all powers so far stays small. Powers alone
suffice where each narrows the components in the directions that are curved. Where the curvature
remains, so that the powers would no longer grow, the components are split along the direction of
largest curvature [2]_.

A case that has no components left to split applies the rest of the likelihood at once, with the
curvature as additional noise: a second-order Kalman update [3]_. Applied in powers, the curvature
would count as independent from power to power, and the covariance would be too small.

References
----------
.. [1] Hanebeck, Briechle, Rauh (2003), Progressive Bayes: a new framework for nonlinear state
   estimation, SPIE 5099.
.. [2] Tuggle, Zanetti (2018), Automated splitting Gaussian mixture nonlinear measurement update, J.
   Guidance, Control, and Dynamics 41(3).
.. [3] Athans, Wishner, Bertolini (1968), Suboptimal state estimation for continuous-time nonlinear
   systems from discrete noisy measurements, IEEE Trans. Automatic Control 13(5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_estimators.curvature import direction_matrix, point_count
from hillsphere_estimators.innovations import WhitenedInnovation
from hillsphere_estimators.mixture import Mixture
from hillsphere_estimators.roots import sort_roots
from hillsphere_estimators.unscented import linear_update

__all__ = ["ExpandedAt", "expand_in_parts", "update_mixture"]

ExpandedAt: TypeAlias = Callable[[Mixture], WhitenedInnovation]
"""Mixture of M components → their M innovations, expanded to second order: the rows `bent` are
those of `hillsphere_estimators.curvature.expand`."""

_GROWTH = 1.0
"""Smallest power, over the sum of those before it, that does not call for a split. With it the
variance of the noise that is left is halved each time; smaller powers would take many steps."""
_STAGES = 200
"""Powers and splits at most. A factor of 1e16 in the sum of powers takes 53 of the former."""
_NOTABLE = 1e-3
"""Weight, over the largest of the case, from which a component's curvature counts: lighter ones
change mean and covariance by less than the band of a consistency test of a thousand runs."""
_REPEATED = 3.0
"""Factor of the rows of curvature that count as noise. The error by curvature is nearly the same in
one measurement after the other, while a filter takes noise as independent: nine times its variance
covers nine successive measurements with the same error. Later, sharper ones outweigh them."""
_POINTS = 200_000
"""States at which a model is evaluated at once, at most: ten arrays of that size and of six rows
take 100 MB."""
_NEAR = 0.5
"""Distance, in standard deviations, of components that are merged after an update. The sum of two
equal normal densities so close is normal to within a percent of its largest value."""


def update_mixture(
    mixture: Mixture, expand_at: ExpandedAt, t_s: Array, most: int, curvature: float
) -> tuple[Mixture, Array]:
    """Return mixtures after measurements.

    Parameters
    ----------
    mixture : Mixture
        Before the measurements.
    expand_at : callable
        Mixture → innovations of its components, expanded to second order.
    t_s : ndarray, shape (N,)
        Times of the cases, s.
    most : int
        Components of a case at most.
    curvature : float
        Largest variance that curvature may add to the measurements of a component without a split,
        in units of the noise's variance.

    Returns
    -------
    mixture : Mixture
        After the measurements.
    unresolved : ndarray, shape (N,)
        See `hillsphere_estimators.mixture.MixtureBelief`.
    """
    cases, n = mixture.cases, len(mixture.x)
    done, unresolved = np.zeros(cases), np.zeros(cases)
    stuck = np.zeros(cases, dtype=bool)
    for stage in range(_STAGES):
        expected = expand_in_parts(mixture, expand_at)
        sorted_root = sort_roots(mixture.root, expected.linear)
        if sorted_root is not None:
            mixture = replace(mixture, root=sorted_root)
            expected = expand_in_parts(mixture, expand_at)
        bend = np.sum(expected.bent**2, axis=(1, 2))
        fine = np.isfinite(bend) & np.isfinite(expected.residual).all(axis=1)
        some = np.logical_or.reduceat(fine, mixture.starts())
        if not fine.all() and (outside := ~fine & some[mixture.owner]).any():
            # a component where the model has no value has no likelihood either
            mixture = mixture.take(~outside)
            continue
        # without any value a case ends as not a number, as with other filters
        stuck |= ~some
        heavy = mixture.weight >= _NOTABLE * mixture.heaviest()[mixture.owner]
        worst = np.maximum.reduceat(np.where(heavy, bend, 0.0), mixture.starts())
        left = 1.0 - done
        # curvature that stays is the same error in all powers: it counts with their sum
        bearable = curvature / np.maximum(worst, curvature) - done
        needed = np.minimum(_GROWTH * done, left)
        # the first power is free; a power that leaves less than rounding is the last one
        power = np.minimum(bearable, left)
        slow = (left > 0.0) & (power < needed) & ~stuck
        if stage == _STAGES - 1:
            stuck |= left > 0.0
            slow[:] = False
        if slow.any():
            due = bend * (done + needed)[mixture.owner] > curvature
            curved = heavy & slow[mixture.owner] & due
            which, full = _choose_splits(mixture, bend, curved, most)
            stuck |= full & slow
            if len(which):
                along = np.linalg.eigh(direction_matrix(expected.bent[which], n))[1][:, :, -1]
                mixture = mixture.split(which, along)
                continue
        power = np.where(stuck, left, power)
        # also of light components, which are never split
        excess = bend * np.where(left > 0.0, power, 0.0)[mixture.owner] > curvature
        if excess.any():
            repeated = np.where(excess, _REPEATED, 1.0)
            expected = replace(expected, bent=repeated[:, None, None] * expected.bent)
        mean_bend = np.bincount(mixture.owner, mixture.weight * bend)
        unresolved = np.maximum(unresolved, np.where(stuck & (left > 0.0), mean_bend, 0.0))
        mixture = _apply(mixture, expected, power, t_s, left > 0.0)
        done = np.where(power >= left, 1.0, done + power)
        mixture = mixture.drop_light()
        finished = done >= 1.0
        if finished.all():
            break
    return mixture.merge_close(_NEAR), unresolved


def expand_in_parts(mixture: Mixture, expand_at: ExpandedAt) -> WhitenedInnovation:
    """Return the innovations of all components, some thousand of them at a time.

    Parameters
    ----------
    mixture : Mixture
        M components of N cases.
    expand_at : callable
        Mixture → innovations of its components.
    """
    n, many = mixture.x.shape
    size = max(1, _POINTS // point_count(n))
    if many <= size:
        return expand_at(mixture)
    parts = []
    for first in range(0, many, size):
        own = slice(first, first + size)
        part = Mixture(
            mixture.owner[own], mixture.weight[own], mixture.x[:, own], mixture.root[own]
        )
        parts.append(expand_at(part))
    return WhitenedInnovation(
        np.concatenate([p.residual for p in parts]),
        np.concatenate([p.linear for p in parts]),
        np.concatenate([p.bent for p in parts]),
        np.concatenate([p.used for p in parts], axis=1),
    )


def _choose_splits(
    mixture: Mixture, bend: Array, curved: NDArray[np.bool_], most: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the components to split, as many as there is room for, and which cases have no room.

    Those with the largest product of weight and curvature come first.
    """
    room = (most - mixture.count) // 6
    order = np.lexsort((-(mixture.weight * bend), ~curved, mixture.owner))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - mixture.starts()[mixture.owner[order]]
    which = np.flatnonzero(curved & (rank < room[mixture.owner]))
    return which, room <= 0


def _apply(
    mixture: Mixture,
    expected: WhitenedInnovation,
    power: Array,
    t_s: Array,
    moving: NDArray[np.bool_],
) -> Mixture:
    """Return mixtures after a power (N,) of the likelihood, in the cases that move."""
    each = np.where(moving, power, 0.0)[mixture.owner]
    after = linear_update(mixture.lanes(t_s), expected, each, None)
    # ∫ N(z; 0, S) exp(−p |r − z|²/2) dz = |1 + p S|^−½ exp(−p rᵀ (1 + p S)⁻¹ r / 2)
    rows = np.concatenate([expected.linear, expected.bent], axis=1)
    scaled = each[:, None, None] * (np.swapaxes(rows, 1, 2) @ rows)
    m = scaled.shape[1]
    scaled[:, np.arange(m), np.arange(m)] += 1.0
    solved = np.linalg.solve(scaled, expected.residual[:, :, None])[:, :, 0]
    # of a case that is not a number the determinant is none either
    with np.errstate(invalid="ignore"):
        logdet = np.linalg.slogdet(scaled)[1]
    log = -0.5 * (logdet + each * np.sum(solved * expected.residual, axis=1))
    log += np.log(mixture.weight)
    log -= np.maximum.reduceat(log, mixture.starts())[mixture.owner]
    keep = (each > 0.0)[:, None, None]
    return Mixture(
        mixture.owner,
        np.maximum(np.exp(log), 1e-300),
        np.where(keep[:, 0, 0], after.x, mixture.x),
        np.where(keep, after.root, mixture.root),
    ).normalised()
