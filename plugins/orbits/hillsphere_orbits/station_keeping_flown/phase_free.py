r"""Gains by phase, independent of time: target points and linear-quadratic regulator.

A deviation :math:`\delta` is taken from the nearest point of the orbit, so that it is orthogonal to
the rate f of the orbit there. With the projector :math:`\Pi = 1 - f f^T/|f|^2` (over positions and
velocities, natural units) and :math:`A(\tau) = \Phi(\tau + T, \tau)` it goes over an interval T as

.. math:: \delta^+ = \Pi(\tau + T)\, A(\tau)\, (\delta + B\,\Delta v).

What lies along the orbit is a change of phase. It is neither weighed nor corrected, and where the
flight is at the next correction, the next nearest point says [1]_.

References
----------
.. [1] J. Hauser, C. C. Chung (1994), Converse Lyapunov functions for exponentially stable periodic
   orbits, Systems & Control Letters 23, p. 27: transverse coordinates of an orbit.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.station_keeping_flown.reference_path import ReferencePath

if TYPE_CHECKING:
    from hillsphere_orbits.station_keeping_flown.sampling import Sampling, Weights

__all__ = ["PhaseGains", "phase_free_lqr_gains", "phase_free_target_point_gains"]

_SPACING = 0.08
"""Largest distance of the phases at which gains are computed, natural units: some sixty in one
revolution, so that lines between them are right to half a percent."""
_SWEEPS = 300
"""Most steps of the Riccati iteration, one interval each. It converges as fast as the closed loop
damps deviations; a law that needs more than these is taken as it is then."""
_CONVERGED = 1e-6
"""Relative change of the cost matrix; the errors of an impulse are a hundredth of it."""


@dataclass(frozen=True, eq=False)
class PhaseGains:
    """Gains at phases of a path, with linear interpolation between them.

    Parameters
    ----------
    t : ndarray, shape (M,)
        Phases, rising from zero, natural units.
    gains : ndarray, shape (M, 3, 6)
        From deviations to impulses, normalised; Δv = -G δ.
    period : float or None
        Of a periodic path: after the last phase comes the first again.
    """

    t: Array
    gains: Array
    period: float | None

    def __call__(self, t: Array) -> Array:
        """Return the gains (3, 6, K) at phases (K,)."""
        left, right, part = _between(self.t, self.period, t)
        part = part[:, None, None]
        gains = (1.0 - part) * self.gains[left] + part * self.gains[right]
        return np.ascontiguousarray(np.moveaxis(gains, 0, 2))


def phase_free_target_point_gains(sampling: Sampling, weights: Weights) -> PhaseGains:
    r"""Return gains that make a weighted sum of deviations from the orbit at later times least.

    As `target_point_gains`, with the positions' rows of the projected deviations
    :math:`\Pi(\tau + iT)\,\Phi(\tau + iT, \tau)\,(\delta + B\,\Delta v)`.

    Parameters
    ----------
    sampling : Sampling
        The reference and the interval T.
    weights : Weights
        Tolerable deviation and impulse, and the targets i.

    Returns
    -------
    PhaseGains
        By phase.
    """
    last = max(weights.targets)
    grid = _grid(sampling, last)
    count, m = grid.count, grid.per_interval
    rows = [np.zeros((count, 3, 6))]
    total = np.broadcast_to(np.eye(6), (count, 6, 6))
    for i in range(1, last + 1):
        # Φ(τ + iT, τ), built up interval by interval
        total = grid.transitions[(i - 1) * m : (i - 1) * m + count] @ total
        if i in weights.targets:
            across = grid.projectors[i * m : i * m + count] @ total
            rows.append(across[:, :3] / weights.position)
    seen = np.concatenate(rows, axis=1)
    by_impulse = seen[:, :, 3:].copy()
    # the first three rows penalise the impulse itself
    by_impulse[:, :3] = np.eye(3) / weights.impulse
    # least squares by the pseudo-inverse: Δv = −G δ minimises the weighted sum of squares
    gains = np.linalg.pinv(by_impulse) @ seen @ grid.projectors[:count]
    return PhaseGains(grid.t[:count], gains, sampling.path.period)


def phase_free_lqr_gains(sampling: Sampling, weights: Weights) -> PhaseGains:
    r"""Return gains of the linear-quadratic regulator of the deviation across the orbit.

    The cost matrix P is a function of the phase, :math:`P(\tau) = \Pi Q \Pi + \dots P(\tau + T)`
    as in the Riccati recursion of `periodic_lqr_gains`. On a periodic orbit, of whose period T need
    be no part, it is iterated to its fixed point at all phases at once, with lines between them
    (which keep it positive); on a path that ends, it runs backwards from there.

    Parameters
    ----------
    sampling : Sampling
        The reference and the interval T.
    weights : Weights
        Tolerable deviations and impulse.

    Returns
    -------
    PhaseGains
        By phase.
    """
    grid = _grid(sampling, 1)
    count, m, period = grid.count, grid.per_interval, sampling.path.period
    across = grid.projectors[:count]
    # transition of the deviation across the orbit: its part along the orbit is projected out
    steps = grid.projectors[m : m + count] @ grid.transitions[:count]
    size = np.diag(np.repeat([weights.position, weights.velocity], 3) ** -2.0)
    q, r = across @ size @ across, np.eye(3) / weights.impulse**2
    gains, cost = np.zeros((count, 3, 6)), q.copy()
    if period is None:
        for end in range(count, 0, -m):
            here = slice(max(end - m, 0), end)
            then = np.minimum(np.arange(here.start, end) + m, count - 1)
            gains[here], cost[here] = _riccati(steps[here], q[here], r, cost[then])
    else:
        left, right, part = _between(grid.t[:count], period, grid.t[:count] + sampling.interval)
        part = part[:, None, None]
        for _ in range(_SWEEPS):
            before = cost
            ahead = (1.0 - part) * cost[left] + part * cost[right]
            gains, cost = _riccati(steps, q, r, ahead)
            if np.max(np.abs(cost - before)) <= _CONVERGED * np.max(np.abs(cost)):
                break
    return PhaseGains(grid.t[:count], gains @ across, period)


def _riccati(steps: Array, q: Array, r: Array, ahead: Array) -> tuple[Array, Array]:
    """Return gains (K, 3, 6) and cost matrices (K, 6, 6) one interval before those `ahead`."""
    cost = np.swapaxes(steps, 1, 2) @ ahead @ steps  # of the state after the impulse
    # G = (R + BᵀPB)⁻¹ BᵀP with B = [0; I]
    gains = np.asarray(np.linalg.solve(r + cost[:, 3:, 3:], cost[:, 3:]), dtype=float)
    # Joseph's form: a sum of squares, which stays positive
    kept = np.repeat(np.eye(6)[None], len(steps), axis=0)
    kept[:, 3:] -= gains
    total = q + np.swapaxes(gains, 1, 2) @ r @ gains + np.swapaxes(kept, 1, 2) @ cost @ kept
    return np.asarray(gains), np.asarray(0.5 * (total + np.swapaxes(total, 1, 2)))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Phases a whole part of the interval apart, from zero to some intervals beyond the path.

    `count` of them lie on the path; an interval is `per_interval` of them. `transitions` (over one
    interval) begin at all but the last interval's, projectors are at all.
    """

    t: Array
    count: int
    per_interval: int
    transitions: Array
    projectors: Array


def _grid(sampling: Sampling, beyond: int) -> _Grid:
    path, interval = sampling.path, sampling.interval
    m = max(1, ceil(interval / _SPACING))
    step = interval / m
    end = path.length if path.period is None else path.period
    count = max(1, ceil(end / step))
    t = step * np.arange(count + beyond * m, dtype=float)
    phi = path.transitions(t[:-1], step)[:6, :6]
    each = np.ascontiguousarray(np.moveaxis(phi, 2, 0))
    return _Grid(t, count, m, _products(each, m), _projectors(path, t))


def _products(each: Array, m: int) -> Array:
    """Return the products of every m consecutive matrices (K, 6, 6), later ones on the left."""
    power, done, total = each, 0, None
    length = 1
    while m:
        # binary exponentiation over a sliding window: log₂ m products instead of m
        if m & 1:
            if total is None:
                total = power
            else:
                later = power[done:]
                size = min(len(later), len(total))
                total = later[:size] @ total[:size]
            done += length
        m >>= 1
        if m:
            power = power[length:] @ power[:-length]
            length *= 2
    assert total is not None
    return total


def _projectors(path: ReferencePath, t: Array) -> Array:
    """Return Π (K, 6, 6) at times (K,)."""
    # Π = I − f fᵀ/|f|²: projects on the deviations across the direction of motion
    f = path.flow.rate(path.states(t))[:6]
    f = f / np.linalg.norm(f, axis=0)
    return np.asarray(np.eye(6) - np.einsum("iK,jK->Kij", f, f))


def _between(
    t: Array, period: float | None, at: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array]:
    """Return the phases on either side of given ones (K,), and how far between them they are."""
    if period is None:
        here = np.clip(at, t[0], t[-1])
        left = np.clip(np.searchsorted(t, here, side="right") - 1, 0, max(t.size - 2, 0))
        right = np.minimum(left + 1, t.size - 1)
        width = np.where(right > left, t[right] - t[left], 1.0)
    else:
        here = np.mod(at, period)
        left = np.clip(np.searchsorted(t, here, side="right") - 1, 0, t.size - 1)
        right = (left + 1) % t.size
        width = np.where(right > left, t[right], period) - t[left]
    return left, right, (here - t[left]) / width
