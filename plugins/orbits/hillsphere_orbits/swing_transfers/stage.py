"""The stage ``swing_transfers``: between planar orbits through families of swing orbits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.runs.workers import Workers
from hillsphere.show.reference import ReferenceTable
from hillsphere_orbits.flow import Compiled, Flow, flow_of
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.survey import LockedMoon
from hillsphere_orbits.swing_qso_families.curves import FamilyTangents
from hillsphere_orbits.swing_qso_families.products import SwingFamilies
from hillsphere_orbits.swing_transfers.assembly import join_transfers, none
from hillsphere_orbits.swing_transfers.chains import Scan
from hillsphere_orbits.swing_transfers.flights import flights_of
from hillsphere_orbits.swing_transfers.legs import Leg, LegSearch, ScannedFamily, SearchedLeg
from hillsphere_orbits.swing_transfers.presentation import present_transfers
from hillsphere_orbits.swing_transfers.products import SwingTransfers, Transfers
from hillsphere_orbits.swing_transfers.routes import fly_routes
from hillsphere_orbits.transfers.curves import PolarOrbit, step_map_of
from hillsphere_orbits.transfers.energy import least_dv
from hillsphere_orbits.transfers.ranks import rank_correlations
from hillsphere_orbits.transfers.specs import SwingTransfersSpec

__all__ = ["SwingTransfersStage", "energy_bound"]

_SAME_EQUATIONS = 1e-8
"""Largest closure, natural units, of orbits that count as solutions of this plant's equations. They
were computed to 1e-9 or better; other equations (another gravity model, say) give far more."""
_TRACK_STEPS = 720
"""Intervals of a drawn transfer: a smooth curve through several revolutions."""


class SwingTransfersStage:
    """Transfers between planar orbits through families of swing orbits.

    Parameters
    ----------
    spec : SwingTransfersSpec
        With its references bound.
    """

    def __init__(self, spec: SwingTransfersSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.reference = ReferenceTable.read(spec.reference) if spec.reference else None
        if self.reference and not {"leg", "dv_m_s"} <= set(self.reference.columns):
            raise InputError(
                "reference: the published costs need the columns leg and dv_m_s, got "
                f"{', '.join(self.reference.columns)}"
            )

    def run(self, ctx: Context, family: QsoFamily, swing: SwingFamilies) -> SwingTransfers:
        """Search every leg of every route.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        family : QsoFamily
            The orbits where transfers begin and end.
        swing : SwingFamilies
            The families that carry them.

        Returns
        -------
        SwingTransfers
            A leg that no family connects is reported; it is not an error.

        Raises
        ------
        InputError
            If a route names an orbit that the family does not have, or one that is no closed curve
            about the body.
        StageError
            If the orbits or families are those of other equations.
        """
        flow = flow_of(self.plant)
        names = self._orbits(family)
        legs = list(dict.fromkeys(pair for r in self.spec.routes for pair in pairwise(r)))
        orbits = self._curves(flow, family, names)
        integral = {name: float(family.members.integral[i]) for name, i in names.items()}
        families = range(len(swing.n))
        work = LegSearch(
            Compiled(self.plant),
            swing,
            {name: (orbits[name].x0, orbits[name].period, integral[name]) for name in names},
            self.spec.dearest,
        )
        advance = ctx.track("swing transfers", len(families) + len(legs) + 1)
        scans: list[Scan] = []
        known: list[FamilyTangents] = []
        searched: list[SearchedLeg] = []
        with Workers(ctx, work) as workers:
            for scanned in workers.map(families):
                assert isinstance(scanned, ScannedFamily)
                scans.append(scanned.scan)
                known.append(scanned.known)
                advance(1)
            for leg in workers.map([_leg(k, pair, scans, known) for k, pair in enumerate(legs)]):
                assert isinstance(leg, SearchedLeg)
                searched.append(leg)
                for note in leg.notes:
                    ctx.info(note)
                advance(1)
        least = [leg.least for leg in searched]
        members = [leg.members for leg in searched]
        every = join_transfers(least) if least else none()
        routes = fly_routes(self.plant, orbits, legs, [tuple(r) for r in self.spec.routes], every)
        best = _cheapest_of_legs(every, len(legs))
        tracks = _tracks(flow, every, best)
        advance(1)
        ranks = [rank_correlations(m.dv, m.angle, m.integral) for m in members]
        of_least = [
            rank_correlations(t.total_m_s, np.mean(t.angle_rad, axis=0), t.integral) for t in least
        ]
        front_of_legs = join_transfers([leg.front for leg in searched]) if searched else none()
        order = list(names)
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        speed = float(flow.system.unit[3])
        return SwingTransfers(
            flights=flights_of(
                orbits, legs, [swing.name(f) for f in families], front_of_legs, every,
                routes,
            ),
            orbits=tuple(order),
            orbit_integral=np.array([integral[name] for name in order]),
            orbit_tracks_m=np.stack([orbits[n].track for n in order], axis=2)
            * float(flow.system.unit[0]),
            legs=tuple(f"{a} to {b}" for a, b in legs),
            departure=np.array([order.index(a) for a, _ in legs], dtype=np.int64),
            arrival=np.array([order.index(b) for _, b in legs], dtype=np.int64),
            bound_m_s=np.array(
                [energy_bound(orbits[a], orbits[b], integral[a], integral[b]) for a, b in legs]
            )
            * speed,
            status=tuple("found" if t.size else _why_not(scans, p) for t, p in
                         zip(least, legs, strict=True)),
            families=tuple(swing.name(f) for f in families),
            d=swing.d,
            n=swing.n,
            least=every,
            front=front_of_legs,
            member_leg=np.repeat(np.arange(len(legs)), [m.dv.size for m in members]).astype(
                np.int64
            ),
            member_family=np.concatenate([m.family for m in members]),
            member_position=np.concatenate([m.position for m in members]),
            member_dv_m_s=np.concatenate([m.dv for m in members]) * speed,
            member_integral=np.concatenate([m.integral for m in members]),
            member_angle_rad=np.concatenate([m.angle for m in members]),
            rank=np.array(ranks),
            rank_of_least=np.array(of_least),
            routes=routes,
            track_leg=every.leg[best],
            tracks_m=tracks,
            frame=flow.system.frame,
            length_m=self.plant.scales.length_m,
            time_s=self.plant.scales.time_s,
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )  # fmt: skip

    def present(
        self, product: SwingTransfers, family: QsoFamily, swing: SwingFamilies
    ) -> Presentation:
        """Show costs beside published ones, Pareto fronts, routes and rank correlations."""
        return present_transfers(product, self.reference, self.spec.label)

    def _orbits(self, family: QsoFamily) -> dict[str, int]:
        """Return the numbers of the orbits in the routes, in the order of their first use."""
        labels = family.members.labels
        names = list(dict.fromkeys(name for route in self.spec.routes for name in route))
        if missing := [name for name in names if name not in labels]:
            raise InputError(
                f"routes: the family has no orbit {', '.join(map(repr, missing))}; it has "
                f"{', '.join(map(repr, labels))}"
            )
        return {name: labels.index(name) for name in names}

    def _curves(
        self, flow: Flow, family: QsoFamily, names: dict[str, int]
    ) -> dict[str, PolarOrbit]:
        """Return the orbits as closed curves, tried on this stage's equations."""
        system, orbits = flow.system, family.members
        x = orbits.x0 / system.unit[:, None]
        period = orbits.period_s / system.time_unit_s
        end = flow.with_matrix(x, period, flow.steps_for(x, period))[0]
        error = float(np.max(np.abs(end - x)))
        if orbits.frame != system.frame or not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the family's orbits (frame {orbits.frame}) do not solve the equations of this "
                f"stage's plant (frame {system.frame}; closure {error:.1e}); give the plant with "
                "which they were computed"
            )
        return {name: PolarOrbit(flow, x[:, i], period[i], name) for name, i in names.items()}


def _leg(
    number: int, names: tuple[str, str], scans: Sequence[Scan], known: Sequence[FamilyTangents]
) -> Leg:
    """Return a leg with the scanned meetings of its two orbits."""
    own = [replace(scan, met={name: scan.met[name] for name in names}) for scan in scans]
    return Leg(number, names, own, known)


def energy_bound(start: PolarOrbit, end: PolarOrbit, first: float, last: float) -> float:
    """Sum of two impulses below which no orbit between two others can go.

    Parameters
    ----------
    start, end : PolarOrbit
        Departure and arrival orbit.
    first, last : float
        Their integrals, normalised.

    Returns
    -------
    float
        min over C of the bounds of both impulses, each at the place where its orbit is fastest
        (`hillsphere_orbits.transfers.energy`). With the speeds v₁(C), v₂(C) of the orbit in between
        at these places the slope of the sum is 1/v₁ − 1/v₂, whose sign is the same for all C
        because v₁² − v₂² is; the sum is therefore least at the C of one of the two orbits.
    """
    one = least_dv(start.largest_speed, first, last)
    two = least_dv(end.largest_speed, last, first)
    return float(np.minimum(one, two))


def _why_not(scans: Sequence[Scan], names: tuple[str, str]) -> str:
    """Say why no family connects two orbits."""
    if not scans:
        return "there is no family of swing orbits"
    silent = [n for n in names if not any(np.isfinite(s.least(n)).any() for s in scans)]
    if silent:
        return f"no member of any family meets {' or '.join(silent)}"
    return "no member of any family meets both orbits"


def _cheapest_of_legs(every: Transfers, legs: int) -> NDArray[np.intp]:
    """Return the numbers of the cheapest transfer of every leg that has one."""
    cheapest = []
    for leg in range(legs):
        own = np.flatnonzero(every.leg == leg)
        if own.size:
            cheapest.append(own[np.argmin(every.total_m_s[own])])
    return np.array(cheapest, dtype=np.intp)


def _tracks(flow: Flow, every: Transfers, which: NDArray[np.intp]) -> Array:
    """Return positions (2, P, K), m, along transfers."""
    unit, clock = flow.system.unit[:, None], flow.system.time_unit_s
    x0, stepper = every.x0[:, which] / unit, step_map_of(flow)
    x: Array = x0
    if which.size:
        x = stepper.propagate(x0, every.departure_s[which] / clock, _TRACK_STEPS)
    way = stepper.trajectory(x, every.tof_s[which] / clock, _TRACK_STEPS)
    return np.ascontiguousarray(way[:2]) * float(flow.system.unit[0])
