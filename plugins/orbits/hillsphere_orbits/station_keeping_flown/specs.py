"""Spec of the stage ``station_keeping_flown``: the keys of a mission."""

from __future__ import annotations

from math import pi
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.base.constants import DAY_S, HOUR_S
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
from hillsphere_orbits.options import label

__all__ = ["StationKeepingFlownNeeds", "StationKeepingFlownSpec"]


class StationKeepingFlownNeeds(Spec):
    """Products of earlier stages that ``station_keeping_flown`` takes."""

    orbits: tuple[Ref, ...] = need(
        "hillsphere.products:OrbitSet", "periodic orbits that are to be held", default=()
    )
    flights: tuple[Ref, ...] = need(
        "hillsphere.products:FlightSet",
        "other trajectories of the plant that are to be held: each coast is a reference",
        default=(),
    )
    ladder: Ref | None = need(
        "hillsphere_orbits.fidelity_ladder.products:FidelityLadder",
        "orbits carried over to the plant, which is one of its rungs",
        default=None,
    )
    index: Ref | None = need(
        "hillsphere_orbits.spatial_qso_families.products:StationKeepingIndex",
        "analytic index, shown beside the simulated cost",
        default=None,
    )


class StationKeepingFlownSpec(StageSpec):
    """Station-keeping flown in the closed loop: strategies, correction intervals, survival, cost.

    A flight is lost when |x|, |y| or, for an orbit in space, |z| passes its limit, when it is too
    far from its reference, or when it meets the surface of the body.
    """

    results = ResultNames(
        metrics=(
            "station_keeping_references",
            "station_keeping_held",
        ),
        tables={
            "station_keeping_flown": (),
            "station_keeping_longest": (),
        },
    )
    produces = "hillsphere_orbits.station_keeping_flown.products:StationKeepingFlown"
    examples = (
        {
            "plant": "hill",
            "needs": {"orbits": ["family"]},
            "intervals_h": [12],
            "once_per_period": False,
            "strategies": ["periodic_lqr"],
            "cases": 4,
            "tuning_cases": 0,
            "duration_d": 1,
        },
        {
            "plant": "hill",
            "needs": {"orbits": ["families"], "index": "index"},
            "intervals_h": [6, 12, 24, 48],
            "cases": 64,
            "distance_max_km": 20,
        },
        {
            "plant": "elliptic",
            "needs": {"ladder": "ladder"},
            "rung": "elliptic",
            "once_per_period": False,
        },
    )

    needs: StationKeepingFlownNeeds = option("products of earlier stages")
    plant: Ref = reference("plant", "equations of motion of the orbits and flights")
    rung: str = option(
        "with needs.ladder: name of the rung whose flights are held, that of the plant", default=""
    )
    members: tuple[str, ...] = option(
        "names of the orbits and flights that are held; left out: all", default=()
    )
    duration_s: float = quantity(
        "time", "for how long every orbit is held", default=30 * DAY_S, gt=0
    )
    strategies: tuple[
        Literal[
            "floquet_mode",
            "target_point",
            "periodic_lqr",
            "phase_free_target_point",
            "phase_free_lqr",
        ],
        ...,
    ] = option(
        "what is flown: 'floquet_mode' nulls the unstable component with the smallest impulse; "
        "'target_point' weighs the impulse against the deviations at later times; 'periodic_lqr' "
        "is the linear-quadratic regulator along the orbit; 'phase_free_target_point' and "
        "'phase_free_lqr' do the same with the deviation from the nearest point of the orbit, "
        "and ignore deviations along it",
        default=(
            "floquet_mode",
            "target_point",
            "periodic_lqr",
            "phase_free_target_point",
            "phase_free_lqr",
        ),
        min_length=1,
    )
    intervals_s: tuple[float, ...] = quantity(
        "time",
        "times between corrections that are tried",
        default=(6 * HOUR_S, 12 * HOUR_S, 24 * HOUR_S, 48 * HOUR_S),
        ge=600.0,
    )
    once_per_period: bool = option(
        "whether one correction per period of the orbit is tried too", default=True
    )
    cases: int = option("flights of each combination", default=64, ge=1, le=100_000)
    injection_position_m: float = quantity(
        "length", "standard deviation per axis of the position at the start", default=100.0, ge=0
    )
    injection_velocity_m_s: float = quantity(
        "speed", "standard deviation per axis of the velocity at the start", default=0.03, ge=0
    )
    navigation_position_m: float = quantity(
        "length",
        "standard deviation per axis of the navigation error in position at each correction",
        default=30.0,
        ge=0,
    )
    navigation_velocity_m_s: float = quantity(
        "speed",
        "standard deviation per axis of the navigation error in velocity at each correction",
        default=0.01,
        ge=0,
    )
    execution_magnitude: float = option(
        "standard deviation of the size of an impulse, as a fraction", default=0.01, ge=0, lt=1
    )
    execution_pointing_rad: float = quantity(
        "angle",
        "standard deviation of the direction of an impulse, about each axis",
        default=0.5 * pi / 180.0,
        ge=0,
        lt=1,
    )
    minimum_impulse_m_s: float = quantity(
        "speed", "a smaller impulse is not done", default=0.001, ge=0
    )
    limit_factor: float = option(
        "a flight is lost beyond this many times the reference's largest |x|, |y| or |z|",
        default=2.0,
        gt=1,
        le=1000,
    )
    distance_max_m: float | None = quantity(
        "length",
        "a flight is lost beyond this distance from the reference at the time, too; left out: none",
        default=None,
        gt=0,
    )
    tolerable_position_m: float = quantity(
        "length",
        "for all strategies but 'floquet_mode': a deviation in position that weighs as much as "
        "the tolerable impulse",
        default=3000.0,
        gt=0,
    )
    tolerable_velocity_m_s: float = quantity(
        "speed",
        "for the regulators: a deviation in velocity that weighs as much as the tolerable impulse",
        default=1.0,
        gt=0,
    )  # fmt: skip
    tolerable_impulse_m_s: float = quantity(
        "speed",
        "for all strategies but 'floquet_mode': impulse that weighs as much as the tolerable "
        "deviations",
        default=0.1,
        gt=0,
    )
    targets: tuple[int, ...] = option(
        "for target points: how many intervals after the correction the deviations count",
        default=(1, 2, 3, 4),
        ge=1,
        le=1000,
        min_length=1,
    )
    tuning_cases: int = option(
        "flights, with errors of their own, by which the weights of each strategy are chosen for "
        "each orbit and interval, starting from the tolerable sizes above; 0: these are taken",
        default=32,
        ge=0,
        le=100_000,
    )
    survival_required: float = option(
        "survival probability from which an interval counts as flyable", default=0.99, gt=0, le=1
    )
    confidence: float = option(
        "confidence of the interval of the survival probability", default=0.95, gt=0, lt=1
    )
    label: str = label()

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not (self.needs.orbits or self.needs.flights or self.needs.ladder):
            text = "nothing to hold; name stages as needs.orbits, needs.flights or needs.ladder"
            raise rule("needs", text)
        if bool(self.needs.ladder) != bool(self.rung):
            raise rule("rung", "needs.ladder and rung go together; give both or neither")
        if not self.intervals_s and not self.once_per_period:
            raise rule("intervals_s", "no interval is asked for; name one or set once_per_period")
        for key in ("members", "strategies", "intervals_s", "targets"):
            values = getattr(self, key)
            if len(set(values)) < len(values):
                raise rule(key, "a value is listed twice")
        return self
