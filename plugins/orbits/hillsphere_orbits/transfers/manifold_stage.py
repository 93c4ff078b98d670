"""The stage ``manifold_transfers``: from planar orbit to planar orbit through an unstable one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.reference import ReferenceTable
from hillsphere.threads import in_threads
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.manifolds.flight import Watch
from hillsphere_orbits.manifolds.sampling import LocalManifold, classified, sides_are_images
from hillsphere_orbits.manifolds.stage import (
    chosen,
    enders,
    orbits_on,
    period_steps,
    trial_places,
)
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.spatial.products import SpatialFamilies
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.manifold_assembly import Case, Found, assembled
from hillsphere_orbits.transfers.manifold_presentation import present_transfers
from hillsphere_orbits.transfers.manifold_products import ManifoldTransfers
from hillsphere_orbits.transfers.manifold_search import Legs, Search, joined, ladder
from hillsphere_orbits.transfers.manifold_specs import ManifoldTransfersSpec

__all__ = ["ManifoldTransfersStage"]

_NEEDED = ("n", "Az_km", "total_m_s", "v_cm_m_s", "dv_m_s", "tof_d")
_ACCURACY = 1e-11  # see `period_steps`; legs magnify errors as they do the first state
_SAME = 1e-9  # of an orbit and its mirror image


@dataclass(frozen=True, eq=False)
class _Setting:
    """What all searches have in common, normalised."""

    flow: Flow
    watch: Watch
    ends: tuple[str, ...]
    departure: PolarOrbit
    arrival: PolarOrbit
    mirror: Array | None


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
            If an orbit is asked for that there is not, or a planar one is no closed curve.
        StageError
            If the orbits belong to other equations.
        """
        spec, flow = self.spec, flow_of(self.plant)
        members = chosen(members_of(*orbits), spec.members)
        if extra := [name for name in spec.check if name not in members.labels]:
            raise InputError(f"check: no orbit is called {extra[0]!r}")
        both = [chosen(planar.members, (name,)) for name in (spec.departure, spec.arrival)]
        x0, period = orbits_on(flow, members)
        targets = []
        for orbit in both:
            start, duration = orbits_on(flow, orbit)
            targets.append(PolarOrbit(flow, start[:, 0], float(duration[0]), orbit.labels[0]))
        ends = enders(flow)
        functions = {"plane": flow.system.x[2], **{e: flow.system.events[e] for e in ends}}
        setting = _Setting(
            flow, Watch(flow.system, functions), ends, targets[0], targets[1],
            _mirror(flow, targets),
        )  # fmt: skip
        advance = ctx.track("transfers", period.size)
        found: list[Found] = []
        kinds = classified(members.monodromy)
        _ = flow.plain  # compiled here, before threads ask for it

        def searched(i: int) -> Found:
            return self._member(setting, members, x0[:, i], float(period[i]), i, kinds[i])

        for i, one in enumerate(in_threads(searched, range(period.size))):
            found.append(one)
            ctx.info(
                f"{members.labels[i]}: {one.status}; {one.departure.p.size} departure and "
                f"{one.arrival.p.size} arrival legs, {one.trajectories} trajectories"
            )
            advance(1)
        revolutions, z_m = _coordinates(members, orbits)
        case = Case(
            plant=self.plant,
            flow=flow,
            orbits=members,
            planar=(both[0], both[1]),
            curves=(setting.departure, setting.arrival),
            revolutions=revolutions,
            z_m=z_m,
            mirrored=setting.mirror is not None,
            checked=spec.check,
            leg_limit_s=spec.leg_limit_s,
            distance=spec.distance,
            start_distance=spec.start_distance,
            closure_limit_m=spec.closure_limit_m,
        )
        return assembled(case, found)

    def present(
        self, product: ManifoldTransfers, planar: OrbitSet, orbits: tuple[OrbitSet, ...]
    ) -> Presentation:
        """Show Table 4, the ladders and the transfers, beside published values where cited."""
        return present_transfers(product, self.spec, self.reference)

    def _member(
        self,
        setting: _Setting,
        orbits: PeriodicOrbits,
        x0: Array,
        period: float,
        i: int,
        kind: str,
    ) -> Found:
        nothing = Legs.none()
        if kind != "unstable":
            return Found(kind, float("nan"), nothing, nothing, 0)
        samples = self.spec.samples
        try:
            steps = period_steps(setting.flow, x0, period, orbits.monodromy[:, :, i], _ACCURACY)
            multiplier, departure, arrival, count = self._legs(setting, x0, period, steps, samples)
            again = None
            if orbits.labels[i] in self.spec.check:
                again = self._legs(setting, x0, period, steps, 2 * samples)[1:3]
        except HillsphereError as error:
            return Found(f"not searched: {error}", float("nan"), nothing, nothing, 0)
        missing = [
            name
            for name, legs in (("departure", departure), ("arrival", arrival))
            if not legs.p.size
        ]
        status = f"no {missing[0]} leg" if len(missing) == 1 else "no leg"
        return Found(
            status if missing else "connected", multiplier, departure, arrival, count, again
        )

    def _legs(
        self, setting: _Setting, x0: Array, period: float, steps: int, samples: int
    ) -> tuple[float, Legs, Legs, int]:
        """Return the multiplier, the ladders of departure and arrival, and trajectories flown."""
        mirror = setting.mirror
        image = mirror is not None and bool(
            np.max(np.abs(mirror * x0 - x0)) <= _SAME * np.max(np.abs(x0))
        )
        local = LocalManifold.of(setting.flow, x0, period, steps)
        if not local.orbit[[2, 5]].any() and not local.mode[[2, 5]].any():
            raise InputError(
                "the orbit and its manifold lie in the plane z = 0, which they do not pass through"
            )
        wanted = [setting.arrival, setting.departure] if image else [setting.arrival]
        found, count = self._sides(setting, local, wanted, samples)
        arrival = found[0]
        if image and mirror is not None:
            return local.multiplier, found[1].mirrored(mirror), arrival, count
        backwards = LocalManifold.of(setting.flow, x0, period, steps, stable=True)
        (departure,), more = self._sides(setting, backwards, [setting.departure], samples)
        return local.multiplier, departure, arrival, count + more

    def _sides(
        self, setting: _Setting, local: LocalManifold, targets: list[PolarOrbit], samples: int
    ) -> tuple[list[Legs], int]:
        """Return the ladders to the targets over both sides of a manifold."""
        spec, scales = self.spec, self.plant.scales
        gain = spec.least_gain_m_s * scales.time_s / scales.length_m
        # a symmetry that maps one side on the other must map the planar orbits on themselves
        kept = tuple(signs for signs in _SIGNS if all(_keeps(t, signs) for t in targets))
        alike = bool(kept) and sides_are_images(local, trial_places(), kept)
        parts: list[list[Legs]] = []
        count = 0
        for side in local.sides[:1] if alike else local.sides:
            search = Search(
                local, setting.watch, side, start=spec.start_distance, distance=spec.distance,
                limit=spec.leg_limit_s / scales.time_s, ends=setting.ends, samples=samples,
                gain=gain,
            )  # fmt: skip
            legs, flown = search.legs(targets)
            parts.append(legs)
            count += flown
        return [ladder(joined([p[k] for p in parts]), gain) for k in range(len(targets))], count


_SIGNS = tuple(
    (i, j, k) for i in (1, -1) for j in (1, -1) for k in (1, -1) if (i, j, k) != (1, 1, 1)
)


def _keeps(orbit: PolarOrbit, signs: tuple[int, int, int], *, reverses: bool = False) -> bool:
    """Whether a sign change of the axes maps a planar orbit on itself."""
    angle = np.linspace(0.1, 6.1, 25)
    mirror = np.array([*signs, *(s * (-1 if reverses else 1) for s in signs)])[:, None]
    image = mirror * orbit.state(angle)
    there = orbit.state(np.arctan2(image[1], image[0]))
    return bool(np.max(np.abs(image - there)) <= _SAME * np.max(np.abs(there)))


def _mirror(flow: Flow, targets: list[PolarOrbit]) -> Array | None:
    """Return the signs of a time reversal that the equations and the planar orbits keep."""
    for signs in flow.system.mirrors.values():
        i, j, k = signs[:3]
        if flow.keeps(signs, trial_places(), reverses_time=True) and all(
            _keeps(target, (i, j, k), reverses=True) for target in targets
        ):
            return np.array(signs, dtype=float)
    return None


def _coordinates(
    members: PeriodicOrbits, orbits: tuple[OrbitSet, ...]
) -> tuple[NDArray[np.int64], Array]:
    """Return revolutions and amplitude of each orbit, where its product tells."""
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
