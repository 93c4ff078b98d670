"""Routes of several legs, flown by their cheapest transfers from the first state to the last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.swing_transfers.products import SwingRoutes, Transfers
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.endtoend import Leg, verify

__all__ = ["fly_routes"]


def fly_routes(
    plant: Plant,
    orbits: Mapping[str, PolarOrbit],
    legs: Sequence[tuple[str, str]],
    routes: Sequence[tuple[str, ...]],
    least: Transfers,
) -> SwingRoutes:
    """Chain the cheapest transfers of the legs of routes, and fly the chains.

    Between two legs the spacecraft stays on the orbit in between until it comes to where the next
    leg begins, less than one revolution.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    orbits : mapping of str to PolarOrbit
        Orbits by name.
    legs : sequence of (str, str)
        Legs of `least` by number.
    routes : sequence of tuple of str
        The routes.
    least : Transfers
        Transfers of the legs.

    Returns
    -------
    SwingRoutes
        NaN where a leg has no transfer.
    """
    numbers: list[tuple[int, ...]] = []
    rows = []
    for route in routes:
        own = tuple(legs.index(pair) for pair in pairwise(route))
        numbers.append(own)
        best = [_cheapest(least, leg) for leg in own]
        if None in best:
            rows.append([np.nan] * 5)
            continue
        rows.append(_fly_route(plant, orbits, route, least, [k for k in best if k is not None]))
    table = np.array(rows, dtype=float).reshape(len(routes), 5).T
    return SwingRoutes(
        name=tuple(", ".join(route) for route in routes),
        legs=tuple(numbers),
        total_m_s=table[0].copy(),
        tof_s=table[1].copy(),
        waiting_s=table[2].copy(),
        closure_km=table[3].copy(),
        closure_m_s=table[4].copy(),
    )


def _cheapest(least: Transfers, leg: int) -> int | None:
    own = np.flatnonzero(least.leg == leg)
    return int(own[np.argmin(least.total_m_s[own])]) if own.size else None


def _fly_route(
    plant: Plant,
    orbits: Mapping[str, PolarOrbit],
    route: Sequence[str],
    least: Transfers,
    best: Sequence[int],
) -> list[float]:
    """Return total, times and misses of one route."""
    first = orbits[route[0]]
    unit, clock = first.flow.system.unit, first.flow.system.time_unit_s
    legs: list[Leg] = []
    waiting, since = 0.0, 0.0
    for k, (name, target) in zip(best, pairwise(route), strict=True):
        # the rest of a revolution until the next leg leaves this orbit
        wait = (float(least.on_departure_s[k]) - since) % (orbits[name].period * clock)
        waiting += wait if legs else 0.0
        legs.append(_leg(f"on {name}", wait, least.impulse_m_s[0, :, k], orbits[name],
                         least.place_m[0, :, k]))  # fmt: skip
        legs.append(_leg(f"to {target}", float(least.tof_s[k]), least.impulse_m_s[1, :, k],
                         orbits[target], least.place_m[1, :, k]))  # fmt: skip
        # the first impulse leads onto the swing orbit
        legs[-2].end[3:, 0] += least.impulse_m_s[0, :, k]
        since = float(least.on_arrival_s[k])
    seen = verify(plant, (first.x0 * unit)[:, None], legs)
    tof = float(np.sum(least.tof_s[list(best)]))
    return [
        float(seen.dv_m_s[0]), tof, waiting, float(seen.closure_km[0]), float(seen.closure_m_s[0])
    ]  # fmt: skip


def _leg(name: str, duration_s: float, impulse: Array, orbit: PolarOrbit, place_m: Array) -> Leg:
    """Return a leg that ends on an orbit, at a place."""
    angle = np.array([np.arctan2(place_m[1], place_m[0])])
    end = orbit.state(angle) * orbit.flow.system.unit[:, None]
    return Leg(name, np.array([duration_s]), impulse[:, None].copy(), end)
