"""Specs of the stages on families of orbits in space: the keys of a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S
from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_orbits.options import VARY_INSTEAD, label
from hillsphere_orbits.qso.specs import read_resonance

__all__ = [
    "SpatialFamiliesNeeds",
    "SpatialFamiliesSpec",
    "StationKeepingNeeds",
    "StationKeepingSpec",
]

_FAMILIES = "hillsphere_orbits.spatial_qso_families.products:SpatialFamilies"


class SpatialFamiliesNeeds(Spec):
    """Products of earlier stages that ``spatial_qso_families`` uses."""

    bifurcations: Ref = need(
        "hillsphere.products:Bifurcations",
        "bifurcations at which the families branch off: the vertical ones",
    )


class SpatialFamiliesSpec(StageSpec):
    """Families of orbits in space that branch off at vertical bifurcations.

    The amplitude of orbits that start with z ≠ 0 on the plane xz is z there; that of others, which
    start on the x axis or on the plane yz, is the largest z of the orbit.
    """

    instead_of_repeating = VARY_INSTEAD
    results = ResultNames(
        metrics=(
            "closure_max",
            "closure_over_lambda_max",
            "half_closure_max",
            "families",
            "families_not_followed",
            "stable_members",
        ),
        tables={
            "spatial_families": (),
            "spatial_members": (),
            "stability_windows": (),
            "secondary_bifurcations": (),
        },
    )
    produces = _FAMILIES
    provides = ("hillsphere.products:OrbitSet",)
    examples = (
        {
            "plant": "hill",
            "needs": {"bifurcations": "bifurcations"},
            "resonances": ["1:5"],
            "z_amplitudes_km": [2],
        },
        {
            "plant": "hill",
            "needs": {"bifurcations": "bifurcations"},
            "z_amplitudes_km": [1, 2],
            "z_max_km": 3,
            "branch": "velocity",
        },
    )

    needs: SpatialFamiliesNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion of the bifurcations")
    resonances: tuple[str, ...] = option(
        "which vertical bifurcations d:n to start from; left out: all that were found", default=()
    )
    branch: Literal["position", "velocity", "companion"] = option(
        'which of the two families of a bifurcation: "position" starts with z ≠ 0 and ż = 0 at '
        'x > 0, "velocity" with z = 0 and ż ≠ 0 (for even n that can be the same family), '
        '"companion" is always the other one than "position"',
        default="position",
    )
    z_amplitudes_m: tuple[float, ...] = quantity(
        "length", "orbits asked for, by amplitude, of every family", gt=0
    )
    z_max_m: float | None = quantity(
        "length",
        "amplitude up to which the families are followed; left out: the largest one asked for",
        default=None,
        gt=0,
    )
    label: str = label()

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for text in self.resonances:
            if read_resonance(text) is None:
                text = f"expected d:n such as '1:17', got {text[:40]!r}"
                raise rule("resonances", text)
        if len(set(self.resonances)) < len(self.resonances):
            raise rule("resonances", "a resonance is listed twice")
        if not self.z_amplitudes_m:
            raise rule("z_amplitudes_m", "no orbit is asked for; give z_amplitudes_km")
        if len(set(self.z_amplitudes_m)) < len(self.z_amplitudes_m):
            raise rule("z_amplitudes_m", "a value is listed twice")
        beyond = [f"{z / 1e3:g} km" for z in self.z_amplitudes_m if z > (self.z_max_m or z)]
        if beyond:
            raise rule("z_amplitudes_m", f"larger than z_max: {', '.join(beyond)}")
        return self


class StationKeepingNeeds(Spec):
    """Products of earlier stages that ``station_keeping_index`` uses."""

    families: Ref = need(_FAMILIES, "the families whose members are judged")


class StationKeepingSpec(StageSpec):
    """Analytic cost of nulling the unstable component once per period."""

    results = ResultNames(
        metrics=(
            "stable_members",
            "v_cm_least",
            "v_cm_largest",
        ),
        tables={
            "table_3": (),
            "table_3_differences": (),
        },
    )
    produces = "hillsphere_orbits.spatial_qso_families.products:StationKeepingIndex"
    examples = ({"needs": {"families": "families"}},)

    needs: StationKeepingNeeds = option("products of earlier stages")
    sigma_position_m: float = quantity(
        "length", "standard deviation of the position per axis", default=100.0, ge=0
    )
    sigma_velocity_m_s: float = quantity(
        "speed", "standard deviation of the velocity per axis", default=0.03, ge=0
    )
    sigmas: float = option("how many standard deviations are covered", default=3.0, gt=0)
    duration_s: float = quantity(
        "time", "time over which the corrections are added up", default=30 * DAY_S, gt=0
    )
    reference: DataPath | None = data_path(
        "cited CSV of published costs with the columns n, Az_km and v_cm_m_s, shown beside ours; "
        "an empty cell stands for a member without a published cost",
        default=None,
    )
    label: str = label("names of the table, figure and metrics")
