"""The stage ``spatial_qso_families``: families in space, their members and their stability."""

from __future__ import annotations

from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import Bifurcations, PeriodicOrbits
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.qso.specs import read_resonance
from hillsphere_orbits.shooting import SymmetricShooting
from hillsphere_orbits.spatial_qso_families.group import Group, OrbitDescriptions, join_descriptions
from hillsphere_orbits.spatial_qso_families.kernel import starts_of, symmetries_of
from hillsphere_orbits.spatial_qso_families.presentation import present_families
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies
from hillsphere_orbits.spatial_qso_families.shooting import MIRRORS, SpatialShooting
from hillsphere_orbits.spatial_qso_families.specs import SpatialFamiliesSpec
from hillsphere_orbits.survey import LockedMoon, Surveyor

__all__ = ["SpatialFamiliesStage"]

_SAME_EQUATIONS = 1e-8
"""Largest closure, natural units, of bifurcating orbits that count as solutions of this plant's
equations. By default they are
computed to 1e-10 or better; other equations (another gravity model, say) give far more."""
_STATES = ("x", "y", "z", "vx", "vy", "vz")


class SpatialFamiliesStage:
    """Families of orbits in space from the vertical bifurcations of planar ones.

    Parameters
    ----------
    spec : SpatialFamiliesSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant has other states than x, y, z, vx, vy, vz.
    """

    def __init__(self, spec: SpatialFamiliesSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        names = tuple(v.name for v in self.plant.states)
        if names != _STATES:
            raise InputError(
                f"families in space need a plant with states {', '.join(_STATES)}; "
                f"{type(self.plant).__name__} has {', '.join(names)}"
            )

    def run(self, ctx: Context, bifurcations: Bifurcations) -> SpatialFamilies:
        """Compute the families.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        bifurcations : Bifurcations
            Where they branch off.

        Returns
        -------
        SpatialFamilies
            Curves, members, windows of stability. A family that could not be followed has no
            curve, and the reason as its end.

        Raises
        ------
        InputError
            If a resonance is not among the bifurcations, no family has any of the amplitudes, or
            the plant's equations do not keep the mirrors.
        StageError
            If the bifurcations belong to other equations.
        ConvergenceError
            If no family can be followed.
        """
        spec, unit = self.spec, self.plant.scales.length_m
        chosen = self._select_bifurcations(bifurcations)
        flow = flow_of(self.plant)
        symmetries = symmetries_of(flow, _samples())
        x, period = self._planar(flow, bifurcations, chosen)
        d, n = (np.array(values)[chosen] for values in (bifurcations.d, bifurcations.n))
        starts = [
            starts_of(flow, x[:, k], float(period[k]), int(d[k]), int(n[k]),
                      doubly=len(symmetries) > 1)[spec.branch]
            for k in range(n.size)
        ]  # fmt: skip
        advance = ctx.track("families in space", n.size + 2)
        # a little beyond, so that the largest amplitude asked for is passed
        z_max = (spec.z_max_m or max(spec.z_amplitudes_m)) / unit * (1.0 + 1e-6)
        surveyor = Surveyor(self.plant, SymmetricShooting(flow, MIRRORS["position"]))
        groups, ends = [], [""] * n.size
        for mirror in dict.fromkeys(start.mirror for start in starts):
            own = np.flatnonzero([start.mirror == mirror for start in starts])
            problem = SpatialShooting(flow, mirror, np.full(own.size, 64))
            begin = np.array([starts[k].x for k in own]).T
            group = Group.follow(
                surveyor, problem, symmetries, own, begin, period[own], n[own], z_max, advance
            )
            for k, reason in (group.ends if isinstance(group, Group) else group).items():
                ends[k] = reason
            if isinstance(group, Group):
                groups.append(group)
        resonances = [f"{p}:{q}" for p, q in zip(d, n, strict=True)]
        if not groups:
            reasons = "; ".join(f"{a}: {b}" for a, b in zip(resonances, ends, strict=True))
            raise ConvergenceError(f"no family could be followed ({reasons})")
        ctx.info(f"{sum(g.number.size for g in groups)} of {n.size} families followed")
        curve, _ = join_descriptions([group.curve for group in groups])
        heights = [z / unit for z in spec.z_amplitudes_m]
        parts = [group.members_at(heights) for group in groups]
        members, order = join_descriptions([part[0] for part in parts])
        target = np.concatenate([part[1] for part in parts])[order]
        missing = self._missing(curve, members, target, resonances, ends)
        advance(1)
        events, event_order = join_descriptions([group.events_at for group in groups])
        kinds = [event.kind for group in groups for event in group.events]
        windows = sorted((row for group in groups for row in group.windows), key=itemgetter(0))
        asked = np.array(spec.z_amplitudes_m)[target]
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        advance(1)
        return SpatialFamilies(
            members=self._orbits(members, _labels(resonances, members.family, asked)),
            branch=spec.branch,
            d=tuple(d.tolist()),
            n=tuple(n.tolist()),
            starts=tuple(start.mirror for start in starts),
            of_position=tuple(start.of_position for start in starts),
            bifurcation_x_m=bifurcations.orbits.x0[0, chosen],
            ends=tuple(ends),
            missing=missing,
            curve=self._orbits(curve, ("",) * curve.period.size),
            member_family=members.family,
            curve_family=curve.family,
            member_z_m=asked,
            curve_z_m=curve.height * unit,
            curve_place=curve.place,
            member_multipliers=members.multipliers,
            curve_multipliers=curve.multipliers,
            curve_return_index=curve.return_index,
            curve_return_power=curve.return_power,
            member_stable=members.stable,
            curve_stable=curve.stable,
            member_half_residual=members.half,
            curve_half_residual=curve.half,
            window_family=np.array([row[0] for row in windows], dtype=np.int64),
            window_z_m=np.array([row[1:] for row in windows]).reshape(-1, 2).T * unit,
            secondary_family=events.family,
            secondary_kind=tuple(kinds[k] for k in event_order),
            secondary_z_m=events.height * unit,
            secondary_jacobi=events.integral,
            secondary_index=events.indices,
            tracks_m=np.concatenate([part[2] for part in parts], axis=2)[:, :, order] * unit,
            method=f"half a period between two states that the mirror keeps; branch {spec.branch}",
            check=surveyor.check,
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )

    def _orbits(self, orbits: OrbitDescriptions, labels: tuple[str, ...]) -> PeriodicOrbits:
        system, scales = flow_of(self.plant).system, self.plant.scales
        return PeriodicOrbits(
            frame=system.frame,
            states=_STATES,
            x0=orbits.x * system.unit[:, None],
            period_s=orbits.period * system.time_unit_s,
            integral=orbits.integral,
            monodromy=orbits.monodromy,
            residual=orbits.closure,
            labels=labels,
            length_m=scales.length_m,
            time_s=scales.time_s,
        )

    def present(self, product: SpatialFamilies, bifurcations: Bifurcations) -> Presentation:
        """Show members, windows of stability, the families in space and their multipliers."""
        return present_families(product, self.spec.label)

    def _select_bifurcations(self, bifurcations: Bifurcations) -> list[int]:
        """Return the numbers of the bifurcations to start from, in the requested order."""
        pairs = list(zip(bifurcations.d, bifurcations.n, strict=True))
        vertical = [i for i, plane in enumerate(bifurcations.plane) if plane == "vertical"]
        wanted = [pair for text in self.spec.resonances if (pair := read_resonance(text))]
        there = ", ".join(dict.fromkeys(f"{pairs[i][0]}:{pairs[i][1]}" for i in vertical)) or "none"
        if missing := [pair for pair in wanted if pair not in {pairs[i] for i in vertical}]:
            names = ", ".join(f"{d}:{n}" for d, n in missing)
            raise InputError(
                f"resonances: no vertical bifurcation {names} was found (found: {there}); ask the "
                "bifurcations stage for it, or leave it out"
            )
        if not vertical:
            raise InputError(
                "there is no vertical bifurcation to start from; ask the bifurcations stage for "
                "some with its key vertical"
            )
        if not wanted:
            return vertical
        return [i for pair in wanted for i in vertical if pairs[i] == pair]

    def _planar(
        self, flow: Flow, bifurcations: Bifurcations, chosen: list[int]
    ) -> tuple[Array, Array]:
        """Return normalised states and periods of the planar orbits, tried on these equations."""
        system, orbits = flow.system, bifurcations.orbits
        x = orbits.x0[:, chosen] / system.unit[:, None]
        period = orbits.period_s[chosen] / system.time_unit_s
        end = flow.with_matrix(x, period, flow.steps_for(x, period))[0]
        error = float(np.max(np.abs(end - x)))
        if orbits.frame != system.frame or not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the bifurcating orbits (frame {orbits.frame}) do not solve the equations of this "
                f"stage's plant (frame {system.frame}; closure {error:.1e}); give the plant with "
                "which they were computed"
            )
        return x, period

    def _missing(
        self,
        curve: OrbitDescriptions,
        members: OrbitDescriptions,
        target: NDArray[np.intp],
        resonances: list[str],
        ends: list[str],
    ) -> tuple[str, ...]:
        """Return sentences on families without requested amplitudes; raise if no member exists."""
        met = set(zip(members.family.tolist(), target.tolist(), strict=True))
        faults = []
        for f in np.unique(curve.family).tolist():
            lost = [
                f"{z / 1e3:.6g}"
                for k, z in enumerate(self.spec.z_amplitudes_m)
                if (f, k) not in met
            ]
            if lost:
                tall = curve.height[curve.family == f] * self.plant.scales.length_m / 1e3
                faults.append(
                    f"{resonances[f]} has no member of amplitude {', '.join(lost)} km (it has "
                    f"{tall.min():.6g} to {tall.max():.6g} km; it ends: {ends[f]})"
                )
        if not met:
            raise InputError(f"z_amplitudes_m: {'; '.join(faults)}")
        return tuple(faults)


def _samples() -> Array:
    """States around the body at which mirrors are tried, shape (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    place = np.geomspace(0.7, 4.0, 48) * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])


def _labels(resonances: list[str], family: NDArray[np.int64], z_m: Array) -> tuple[str, ...]:
    names: list[str] = []
    for f, z in zip(family, z_m, strict=True):
        name = f"{resonances[int(f)]}, {z / 1e3:.9g} km"
        count = sum(other.split(" #")[0] == name for other in names)
        names.append(f"{name} #{count + 1}" if count else name)
    return tuple(names)
