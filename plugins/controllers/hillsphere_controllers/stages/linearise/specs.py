"""Spec of the stage ``linearise``: keys of its table in a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

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

__all__ = ["LineariseNeeds", "LineariseSpec"]


class LineariseNeeds(Spec):
    """Products of earlier stages that ``linearise`` takes."""

    reference: Ref = need("hillsphere.products:FlightSet", "a trajectory, with its command if any")


class LineariseSpec(StageSpec):
    """Linear models of a plant at points of a trajectory, at several values of its parameters.

    Inputs ``a`` (the plant's controls) and, with dispersions, ``d`` (what they make an unknown
    acceleration, one standard deviation each); outputs ``r`` and ``v`` (deviations of positions and
    velocities), all SI. Other states, such as a true anomaly, go on as on the trajectory.
    """

    results = ResultNames(
        metrics=(
            "linearised_models",
            "linearised_abscissa",
            "linearised_disturbance",
        ),
        tables={
            "linearised_points": (),
            "linearised_influence": (),
        },
    )
    produces = "hillsphere_controllers.stages.linearise.products:LinearisedFlight"
    provides = ("hillsphere_controllers.linear_products:LinearModels",)
    examples = (
        {"plant": "hill", "needs": {"reference": "reference_trajectories"}, "points": 2},
        {
            "plant": "hill",
            "needs": {"reference": "reference_trajectories"},
            "follow": "rt1",
            "command_error": 0.05,
        },
        {
            "plant": "hill",
            "needs": {"reference": "reference_trajectories"},
            "times_s": [0, 600, 1200],
        },
    )

    needs: LineariseNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion, in the frame of the trajectory")
    follow: str = option(
        "name of the trajectory in needs.reference; left out: the only one", default=""
    )
    points: int = option(
        "so many points, at equal steps of time up to the end; the start is none of them",
        default=10, ge=1, le=200,
    )  # fmt: skip
    times_s: tuple[float, ...] = quantity(
        "time",
        "times of the points since the trajectory's start, instead of points",
        default=(),
        ge=0,
    )
    start_time_s: float = quantity(
        "time", "time at the start of the trajectory, for a plant whose equations depend on it",
        default=0.0,
    )  # fmt: skip
    dispersions: tuple[Ref, ...] = reference(
        "dispersions", "distributions of parameters of the plant and of its models", default=()
    )
    sigmas: float = option(
        "how many standard deviations from nominal models are made", default=3.0, gt=0
    )
    corners: int = option(
        "pairs of opposite random corners of these bounds at which models are made besides, to "
        "check that the parameters' effects add up, or to fit them if they do not",
        default=1, ge=0, le=1000,
    )  # fmt: skip
    command_error: float = option(
        "standard deviation of each component of the trajectory's command, as a fraction of it; "
        "counted among the unknown accelerations",
        default=0.0, ge=0, lt=1,
    )  # fmt: skip

    @model_validator(mode="after")
    def _points_or_times(self) -> Self:
        if self.times_s and "points" in self.model_fields_set:
            raise rule("times_s", "points says it already; give one of the two")
        if len(set(self.times_s)) < len(self.times_s):
            raise rule("times_s", "a time is listed twice")
        return self
