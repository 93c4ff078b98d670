"""Checks while families in space are followed: sub-steps, surface, amplitude."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.shooting import SpatialShooting, ends

__all__ = ["BIRTH", "FOLLOWED", "HALF", "SENSITIVE", "Following", "clearance", "height"]

BIRTH = 0.01
"""z or ż, natural units, of the first member: beyond it the kernel's plane is left."""

FOLLOWED = 1e-6
"""Error of half a period while following; returned orbits are corrected further."""

HALF = 1e-10
"""Largest half-period residual by the other integrator of any returned orbit."""

_APART = 1e-7  # of two orbits by which the growth of errors is judged
_ROUNDING = np.finfo(float).eps  # of the largest state: it cannot be known better
_BETWEEN = np.array([0.0, 0.25, 0.5, 0.75])  # of a sub-step, where the surface is looked for

SURFACE = "the next orbit meets the surface"
ASKED = "the amplitude asked for"
PLANE = "the family returns to the plane"
LOST = "the next orbit cannot be propagated"
SENSITIVE = "half a period magnifies errors too much for double precision beyond"


def height(problem: SpatialShooting, z: Array) -> Array:
    """Return the amplitude (N,) of members: z at the start, or the largest |z|."""
    if problem.start == "position":
        return np.asarray(z[problem.unknowns.index("z")])
    if not z.shape[1]:
        return np.empty(0)
    # both halves are each other's mirror image
    return _highest(problem, z, problem.path(z))


def _highest(problem: SpatialShooting, z: Array, way: Array) -> Array:
    flow = problem.flow
    lane = np.arange(z.shape[1])
    top = np.argmax(np.abs(way[2]), axis=0)
    here = base = way[:, top, lane]
    h = np.zeros(z.shape[1])
    for _ in range(6):
        # Newton's iteration for ż = 0 at the highest sample
        h = h - here[5] / flow.rate(here)[5]
        here = flow.at_once(base, h)
    return np.asarray(np.abs(here[2]))


class Following:
    """Equations of families that are followed, and when they end.

    The error of each new member is measured, and its family gets more sub-steps where it has grown.
    So is what half a period makes of a small error: where it makes more of rounding than `HALF`, no
    other integrator would confirm the orbits beyond.

    Parameters
    ----------
    problem : SpatialShooting
        With the sub-steps to begin with.
    z_max : float
        Amplitude at which to end, normalised.
    tick : callable
        Called with the number of families that have ended since the last time.
    """

    def __init__(self, problem: SpatialShooting, z_max: float, tick: Callable[[int], None]) -> None:
        system = problem.flow.system
        self.problem, self.z_max, self.tick = problem, z_max, tick
        self.dropped: set[int] = set()
        self._impact = (
            system.function(system.events["impact"]) if "impact" in system.events else None
        )

    def of(self, lanes: NDArray[np.intp]) -> SpatialShooting:
        """Return the problem of some of the families, with their present sub-steps."""
        return self.problem.of(lanes)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return self.problem.unknowns

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return F and dF/dz of all families."""
        return self.problem.residual(z)

    def done(self, z: Array, lanes: NDArray[np.intp]) -> list[str]:
        """Say why families (K,) end at their new members (4, K); see `lockstep.Done`."""
        problem = self.problem.of(lanes)
        way = problem.path(z, 2 * problem.steps)
        growth = self._refine(problem, z, lanes, way[:, -1])
        # rounding of the start, magnified by half a period, must stay below the residual allowed
        blurred = growth * _ROUNDING * np.max(np.abs(problem.state(z)), axis=0) > HALF
        finite = np.asarray(np.isfinite(way).all(axis=(0, 1)))
        clear = np.full(z.shape[1], -1.0)
        if np.any(finite):
            clear[finite] = clearance(self._impact, problem, z[:, finite], way[:, :, finite])
        tall = z[problem.unknowns.index("z")] if problem.start == "position" else None
        if tall is None:
            tall = np.max(np.abs(way[2]), axis=0)
        reasons = [
            LOST if not fine
            else SURFACE if room < 0.0
            else ASKED if top > self.z_max
            else PLANE if out < 0.5 * BIRTH
            else SENSITIVE if lost
            else ""
            for fine, room, top, out, lost in zip(
                finite, clear, tall, z[problem.kernel], blurred, strict=True
            )
        ]  # fmt: skip
        self.dropped.update(
            int(k) for k, reason in zip(lanes, reasons, strict=True) if reason in (LOST, SURFACE)
        )
        self.tick(sum(reason != "" for reason in reasons))
        return reasons

    def _refine(
        self, problem: SpatialShooting, z: Array, lanes: NDArray[np.intp], exact: Array
    ) -> Array:
        """Raise the sub-steps of lanes whose error has grown; return the growth of errors.

        That is by how much half a period magnifies one of the states, in those that vanish.
        """
        beside = z.copy()
        beside[:-1] += _APART
        each = np.tile(problem.counts, 2)
        here, there = np.split(ends(problem, np.hstack([z, beside]), each), 2, axis=1)
        error = np.max(np.abs(here - exact), axis=0)
        grown = np.isfinite(error) & (error > FOLLOWED)
        if np.any(grown):
            counts = self.problem.counts.copy()
            # error ∝ steps⁻⁸: aim at a tenth of the limit, at most twice the steps
            factor = np.clip((10.0 * error[grown] / FOLLOWED) ** 0.125, 1.1, 2.0)
            counts[lanes[grown]] = np.ceil(factor * counts[lanes[grown]]).astype(np.int64)
            self.problem = self.problem.with_counts(counts)
        odd = np.array(problem.mirror) == -1
        return np.asarray(np.max(np.abs(there - here)[odd], axis=0) / _APART)


def clearance(
    impact: ArrayFunction | None, problem: SpatialShooting, z: Array, way: Array
) -> Array:
    """Return the least value of the event "impact" along half of each orbit (N,); 1 without one.

    Between sub-steps the path is interpolated by cubics, so that a graze is not stepped over.
    """
    if impact is None:
        return np.ones(z.shape[1])
    h = z[-1] / (way.shape[1] - 1)
    a, b = way[:, :-1, None], way[:, 1:, None]
    s = _BETWEEN[None, None, :, None]
    place = (
        a[:3] * (1.0 + 2.0 * s) * (1.0 - s) ** 2 + b[:3] * s**2 * (3.0 - 2.0 * s)
        + h * (a[3:] * s * (1.0 - s) ** 2 - b[3:] * s**2 * (1.0 - s))
    )  # fmt: skip
    # the event depends on the place alone; any velocity serves
    states = np.concatenate([place, np.broadcast_to(a[3:], place.shape)])
    flat = np.ascontiguousarray(states.reshape(6, -1))
    values = impact(flat, problem.flow.system.parameters(None, flat.shape[1]))[0]
    return np.asarray(np.min(values.reshape(-1, z.shape[1]), axis=0))
