r"""Least squares over an arc of measurements, from one or several starts, for all cases at once.

The method is that of Levenberg and Marquardt. With the rows A and residuals b of prior and
measurements, in units of their noise, a step d solves

.. math:: \min_d\; |A d - b|^2 + \lambda |D d|^2,

D the lengths of the columns of A. λ is divided by 10 after a step that reduces the sum of squares
and multiplied by 10 after one that does not, case by case [1]_. The unknowns are z with x = x̄ + S
z, x̄ and S mean and root of the prior: a damped step then does not move what the prior knows well.
The rows enter by QR decomposition, and the normal equations are never formed. The sum of squares
may have several minima, as with angles that leave the distance open; it is minimised from several
starts, and the least of the results is taken.

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
from hillsphere_estimators.innovations import require_independent, usable
from hillsphere_estimators.orbit_refinement.motion import BodiesModel
from hillsphere_estimators.roots import lower_root, upper_triangle

__all__ = ["ArcFit", "ArcRows", "arc_fit", "arc_rows", "prior_rows", "select_starts"]

_CONVERGED = 1e-2
"""Length of the last step, in standard deviations, below which a fit has converged. A longer limit
would leave an error that the covariance does not state; at a shorter one rounding may decide which
of two sums of squares is less, and a converged fit would be reported as not converged."""


@dataclass(frozen=True)
class ArcRows:
    """The measurements of an arc linearised about states at its start, in units of the noise.

    Parameters
    ----------
    slopes : ndarray, shape (N, K, m, n)
        Derivatives of the measurements by z at the start.
    residual : ndarray, shape (N, K, m)
        Measured minus predicted.
    path : ndarray, shape (n, K, N)
        States along the arc.
    phi : ndarray, shape (N, K, n, n)
        Their derivatives by z.
    """

    slopes: Array
    residual: Array
    path: Array
    phi: Array

    def flat(self) -> Array:
        """Return derivatives and residuals as rows of one matrix (N, K · m, n + 1)."""
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
        States at the start, given all measurements.
    squares : ndarray, shape (N,)
        Sum of the squared residuals, with those of the prior, in units of their noise.
    rows : ndarray, shape (N,)
        Number of measured values.
    settled : ndarray of bool, shape (N,)
        Whether the last step was shorter than a hundredth of a standard deviation.
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
        Motion and sensors; its process noise is not used.
    prior : Belief
        States (n, N) at the first time; wide where little is known.
    sets : sequence of MeasurementSet
        At K times, in order.
    starts : ndarray, shape (n, S, N), optional
        States from which the search starts; by default the prior's means.
    rounds : int
        Steps at most.
    farthest : float
        Largest distance of the states from the prior's means, in its standard deviations. A
        linearisation far from the truth may otherwise lead to states without an orbit.

    Returns
    -------
    ArcFit
        For each case that of the start with the least sum of squares.
    """
    require_independent(sets, "a fit of an arc")
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
    # a small λ at first: nearly a Gauss-Newton step, which is right if the start is good
    damping = np.full(x.shape[1], 1e-6)
    settled = np.zeros(x.shape[1], dtype=bool)
    for _ in range(rounds):
        step = _solve_damped(upper, damping)
        # |U d|: length of the step in standard deviations of the fit
        length = np.linalg.norm(upper[:, :n, :n] @ step[:, :, None], axis=(1, 2))
        there = np.where(
            settled, x, x + _state_change(prior, _limit_step(prior, x, step, farthest))
        )
        new, reached = _problem(model, prior, there, sets)
        better = (reached <= squares) & ~settled
        # converged although the sum may have risen: so close to the minimum rounding decides which
        # sum is less. A strongly damped step is short anywhere and proves nothing.
        settled |= (length < _CONVERGED) & (damping < 1.0)
        x = np.where(better, there, x)
        upper = np.where(better[:, None, None], new, upper)
        squares = np.where(better, reached, squares)
        damping = np.clip(np.where(better, 0.1 * damping, 10.0 * damping), 1e-18, 1e12)
        if settled.all():
            break
    # covariance of z is U⁻¹ U⁻ᵀ, that of the states S U⁻¹ U⁻ᵀ Sᵀ
    root = prior.root @ np.linalg.inv(upper[:, :n, :n])
    fits = Belief(x, lower_root(np.swapaxes(root, 1, 2)), prior.t_s)
    best = np.argmin(squares.reshape(tries, cases), axis=0) * cases + np.arange(cases)
    rows = sum(usable(m)[1].sum(axis=0) for m in sets)
    return ArcFit(
        Belief(fits.x[:, best], fits.root[best], fits.t_s[best]),
        squares[best],
        np.asarray(rows, dtype=float)[best],
        settled[best],
    )


def select_starts(model: BodiesModel, measured: MeasurementSet, starts: Array, keep: int) -> Array:
    """Return the starts that fit the measurements of the first time best.

    Parameters
    ----------
    model : BodiesModel
        Sensors.
    measured : MeasurementSet
        At the first time.
    starts : ndarray, shape (n, S, N)
        States.
    keep : int
        Number of starts that are kept for each case.

    Returns
    -------
    ndarray, shape (n, keep, N)
        In rising order of the sum of squared residuals.
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
    """Return the rows (N, n, n + 1) of the prior about x (n, N): 1 and S⁻¹ (x̄ − x)."""
    off = np.linalg.solve(prior.root, (prior.x - x).T[:, :, None])
    one = np.broadcast_to(np.eye(len(x)), prior.root.shape)
    return np.concatenate([one, off], axis=2)


def arc_rows(model: BodiesModel, x: Array, sets: Sequence[MeasurementSet], root: Array) -> ArcRows:
    """Linearise the measurements of an arc about states at its start.

    Parameters
    ----------
    model : BodiesModel
        Motion and sensors.
    x : ndarray, shape (n, N)
        States at the start.
    sets : sequence of MeasurementSet
        At K times.
    root : ndarray, shape (N, n, n)
        S of the prior: derivatives are by z.

    Returns
    -------
    ArcRows
        Rows that were not measured are zero.
    """
    require_independent(sets, "a fit of an arc")
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
    """Return the triangle (N, n + 1, n + 1) of all rows about x, and the sum of squares (N,)."""
    rows = arc_rows(model, x, sets, prior.root).flat()
    every = np.concatenate([prior_rows(prior, x), rows], axis=1)
    return upper_triangle(every), np.sum(every[:, :, -1] ** 2, axis=1)


def _solve_damped(upper: Array, damping: Array) -> Array:
    """Return the damped steps (N, n) of z.

    The damping is n more rows √λ D below the triangle.
    """
    n = upper.shape[1] - 1
    size = np.linalg.norm(upper[:, :, :n], axis=1)
    held = np.zeros((len(upper), n, n + 1))
    held[:, np.arange(n), np.arange(n)] = np.sqrt(damping)[:, None] * size
    solved = upper_triangle(np.concatenate([upper, held], axis=1))
    return np.asarray(np.linalg.solve(solved[:, :n, :n], solved[:, :n, n:])[:, :, 0])


def _state_change(prior: Belief, step: Array) -> Array:
    """Return the change S d of the states (n, N) by a step d (N, n) of z."""
    return np.asarray((prior.root @ step[:, :, None])[:, :, 0].T)


def _limit_step(prior: Belief, x: Array, step: Array, farthest: float) -> Array:
    """Return steps (N, n) of z shortened to the largest distance from the prior's means."""
    if not np.isfinite(farthest):
        return step
    z = np.linalg.solve(prior.root, (x - prior.x).T[:, :, None])[:, :, 0]
    a, b = np.sum(step * step, axis=1), np.sum(z * step, axis=1)
    # |z + s d|² = f² is s² a + 2 s b − c = 0; the positive root in the form without cancellation
    c = np.maximum(farthest**2 - np.sum(z * z, axis=1), 0.0)
    share = c / np.maximum(b + np.sqrt(b * b + a * c), 1e-300)
    return np.asarray(step * np.minimum(1.0, share)[:, None])
