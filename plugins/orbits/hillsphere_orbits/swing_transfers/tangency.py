"""Members of families that just touch an orbit: there meetings appear or vanish in pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.dynamics import bracketed_roots
from hillsphere.interfaces import Array
from hillsphere_orbits.swing_transfers.chains import Chains, Scan, fly, interpolate_unknowns
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.meetings import Bends, meetings

__all__ = ["MARGIN", "Tangency", "bracket_tangencies", "tangent_members"]

MARGIN = 1.15
"""What is this much above a family's least cost, judged by samples, is not looked into."""


@dataclass(frozen=True)
class Tangency:
    """A member that just touches an orbit: between which members, and where on it.

    Parameters
    ----------
    family : int
        Its family.
    low : float
        It lies between positions low and low + 1.
    values, phases : (float, float)
        At these two: the extremum of g that changes its sign, and its phase in periods.
    u : float
        Position, once it is found.
    """

    family: int
    low: float
    values: tuple[float, float]
    phases: tuple[float, float]
    u: float = np.nan

    def phase(self, u: Array) -> Array:
        """Return the phase, interpolated."""
        turned = self.phases[1] - self.phases[0]
        return np.asarray(self.phases[0] + (u - self.low) * (turned - round(turned)))


def bracket_tangencies(scanned: Scan, name: str, other: str) -> list[Tangency]:
    """Return where an extremum of g changes its sign, if a cheap transfer may begin there.

    Parameters
    ----------
    scanned : Scan
        What a family's members meet.
    name, other : str
        The orbit that is touched, and the one at the other end of the transfer.

    Returns
    -------
    list of Tangency
        Without those whose cost, estimated at the neighbouring members, is far above the family's
        least, and without mirror images.
    """
    bends, members = scanned.met[name].bends, scanned.period.size
    value, phase, dv = _pad_extrema(bends, scanned.period, members)
    # the same extremum of the next member: each the other's nearest in phase, once around
    away = np.abs(phase[:-1, :, None] - phase[1:, None, :])
    # phases are in periods: the distance is at most half a period
    away = np.fmin(away, 1.0 - away)
    away = np.where(np.isfinite(away), away, np.inf)
    i, j = np.nonzero(np.isfinite(phase[:-1]))
    k = np.argmin(away[i, j], axis=1) if i.size else j
    mutual = np.argmin(away[i, :, k], axis=1) == j if i.size else np.zeros(0, dtype=bool)
    crosses = mutual & ((value[i, j] > 0.0) != (value[i + 1, k] > 0.0))
    elsewhere = scanned.least(other)
    least = float(np.min(scanned.least(name) + elsewhere))
    touches: dict[tuple[int, float], Tangency] = {}
    for a, p, q in zip(i[crosses].tolist(), j[crosses].tolist(), k[crosses].tolist(), strict=True):
        there = min(elsewhere[a], elsewhere[a + 1])
        if not min(dv[a, p], dv[a + 1, q]) + (there if there < np.inf else 0.0) < MARGIN * least:
            continue
        values = (float(value[a, p]), float(value[a + 1, q]))
        one = Tangency(
            scanned.family, float(a), values, (float(phase[a, p]), float(phase[a + 1, q]))
        )
        touches.setdefault((a, round(values[0], 9)), one)
    return list(touches.values())


def _pad_extrema(bends: Bends, period: Array, members: int) -> tuple[Array, Array, Array]:
    """Return values, phases and speed changes of extrema, (members, most of one), padded by NaN."""
    count = np.bincount(bends.lane, minlength=members)
    place = np.arange(bends.lane.size) - np.concatenate([[0], np.cumsum(count)])[bends.lane]
    table = np.full((3, members, max(1, int(count.max(initial=0)))), np.nan)
    phase = (bends.time / period[bends.lane]) % 1.0
    table[:, bends.lane, place] = bends.value, phase, bends.dv
    return table[0], table[1], table[2]


def _bend_near(bends: Bends, period: Array, phase: Array) -> Array:
    """Return the value of g at the extremum of every lane that is nearest to a phase."""
    values, phases, _ = _pad_extrema(bends, period, period.size)
    away = np.abs(phases - (phase % 1.0)[:, None])
    away = np.where(np.isfinite(away), np.fmin(away, 1.0 - away), np.inf)
    return np.asarray(values[np.arange(period.size), np.argmin(away, axis=1)])


def tangent_members(
    chains: Chains, touches: Sequence[Tangency], orbit: PolarOrbit, coarse: int
) -> list[Tangency]:
    """Find members that just touch an orbit, on the interpolated chains.

    Parameters
    ----------
    chains : Chains
        The families.
    touches : sequence of Tangency
        Between which members they are.
    orbit : PolarOrbit
        The orbit.
    coarse : int
        Times fewer sub-steps than for rounding.

    Returns
    -------
    list of Tangency
        With their positions.
    """
    if not touches:
        return []
    family = np.array([t.family for t in touches], dtype=np.intp)
    low = np.array([t.low for t in touches])
    first, last = (np.array([t.values[k] for t in touches]) for k in (0, 1))

    def value(u: Array) -> Array:
        phase = np.array([float(t.phase(place)) for t, place in zip(touches, u, strict=True)])
        strands = fly(chains, family, interpolate_unknowns(chains, family, u), coarse)
        period = strands.h * (strands.way.shape[1] - 1)
        return _bend_near(meetings(orbit, strands).bends, period, phase)

    u = bracketed_roots(value, low, low + 1.0, first, last, np.full(low.shape, 1e-9))
    return [replace(t, u=float(place)) for t, place in zip(touches, u, strict=True)]
