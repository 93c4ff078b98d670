"""Spec of the stage ``closed_loop``: what a mission may write."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

from pydantic import model_validator

from hillsphere.engine import flight_metrics
from hillsphere.engine.start_specs import StartSpec
from hillsphere.spec import (
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    need,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_flight.metrics import LANDING_METRICS, METRICS

__all__ = [
    "ActuatorSpec",
    "ClosedLoopNeeds",
    "ClosedLoopSpec",
    "LimitsSpec",
    "NavigationSpec",
    "RequirementsSpec",
    "TargetSpec",
]

MOST_SAMPLES = 10_000_000
"""Samples of a flight at most: histories of so many already fill gigabytes."""


class ClosedLoopNeeds(Spec):
    """Products of earlier stages that ``closed_loop`` takes."""

    reference: Ref | None = need(
        "hillsphere.products:FlightSet",
        "a trajectory that is followed, with its command, if it has one, added to the law's, also "
        "where it changes between samples",
        default=None,
    )
    controller: Ref | None = need(
        "hillsphere.products:ControlDesign",
        "the controller of a law that waits for one, from a synthesis",
        default=None,
    )


class TargetSpec(Spec):
    """A state that is held."""

    position_m: tuple[float, ...] | None = quantity(
        "length",
        "positions, one per state that is a length; left out: those at the start",
        default=None,
        min_length=1,
    )
    velocity_m_s: tuple[float, ...] | None = quantity(
        "speed",
        "velocities, one per state that is a velocity; left out: zero",
        default=None,
        min_length=1,
    )


class NavigationSpec(Spec):
    """Errors of the states that the law sees, independent for each axis."""

    position_m: float = quantity("length", "standard deviation of each position", default=0.0, ge=0)
    velocity_m_s: float = quantity(
        "speed", "standard deviation of each velocity", default=0.0, ge=0
    )
    correlation_time_s: float = quantity(
        "time",
        "correlation time of the errors (first-order Gauss-Markov process); zero: errors are "
        "independent from sample to sample",
        default=0.0,
        ge=0,
    )


class ActuatorSpec(Spec):
    """Limits and execution errors of the thrust, for each thrust vector on its own."""

    magnitude: float = option(
        "relative standard deviation of the magnitude, drawn anew at each sample",
        default=0.0,
        ge=0,
        lt=1,
    )
    pointing_rad: float = quantity(
        "angle",
        "standard deviation of the direction about each axis normal to the command, drawn anew at "
        "each sample",
        default=0.0,
        ge=0,
        lt=1,
    )
    minimum_acceleration_m_s2: float = quantity(
        "acceleration", "held laws: a smaller command is not executed", default=0.0, ge=0
    )
    maximum_acceleration_m_s2: float | None = quantity(
        "acceleration", "held laws: a larger command is cut to this", default=None, gt=0
    )
    quantum_acceleration_m_s2: float = quantity(
        "acceleration", "held laws: commands are rounded to multiples of this", default=0.0, ge=0
    )
    minimum_impulse_m_s: float = quantity(
        "speed", "impulsive laws: a smaller impulse is not executed", default=0.0, ge=0
    )
    maximum_impulse_m_s: float | None = quantity(
        "speed", "impulsive laws: a larger impulse is cut to this", default=None, gt=0
    )
    quantum_impulse_m_s: float = quantity(
        "speed", "impulsive laws: impulses are rounded to multiples of this", default=0.0, ge=0
    )


class LimitsSpec(Spec):
    """Limits that end a flight, beside the events of the plant (impact, escape)."""

    position_error_m: float | None = quantity(
        "length", "largest distance from the reference (a tube about it)", default=None, gt=0
    )
    velocity_error_m_s: float | None = quantity(
        "speed", "largest difference in velocity from the reference", default=None, gt=0
    )
    distance_min_m: float | None = quantity(
        "length", "smallest distance from the centre of the plant's frame", default=None, gt=0
    )
    distance_max_m: float | None = quantity(
        "length", "largest distance from the centre of the plant's frame", default=None, gt=0
    )
    dv_m_s: float | None = quantity("speed", "Δv budget", default=None, ge=0)


if TYPE_CHECKING:
    RequirementsSpec = flight_metrics.RequirementsSpec
else:
    RequirementsSpec = flight_metrics.requirements_spec(
        "RequirementsSpec", __name__, (*METRICS, *LANDING_METRICS)
    )


class ClosedLoopSpec(StageSpec):
    """A plant under a law that follows a reference: flown once, or repeated by a campaign.

    The inputs that may differ from case to case, to be dispersed or swept, are: the parameters of
    the plant; ``state.NAME`` (the start) or ``offset.NAME`` (added to it) of each state;
    ``start_time``; ``dv_budget`` where one is given; ``actuator.scale``; for each row of the
    command ``actuator.gain.ROW`` (effectiveness) and ``actuator.turn.ROW`` (misalignment about that
    axis, rad); and ``actuator.coupling`` (the part of each component that is added to the other
    components of its thrust vector). Those of the actuator are constant over a flight and apply to
    the whole command, the reference's included.
    """

    results = ResultNames(
        metrics=("closed_loop_*",),
        tables={
            "closed_loop": (),
        },
    )
    produces = "hillsphere_flight.products:ClosedLoopFlight"
    provides = ("hillsphere.products:Flown",)
    course = ("plant", "needs.reference", "follow", "target", "duration_s", "samples")
    examples = (
        {
            "plant": "hill",
            "law": "hover",
            "target": {"position_km": [0, 300, 0]},
            "samples": 2,
            "substeps": 50,
            "navigation": {"position_m": 5, "velocity_mm_s": 1},
            "actuator": {"magnitude": 0.01, "pointing_deg": 0.5},
            "limits": {"distance_max_km": 1000, "dv_m_s": 1000},
        },
        {
            "plant": "hill",
            "law": "tracking",
            "needs": {"reference": "descent"},
            "success": ["impact"],
            "overtime_min": 5,
            "tolerance": 1e-9,
            "limits": {"position_error_m": 500, "dv_m_s": 30},
            "require": {
                "final_velocity_error_m_s": 0.2,
                "touchdown_speed_m_s": 1,
                "landing_miss_m": 100,
                "early_min": 1,
                "late_min": 2,
            },
        },
    )

    needs: ClosedLoopNeeds = option("products of earlier stages", default=ClosedLoopNeeds())
    plant: Ref = reference("plant", "equations of motion")
    law: Ref = reference("compensator", "control law")
    follow: str = option(
        "with needs.reference: name of the trajectory in it that is followed; left out: the only "
        "one",
        default="",
    )
    design: int = option(
        "with needs.controller: which controller of the synthesis; 1: the one that it took, 2 and "
        "further: those at which its other searches ended, the best first",
        default=1, ge=1, le=1000,
    )  # fmt: skip
    target: TargetSpec | None = option(
        "state that is held; left out: what needs.reference gives, or else the place of the start",
        default=None,
    )
    start: StartSpec = option("where and when the flight begins", default=StartSpec())
    sees: tuple[str, ...] = option(
        "names of the states that the law sees, in its order; left out: all positions and "
        "velocities (all states, for a law that measures them continuously)",
        default=(),
    )
    duration_s: float | None = quantity(
        "time",
        "how long a flight lasts, rounded up to whole periods of the law; left out: samples, or as "
        "long as the reference",
        default=None,
        gt=0,
    )
    samples: int | None = option(
        "number of samples at which the law acts, instead of a duration",
        default=None,
        ge=1,
        le=MOST_SAMPLES,
    )
    overtime_s: float = quantity(
        "time",
        "how much longer than its reference a flight may last that has not ended by then, as a "
        "landing that still is above the ground: the reference goes on at the velocity of its end "
        "and the law follows it; the largest errors and commands are those until the reference's "
        "end",
        default=0.0,
        ge=0,
    )
    overtime_command: Literal["held", "zero"] = option(
        "with overtime_s: the reference's command beyond its end", default="held"
    )
    method: Literal["rk6", "dop853"] = option("formula of the step map", default="dop853")
    substeps: int = option(
        "steps of the step map between two samples; events are decided between "
        "their ends too; a reference's command that changes in between has at least one for each "
        "of its steps",
        default=1,
        ge=1,
        le=100_000,
    )
    tolerance: float | None = option(
        "check every leg against twice as many steps, doubled until they differ by less, in the "
        "plant's natural units; three times the work or more; left out: not checked",
        default=None,
        gt=0,
    )
    most_substeps: int = option("with tolerance: the most steps", default=1024, ge=2, le=1_000_000)
    navigation: NavigationSpec = option(
        "errors of the states that the law sees; left out: none", default=NavigationSpec()
    )
    actuator: ActuatorSpec | None = option(
        "limits and execution errors of the thrust; left out: none", default=None
    )
    limits: LimitsSpec = option("limits that end a flight early", default=LimitsSpec())
    largest_step_error: float = option(
        "estimated step error, in the plant's natural units, beyond which a flight is undecided, "
        "neither success nor failure; where a smaller one could turn what is required, a flight "
        "with half the steps decides it, or leaves it undecided",
        # With a thousandth of the plant's natural size no metric has three digits left, which are
        # the fewest that tables show; what is required is guarded by its own margin.
        default=1e-3,
        gt=0,
    )
    success: tuple[Literal["completed", "impact", "escape", "constraint", "propellant"], ...] = (
        option(
            "how a flight may end that has not failed: after its last sample, or for a landing "
            "with 'impact'",
            default=("completed",),
            min_length=1,
        )
    )
    require: RequirementsSpec = option(
        "largest metric values; a flight that exceeds one has failed", default=RequirementsSpec()
    )
    errors_from_s: float = quantity(
        "time",
        "time since the start from which the largest errors count, to leave out how an error of "
        "the start is brought in",
        default=0.0,
        ge=0,
    )
    flight_inputs: dict[str, float] = option(
        "inputs by name, SI, with which this stage's own flight differs from nominal "
        "('plant.gravity.C2,0', 'actuator.coupling'), to show what the law has to do; campaigns "
        "that repeat the stage do not use them",
        default={},
    )
    label: str = option(
        "appended to the names of tables, figures and metrics, to tell two such stages apart",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )

    @model_validator(mode="after")
    def _something_to_follow(self) -> Self:
        given = self.needs.reference is not None
        if given and self.target is not None:
            raise rule("target", "needs.reference is followed already; give one of the two")
        if self.follow and not given:
            raise rule("follow", "it names a trajectory of needs.reference, which is not given")
        place = self.target.position_m if self.target else None
        given_start = self.start
        start = (
            given_start.position_m
            or given_start.inertial
            or given_start.elements
            or given_start.message
        )
        if not given and place is None and start is None:
            raise rule("target", "where? give target.position_m, start.position_m or both")
        if self.duration_s is not None and self.samples is not None:
            raise rule("samples", "the duration says it already; give one of the two")
        if self.duration_s is None and self.samples is None and not given:
            raise rule("duration_s", "how long? give a duration or the number of samples")
        if self.overtime_s and not given:
            raise rule("overtime_s", "a state that is held has no end; leave it out")
        if self.overtime_s and (self.duration_s is not None or self.samples is not None):
            key = "samples" if self.duration_s is None else "duration_s"
            raise rule(key, "with overtime_s a flight lasts as long as its reference, and longer")
        if not self.overtime_s:
            if self.overtime_command != "held":  # also a spec made anew from all of another one
                raise rule("overtime_command", "there is no overtime_s; leave it out")
            if self.require.limit("late_s") is not None:
                raise rule("require", "late_s: no flight ends later without overtime_s")
        lands = given and "impact" in self.success
        if self.require.limit("landing_miss_m") is not None and not lands:
            raise rule(
                "require",
                "landing_miss_m: flights that land follow a needs.reference, with 'impact' among "
                "success",
            )
        if self.tolerance is not None and self.most_substeps < 2 * self.substeps:
            raise rule("most_substeps", "must be at least twice substeps")
        for key in ("sees", "success"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a value is listed twice")
        return self
