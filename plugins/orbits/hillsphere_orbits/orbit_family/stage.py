"""The stage ``orbit_family``: a family of periodic orbits, continued in parameters."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere_orbits.members import Quantity, members_at
from hillsphere_orbits.orbit_family.arrival import Arrival, continue_members, keep_members
from hillsphere_orbits.orbit_family.guess import GuessedFamily
from hillsphere_orbits.orbit_family.presentation import present_followed
from hillsphere_orbits.orbit_family.products import FollowedFamily
from hillsphere_orbits.orbit_family.specs import OrbitFamilySpec
from hillsphere_orbits.parameter_continuation import ParameterPath
from hillsphere_orbits.qso.families import Family
from hillsphere_orbits.stability import is_decoupled, stability_indices
from hillsphere_orbits.survey import LockedMoon, Surveyor, require_accuracy
from hillsphere_orbits.winding import require_motion

__all__ = ["FamilyProvider", "OrbitFamilyStage"]

_BEYOND = 1.02  # of the largest amplitude asked for: so that it is passed
_FAR = 4.0  # units of length
_TAYLOR = "re-propagated by Taylor series, independent of the step map that found them"


@runtime_checkable
class FamilyProvider(Contract, Protocol):
    """Interface of a family that can compute itself between two amplitudes."""

    @property
    def plant(self) -> Plant:
        """Equations of motion."""
        ...

    def family(self, low_m: float | None, high_m: float, members: int, /) -> Family:
        """Compute it between two amplitudes; without the smallest, from where it begins."""
        ...


class _Absent(NamedTuple):
    """A requested orbit that the family does not have: its name, the held quantity, and why."""

    name: str
    kind: str
    fault: str


class OrbitFamilyStage:
    """A family of periodic orbits and its members at prescribed values, continued in parameters.

    Parameters
    ----------
    spec : OrbitFamilySpec
        With its references bound.

    Raises
    ------
    InputError
        If the family does not know where it begins, or a parameter that is to vary is unknown.
    """

    def __init__(self, spec: OrbitFamilySpec) -> None:
        self.spec = spec
        self.source: FamilyProvider
        if spec.plant is not None:
            self.source = GuessedFamily(spec.plant.get(), spec.guess, spec.accuracy)
        else:
            family = spec.family.get() if spec.family else None
            if not isinstance(family, FamilyProvider):
                raise InputError(
                    f"a {type(family).__name__} does not say where it begins (it has no method "
                    "'family'); give the stage its plant and a guess instead"
                )
            self.source = family
        self.paths = self._paths()

    def run(self, ctx: Context) -> FollowedFamily:
        """Follow the family, find the members and carry them along the parameters.

        Parameters
        ----------
        ctx : Context
            Log and progress.

        Returns
        -------
        FollowedFamily
            Members, curve and ways.

        Raises
        ------
        InputError
            If the family has none of the orbits asked for; all are named. If it has some, the
            status of the others says so.
        ConvergenceError
            If the family cannot be followed, or an orbit does not keep the accuracy.
        """
        spec, plant = self.spec, self.source.plant
        advance = ctx.track("orbit family", 2)
        family = self.source.family(*self._range(), spec.curve_members)
        ctx.info(f"family over {family.method}; {family.problem.steps} sub-steps")
        ctx.info(f"its ends: {family.branch.ends[0]}; {family.branch.ends[1]}")
        advance(1)
        z, labels, kinds, absent = self._find_members(family)
        for orbit in absent:
            ctx.info(f"{orbit.name}: {orbit.fault}")
        surveyor = Surveyor(plant, family.problem)
        curve = surveyor.orbits(family.branch.z, ("",) * family.branch.size)
        require_accuracy(curve, spec.accuracy)
        require_motion(family.problem, family.branch.z, plant.scales.length_m)
        advance(1)
        arrival = self._arrival(ctx, family, z, kinds)
        kept = tuple(name for name, s in zip(labels, arrival.status, strict=True) if s == "reached")
        if arrival.problem is None:
            members = surveyor.orbits(z, labels)
        else:
            members = arrival.problem.orbits(arrival.z, kept)
        if kept:
            require_accuracy(members, spec.accuracy)
        unit = plant.scales.length_m
        moon = plant if isinstance(plant, LockedMoon) else None
        path = self.paths[-1] if self.paths else None
        return FollowedFamily(
            members=members,
            curve=curve,
            member_indices=_indices(members.monodromy),
            curve_indices=_indices(curve.monodromy),
            member_amplitude_m=family.amplitude(arrival.z[: len(z)])[0] * unit,
            curve_amplitude_m=family.amplitude(family.branch.z)[0] * unit,
            member_clearance=arrival.clearance,
            asked=(*labels, *(orbit.name for orbit in absent)),
            status=(*arrival.status, *(orbit.fault for orbit in absent)),
            held=(*kinds, *(orbit.kind for orbit in absent)) if path else (),
            held_value=np.append(arrival.held_value, [np.nan] * (len(absent) if path else 0)),
            parameters=path.names if path else (),
            parameter_start=path.start if path else np.empty(0),
            parameter_end=path.end if path else np.empty(0),
            way_orbit=arrival.way_orbit,
            way_fraction=arrival.way[-1] if path else np.empty(0),
            way_x0=arrival.way_x0,
            way_period_s=arrival.way_period * plant.scales.time_s,
            way_integral=arrival.way_integral,
            tracks_m=arrival.tracks * unit,
            method=family.method,
            check=_TAYLOR if path else surveyor.check,
            ends=family.branch.ends,
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )

    def present(self, product: FollowedFamily) -> Presentation:
        """Show members, curve and ways."""
        return present_followed(product, self.spec.label)

    def _arrival(self, ctx: Context, family: Family, z: Array, kinds: list[str]) -> Arrival:
        """Carry the members along, if parameters change."""
        spec = self.spec
        if not self.paths:
            return keep_members(family, z)
        advance = ctx.track("parameters", len(kinds) * len(self.paths))
        return continue_members(
            self.source.plant, family, z, kinds, self.paths, spec.method, spec.accuracy, advance
        )

    def _paths(self) -> tuple[ParameterPath, ...]:
        """Return the path, preceded by the one from the plant's own parameters to its start."""
        if not self.spec.vary:
            return ()
        plant = self.source.plant
        own = {q.name: q.value for q in plant.parameters()}
        start = {v.parameter: v.start for v in self.spec.vary if v.start is not None}
        path = ParameterPath.of(plant, {v.parameter: v.to for v in self.spec.vary}, start)
        here = np.array([own[name] for name in path.names])
        if np.array_equal(here, path.start):
            return (path,)
        return ParameterPath(path.names, here, path.start), path

    def _range(self) -> tuple[float | None, float]:
        """Return the amplitudes between which the family is followed."""
        spec, unit = self.spec, self.source.plant.scales.length_m
        low, high = spec.amplitude_min_m, spec.amplitude_max_m
        if low is None and spec.plant is not None:
            low = min(
                [0.5 * abs(spec.guess["x"]) * unit, *(a / _BEYOND for a in spec.amplitudes_m)]
            )
        if high is None:
            high = max((_BEYOND * a for a in spec.amplitudes_m), default=_FAR * unit)
            if spec.plant is not None:
                high = max(high if spec.amplitudes_m else 0.0, 2.0 * abs(spec.guess["x"]) * unit)
            elif spec.periods_s or spec.jacobi_constants:
                high = max(high, _FAR * unit)
        return low, high

    def _find_members(
        self, family: Family
    ) -> tuple[Array, tuple[str, ...], list[str], list[_Absent]]:
        """Find the requested orbits: unknowns, names, and the quantity that selects each.

        Those that are missing come last, by name with what there is instead; if all are, they are
        named in one error.
        """
        spec, scales = self.spec, self.source.plant.scales
        asked: list[tuple[str, str, str, float, Quantity, tuple[float, ...]]] = []
        if spec.amplitudes_m:
            asked.append(
                ("amplitude", "amplitude", " km", scales.length_m / 1e3, family.amplitude,
                 tuple(a / 1e3 for a in spec.amplitudes_m))
            )  # fmt: skip
        if spec.periods_s:
            asked.append(
                ("period", "T", " h", scales.time_s / HOUR_S, family.period,
                 tuple(t / HOUR_S for t in spec.periods_s))
            )  # fmt: skip
        if spec.jacobi_constants:
            asked.append(("jacobi", "C", "", 1.0, family.integral, spec.jacobi_constants))
        columns: list[Array] = []
        labels: list[str] = []
        kinds: list[str] = []
        missing: list[_Absent] = []
        for kind, symbol, unit, size, quantity, values in asked:
            members = members_at(family.problem, family.branch, quantity, np.array(values) / size)
            columns.append(members.z)
            labels += [f"{symbol} = {values[k]:.9g}{unit}" for k in members.target]
            kinds += [spec.hold or kind] * members.target.size
            span = quantity(family.branch.z)[0] * size
            for k in members.missing(len(values)):
                fault = (
                    f"the family has no such member; it has {span.min():.9g} to "
                    f"{span.max():.9g}{unit} and ends: {'; '.join(family.branch.ends)}"
                )
                missing.append(
                    _Absent(f"{symbol} = {values[k]:.9g}{unit}", spec.hold or kind, fault)
                )
        if not labels:
            raise InputError("; ".join(f"{orbit.name}: {orbit.fault}" for orbit in missing))
        return np.concatenate(columns, axis=1), _distinct(labels), kinds, missing


def _indices(monodromy: Array) -> Array:
    """Return both stability indices (2, N); where the planes mix, the larger one first."""
    pair = np.array(stability_indices(monodromy))
    return np.where(is_decoupled(monodromy), pair, np.sort(pair, axis=0)[::-1])


def _distinct(labels: list[str]) -> tuple[str, ...]:
    """Return the names, numbered where one stands several times."""
    names: list[str] = []
    for label in labels:
        count = sum(other.split(" #")[0] == label for other in names)
        names.append(f"{label} #{count + 1}" if count else label)
    return tuple(names)
