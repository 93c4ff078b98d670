r"""Least squares over an arc of measurements, from one or many starts, all cases at once.

Levenberg's and Marquardt's method: of the whitened rows A and residuals b of prior and
measurements, steps d solve

.. math:: \min_d\; |A d - b|^2 + \lambda |D d|^2,

D the lengths of the columns of A; λ falls after a step that lessens the sum of squares and rises
after one that does not, in each lane by itself [1]_. States are counted from the prior's means in
its own root, x = x̄ + S z, so that no damped step leaves what is known well for what is not; the
rows enter by orthogonal triangularisation, and normal equations are never formed. Where the sum has
several minima, as with angles that leave the distance open, it is solved from several starts and
the least is taken.

References
----------
.. [1] Nocedal, Wright (2006), Numerical optimization, 2nd ed., section 10.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.orbit_refinement.motion import BodiesModel
from hillsphere_estimators.roots import lower_root, upper_triangle

__all__ = ["ArcFit", "ArcRows", "arc_fit", "arc_rows", "prior_rows", "select_starts"]

_CONVERGED = 1e-2
"""Length of the last step, in standard deviations, below which a fit has converged. A longer limit
would leave an error that the covariance does not state; at a shorter one rounding may decide which
of two sums of squares is less, and a converged fit would be reported as not converged."""


@dataclass(frozen=True)
class ArcRows:
    """An arc linearised about states at its start, in units of the noise.

    Parameters
    ----------
    slopes : ndarray, shape (N, K, m, n)
        By z at the start.
    residual : ndarray, shape (N, K, m)
        Measured minus shown.
    path : ndarray, shape (n, K, N)
        States.
    phi : ndarray, shape (N, K, n, n)
        Their derivatives by z.
    """

    slopes: Array
    residual: Array
    path: Array
    phi: Array

    def flat(self) -> Array:
        """Return slopes beside residuals (N, K m, n + 1)."""
        cases, n = len(self.slopes), self.slopes.shape[-1]
        return np.concatenate(
            [self.slopes.reshape(cases, -1, n), self.residual.reshape(cases, -1, 1)], axis=2
        )


@dataclass(frozen=True)
class ArcFit:
    """The best fit of each case.

    Parameters
    ----------
    belief : Belief
        Of the states at the start.
    squares : ndarray, shape (N,)
        Sum of the squared residuals in units of their noise, the prior's with them.
    rows : ndarray, shape (N,)
        How many values were measured.
    settled : ndarray of bool, shape (N,)
        Where the last step was shorter than a hundredth of a standard deviation.
    """

    belief: Belief
    squares: Array
    rows: Array
    settled: NDArray[np.bool_]


def arc_fit(
    model: BodiesModel,
    prior: Belief,
    sets: Sequence[MeasurementSet],
    starts: Array | None = None,
    *,
    rounds: int = 60,
    farthest: float = np.inf,
) -> ArcFit:
    """Fit the states at the start of an arc.

    Parameters
    ----------
    model : BodiesModel
        Motion and sensors; its noise is not used.
    prior : Belief
        Of the states (n, N) at the first time; wide where little is known.
    sets : sequence of MeasurementSet
        At K times, in order.
    starts : ndarray, shape (n, S, N), optional
        States to begin from; left out: the prior's means.
    rounds : int
        Steps at most.
    farthest : float
        No step leads farther from the prior's means, in its standard deviations: linearised far
        from the truth, one may point to where there is no orbit.

    Returns
    -------
    ArcFit
        For each case from the best of its starts.
    """
    n, cases = prior.x.shape
    begun = prior.x[:, None] if starts is None else starts
    tries = begun.shape[1]
    if tries > 1:
        model = model.beside(tries)
        prior = Belief(
            np.tile(prior.x, tries), np.tile(prior.root, (tries, 1, 1)), np.tile(prior.t_s, tries)
        )
        sets = [
            MeasurementSet(
                np.tile(m.t_s, tries), np.tile(m.values, tries), np.tile(m.sigma, tries),
                m.blocks, np.tile(m.present, tries),
            )
            for m in sets
        ]  # fmt: skip
    x = np.ascontiguousarray(begun.reshape(n, -1))
    upper, squares = _problem(model, prior, x, sets)
    damping = np.full(x.shape[1], 1e-6)
    settled = np.zeros(x.shape[1], dtype=bool)
    for _ in range(rounds):
        step = _solve_damped(upper, damping)
        length = np.linalg.norm(upper[:, :n, :n] @ step[:, :, None], axis=(1, 2))
        there = np.where(
            settled, x, x + _state_change(prior, _limit_step(prior, x, step, farthest))
        )
        new, reached = _problem(model, prior, there, sets)
        better = (reached <= squares) & ~settled
        # below a hundredth of a standard deviation rounding may decide which sum is less
        settled |= (length < _CONVERGED) & (damping < 1.0)
        x = np.where(better, there, x)
        upper = np.where(better[:, None, None], new, upper)
        squares = np.where(better, reached, squares)
        damping = np.clip(np.where(better, 0.1 * damping, 10.0 * damping), 1e-18, 1e12)
        if settled.all():
            break
    root = prior.root @ np.linalg.inv(upper[:, :n, :n])
    found = Belief(x, lower_root(np.swapaxes(root, 1, 2)), prior.t_s)
    best = np.argmin(squares.reshape(tries, cases), axis=0) * cases + np.arange(cases)
    rows = sum(usable(m)[1].sum(axis=0) for m in sets)
    return ArcFit(
        Belief(found.x[:, best], found.root[best], found.t_s[best]),
        squares[best],
        np.asarray(rows, dtype=float)[best],
        settled[best],
    )


def select_starts(model: BodiesModel, measured: MeasurementSet, starts: Array, keep: int) -> Array:
    """Return those of many starts that fit the measurements of the first time best.

    Parameters
    ----------
    model : BodiesModel
        What sensors show.
    measured : MeasurementSet
        At the first time.
    starts : ndarray, shape (n, S, N)
        States.
    keep : int
        How many are wanted of each case.

    Returns
    -------
    ndarray, shape (n, keep, N)
        By the sum of squared residuals, the least first.
    """
    n, tries, cases = starts.shape
    layout, used = usable(measured)
    shown = model.beside(tries).observe(
        np.ascontiguousarray(starts.reshape(n, -1)), np.tile(measured.t_s, tries),
        np.arange(tries * cases),
    ).reshape(-1, tries, cases)  # fmt: skip
    values = np.where(used, measured.values, 0.0)[:, None]
    off = layout.difference(values, shown) / np.where(used, measured.sigma, 1.0)[:, None]
    order = np.argsort(np.sum(np.where(used[:, None], off, 0.0) ** 2, axis=0), axis=0)[:keep]
    return np.take_along_axis(starts, order[None], axis=1)


def prior_rows(prior: Belief, x: Array) -> Array:
    """Return the prior's rows (N, n, n + 1) about x (n, N), by z."""
    off = np.linalg.solve(prior.root, (prior.x - x).T[:, :, None])
    one = np.broadcast_to(np.eye(len(x)), prior.root.shape)
    return np.concatenate([one, off], axis=2)


def arc_rows(model: BodiesModel, x: Array, sets: Sequence[MeasurementSet], root: Array) -> ArcRows:
    """Linearise an arc about states at its start.

    Parameters
    ----------
    model : BodiesModel
        Motion and sensors.
    x : ndarray, shape (n, N)
        States at the start.
    sets : sequence of MeasurementSet
        At K times.
    root : ndarray, shape (N, n, n)
        S of the prior, by whose columns derivatives are taken.

    Returns
    -------
    ArcRows
        Rows that were not measured are zero.
    """
    layout, _ = usable(sets[0])
    times = np.array([m.t_s[0] for m in sets])
    path, phi = model.path(x, times)
    phi = phi @ root[:, None]
    values = np.stack([m.values for m in sets], axis=1)
    present = np.stack([m.present for m in sets], axis=1)
    sigma = np.stack([m.sigma for m in sets], axis=1)
    shown, slopes = model.along(path, times, present)
    residual = layout.difference(np.where(present, values, shown), shown)
    used = present & layout.real[:, None, None]
    weight = np.where(used, 1.0 / np.where(used, sigma, 1.0), 0.0)
    m, count, cases = values.shape
    n = len(x)
    flat = layout.tangent(
        slopes.reshape(m, n, count * cases).transpose(2, 0, 1), shown.reshape(m, -1)
    ).reshape(count, cases, m, n)  # fmt: skip
    white = flat.transpose(1, 0, 2, 3) * weight.transpose(2, 1, 0)[:, :, :, None]
    return ArcRows(white @ phi, (residual * weight).transpose(2, 1, 0), path, phi)


def _problem(
    model: BodiesModel, prior: Belief, x: Array, sets: Sequence[MeasurementSet]
) -> tuple[Array, Array]:
    """Return the triangle (N, n + 1, n + 1) of all rows about x, and the sum of squares."""
    rows = arc_rows(model, x, sets, prior.root).flat()
    every = np.concatenate([prior_rows(prior, x), rows], axis=1)
    return upper_triangle(every), np.sum(every[:, :, -1] ** 2, axis=1)


def _solve_damped(upper: Array, damping: Array) -> Array:
    """Return the damped steps (N, n) of z."""
    n = upper.shape[1] - 1
    size = np.linalg.norm(upper[:, :, :n], axis=1)
    held = np.zeros((len(upper), n, n + 1))
    held[:, np.arange(n), np.arange(n)] = np.sqrt(damping)[:, None] * size
    solved = upper_triangle(np.concatenate([upper, held], axis=1))
    return np.asarray(np.linalg.solve(solved[:, :n, :n], solved[:, :n, n:])[:, :, 0])


def _state_change(prior: Belief, step: Array) -> Array:
    """Return the change of the states (n, N) of one of z (N, n)."""
    return np.asarray((prior.root @ step[:, :, None])[:, :, 0].T)


def _limit_step(prior: Belief, x: Array, step: Array, farthest: float) -> Array:
    """Return steps (N, n) of z that lead no farther from the prior's means than is allowed."""
    if not np.isfinite(farthest):
        return step
    z = np.linalg.solve(prior.root, (x - prior.x).T[:, :, None])[:, :, 0]
    a, b = np.sum(step * step, axis=1), np.sum(z * step, axis=1)
    c = np.maximum(farthest**2 - np.sum(z * z, axis=1), 0.0)
    share = c / np.maximum(b + np.sqrt(b * b + a * c), 1e-300)
    return np.asarray(step * np.minimum(1.0, share)[:, None])
