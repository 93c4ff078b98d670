"""Specs of the controllers: keys of their tables ``[compensator.NAME]``."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Spec, option, quantity, rule

__all__ = ["ImpulsiveSpec", "Matrix", "PidSpec", "StateSpaceSpec", "check_system"]

Matrix = tuple[tuple[float, ...], ...]


def check_system(a: Matrix, b: Matrix, c: Matrix, d: Matrix) -> None:
    """Raise a fault of a rule unless matrices A, B, C, D, of which some are empty, fit."""
    m = len(a)
    if not c and not d:
        raise rule("d", "neither c nor d is given: the law would command nothing")
    p = len(c or d)
    q = len(b[0]) if b else len(d[0]) if d else 0
    if q == 0:
        raise rule("b", "neither b nor d says how many values the law sees")
    wanted = {"a": (a, m, m), "b": (b, m, q), "c": (c, p, m), "d": (d, p, q)}
    for key, (matrix, rows, columns) in wanted.items():
        if not matrix and (key == "d" or m == 0):
            continue
        if len(matrix) != rows or any(len(row) != columns for row in matrix):
            found = f"{len(matrix)} rows of {sorted({len(row) for row in matrix})}"
            raise rule(key, f"must be {rows} × {columns} to fit the others, got {found}")


class PidSpec(Spec):
    """Proportional, integral and derivative action on each axis."""

    examples = (
        {"period_s": 60, "proportional": [3e-4] * 3, "derivative": [0.03] * 3},
        {
            "period_s": 60,
            "proportional": [3e-4, 3e-4, 3e-4],
            "integral": [1e-6, 1e-6, 1e-6],
            "derivative": [0.03, 0.03, 0.03],
            "rate": "position",
            "derivative_filter_s": 20.0,
            "maximum_mm_s2": 5.0,
        },
    )

    period_s: float = quantity("time", "time between samples", gt=0)
    proportional: tuple[float, ...] = option(
        "gain of each axis on its position error, 1/s²", min_length=1
    )
    integral: tuple[float, ...] = option(
        "gain of each axis on the integral of its position error, 1/s³; left out: none",
        default=(),
    )
    derivative: tuple[float, ...] = option(
        "gain of each axis on its velocity error, 1/s; left out: none", default=()
    )
    rate: Literal["velocity", "position"] = option(
        "where the velocity error comes from: 'velocity', the law sees velocities, in the rows "
        "after the positions; 'position', the difference of two position errors",
        default="velocity",
    )
    derivative_filter_s: float = quantity(
        "time", "time constant of the low-pass filter on the derivative action", default=0.0, ge=0
    )
    maximum_m_s2: float | None = quantity(
        "acceleration", "largest command of each axis, either sign", default=None, gt=0
    )
    tracking_time_s: float | None = quantity(
        "time",
        "time constant with which the integral action runs back while a command is cut "
        "(anti-windup); left out: the sampling period",
        default=None,
        gt=0,
    )

    @model_validator(mode="after")
    def _one_gain_per_axis(self) -> Self:
        axes = len(self.proportional)
        for key in ("integral", "derivative"):
            if (count := len(getattr(self, key))) not in (0, axes):
                raise rule(key, f"must have one gain per axis, {axes}, got {count}")
        return self


class StateSpaceSpec(Spec):
    """Linear compensator ẋ = A x + B e, u = C x + D e on the error e = reference − seen."""

    examples = (
        {"period_s": 60, "d": [[3e-4, 0, 0, 0.03, 0, 0], [0, 3e-4, 0, 0, 0.03, 0],
                               [0, 0, 3e-4, 0, 0, 0.03]]},
        {
            "period_s": 60,
            "form": "continuous",
            "a": [[-0.3, 0, 0], [0, -0.3, 0], [0, 0, -0.3]],
            "b": [[0.3, 0, 0, 90, 0, 0], [0, 0.3, 0, 0, 90, 0], [0, 0, 0.3, 0, 0, 90]],
            "c": [[2.5e-5, 0, 0], [0, 2.5e-5, 0], [0, 0, 2.5e-5]],
        },
        {
            "period_s": 60,
            "form": "continuous",
            "states": "continuous",
            "a": [[-0.3, 0, 0], [0, -0.3, 0], [0, 0, -0.3]],
            "b": [[0.3, 0, 0, 90, 0, 0], [0, 0.3, 0, 0, 90, 0], [0, 0, 0.3, 0, 0, 90]],
            "c": [[2.5e-5, 0, 0], [0, 2.5e-5, 0], [0, 0, 2.5e-5]],
        },
    )  # fmt: skip

    period_s: float = quantity("time", "time between samples", gt=0)
    form: Literal["discrete", "continuous"] = option(
        "whether A and B are those of x(k+1) = A x(k) + B e(k) or of ẋ = A x + B e, 1/s",
        default="discrete",
    )
    states: Literal["sampled", "continuous"] = option(
        "'sampled': a continuous form is discretised exactly for errors held over the period, and "
        "u is held likewise; 'continuous': its states and u move between samples, with the plant",
        default="sampled",
    )
    measurement: Literal["held", "continuous"] = option(
        "for continuous states: whether the error is held between samples, or taken from the true "
        "states at every instant",
        default="held",
    )
    actuation: Literal["hold", "impulse"] = option(
        "for sampled states: whether u is an acceleration, held, or a change of velocity",
        default="hold",
    )
    a: Matrix = option("A, m × m, row by row; left out: no states", default=())
    b: Matrix = option("B, m × q", default=())
    c: Matrix = option("C, p × m", default=())
    d: Matrix = option("D, p × q; left out: zero", default=())

    @model_validator(mode="after")
    def _shapes(self) -> Self:
        check_system(self.a, self.b, self.c, self.d)
        if self.states == "continuous" and self.form == "discrete":
            raise rule("states", "continuous states need form = 'continuous'")
        if self.states == "continuous" and self.actuation == "impulse":
            raise rule("actuation", "continuous states command an acceleration; leave it out")
        if self.states == "sampled" and self.measurement == "continuous":
            raise rule("measurement", "a continuous measurement needs states = 'continuous'")
        return self


class ImpulsiveSpec(Spec):
    """Linear feedback Δv = −K (seen − reference) at each sample."""

    examples = (
        {
            "period_h": 6,
            "gain": [[1e-4, 0, 0, 1, 0, 0], [0, 1e-4, 0, 0, 1, 0], [0, 0, 1e-4, 0, 0, 1]],
            "dead_band_mm_s": 1,
            "maximum_m_s": 2,
        },
    )

    period_s: float = quantity("time", "time between corrections", gt=0)
    gain: Matrix = option(
        "K, one row per velocity, one column per value that the law sees (1/s for positions, "
        "1 for velocities)",
        min_length=1,
    )
    dead_band_m_s: float = quantity("speed", "a smaller Δv is not done", default=0.0, ge=0)
    maximum_m_s: float | None = quantity(
        "speed", "a larger Δv is cut to this, its direction kept", default=None, gt=0
    )

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        if len({len(row) for row in self.gain}) != 1 or not self.gain[0]:
            raise rule("gain", "must have rows of the same length, at least 1")
        if self.maximum_m_s is not None and self.maximum_m_s < self.dead_band_m_s:
            raise rule("maximum_m_s", "must not be below the dead band")
        return self
