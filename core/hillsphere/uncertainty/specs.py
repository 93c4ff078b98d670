"""Specs of distributions, the keys of a table ``[dispersions.NAME]``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from pydantic import field_validator, model_validator
from pydantic_core import PydanticCustomError

from hillsphere.base.problems import did_you_mean
from hillsphere.spec.base import UNITS, DataPath, Spec, data_path, option, rule, table_name

__all__ = [
    "ChoiceSpec",
    "ContinuousSpec",
    "DispersionSpec",
    "IntervalSpec",
    "LogNormalSpec",
    "NormalSpec",
    "SamplesSpec",
    "StartCovarianceSpec",
    "TriangularSpec",
    "UniformSpec",
]

Sizes = float | tuple[float, ...]
Matrix = tuple[tuple[float, ...], ...]


class DispersionSpec(Spec):
    """Common keys of all distributions: quantities, unit, and scale of the spread."""

    of: str = table_name(
        'table that the quantities belong to, "gravity.phobos"; the repeated stage\'s own, '
        '"stage.hover", for its initial state and whatever else it offers; "stage" for that of '
        "whichever stage is repeated"
    )
    parameters: tuple[str, ...] = option(
        "names of the quantities there; * stands for any characters", min_length=1
    )
    unit: str = option(
        "unit of the numbers of this table: km, deg, mm_s …; left out: SI. Only quantities of its "
        "dimension may then be meant",
        default="",
    )
    scale: float = option("factor by which the spread is multiplied", default=1.0, ge=0)

    @field_validator("unit")
    @classmethod
    def _known_unit(cls, unit: str) -> str:
        known = [suffix for suffixes in UNITS.values() for suffix in suffixes]
        if unit and unit not in known:
            hint = did_you_mean(unit, known, otherwise="units")
            raise PydanticCustomError(
                "rule", "{text}", {"text": f"no unit {unit[:40]!r} is known{hint}"}
            )
        return unit

    @field_validator("parameters")
    @classmethod
    def _each_once(cls, parameters: tuple[str, ...]) -> tuple[str, ...]:
        for name in parameters:
            if not name or parameters.count(name) > 1:
                text = f"{name!r} stands there twice" if name else "a name must not be empty"
                raise PydanticCustomError("rule", "{text}", {"text": text})
        return parameters


class ContinuousSpec(DispersionSpec):
    """Common key of all continuous distributions: the correlation."""

    correlation: Matrix | None = option(
        "correlation matrix of the underlying normal numbers (Gaussian copula), in the order in "
        "which parameters finds the quantities; left out: independent",
        default=None,
    )

    @field_validator("correlation")
    @classmethod
    def _is_correlation(cls, matrix: Matrix | None) -> Matrix | None:
        text = "" if matrix is None else _matrix_fault(matrix)
        if text:
            raise PydanticCustomError("rule", "{text}", {"text": text})
        return matrix


def _matrix_fault(matrix: Matrix) -> str:
    """Return the fault of a correlation matrix, eigenvalues excepted; ``""`` without one."""
    size = len(matrix)
    if any(len(row) != size for row in matrix):
        return f"must be square: {size} rows of {size} numbers each"
    for i, row in enumerate(matrix):
        if row[i] != 1.0:
            return f"the diagonal must be 1, got {row[i]:g} in row {i}"
        for j in range(i):
            if row[j] != matrix[j][i]:
                return f"must be symmetric, got {row[j]:g} and {matrix[j][i]:g} at rows {j} and {i}"
            if not -1.0 <= row[j] <= 1.0:
                return f"a correlation lies between -1 and 1, got {row[j]:g} in row {i}"
    return ""


def _one_of(spec: Spec, keys: Sequence[str]) -> None:
    """Require that a table gives exactly one of these keys."""
    given = [key for key in keys if getattr(spec, key) is not None]
    if len(given) != 1:
        said = f"got {' and '.join(given)}" if given else "got none"
        text = f"give one of {', '.join(keys)}; {said}"
        raise rule(given[1] if given else keys[0], text)


def _offset() -> Sizes:
    made: Sizes = option(
        "known shift from the nominal value, for all quantities or one for each", default=0.0
    )
    return made


class NormalSpec(ContinuousSpec):
    """A normal distribution about the nominal value."""

    examples = (
        {"of": "gravity.phobos", "parameters": ["C*", "S*"], "sigma_relative": 0.05},
        {
            "of": "stage.hover",
            "parameters": ["state.x", "state.y"],
            "unit": "km",
            "sigma": [0.1, 0.2],
            "truncate_sigmas": 3.0,
            "correlation": [[1.0, 0.3], [0.3, 1.0]],
        },
    )

    sigma: Sizes | None = option(
        "standard deviation, for all quantities or one for each", default=None, ge=0
    )
    sigma_relative: Sizes | None = option(
        "standard deviation as a share of the nominal value's magnitude", default=None, ge=0
    )
    offset: Sizes = _offset()
    truncate_sigmas: float | None = option(
        "cut off beyond so many of these standard deviations; that of what is left is smaller",
        default=None,
        ge=0.1,
    )

    @model_validator(mode="after")
    def _one_size(self) -> Self:
        _one_of(self, ("sigma", "sigma_relative"))
        return self


class IntervalSpec(ContinuousSpec):
    """An interval about the nominal value, or between given limits."""

    half_width: Sizes | None = option(
        "half the interval's width, for all quantities or one for each", default=None, ge=0
    )
    half_width_relative: Sizes | None = option(
        "half the interval's width as a share of the nominal value's magnitude", default=None, ge=0
    )
    lower: Sizes | None = option("lower end, instead of a width", default=None)
    upper: Sizes | None = option("upper end, instead of a width", default=None)
    offset: Sizes = _offset()

    @model_validator(mode="after")
    def _one_interval(self) -> Self:
        _one_of(self, ("half_width", "half_width_relative", "lower"))
        if (self.lower is None) != (self.upper is None):
            raise rule("upper", "lower and upper belong together")
        if self.lower is not None and self.offset != 0.0:
            raise rule("offset", "lower and upper say where the interval is; leave offset out")
        return self


class UniformSpec(IntervalSpec):
    """Equally probable values in an interval; `scale` stretches it about its middle."""

    examples = (
        {"of": "gravity.phobos", "parameters": ["gm"], "half_width_relative": 0.01},
        {"of": "stage.hover", "parameters": ["state.x"], "unit": "km", "lower": 19, "upper": 21},
    )


class TriangularSpec(IntervalSpec):
    """A triangular density with its mode at the nominal value, zero at the interval's ends."""

    examples = (
        {"of": "gravity.phobos", "parameters": ["gm"], "half_width_relative": 0.01},
        {"of": "stage.hover", "parameters": ["state.x"], "unit": "km", "lower": 19, "upper": 22},
    )


class LogNormalSpec(ContinuousSpec):
    """The nominal value, which is the median, times a factor whose logarithm is normal."""

    examples = ({"of": "gravity.phobos", "parameters": ["gm"], "factor": 1.2},)

    factor: Sizes = option(
        "factor of one standard deviation: 1.2 for a 68 % chance of within 1/1.2 to 1.2 times",
        ge=1,
    )


class ChoiceSpec(DispersionSpec):
    """One of several values, drawn independently per quantity; `scale` stretches about the mean."""

    examples = (
        {
            "of": "gravity.phobos",
            "parameters": ["gm"],
            "unit": "km3_s2",
            "values": [7.08e-4, 7.09e-4],
            "weights": [3, 1],
        },
    )

    values: tuple[float, ...] = option("the values", min_length=1)
    weights: tuple[float, ...] | None = option(
        "how often each is chosen, relative to the others; left out: equally often",
        default=None,
        ge=0,
    )

    @model_validator(mode="after")
    def _one_weight_each(self) -> Self:
        if self.weights is not None:
            if len(self.weights) != len(self.values):
                text = f"must be as many as values, {len(self.values)}, got {len(self.weights)}"
                raise rule("weights", text)
            if not sum(self.weights) > 0:
                raise rule("weights", "at least one must be positive")
        return self


class SamplesSpec(DispersionSpec):
    """Whole rows of a table, such as results of an estimation, with their correlation."""

    examples = (
        {
            "of": "stage.hover",
            "parameters": ["state.x", "state.y"],
            "unit": "km",
            "rows": [[20.1, 0.2], [19.8, -0.1], [20.0, 0.0]],
        },
    )

    rows: Matrix | None = option(
        "the table, a column for each quantity in the order in which parameters finds them; every "
        "row is equally probable. `scale` stretches about the mean",
        default=None,
        min_length=1,
    )
    file: DataPath | None = data_path(
        "CSV file with the table, instead of rows; its header names the quantities, which "
        "parameters must then do without *",
        default=None,
    )

    @model_validator(mode="after")
    def _one_table(self) -> Self:
        _one_of(self, ("rows", "file"))
        if self.rows is not None:
            widths = {len(row) for row in self.rows}
            if len(widths) > 1 or widths == {0}:
                raise rule("rows", "every row must hold one number for each quantity")
        elif any("*" in name for name in self.parameters):
            raise rule("parameters", "a file's columns are found by whole names; leave * out")
        return self


class StartCovarianceSpec(DispersionSpec):
    """The initial state, normal with the covariance that `start.message` states."""

    examples = ({"of": "stage.descent"}, {"of": "stage.descent", "scale": 3.0})

    parameters: tuple[str, ...] = option(
        "the six states in the order of position and velocity; left out: what is added to the "
        "start, offset.x to offset.vz",
        default=("offset.x", "offset.y", "offset.z", "offset.vx", "offset.vy", "offset.vz"),
    )

    @model_validator(mode="after")
    def _six_states(self) -> Self:
        if len(self.parameters) != 6:
            text = f"expected six states, position and velocity, got {len(self.parameters)}"
            raise rule("parameters", text)
        if self.unit:
            raise rule("unit", "the message has units of its own; leave unit out")
        return self
