"""The stage ``qso_family``: the family and its members at prescribed values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np

from hillsphere.base.constants import HOUR_S
from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.show.reference import ReferenceTable
from hillsphere_orbits.members import Quantity, members_at
from hillsphere_orbits.qso.families import Family, Qso
from hillsphere_orbits.qso.forecast import warn_of_slow_gravity
from hillsphere_orbits.qso.presentation import present_family
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.qso.specs import QsoFamilySpec, QsoSpec
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.stability import stability_indices
from hillsphere_orbits.survey import (
    LockedMoon,
    SeriesMoon,
    Surveyor,
    TruePrimary,
    extent,
    nearest,
    require_accuracy,
    tracks,
)
from hillsphere_orbits.winding import Winding, primary_distance, require_motion, require_smooth

__all__ = ["QsoFamilyStage", "family_of"]

_SAME_ORBIT_KM = 1e-6  # a published amplitude is a round number
_EVERY_POINT = 4
"""Of the points of a track, those at which the error of a series is measured: 60 an orbit, in 2 s
for 40 orbits about a shape of 20 000 faces."""
_FAR, _PRIMARY_SHARE = 4.0, 0.5
"""Largest amplitude where none is given: in units of length, there the attraction is 1/64 of the
tide; and of the primary's distance, since orbits that reach farther pass it ever more closely."""


@runtime_checkable
class QuasiSatelliteFamily(Contract, Protocol):
    """Interface of a family of quasi-satellite orbits for stages; `Qso` documents the members.

    The shooting problem (`hillsphere.interfaces.OrbitFamily.problem`) is needed too, but not looked
    for, which would compile its equations.
    """

    plant: Plant
    accuracy: float

    @property
    def winding(self) -> Winding:
        """How often members wind about the moon, and about the primary."""
        ...

    def family(
        self,
        x_min_m: float | None,
        x_max_m: float,
        members: int = 161,
        context: Context | None = None,
    ) -> Family:
        """Compute the family between two amplitudes."""
        ...


def _is_of_quasi_satellites(family: object) -> TypeGuard[Qso]:
    return isinstance(family, QuasiSatelliteFamily)


def family_of(plant: object | None, family: object | None, accuracy: float) -> Qso:
    """Return the family that a stage's Spec names, directly or by its plant."""
    if family is None:
        return Qso(QsoSpec.model_validate({"plant": plant, "accuracy": accuracy}))
    if not _is_of_quasi_satellites(family):
        raise InputError(
            "this stage needs a family of quasi-satellite orbits, as of type 'qso', got a "
            f"{type(family).__name__}"
        )
    return family


def _snap(x_m: Array, asked_m: Sequence[float]) -> None:
    """Replace amplitudes by the requested ones, which differ by the rounding of scaling."""
    for value in asked_m:
        x_m[np.abs(x_m - value) <= 4.0 * np.spacing(value)] = value


def _largest_gravity_error(plant: Plant, problem: Shooting, z: Array) -> float | None:
    """Return the largest relative error of a series along orbits (m, N), by the exact gravity."""
    if not isinstance(plant, SeriesMoon) or plant.gravity_holds_from_m is None:
        return None
    places = tracks(problem, z)[:, ::_EVERY_POINT] * plant.scales.length_m
    errors = plant.gravity_error(np.ascontiguousarray(places.reshape(3, -1)))
    return None if errors is None else float(errors.max())


class QsoFamilyStage:
    """The family of quasi-satellite orbits and its members at prescribed values.

    Parameters
    ----------
    spec : QsoFamilySpec
        With its references bound.
    """

    def __init__(self, spec: QsoFamilySpec) -> None:
        self.spec = spec
        self.qso = family_of(
            spec.plant.get() if spec.plant else None,
            spec.family.get() if spec.family else None,
            spec.accuracy,
        )
        self.reference = ReferenceTable.read(spec.reference) if spec.reference else None
        if spec.needs.compare is None:
            self._range(None)  # refuses an empty range
        warn_of_slow_gravity(self.qso.plant)

    def run(self, ctx: Context, compare: QsoFamily | None = None) -> QsoFamily:
        """Compute the family.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        compare : QsoFamily, optional
            Another family, whose range is taken where the Spec gives none.

        Returns
        -------
        QsoFamily
            Curve and members.

        Raises
        ------
        InputError
            If the family has none of the orbits asked for; all are named. If it has some, the
            others are named in `QsoFamily.missing`.
        ConvergenceError
            If the family cannot be followed, or an orbit does not keep the accuracy.
        """
        qso, spec = self.qso, self.spec
        low, high = self._range(compare)
        family = qso.family(low, high, spec.curve_members, ctx)
        advance = ctx.track("quasi-satellite orbits: members and checks", 4)
        problem = family.problem
        ctx.info(f"orbits found over {family.method}; {problem.steps} sub-steps")
        ctx.info(f"ends of the family: {family.branch.ends[0]}; {family.branch.ends[1]}")
        advance(1)
        z, labels, missing = self._members(family)
        for fault in missing:
            ctx.info(fault)
        advance(1)
        surveyor = Surveyor(qso.plant, problem)
        members = surveyor.orbits(z, labels)
        _snap(members.x0[0], spec.x_amplitudes_m)
        curve = surveyor.orbits(family.branch.z, ("",) * family.branch.size)
        advance(1)
        drift = surveyor.drift(z, spec.drift_revolutions)
        require_accuracy(curve, qso.accuracy)
        require_accuracy(members, qso.accuracy, drift)
        unit = qso.plant.scales.length_m
        require_motion(problem, z, unit)
        qso.winding.require(problem, z, unit, "quasi-satellite orbit", "ask for more curve_members")
        indices = np.array(stability_indices(curve.monodromy))
        require_smooth(indices, family.amplitude(family.branch.z)[0], unit)
        y_max, vx = extent(problem, z)
        advance(1)
        scales = qso.plant.scales
        moon = qso.plant if isinstance(qso.plant, LockedMoon) else None
        approximate = moon is not None and not isinstance(moon, TruePrimary)
        return QsoFamily(
            members=members,
            curve=curve,
            member_indices=np.array(stability_indices(members.monodromy)),
            curve_indices=indices,
            y_max_m=y_max * scales.length_m,
            vx_at_y_max_m_s=vx * scales.length_m / scales.time_s,
            tracks_m=tracks(problem, z) * scales.length_m,
            nearest_m=float(nearest(problem, family.branch.z) * scales.length_m),
            drift=drift,
            drift_revolutions=spec.drift_revolutions,
            name=spec.label.replace("_", " ") or (moon.gravity_name if moon else "this family"),
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
            primary_distance_m=moon.primary_distance_m if moon and approximate else None,
            series_radius_m=moon.series_radius_m if moon else None,
            gravity_error=_largest_gravity_error(qso.plant, problem, family.branch.z),
            method=family.method,
            check=surveyor.check,
            ends=family.branch.ends,
            missing=missing,
        )

    def present(self, product: QsoFamily, compare: QsoFamily | None = None) -> Presentation:
        """Show table, figures and checks, beside published values where the Spec cites them."""
        return present_family(product, compare, self.reference, self.spec.label)

    def _range(self, compare: QsoFamily | None) -> tuple[float | None, float]:
        spec = self.spec
        low, high = spec.x_min_m, spec.x_max_m
        asked = max(spec.x_amplitudes_m, default=0.0)
        if compare is not None:
            x = compare.curve.x0[0]
            low = float(x.min()) if low is None else low
            high = max(float(x.max()), asked) if high is None else high
        if high is None:
            distance = primary_distance(self.qso.plant)
            far = _FAR if distance is None else min(_FAR, _PRIMARY_SHARE * distance)
            high = max(far * self.qso.plant.scales.length_m, 1.05 * asked)
        if low is not None and low >= high:
            raise InputError(
                f"the range of amplitudes is empty: x_min {low / 1e3:.6g} km, "
                f"x_max {high / 1e3:.6g} km"
            )
        return low, high

    def _members(self, family: Family) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
        """Find the requested members; report the missing ones with the family's nearest values."""
        spec, scales = self.spec, self.qso.plant.scales
        asked: list[tuple[str, str, float, Quantity, tuple[float, ...]]] = [
            ("x", " km", scales.length_m / 1e3, family.amplitude,
             tuple(x / 1e3 for x in spec.x_amplitudes_m)),
            ("T", " h", scales.time_s / HOUR_S, family.period,
             tuple(t / HOUR_S for t in spec.periods_s)),
        ]  # fmt: skip
        if spec.jacobi_constants:
            asked.append(("C", "", 1.0, family.integral, spec.jacobi_constants))
        columns: list[Array] = []
        labels: list[str] = []
        missing: list[str] = []
        for symbol, unit, size, quantity, values in asked:
            if not values:
                continue
            members = members_at(family.problem, family.branch, quantity, np.array(values) / size)
            columns.append(members.z)
            labels.extend(f"{symbol} = {values[k]:.9g}{unit}" for k in members.target)
            if lost := members.missing(len(values)):
                span = quantity(family.branch.z)[0] * size
                missing.append(
                    f"{symbol} = {', '.join(f'{values[k]:.9g}' for k in lost)}{unit} (it has "
                    f"{span.min():.9g} to {span.max():.9g}{unit})"
                )
        z = np.concatenate(columns, axis=1)
        faults: tuple[str, ...] = ()
        if missing:
            inner = family.amplitude(family.branch.z)[0][-1] * scales.length_m / 1e3
            faults = (
                f"the family has no member with {'; '.join(missing)}; its ends: "
                f"{family.branch.ends[0]}; {family.branch.ends[1]} ({inner:.6g} km)",
            )
            if not labels:
                raise InputError(faults[0])
        return (
            z,
            self._label_members(family.amplitude(z)[0] * scales.length_m / 1e3, labels),
            faults,
        )

    def _label_members(self, x_km: Array, labels: list[str]) -> tuple[str, ...]:
        """Return the published names where available, else the labels, made unique."""
        published: Mapping[int, str] = {}
        if self.reference is not None and {"x0_km", "name"} <= set(self.reference.columns):
            rows = (self.reference.match("x0_km", float(x), _SAME_ORBIT_KM) for x in x_km)
            published = {i: str(row["name"]) for i, row in enumerate(rows) if row}
        names: list[str] = []
        for i, label in enumerate(labels):
            name = published.get(i, label)
            count = sum(other.split(" #")[0] == name for other in names)
            names.append(f"{name} #{count + 1}" if count else name)
        return tuple(names)
