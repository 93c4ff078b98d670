"""Orbits of many revolutions over half a period, each with sub-steps of its own.

Orbits of 17 and of 27 revolutions, or near the body and far from it, need different numbers of
sub-steps. Here every lane has its own, which neither depends on nor changes its neighbours'.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.shooting import SymmetricShooting
from hillsphere_orbits.stability import monodromy_of_half

__all__ = ["MIRRORS", "SpatialShooting", "ends", "sub_steps"]

MIRRORS = {
    "position": (1, -1, 1, -1, 1, -1),
    "velocity": (1, -1, -1, -1, 1, 1),
    "y_position": (-1, 1, 1, 1, -1, -1),
}
"""Signs of x, y, z, vx, vy, vz under the time reversal that orbits of a start keep.

"position" starts on the plane xz with z ≠ 0, "velocity" on the x axis with ż ≠ 0, "y_position" on
the plane yz with z ≠ 0.
"""

_WIDTH = 8  # lanes per SIMD call; the lanes of a remainder cost as much each
_ORDER = 8.0  # of the step map's formula
_MOST = 100_000
"""Most sub-steps of half a period: beyond these an orbit takes seconds and gains no digit."""


@dataclass(frozen=True)
class SpatialShooting:
    """Half-period problem in which each of N lanes has a number of sub-steps.

    Parameters
    ----------
    flow : Flow
        States x, y, z, vx, vy, vz.
    start : str
        Key of `MIRRORS`.
    counts : ndarray of int, shape (N,)
        Sub-steps of each lane's half-period.
    """

    flow: Flow
    start: str
    counts: NDArray[np.int64]

    @cached_property
    def _common(self) -> SymmetricShooting:
        return SymmetricShooting(self.flow, MIRRORS[self.start])

    @property
    def mirror(self) -> tuple[int, ...]:
        """Diagonal of the time reversal."""
        return MIRRORS[self.start]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the three free states, then ``half_period``."""
        return self._common.unknowns

    @property
    def kernel(self) -> int:
        """Number of the unknown that leads out of the plane."""
        return self.unknowns.index("vz" if self.start == "velocity" else "z")

    @property
    def steps(self) -> int:
        """Largest number of sub-steps."""
        return int(np.max(self.counts))

    def of(self, lanes: NDArray[np.intp]) -> SpatialShooting:
        """Return the problem of some of the lanes."""
        return replace(self, counts=self.counts[lanes])

    def with_counts(self, counts: NDArray[np.int64]) -> SpatialShooting:
        """Return the same problem with other sub-steps (N,)."""
        return replace(self, counts=np.asarray(counts, dtype=np.int64))

    def with_steps(self, steps: int) -> SpatialShooting:
        """Return the same problem with one number of sub-steps for all lanes."""
        return replace(self, counts=np.full_like(self.counts, steps))

    def state(self, z: Array) -> Array:
        """Return the initial states (6, N)."""
        return self._common.state(z)

    def period(self, z: Array) -> Array:
        """Return the full periods (N,)."""
        return self._common.period(z)

    def unknowns_at(self, x: Array, period: Array) -> Array:
        """Return z for initial states (6, N) and full periods (N,)."""
        return self._common.unknowns_at(x, period)

    def fly(self, x: Array, duration: Array) -> tuple[Array, Array]:
        """Return states (6, N) after the durations (N,) in `counts` steps, and matrices (6, 6, N).

        Lanes fly in step until those with the fewest sub-steps have arrived, and so on. A lane that
        leaves the domain of the equations is NaN.
        """
        end, phi = x.copy(), np.repeat(np.eye(len(x))[:, :, None], x.shape[1], axis=2)
        h, flown = duration / self.counts, 0
        for count in np.unique(self.counts):
            lanes = np.flatnonzero(self.counts >= count)
            wide = _pad_lanes(lanes)
            legs = int(count) - flown
            begin, lost = _finite(end[:, wide])
            y, m = self.flow.map.propagate(begin, h[wide] * legs, legs, strict=False)
            y[:, lost] = np.nan
            end[:, lanes] = y[:, : lanes.size]
            m = m[:, :, : lanes.size]
            phi[:, :, lanes] = np.einsum("ijk,jlk->ilk", m, phi[:, :, lanes]) if flown else m
            flown = int(count)
        return end, phi

    def evaluate(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """Return F (3, N), dF/dz (3, 4, N), and states and matrices after half a period."""
        end, phi = self.fly(self.state(z), z[-1])
        return *self.conditions(z, end, phi), end, phi

    def conditions(self, z: Array, end: Array, phi: Array) -> tuple[Array, Array]:
        """Return F and dF/dz from the states and matrices after half a period."""
        return self._common.conditions(self.state(z), end, phi, self.flow.rate(end))

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return the states with sign −1 at half the period, and their exact derivatives."""
        values, slopes, _, _ = self.evaluate(z)
        return values, slopes

    def monodromy(self, z: Array) -> Array:
        """Return M (6, 6, N) = S M_h⁻¹ S M_h, from the half-period's matrix M_h."""
        return monodromy_of_half(self.fly(self.state(z), z[-1])[1], self.mirror)

    def path(self, z: Array, steps: int | None = None) -> Array:
        """Return the states (6, K + 1, N) along half a period, not finite where it fails."""
        wide = _pad_lanes(np.arange(z.shape[1]))
        way = self.flow.plain.trajectory(
            np.ascontiguousarray(self.state(z)[:, wide]),
            z[-1, wide],
            steps or self.steps,
            strict=False,
        )
        return np.asarray(way[:, :, : z.shape[1]])


def sub_steps(
    problem: SpatialShooting, z: Array, tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Find sub-steps of each lane that meet a tolerance, by step doubling.

    Parameters
    ----------
    problem : SpatialShooting
        With the numbers to begin with.
    z : ndarray, shape (4, N)
        Orbits.
    tolerance : float
        Largest difference between the states after half a period in `counts` steps and in twice
        as many; or rounding, where that is more.

    Returns
    -------
    counts : ndarray of int, shape (N,)
        Sub-steps.
    converged : ndarray of bool, shape (N,)
        Whether they meet the tolerance.
    """
    counts = problem.counts.copy()
    converged = np.zeros(counts.size, dtype=bool)
    best = np.full(counts.size, np.inf)
    stalled = np.zeros(counts.size, dtype=int)
    todo = np.arange(counts.size)
    while todo.size:
        coarse = ends(problem, z[:, todo], counts[todo])
        fine = ends(problem, z[:, todo], 2 * counts[todo])
        error = np.max(np.abs(coarse - fine), axis=0)
        error = np.where(np.isfinite(error), error, np.inf)
        converged[todo] = error <= tolerance
        # a difference that no longer shrinks is rounding: more steps cannot better it
        stalled[todo] += error > 0.5 * best[todo]
        best[todo] = np.minimum(best[todo], error)
        # error ∝ steps⁻⁸: factor by which the steps must grow to meet the tolerance
        growth = np.where(np.isfinite(error), (error / tolerance) ** (1.0 / _ORDER), 2.0)
        # 5 % of margin; at most fourfold, since a large error is not yet asymptotic
        raised = np.ceil(counts[todo] * np.clip(1.05 * growth, 1.02, 4.0)).astype(np.int64)
        again = ~converged[todo] & (stalled[todo] < 2) & (raised <= _MOST)
        counts[todo[again]] = raised[again]
        todo = todo[again]
    return counts, converged


def ends(problem: SpatialShooting, z: Array, counts: NDArray[np.int64]) -> Array:
    """Return the states (6, N) after half a period in `counts` steps, without matrices."""
    end, h, flown = problem.state(z), z[-1] / counts, 0
    for count in np.unique(counts):
        lanes = np.flatnonzero(counts >= count)
        wide, legs = _pad_lanes(lanes), int(count) - flown
        begin, lost = _finite(end[:, wide])
        y = problem.flow.plain.propagate(begin, h[wide] * legs, legs, strict=False)
        y[:, lost] = np.nan
        end[:, lanes] = y[:, : lanes.size]
        flown = int(count)
    return end


def _finite(x: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return contiguous states, ones for a lane that is not finite, and which lanes are not."""
    lost = np.asarray(~np.isfinite(x).all(axis=0))
    return np.ascontiguousarray(np.where(lost, 1.0, x)), lost


def _pad_lanes(lanes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Repeat the last lane until the number of lanes is a whole multiple of the width."""
    if lanes.size <= 2:
        return lanes
    return np.concatenate([lanes, np.full(-lanes.size % _WIDTH, lanes[-1])])
