"""Specs of the stage ``navigation``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.engine.start_specs import StartSpec
from hillsphere.spec import (
    Pair,
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
from hillsphere_estimators.sensor_fit import noiseless, two_dates, unseen

__all__ = [
    "AttitudeSpec",
    "BeliefSpec",
    "BiasSpec",
    "NavigationNeeds",
    "NavigationSpec",
    "OutageSpec",
    "TruthSpec",
]


OWN = ("acceleration", "thrust")
"""Biases of the motion, not of a sensor."""


class NavigationNeeds(Spec):
    """Products of earlier stages that ``navigation`` takes."""

    examples = ({},)

    reference: Ref | None = need(
        "hillsphere.products:FlightSet", "a trajectory that is followed", default=None
    )
    belief: Ref | None = need(
        "hillsphere_estimators.initialisation.products:StartingBelief",
        "beliefs before the first measurement, with their true states, instead of start and "
        "belief: one for each case in turn, fits that did not converge left out. Flights begin at "
        "their time, on the reference at that time or, without one, holding the mean position",
        default=None,
    )


_VELOCITY = 1e-3
"""Standard deviation of a velocity, m/s, where a mission states none."""


class BeliefSpec(Spec):
    """How well the start is known: standard deviations axis by axis, or a message's covariance."""

    examples = (
        {"position_relative": 0.1, "velocity_mm_s": 1},
        {"position_m": 50},
        {"source": "message", "off": "estimate"},
    )

    source: Literal["stated", "message"] = option(
        "'stated': standard deviations as below, of a position the larger of two; 'message': the "
        "covariance that start.message states, in the plant's frame",
        default="stated",
    )

    position_relative: float = option(
        "standard deviation of each position as a part of its spacecraft's distance from the "
        "origin",
        default=0.0, ge=0,
    )  # fmt: skip
    position_m: float = quantity("length", "standard deviation of each position", default=0.0, ge=0)
    velocity_m_s: float = quantity(
        "speed", "standard deviation of each velocity", default=_VELOCITY, gt=0
    )
    off: Literal["truth", "estimate"] = option(
        "what differs at random from the planned start: the truth (the estimate begins there), or "
        "the estimate",
        default="truth",
    )

    @model_validator(mode="after")
    def _some_position(self) -> Self:
        if self.source == "message":
            if self.position_relative or self.position_m or self.velocity_m_s != _VELOCITY:
                text = "the message states the covariance; give no standard deviations"
                raise rule("source", text)
            return self
        if not (self.position_relative or self.position_m):
            raise rule("position_m", "give position_m or position_relative: zero is no belief")
        return self


class TruthSpec(Spec):
    """Differences between the true world and the filter's model."""

    examples = (
        {},
        {"plant": "proximity", "scale": {"rotation_rate": 1.01}, "thrust": 1.02},
    )

    plant: Ref | None = reference(
        "plant", "true equations of motion, of the same states; left out: as believed", default=None
    )
    sensors: tuple[Ref, ...] = reference(
        "sensor", "true sensors, of the same channels; left out: as believed", default=()
    )
    scale: dict[str, float] = option(
        "factors of parameters of the true plant against nominal (rotation_rate = 1.01)",
        default={},
    )
    thrust: float = option("thrust as a part of the command", default=1.0, gt=0, le=10)

    @model_validator(mode="after")
    def _scales(self) -> Self:
        for name, factor in self.scale.items():
            if not (isfinite(factor) and factor >= 0.0):
                raise rule("scale", f"{name} = {factor:g}: a factor is a number from 0 on")
        return self


class OutageSpec(Spec):
    """An interval in which some sensors do not measure."""

    examples = ({"interval_h": [6, 30]}, {"sensors": ["lidar"], "interval_h": [6, 30]})

    sensors: tuple[str, ...] = option("names of the sensors; left out: all of them", default=())
    interval_s: Pair = quantity("time", "[from, to], since the start")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        begin, end = self.interval_s
        if not 0.0 <= begin <= end:
            raise rule("interval_s", f"must be [from, to] with 0 ≤ from ≤ to, got [{begin:g}, "
                        f"{end:g}] s")  # fmt: skip
        return self


class BiasSpec(Spec):
    """A bias as an additional state of the filter."""

    examples = (
        {"of": "camera", "channel": "azimuth", "sigma": 0.02},
        {"of": "acceleration", "channel": "ax", "sigma": 2e-8, "time_h": 12, "considered": True},
    )

    of: str = option(
        "name of a sensor; 'acceleration': one for each component, beside the command; or "
        "'thrust': relative error of the thrust, one for each spacecraft"
    )
    channel: str = option(
        "of a sensor: which channel has it; of an acceleration: which control of the plant (ax1); "
        "left out: each of them, and each its own",
        default="",
    )
    sigma: float = option("standard deviation, SI (m, rad, m/s²; a part of thrust)", gt=0)
    time_s: float | None = quantity(
        "time", "correlation time (first-order Gauss-Markov process); left out: a constant",
        default=None, gt=0,
    )  # fmt: skip
    considered: bool = option(
        "whether the bias is not estimated and only its uncertainty counts (Schmidt)",
        default=False,
    )


class AttitudeSpec(Spec):
    """Attitude error of each spacecraft, shared by all of its sensors: a drift and a jitter."""

    examples = (
        {"drift_sigma_deg": 0.05, "drift_time_h": 6, "jitter_sigma_deg": 0.001},
        {"drift_sigma_deg": 0.05, "believed": "estimated"},
    )

    drift_sigma_rad: float = quantity(
        "angle", "standard deviation of the drift about each axis", default=0.0, ge=0
    )
    drift_time_s: float | None = quantity(
        "time",
        "correlation time of the drift (first-order Gauss-Markov process); left out: a constant "
        "misalignment",
        default=None, gt=0,
    )  # fmt: skip
    jitter_sigma_rad: float = quantity(
        "angle", "standard deviation of the jitter about each axis, independent at each sample",
        default=0.0, ge=0,
    )  # fmt: skip
    believed: Literal["noise", "estimated"] = option(
        "what the filter believes of it: noise of both together, independent at each sample but "
        "common to the sensors of a spacecraft; or the drift estimated as three states of each "
        "spacecraft, and the jitter as such noise",
        default="noise",
    )

    @model_validator(mode="after")
    def _some_error(self) -> Self:
        if not (self.drift_sigma_rad or self.jitter_sigma_rad):
            raise rule("drift_sigma_rad", "neither drift nor jitter; give one, or leave attitude "
                        "out")  # fmt: skip
        return self


class NavigationSpec(StageSpec):
    """Spacecraft navigated by sensors and a filter, and controlled by its estimate.

    Inputs that may differ from case to case: parameters of the true plant, as ``plant.NAME`` or, if
    the truth has a plant of its own, ``truth.plant.NAME``; and ``thrust``, the thrust as a part of
    the command. The filter does not know them. The orbit of the body is the same in all cases.
    """

    results = ResultNames(
        metrics=(
            "navigation_nees",
            "navigation_consistent",
            "navigation_lost",
            "navigation_diverged",
            "navigation_alarms",
            "navigation_bound_ratio",
            "navigation_dv",
        ),
        tables={
            "navigation": (),
            "navigation_sensors": (),
        },
    )
    produces = "hillsphere_estimators.navigation.products:NavigationFlight"
    examples = (
        {
            "plant": "proximity",
            "sensors": ["lidar"],
            "estimator": "unscented",
            "start": {"position_km": [30, -40, 20]},
            "belief": {"position_relative": 0.05},
            "interval_min": 10,
            "duration_min": 20,
            "report_at_min": [10],
        },
    )

    needs: NavigationNeeds = option("products of earlier stages", default=NavigationNeeds())
    plant: Ref = reference("plant", "equations of motion that the filter believes in")
    law: Ref | None = reference(
        "compensator",
        "continuous law that acts on the estimate; left out: free motion",
        default=None,
    )
    sensors: tuple[Ref, ...] = reference("sensor", "the sensors")
    earth: Ref | None = reference(
        "body", "the Earth, for stations on it; left out: there are none", default=None
    )
    epoch: str | None = option(
        "date and time (TDB) at which time is 0: places the Earth and turns it; left out: that of "
        "the body's mean anomaly, if the plant begins there",
        default=None,
        max_length=40,
    )
    estimator: Ref = reference("estimator", "the filter, of all states")
    opening: Ref | None = reference(
        "estimator",
        "filter of the first updates (one without a gate, which might reject good measurements "
        "while the belief is wide); left out: none",
        default=None,
    )
    gate_after: int = option(
        "with opening: number of updates before estimator takes over", default=0, ge=0, le=1_000_000
    )
    members: tuple[tuple[str, ...], ...] = option(
        "decentralised filter: names of the sensors of each member. Each member filters its own "
        "measurements; the results are fused by covariance intersection, which allows for any "
        "correlation. Left out: one joint filter",
        default=(),
    )
    follow: str = option(
        "with needs.reference: name of the trajectory in it; left out: the only one", default=""
    )
    start: StartSpec = option(
        "where and when the flight is planned to begin; left out: where the reference does",
        default=StartSpec(),
    )
    belief: BeliefSpec | None = option(
        "how well the start is known; left out: as start.message says, or without one to a tenth "
        "of the distance from the origin and 1 mm/s",
        default=None,
    )
    interval_s: float = quantity("time", "time between two sets of measurements", gt=0)
    duration_s: float = quantity(
        "time", "how long the flight lasts, in whole intervals; measurements at both ends", gt=0
    )
    step_s: float = quantity("time", "longest step of the step maps", default=60.0, gt=0)
    noise_step_s: float = quantity(
        "time", "time over which the random accelerations that the plant declares are held",
        default=60.0, gt=0,
    )  # fmt: skip
    method: Literal["rk6", "dop853"] = option("formula of the step maps", default="rk6")
    search_beyond_rad: float | None = quantity(
        "angle",
        "a spacecraft that points farther from the body than this (half its camera's field of "
        "view) searches until it sees the body, and then points there; left out: it points where "
        "it believes the body to be, and may never see it",
        default=None, gt=0,
    )  # fmt: skip
    truth: TruthSpec = option(
        "how the true world differs from the believed one; left out: not at all",
        default=TruthSpec(),
    )
    dropouts: float = option("probability that a block of measurements is missing", default=0.0,
        ge=0, lt=1,
    )  # fmt: skip
    outliers: float = option("probability that a block is an outlier", default=0.0, ge=0, lt=1)
    outlier_sigmas: float = option(
        "error of an outlier in standard deviations of the noise", default=30.0, ge=0, le=1e6
    )
    faults_from_s: float = quantity(
        "time",
        "time since the start from which there are dropouts and outliers; a gate cannot reject "
        "earlier outliers, while the belief is wide",
        default=0.0, ge=0,
    )  # fmt: skip
    outages: tuple[OutageSpec, ...] = option(
        "intervals in which sensors do not measure", default=()
    )
    biases: tuple[BiasSpec, ...] = option("biases as additional states of the filter", default=())
    attitude: AttitudeSpec | None = option(
        "attitude error of the spacecraft, beside the noise of each sensor; left out: none. The "
        "Cramér-Rao bounds leave it out",
        default=None,
    )
    report_at_s: tuple[float, ...] = quantity(
        "time", "times since the start at which errors are given besides those at the end",
        default=(),
    )  # fmt: skip
    rms_from_s: float = quantity(
        "time", "time since the start from which root mean squares count", default=0.0, ge=0
    )
    diverged_beyond: float = option(
        "a filter has diverged, and the flight failed, if its NEES per state at the end is greater "
        "than this (1 on average for a consistent filter, of which less than one in 1e6 is counted "
        "as diverged). Its innovations give an alarm if the NIS per row is greater in each of the "
        "last five sets of measurements, or if the gate rejects more than half of each",
        default=10.0, gt=1, le=1e6,
    )  # fmt: skip
    label: str = option(
        "appended to the names of tables, figures and metrics, to tell two such stages apart",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not self.sensors:
            raise rule("sensors", "nothing measures; name at least one")
        names = [ref.name for ref in self.sensors]
        bound = any(ref.target is not None for ref in self.sensors)
        if not bound and len(set(names)) < len(names):
            raise rule("sensors", "a name is listed twice")
        if self.interval_s > self.duration_s:
            raise rule("interval_s", "is longer than the flight; shorten it")
        asked = [("outages", n) for out in self.outages for n in out.sensors]
        asked += [("members", n) for group in self.members for n in group]
        asked += [("biases", b.of) for b in self.biases if b.of not in OWN]
        if not bound:
            for key, name in asked:
                if name not in names:
                    known = ", ".join(names)
                    raise rule(key, f"{name!r} is none of the sensors, which are {known}")
        for out in self.outages:
            if out.interval_s[0] > self.duration_s:
                raise rule("outages", f"{out.interval_s[0]:g} s is after the end, "
                            f"{self.duration_s:g} s")  # fmt: skip
        for bias in self.biases:
            if bias.of == "thrust" and bias.channel:
                raise rule("biases", "'thrust' has no channels; leave channel out")
        pairs = [(bias.of, bias.channel) for bias in self.biases]
        for of, channel in pairs:
            twice = pairs.count((of, channel)) > 1 or (channel and (of, "") in pairs)
            if twice:
                raise rule("biases", f"{of!r} {channel} is listed twice".replace("  ", " "))
        if not all(self.members):
            raise rule("members", "a member without any sensor; name some, or leave it out")
        if self.members:
            flat = [n for group in self.members for n in group]
            if sorted(flat) != sorted(names) and not bound:
                raise rule("members", "each sensor must belong to one member, and only to one")
        if self.gate_after and self.opening is None:
            raise rule("gate_after", "needs opening, the filter of the updates before")
        if self.opening is not None and not self.gate_after:
            raise rule("opening", "takes no update; say how many with gate_after")
        if self.start.position_m is not None and len(self.start.position_m) % 3 == 0:
            p = self.start.position_m
            for i in range(0, len(p), 3):
                if not any(p[i : i + 3]):
                    raise rule("start.position_m", f"spacecraft {i // 3 + 1} is at the origin, "
                                "inside the body; move it off")  # fmt: skip
        given_start = self.start
        somewhere = (
            given_start.position_m
            or given_start.inertial
            or given_start.elements
            or given_start.message
        )
        if self.belief and self.belief.source == "message" and self.start.message is None:
            raise rule("belief", "source = 'message' needs start.message; give one")
        if self.needs.belief is not None:
            if somewhere or self.start.velocity_m_s is not None:
                raise rule("start", "needs.belief says where flights begin; leave start out")
        elif self.needs.reference is None and not somewhere:
            raise rule(
                "start",
                "where? give needs.reference, start.position_m, start.inertial, start.elements or "
                "needs.belief",
            )
        for time in self.report_at_s:
            if time > self.duration_s:
                raise rule("report_at_s", f"{time:g} s is after the end, {self.duration_s:g} s")
            part = time / self.interval_s
            if time < 0.0 or abs(part - round(part)) > 1e-6:
                raise rule("report_at_s", f"at {time:g} s nothing is measured, only every "
                            f"{self.interval_s:g} s; take a multiple of that")  # fmt: skip
        if len(set(self.report_at_s)) < len(self.report_at_s):
            raise rule("report_at_s", "a time is listed twice")
        if self.rms_from_s > self.duration_s:
            raise rule("rms_from_s", "is after the end")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the sensors that would find nothing to measure, or have no noise."""
        believed = [(("sensors", i), ref) for i, ref in enumerate(self.sensors)]
        true = [(("truth", "sensors", i), ref) for i, ref in enumerate(self.truth.sensors)]
        plants = [self.plant, *([self.truth.plant] if self.truth.plant else [])]
        yield from noiseless(believed, tables)
        yield from unseen([*believed, *true], plants, tables, self.earth, self.epoch)
        yield from two_dates(plants, tables, self.epoch)
