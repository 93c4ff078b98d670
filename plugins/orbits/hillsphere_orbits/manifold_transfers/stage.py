"""The stage ``manifold_transfers``: from planar orbit to planar orbit through an unstable one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.runs.workers import Workers
from hillsphere.show.reference import ReferenceTable
from hillsphere_orbits.flow import Compiled, Flow, flow_of
from hillsphere_orbits.invariant_manifolds.flight import UNPROVED
from hillsphere_orbits.invariant_manifolds.sampling import classify_manifolds
from hillsphere_orbits.invariant_manifolds.stage import orbits_on, select_orbits
from hillsphere_orbits.manifold_transfers.assembly import Case, OrbitTransfers, assemble_product
from hillsphere_orbits.manifold_transfers.flights import Coasts, VerifiedFlights, Waits
from hillsphere_orbits.manifold_transfers.orbit import OrbitSearch, UnstableOrbit, mirror_of
from hillsphere_orbits.manifold_transfers.presentation import present_transfers
from hillsphere_orbits.manifold_transfers.products import ManifoldTransfers
from hillsphere_orbits.manifold_transfers.specs import ManifoldTransfersSpec
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies
from hillsphere_orbits.transfers.curves import PolarOrbit

__all__ = ["ManifoldTransfersStage"]

_NEEDED = ("n", "Az_km", "total_m_s", "v_cm_m_s", "dv_m_s", "tof_d")


class ManifoldTransfersStage:
    """Transfers along the manifolds of unstable orbits.

    Parameters
    ----------
    spec : ManifoldTransfersSpec
        With its references bound.

    Raises
    ------
    InputError
        If the table of published values cannot be read or lacks a column.
    """

    def __init__(self, spec: ManifoldTransfersSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.reference = ReferenceTable.read(spec.reference) if spec.reference else None
        if self.reference is not None:
            missing = [name for name in _NEEDED if name not in self.reference.columns]
            if missing:
                raise InputError(
                    f"reference: no column {', '.join(missing)}; it has "
                    f"{', '.join(self.reference.columns)}"
                )

    def run(
        self, ctx: Context, planar: OrbitSet, orbits: tuple[OrbitSet, ...]
    ) -> ManifoldTransfers:
        """Search the transfers.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        planar : OrbitSet
            Has the planar orbits of departure and arrival.
        orbits : tuple of OrbitSet
            Have the orbits in between.

        Returns
        -------
        ManifoldTransfers
            Ladders of legs, and the transfers made of them.

        Raises
        ------
        InputError
            If a requested orbit does not exist, or a planar one is not a closed curve.
        StageError
            If the orbits belong to other equations.
        """
        spec, flow = self.spec, flow_of(self.plant)
        members = select_orbits(members_of(*orbits), spec.members)
        if extra := [name for name in spec.check if name not in members.labels]:
            raise InputError(f"check: no orbit is called {extra[0]!r}")
        both = [select_orbits(planar.members, (name,)) for name in (spec.departure, spec.arrival)]
        x0, period = orbits_on(flow, members)
        ends = [_start_of(flow, orbit) for orbit in both]
        targets = [PolarOrbit(flow, state, duration, name) for name, state, duration in ends]
        scales = self.plant.scales
        work = OrbitSearch(
            Compiled(self.plant), ends[0], ends[1],
            limit=spec.leg_limit_s / scales.time_s,
            gain=spec.least_gain_m_s * scales.time_s / scales.length_m,
            start=spec.start_distance, distance=spec.distance, samples=spec.samples,
        )  # fmt: skip
        kinds = classify_manifolds(members.monodromy)
        pieces = [
            UnstableOrbit(
                x0[:, i].copy(),
                float(period[i]),
                members.monodromy[:, :, i].copy(),
                kinds[i],
                label in spec.check,
            )
            for i, label in enumerate(members.labels)
        ]
        revolutions, z_m = _coordinates(members, orbits)
        case = Case(
            plant=self.plant,
            flow=flow,
            orbits=members,
            planar=(both[0], both[1]),
            curves=(targets[0], targets[1]),
            revolutions=revolutions,
            z_m=z_m,
            mirrored=mirror_of(flow, targets) is not None,
            checked=spec.check,
            leg_limit_s=spec.leg_limit_s,
            distance=spec.distance,
            start_distance=spec.start_distance,
            closure_limit_m=spec.closure_limit_m,
        )
        advance = ctx.track("transfers", len(pieces))
        results: list[OrbitTransfers] = []
        with Workers(ctx, work) as workers:
            for label, one in zip(members.labels, workers.map(pieces), strict=True):
                assert isinstance(one, OrbitTransfers)
                results.append(one)
                ctx.info(
                    f"{label}: {one.status}; {one.departure.p.size} departure and "
                    f"{one.arrival.p.size} arrival legs, {one.trajectories} trajectories"
                )
                if one.unproved:
                    ctx.info(
                        f"{label}: {one.unproved} trajectories touch the plane or the surface, or "
                        f"offer no bound: {UNPROVED}"
                    )
                advance(1)

            def flown(legs: Sequence[Coasts | Waits]) -> Iterator[VerifiedFlights]:
                for one in workers.map(legs):
                    assert isinstance(one, VerifiedFlights)
                    yield one

            return assemble_product(case, results, flown)

    def present(
        self, product: ManifoldTransfers, planar: OrbitSet, orbits: tuple[OrbitSet, ...]
    ) -> Presentation:
        """Show Table 4, the ladders and the transfers, beside published values where cited."""
        return present_transfers(product, self.spec, self.reference)


def _start_of(flow: Flow, orbit: PeriodicOrbits) -> tuple[str, Array, float]:
    """Return name, state (6,) and period of the one orbit of a set, normalised."""
    start, duration = orbits_on(flow, orbit)
    return orbit.labels[0], start[:, 0], float(duration[0])


def _coordinates(
    members: PeriodicOrbits, orbits: tuple[OrbitSet, ...]
) -> tuple[NDArray[np.int64], Array]:
    """Return revolutions and amplitude of each orbit, where its product has them."""
    revolutions = np.zeros(len(members.labels), dtype=np.int64)
    z_m = np.full(len(members.labels), np.nan)
    for families in orbits:
        if not isinstance(families, SpatialFamilies):
            continue
        for j, label in enumerate(families.members.labels):
            if label in members.labels:
                i = members.labels.index(label)
                revolutions[i] = families.n[int(families.member_family[j])]
                z_m[i] = families.member_z_m[j]
    return revolutions, z_m
