"""Spec of the stage ``linear_models``: keys of its table in a mission."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator

from hillsphere.errors import InputError
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
    rule,
)
from hillsphere_controllers.stages.faults import require_one
from hillsphere_controllers.stages.linear_models.expressions import FUNCTIONS, parameter_names

__all__ = [
    "DelaySpec", "GaussMarkovSpec", "InterconnectionSpec", "LinearModelsNeeds", "LinearModelsSpec",
    "LowPassSpec", "ParameterSpec", "PerformanceSpec", "ShelvingSpec", "SystemSpec",
]  # fmt: skip

Entry = float | str
EntryMatrix = tuple[tuple[Entry, ...], ...]

_NAME = r"^[A-Za-z_][A-Za-z0-9_]{0,39}$"
_MODELS = 2000
"""Models of a stage at most: later stages close a loop and compute a norm for each."""


class ShelvingSpec(Spec):
    """A weight from one gain at low to another at high frequency."""

    examples = ({"low": 100, "high": 0.5, "frequency_rad_s": 0.1},)

    low: float = option("gain at zero frequency", ge=0)
    high: float = option("gain at infinite frequency", ge=0)
    frequency_rad_s: float = quantity(
        "angular_rate", "frequency at which the weight has the value of gain", gt=0
    )
    gain: float = option("gain at that frequency, between low and high", default=1.0, gt=0)
    order: int = option("number of equal poles", default=1, ge=1, le=10)

    @model_validator(mode="after")
    def _check_between(self) -> Self:
        if not min(self.low, self.high) < self.gain < max(self.low, self.high):
            raise rule("gain", f"must lie between low ({self.low:g}) and high ({self.high:g})")
        return self


class PerformanceSpec(Spec):
    """A weight of the sensitivity: (s/M + ω)/(s + ω A), to the power of its order."""

    examples = ({"bandwidth_rad_s": 0.05, "peak": 2, "steady_error": 1e-4},)

    bandwidth_rad_s: float = quantity(
        "angular_rate", "ω, where the inverse weight crosses one", gt=0
    )
    peak: float = option("M, what it allows at high frequency", default=2.0, gt=0)
    steady_error: float = option("A, what it allows at zero frequency", default=1e-4, gt=0)
    order: int = option("slope of the inverse weight at low frequency", default=1, ge=1, le=10)

    @model_validator(mode="after")
    def _order(self) -> Self:
        if not self.steady_error < self.peak:
            raise rule("steady_error", f"must be below the peak, {self.peak:g}")
        return self


class DelaySpec(Spec):
    """A delay, as a rational function of s (Padé)."""

    examples = ({"time_s": 30, "order": 2},)

    time_s: float = quantity("time", "delay; half a period stands for a hold between samples", gt=0)
    order: int = option("order of the rational function", default=1, ge=1, le=8)


class LowPassSpec(Spec):
    """Equal first-order filters one after the other, gain one at zero frequency."""

    examples = ({"frequency_hz": 0.05},)

    frequency_hz: float = quantity("frequency", "corner of each filter", gt=0)
    order: int = option("number of filters", default=1, ge=1, le=10)


class GaussMarkovSpec(Spec):
    """Coloured noise made of white noise: first order, as errors of navigation are declared."""

    examples = ({"deviation": 0.5, "correlation_time_min": 10},)

    deviation: float = option("standard deviation of the noise, in its signal's unit, SI", gt=0)
    correlation_time_s: float = quantity("time", "correlation time of the noise", gt=0)


class SystemSpec(Spec):
    """One linear system: by matrices, transfer function, weight, filter or file, or a model."""

    examples = (
        {"a": [["-rate"]], "b": [[1]], "c": [[1]], "inputs": ["v"], "outputs": ["y"]},
        {"numerator": [5, 1], "denominator": [0.5, 1], "inputs": ["u"], "outputs": ["z"]},
        {"performance": {"bandwidth_rad_s": 0.05}, "inputs": ["e"], "outputs": ["z"]},
        {"shelving": {"low": 100, "high": 0.5, "frequency_rad_s": 1}, "inputs": ["e"],
         "outputs": ["z"], "channels": 2},
        {"file": "plant.mat", "variable": "P", "inputs": ["u"], "outputs": ["y"]},
        {"low_pass": {"frequency_hz": 0.05}, "inputs": ["r"], "outputs": ["r_hat"], "channels": 3},
        {"delay": {"time_s": 30}, "inputs": ["u"], "outputs": ["a"], "channels": 3},
        {"gauss_markov": {"deviation": 0.5, "correlation_time_s": 600}, "inputs": ["w_r"],
         "outputs": ["noise_r"], "channels": 3},
        {"model": True, "inputs": ["a"], "outputs": ["r", "v"]},
    )  # fmt: skip

    inputs: tuple[str, ...] = option(
        "names of its inputs; one name u stands for u[0], u[1] … if there are several; of a model "
        "those inputs of its own that are used",
        min_length=1,
    )
    outputs: tuple[str, ...] = option("names of its outputs, likewise", min_length=1)
    model: bool = option("whether it is the model of needs.models, each in turn", default=False)
    a: EntryMatrix = option(
        "A, row by row; an entry is a number or a formula of parameters; left out: no states",
        default=(),
    )
    b: EntryMatrix = option("B, row by row, entries as in A", default=())
    c: EntryMatrix = option("C, row by row, entries as in A", default=())
    d: EntryMatrix = option("D, row by row, entries as in A; left out: zero", default=())
    numerator: tuple[Entry, ...] = option(
        "coefficients of the numerator of a transfer function, the highest power of s first",
        default=(),
    )
    denominator: tuple[Entry, ...] = option(
        "coefficients of the denominator of the transfer function", default=()
    )
    shelving: ShelvingSpec | None = option(
        "a weight by its gains at low and high frequency", default=None
    )
    performance: PerformanceSpec | None = option(
        "a weight of the sensitivity by bandwidth, peak and steady error", default=None
    )
    low_pass: LowPassSpec | None = option("a filter without gain", default=None)
    delay: DelaySpec | None = option("a delay", default=None)
    gauss_markov: GaussMarkovSpec | None = option(
        "what makes noise of a first-order Gauss-Markov process out of white noise of unit "
        "intensity: added to a measurement, with its input among those that disturb, it is what "
        "an H2 channel sees of navigation",
        default=None,
    )
    file: DataPath | None = data_path(
        "a file .mat or .npz with the matrices a, b, c, d", default=None
    )
    variable: str = option(
        "which variable of a .mat file; left out: the only system in it", default=""
    )
    channels: int = option("number of copies of the system, side by side", default=1, ge=1, le=200)

    @model_validator(mode="after")
    def _described_once(self) -> Self:
        ways = {
            "d": bool(self.a or self.b or self.c or self.d),
            "numerator": bool(self.numerator or self.denominator),
            "shelving": self.shelving is not None,
            "performance": self.performance is not None,
            "low_pass": self.low_pass is not None,
            "delay": self.delay is not None,
            "gauss_markov": self.gauss_markov is not None,
            "file": self.file is not None,
            "model": self.model,
        }
        require_one([key for key, given in ways.items() if given], ways, "d")
        if ways["numerator"] and not (self.numerator and self.denominator):
            raise rule("denominator", "a transfer function needs numerator and denominator")
        if self.model and self.channels > 1:
            raise rule("channels", "a model stands there once")
        if ways["d"]:
            self._check_shapes()
        for key, entry in self.entries():
            if isinstance(entry, str):
                try:
                    parameter_names(entry)
                except InputError as error:
                    raise rule(key, str(error)) from None
        return self

    def _check_shapes(self) -> None:
        n = len(self.a)
        if n and not (self.b and self.c):
            raise rule("b" if not self.b else "c", "a system with states needs a, b and c")
        if not n and not self.d:
            raise rule("d", "a system without states needs d")
        m, p = len((self.b or self.d)[0]), len(self.c or self.d)
        wanted = {"a": (n, n), "b": (n, m), "c": (p, n), "d": (p, m)}
        for key, (rows, columns) in wanted.items():
            matrix: EntryMatrix = getattr(self, key)
            if not matrix and (key == "d" or n == 0):
                continue
            if len(matrix) != rows or any(len(row) != columns for row in matrix):
                found = f"{len(matrix)} rows of {sorted({len(row) for row in matrix})}"
                raise rule(key, f"must be {rows} × {columns} to fit the others, got {found}")

    def entries(self) -> Iterator[tuple[str, Entry]]:
        """Yield (key, entry) for all entries of matrices and polynomials."""
        for key in ("a", "b", "c", "d"):
            matrix: EntryMatrix = getattr(self, key)
            for row in matrix:
                for entry in row:
                    yield key, entry
        for key in ("numerator", "denominator"):
            for entry in getattr(self, key):
                yield key, entry


class ParameterSpec(Spec):
    """A parameter of the models."""

    examples = ({"name": "k", "nominal": 1.25, "values": [0.5, 1.25, 2], "unit": "N/m"},)

    name: str = option("name of the parameter in formulas", pattern=_NAME)
    nominal: float = option("nominal value")
    values: tuple[float, ...] = option(
        "values for which a model is made; left out: the nominal one",
        default=(),
        max_length=_MODELS,
    )
    unit: str = option("unit of the parameter's values, for tables", default="-")

    @model_validator(mode="after")
    def _values(self) -> Self:
        if self.name in FUNCTIONS or self.name == "pi":
            raise rule("name", f"{self.name!r} means something in a formula; choose another name")
        if len(set(self.values)) < len(self.values):
            raise rule("values", "a value is listed twice")
        return self


class InterconnectionSpec(Spec):
    """Systems connected by the names of their signals."""

    examples: ClassVar[tuple[dict[str, Any], ...]] = (
        {
            "systems": [
                {"numerator": [1], "denominator": [1, 0], "inputs": ["e"], "outputs": ["u"]}
            ],
            "inputs": ["e"],
            "outputs": ["u"],
        },
    )

    systems: tuple[SystemSpec, ...] = option("the systems", min_length=1, max_length=200)
    junctions: tuple[str, ...] = option(
        "sums of signals, 'e = r - y'; names without a number stand for all that have one",
        default=(),
    )
    inputs: tuple[str, ...] = option("signals that come from outside, in their order")
    outputs: tuple[str, ...] = option("signals that are seen from outside, in their order")

    @model_validator(mode="after")
    def _names(self) -> Self:
        for key in ("inputs", "outputs"):
            names = getattr(self, key)
            if twice := sorted({name for name in names if names.count(name) > 1}):
                raise rule(key, f"the signal {twice[0]!r} is listed twice")
        return self


class LinearModelsNeeds(Spec):
    """Products of earlier stages that ``linear_models`` takes."""

    models: Ref | None = need(
        "hillsphere_controllers.linear_products:LinearModels",
        "models, such as those of a plant along a trajectory, each of which takes the place of the "
        "system with model = true",
        default=None,
    )


class LinearModelsSpec(InterconnectionSpec, StageSpec):
    """Linear models of one plant, weights and all, at one or more values of its parameters."""

    results = ResultNames(
        metrics=("linear_models",),
        tables={
            "linear_models": (
                "model",
                "order",
                "outputs",
                "inputs",
                "abscissa_1_s",
                "unstable_poles",
                "border_poles",
                "fastest_pole_rad_s",
            ),
        },
    )
    produces = "hillsphere_controllers.linear_products:LinearModels"
    examples = (
        {
            "parameters": [{"name": "rate", "nominal": 1, "values": [0.5, 1, 1.5]}],
            "systems": [
                {"a": [["-rate"]], "b": [[1]], "c": [[1]], "inputs": ["v"], "outputs": ["y"]},
                {
                    "performance": {"bandwidth_rad_s": 1, "steady_error": 0.01},
                    "inputs": ["e"],
                    "outputs": ["z_error"],
                },
                {"d": [[0.1]], "inputs": ["u"], "outputs": ["z_control"]},
            ],
            "junctions": ["e = r - y", "v = u + d"],
            "inputs": ["r", "d"],
            "outputs": ["z_error", "z_control"],
            "controls": ["u"],
            "measurements": ["e"],
        },
        {
            "systems": [{"file": "plant.mat", "variable": "P", "inputs": ["u"], "outputs": ["y"]}],
            "inputs": [],
            "outputs": [],
            "controls": ["u"],
            "measurements": ["y"],
        },
        {
            "needs": {"models": "models"},
            "which": ["nominal*"],
            "systems": [
                {"model": True, "inputs": ["a"], "outputs": ["r", "v"]},
                {"low_pass": {"frequency_hz": 0.05}, "channels": 3, "inputs": ["r"],
                 "outputs": ["r_hat"]},
            ],
            "inputs": [],
            "outputs": ["v"],
            "controls": ["a"],
            "measurements": ["r_hat"],
        },
    )  # fmt: skip

    needs: LinearModelsNeeds = option("products of earlier stages", default=LinearModelsNeeds())
    which: tuple[str, ...] = option(
        "names of the models of needs.models that are taken; * stands for any characters; left "
        "out: all",
        default=(),
    )
    parameters: tuple[ParameterSpec, ...] = option(
        "what the formulas may name", default=(), max_length=50
    )
    combine: Literal["grid", "list"] = option(
        "whether a model is made for every combination of the parameters' values, or for the first "
        "values of all, the second ones, and so on",
        default="grid",
    )
    controls: tuple[str, ...] = option("signals that a controller commands", default=())
    measurements: tuple[str, ...] = option("signals that a controller sees", default=())
    period_s: float | None = quantity(
        "time", "sampling period of systems in discrete time; models in continuous time are "
        "discretised exactly, for inputs that are held; left out: continuous time",
        default=None, gt=0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [parameter.name for parameter in self.parameters]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise rule("parameters", f"the name {twice[0]!r} is listed twice")
        for system in self.systems:
            for _, entry in system.entries():
                unknown = parameter_names(entry) - set(names) if isinstance(entry, str) else set()
                if unknown:
                    raise rule(
                        "systems",
                        f"{entry!r}: no parameter {min(unknown)!r}; there are: "
                        f"{', '.join(names) or 'none'}",
                    )
        taken = sum(system.model for system in self.systems)
        if taken > 1 or bool(taken) != (self.needs.models is not None):
            text = "needs.models and just one system with model = true are given together"
            raise rule("systems", text)
        if self.which and not taken:
            raise rule("which", "names models of needs.models; leave it out")
        if bool(self.controls) != bool(self.measurements):
            key = "measurements" if self.controls else "controls"
            raise rule(key, "controls and measurements are given together, or neither")
        counts = [len(p.values) for p in self.parameters if p.values]
        if self.combine == "list" and len(set(counts)) > 1:
            raise rule("parameters", f"a list needs as many values of each, got {counts}")
        total = 1
        for count in counts:
            total *= count
        if self.combine == "grid" and total > _MODELS:
            raise rule("parameters", f"{total} models; at most {_MODELS} are made")
        if not (self.inputs or self.controls):
            raise rule("inputs", "the models have no input")
        return self
