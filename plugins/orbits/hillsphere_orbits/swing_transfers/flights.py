"""Transfers through swing orbits as flights, for stages that write them or fly them again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.interfaces import Array
from hillsphere.products import Trajectories
from hillsphere_orbits.swing_transfers.products import SwingRoutes, Transfers
from hillsphere_orbits.transfers.curves import PolarOrbit

__all__ = ["flights_of"]

_STATES = 481  # of a coast
_STEP = 0.01  # longest sub-step, natural units: two hundred in a revolution at the surface


def flights_of(
    orbits: Mapping[str, PolarOrbit],
    legs: Sequence[tuple[str, str]],
    families: Sequence[str],
    front: Transfers,
    least: Transfers,
    routes: SwingRoutes,
) -> Trajectories:
    """Return the transfers of the fronts, a coast each, and routes, a coast per leg.

    Parameters
    ----------
    orbits : mapping of str to PolarOrbit
        Orbits by name; one at least.
    legs : sequence of (str, str)
        Names of departure and arrival orbit of each leg.
    families : sequence of str
        Names of the families.
    front, least : Transfers
        See `SwingTransfers`.
    routes : SwingRoutes
        Those of more than one leg become plans; their coasts are apart by the times on the orbits
        in between, which are left out.

    Returns
    -------
    Trajectories
        By leg and time, then the routes.
    """
    flow = next(iter(orbits.values())).flow
    clock = flow.system.time_unit_s
    plans: list[str] = []
    labels: list[str] = []
    parts: list[Array] = []
    begins: list[float] = []

    def named(transfers: Transfers, k: int) -> str:
        return " to ".join(legs[transfers.leg[k]])

    def add(transfers: Transfers, k: int, plan: str, begin: float) -> None:
        plans.append(plan)
        labels.append(families[transfers.family[k]])
        values = (transfers.departure_s[k], transfers.tof_s[k])
        parts.append(np.concatenate([transfers.x0[:, k], values]))
        begins.append(begin)

    for k in range(front.size):
        cost, hours = front.total_m_s[k], front.tof_s[k] / HOUR_S
        plan = f"{named(front, k)}, {cost:.2f} m/s in {hours:.2f} h"
        count = sum(other.split(" #")[0] == plan for other in plans)
        add(front, k, f"{plan} #{count + 1}" if count else plan, 0.0)
    for r, own in enumerate(routes.legs):
        if len(own) < 2 or not np.isfinite(routes.total_m_s[r]):
            continue
        time = since = 0.0
        for j, leg in enumerate(own):
            mine = np.flatnonzero(least.leg == leg)
            k = int(mine[np.argmin(least.total_m_s[mine])])
            if j:
                period = orbits[legs[leg][0]].period * clock
                time += float((least.on_departure_s[k] - since) % period)
            add(least, k, routes.name[r], time)
            time += float(least.tof_s[k])
            since = float(least.on_arrival_s[k])
    if not plans:
        return Trajectories(flow.system.frame, flow.names, (), (), np.empty((0, 0)),
                            np.empty((6, 0, 0)))  # fmt: skip
    given = np.array(parts).T
    unit = flow.system.unit[:, None]
    x0 = np.ascontiguousarray(given[:6] / unit)
    wait, tof = given[6] / clock, given[7] / clock
    longest = float(np.max([wait, tof]))
    each = ceil(longest / _STEP / (_STATES - 1))
    start = flow.plain.propagate(x0, wait, each * (_STATES - 1))
    way = flow.plain.trajectory(start, tof, each * (_STATES - 1))[:, ::each]
    time = np.linspace(0.0, 1.0, _STATES)[:, None] * given[7] + np.array(begins)
    return Trajectories(
        frame=flow.system.frame,
        states=flow.names,
        plans=tuple(plans),
        labels=tuple(labels),
        t_s=time,
        x=np.ascontiguousarray(way) * unit[..., None],
    )
