"""Spec of the stage ``reference_trajectories``: its keys in a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.engine.start_specs import StartFormsSpec
from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_guidance.site_specs import SiteSpec

__all__ = ["DepartureSpec", "DescentSpec", "ReferenceTrajectoriesSpec"]


class DepartureSpec(StartFormsSpec):
    """Where and when a descent begins."""

    examples = ({"position_km": [16.56, 0, 0], "others": {"true_anomaly": 0.0}},)

    position_m: tuple[float, ...] = quantity(
        "length", "positions in the plant's frame, in the order of its states", default=()
    )
    velocity_m_s: tuple[float, ...] = quantity(
        "speed",
        "velocities in the plant's frame, in the order of its states; left out: zero",
        default=(),
    )
    others: dict[str, float] = option(
        "values of states that are neither, by name, SI (true_anomaly = 0)", default={}
    )
    time_s: float = quantity("time", "time at the start", default=0.0)

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if not self.position_m and self.inertial is None and self.elements is None:
            raise rule("position_m", "where? give position_m (or _km), inertial or elements")
        return self


class DescentSpec(Spec):
    """A flight from a state to a landing site, or to another state."""

    examples = (
        {
            "name": "rt1",
            "start": {"position_km": [16.56, 0, 0], "others": {"true_anomaly": 0.0}},
            "site": {"latitude_deg": 12, "longitude_deg": 25},
            "touchdown_speed_m_s": 0.5,
            "duration_s": 7980,
        },
    )

    name: str = option(
        "name by which the descent is followed", pattern=r"^[A-Za-z0-9][A-Za-z0-9 ._-]{0,39}$"
    )
    start: DepartureSpec = option("where and when the descent begins")
    duration_s: float = quantity("time", "length of the flight", gt=0)
    site: SiteSpec | None = option(
        "where the descent lands; left out: end_position_m", default=None
    )
    touchdown_speed_m_s: float | None = quantity(
        "speed", "with a site: speed at its end, along the inward normal", default=None, ge=0
    )
    end_position_m: tuple[float, ...] = quantity(
        "length", "instead of a site: positions at the end, in the plant's frame", default=()
    )
    end_velocity_m_s: tuple[float, ...] = quantity(
        "speed", "with end_position: velocities at the end; left out: zero", default=()
    )

    @model_validator(mode="after")
    def _one_end(self) -> Self:
        if (self.site is None) == (not self.end_position_m):
            raise rule("site", "give one of site and end_position_m (or _km)")
        if (self.site is None) != (self.touchdown_speed_m_s is None):
            raise rule("touchdown_speed_m_s", "site and touchdown_speed_m_s belong together")
        if self.end_velocity_m_s and not self.end_position_m:
            raise rule("end_velocity_m_s", "it belongs to end_position_m, not to a site")
        return self


class ReferenceTrajectoriesSpec(StageSpec):
    """Descents planned by guidance in the full field of a plant, each with its command."""

    results = ResultNames(
        metrics=(
            "reference_trajectories",
            "replay_error",
            "replay_error_held",
        ),
        tables={
            "reference_trajectories": (),
            "reference_ends": (),
            "reference_differences": (),
        },
    )
    produces = "hillsphere_guidance.reference_trajectories.products:ReferenceTrajectories"
    provides = ("hillsphere.products:FlightSet",)
    examples = (
        {
            "plant": "hill",
            "guidance": "minimum_energy",
            "descents": [
                {
                    "name": "down",
                    "start": {"position_km": [24, 5, 2], "velocity_m_s": [0, 0, 0]},
                    "end_position_km": [16, 8, 1],
                    "end_velocity_m_s": [-0.3, 0.1, 0],
                    "duration_h": 2,
                }
            ],
            "step_s": 300,
            "compare": ["three_body"],
        },
    )

    plant: Ref = reference("plant", "equations of motion")
    guidance: Ref = reference("guidance", "what plans the flights")
    descents: tuple[DescentSpec, ...] = option("the flights", min_length=1, max_length=100)
    start_distances_m: tuple[float, ...] = quantity(
        "length",
        "every descent also from these distances from the centre, in the direction of its start, "
        "under names like 'rt1 from 20 km'",
        default=(),
        gt=0,
        max_length=100,
    )
    compare: tuple[Ref, ...] = reference(
        "plant",
        "the same motion by other plants, as with another gravity model: how much their "
        "accelerations differ along the paths; a flight by one of them is a closed_loop with that "
        "plant",
        default=(),
    )
    step_s: float = quantity(
        "time", "time for which each value of the command is held", default=10.0, gt=0
    )
    reference: DataPath | None = data_path(
        "CSV of published costs beside the computed ones: columns descent, dv_m_s", default=None
    )
    note: str = option("what a reader of the table must know", default="", max_length=500)
    label: str = option(
        "appended to the names of tables, figures and metrics, to tell two such stages apart",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )

    @model_validator(mode="after")
    def _names(self) -> Self:
        names = [descent.name for descent in self.descents]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise rule("descents", f"two descents are called {', '.join(twice)}")
        if len(self.descents) * (1 + len(self.start_distances_m)) > 1000:
            raise rule("start_distances_m", "more than 1000 descents in all")
        return self

    @model_validator(mode="after")
    def _compared_with_others(self) -> Self:
        seen = [self.plant]
        for ref in self.compare:
            if any(_same(ref, one) for one in seen):
                what = (
                    "is the plant itself, from which it cannot differ"
                    if _same(ref, self.plant)
                    else "is listed twice"
                )
                raise rule("compare", f"{ref.name!r} {what}; leave it out")
            seen.append(ref)
        return self


def _same(one: Ref, other: Ref) -> bool:
    """Return whether two references mean the same plant: by name, or the object if given one."""
    if one.target is not None or other.target is not None:
        return one.target is other.target
    return one.name == other.name
