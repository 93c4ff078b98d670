"""Spec of the stage ``nonlinear_stability``: the keys of a mission."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S
from hillsphere.spec import Ref, ResultNames, StageSpec, Vector3, option, quantity, reference, rule
from hillsphere_orbits.options import label
from hillsphere_orbits.source_specs import OrbitNeeds

__all__ = ["NonlinearStabilitySpec"]


class NonlinearStabilitySpec(StageSpec):
    """Largest offsets that periodic orbits survive, and survival of injection errors.

    An orbit is lost when |x|, |y| or, for an orbit in space, |z| passes its limit, or
    when it meets the surface of the body. An orbit that leaves the plane by less than a twentieth
    of its largest extent counts as planar.
    """

    results = ResultNames(
        metrics=(
            "survival_flights",
            "survival_integral_drift",
        ),
        tables={
            "nonlinear_stability": (),
            "survival_probability": (),
            "survival_edges": (),
            "nearby_resonances": (),
            "offset_fates": (),
        },
    )
    produces = "hillsphere_orbits.nonlinear_stability.products:NonlinearStability"
    examples = (
        {
            "plant": "hill",
            "needs": {"orbits": ["family"]},
            "duration_d": 1,
            "random_directions": 0,
            "doublings": 2,
            "scan": 2,
            "draws": 8,
        },
        {
            "plant": "hill",
            "needs": {"orbits": ["families"]},
            "velocity_offsets_cm_s": [[0, 10, 0], [0, -10, 0]],
            "phases": [0, 0.5],
        },
    )

    needs: OrbitNeeds = option("products of earlier stages: whose members are tried")
    plant: Ref = reference("plant", "equations of motion of the orbits")
    duration_s: float = quantity(
        "time", "for how long an orbit must not be lost", default=30 * DAY_S, gt=0
    )
    limit: float = option(
        "an orbit is lost beyond this many times its own largest |x|, |y| or, in space, |z|",
        default=2.0,
        gt=1,
        le=1000,
    )
    random_directions: int = option(
        "directions drawn on the sphere of position offsets, and as many on that of velocity "
        "offsets, beside those of the six axes, to either side",
        default=2,
        ge=0,
        le=1000,
    )
    position_max_m: float | None = quantity(
        "length",
        "largest position offset tried; left out: half the orbit's largest |x|",
        default=None,
        gt=0,
    )
    velocity_max_m_s: float | None = quantity(
        "speed",
        "largest velocity offset tried; left out: half the orbit's largest |x| per unit of time",
        default=None,
        gt=0,
    )
    doublings: int = option(
        "each direction is first tried with the largest offset halved so often, then twice that, "
        "and so on up to the largest",
        default=9,
        ge=0,
        le=30,
    )
    scan: int = option(
        "number of equal parts into which the range below the first loss is then divided",
        default=8,
        ge=1,
        le=10000,
    )
    sigma_position_m: float = quantity(
        "length", "injection error: standard deviation of the position per axis", default=100.0,
        ge=0,
    )  # fmt: skip
    sigma_velocity_m_s: float = quantity(
        "speed", "injection error: standard deviation of the velocity per axis", default=0.03, ge=0
    )
    draws: int = option(
        "injection errors drawn for each orbit and phase", default=200, ge=1, le=100_000
    )
    phases: tuple[float, ...] = option(
        "phases of injection, as parts of the orbit's period after its start",
        default=(0.0,),
        ge=0,
        lt=1,
        min_length=1,
    )
    confidence: float = option(
        "confidence of the interval of the survival probability", default=0.95, gt=0, lt=1
    )
    position_offsets_m: tuple[Vector3, ...] = quantity(
        "length", "offsets x, y, z at the start, each flown for its own fate", default=()
    )
    velocity_offsets_m_s: tuple[Vector3, ...] = quantity(
        "speed", "offsets ẋ, ẏ, ż at the start, each flown for its own fate", default=()
    )
    n_max: int = option(
        "resonances d:n up to this n are looked for near planar orbits of one revolution",
        default=9,
        ge=1,
        le=100,
    )
    resonance_distance_m: float = quantity(
        "length",
        "largest distance in amplitude x of a resonance near an orbit",
        default=2000.0,
        gt=0,
    )
    accuracy: float = option(
        "largest change of the integral of motion that a flight may show, relative to it or to "
        "one natural unit; flights that change it more are flown again with smaller steps",
        default=1e-5,
        ge=1e-9,
        le=1e-2,
    )
    label: str = label()

    @model_validator(mode="after")
    def _different(self) -> Self:
        for key in ("phases", "position_offsets_m", "velocity_offsets_m_s"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                text = "a value is listed twice"
                raise rule(key, text)
        return self
