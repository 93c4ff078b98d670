"""Construction of linear systems from their Specs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere.products.product_codec import HEADER, load_product, read_arrays
from hillsphere_controllers.stages.linear_models.expressions import evaluate_entry
from hillsphere_controllers.stages.linear_models.specs import (
    EntryMatrix,
    GaussMarkovSpec,
    InterconnectionSpec,
    LowPassSpec,
    PerformanceSpec,
    ShelvingSpec,
    SystemSpec,
)
from hillsphere_controllers.stages.signals import find_signals
from hillsphere_controllers.systems.algebra import append, series
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.delay import pade_delay
from hillsphere_controllers.systems.exchange import load_mat
from hillsphere_controllers.systems.holding import zero_order_hold
from hillsphere_controllers.systems.interconnection import connect, with_names
from hillsphere_controllers.systems.weights import performance_weight, shelving_weight

__all__ = [
    "build_parts",
    "build_performance_weight",
    "build_shelving_weight",
    "build_system",
    "connect_systems",
    "model_part",
    "system_from_file",
]

Values = Mapping[str, float]


def connect_systems(spec: InterconnectionSpec, parts: Sequence[LtiSystem]) -> LtiSystem:
    """Connect systems by the junctions and signals of a Spec.

    Parameters
    ----------
    spec : InterconnectionSpec
        Junctions and signals; of a `LinearModelsSpec` the controls are the last inputs, the
        measurements the last outputs.
    parts : sequence of LtiSystem
        Its systems with their names.

    Raises
    ------
    InputError
        If they do not connect.
    """
    inputs = [*spec.inputs, *getattr(spec, "controls", ())]
    outputs = [*spec.outputs, *getattr(spec, "measurements", ())]
    return connect(parts, spec.junctions, inputs, outputs)


def build_parts(
    spec: InterconnectionSpec,
    values: Values,
    period_s: float | None = None,
    model: LtiSystem | None = None,
    known: Sequence[LtiSystem] | None = None,
) -> tuple[LtiSystem, ...]:
    """Return the systems that a mission names, with the names of their signals.

    Parameters
    ----------
    spec : InterconnectionSpec
        The systems.
    values : mapping of str to float
        Of the parameters.
    period_s : float or None
        Sampling period, s.
    model : LtiSystem, optional
        For the system with ``model = true``.
    known : sequence of LtiSystem, optional
        The same systems with another model: all others are taken from there.

    Raises
    ------
    InputError
        If a system cannot be made; the key is named.
    """
    return tuple(
        model_part(one, model, period_s, f"systems[{k}]")
        if one.model
        else known[k]
        if known is not None
        else build_system(one, values, period_s, f"systems[{k}]")
        for k, one in enumerate(spec.systems)
    )


def model_part(
    spec: SystemSpec, model: LtiSystem | None, period_s: float | None = None, key: str = "system"
) -> LtiSystem:
    """Return a model restricted to the signals that a mission names.

    Parameters
    ----------
    spec : SystemSpec
        Which inputs and outputs.
    model : LtiSystem or None
        The model.
    period_s : float or None
        Sampling period, s, to which a model in continuous time is brought, its inputs held.
    key : str
        For messages.

    Raises
    ------
    InputError
        If there is no model, or no such signal.
    """
    if model is None:
        raise InputError(f"{key}: no models are there; they come with needs.models")
    rows = find_signals(model.outputs, spec.outputs, f"{key}.outputs")
    columns = find_signals(model.inputs, spec.inputs, f"{key}.inputs")
    used = model.of([model.outputs[i] for i in rows], [model.inputs[j] for j in columns])
    return zero_order_hold(used, period_s) if period_s is not None and used.dt_s is None else used


def build_system(
    spec: SystemSpec, values: Values, period_s: float | None = None, key: str = "system"
) -> LtiSystem:
    """Return one system with the names of its signals.

    Raises
    ------
    InputError
        If a formula has no value, a file does not hold the system, or names do not fit.
    """
    try:
        one = _build_unnamed(spec, values, period_s)
        if spec.channels > 1:
            bare = LtiSystem(one.a, one.b, one.c, one.d, one.dt_s)
            one = append(*[bare] * spec.channels)
        return with_names(one, _names(spec.inputs), _names(spec.outputs))
    except InputError as error:
        raise InputError(f"{key}: {error}") from error


def build_shelving_weight(spec: ShelvingSpec, period_s: float | None = None) -> LtiSystem:
    """Return a weight by its gains."""
    return shelving_weight(
        spec.low, spec.high, spec.frequency_rad_s, spec.gain, order=spec.order, dt_s=period_s
    )


def build_performance_weight(spec: PerformanceSpec, period_s: float | None = None) -> LtiSystem:
    """Return a weight of the sensitivity.

    Raises
    ------
    InputError
        In discrete time, for which there is none.
    """
    if period_s is not None:
        raise InputError("a weight by its bandwidth is one in continuous time; write 'shelving'")
    return performance_weight(spec.bandwidth_rad_s, spec.peak, spec.steady_error, order=spec.order)


def _build_unnamed(spec: SystemSpec, values: Values, period_s: float | None) -> LtiSystem:
    if spec.file is not None:
        return system_from_file(Path(spec.file), spec.variable)
    if spec.shelving is not None:
        return build_shelving_weight(spec.shelving, period_s)
    if spec.performance is not None:
        return build_performance_weight(spec.performance, period_s)
    if spec.low_pass is not None:
        return _low_pass(spec.low_pass, period_s)
    if spec.delay is not None:
        _require_continuous("delay", period_s)
        return pade_delay(spec.delay.time_s, spec.delay.order)
    if spec.gauss_markov is not None:
        return _gauss_markov(spec.gauss_markov, period_s)
    if spec.numerator:
        top, bottom = (
            [evaluate_entry(entry, values) for entry in polynomial]
            for polynomial in (spec.numerator, spec.denominator)
        )
        return transfer_function(top, bottom, period_s)
    n, p, m = len(spec.a), len(spec.c or spec.d), len((spec.b or spec.d)[0])

    def made(matrix: EntryMatrix, rows: int, columns: int) -> Array:
        if not matrix:
            return np.zeros((rows, columns))
        return np.array([[evaluate_entry(entry, values) for entry in row] for row in matrix])

    return LtiSystem(
        made(spec.a, n, n), made(spec.b, n, m), made(spec.c, p, n), made(spec.d, p, m), period_s
    )


def _low_pass(spec: LowPassSpec, period_s: float | None) -> LtiSystem:
    _require_continuous("low_pass", period_s)
    corner = 2.0 * pi * spec.frequency_hz
    return series(*[transfer_function([corner], [1.0, corner])] * spec.order)


def _gauss_markov(spec: GaussMarkovSpec, period_s: float | None) -> LtiSystem:
    """Return the shaping filter σ √(2/τ)/(s + 1/τ), or its equivalent at samples, of H2 norm σ."""
    size, rate = np.array([[spec.deviation]]), 1.0 / spec.correlation_time_s
    one, none = np.ones((1, 1)), np.zeros((1, 1))
    if period_s is None:
        return LtiSystem(-rate * one, np.sqrt(2.0 * rate) * size, one, none)
    kept = np.exp(-rate * period_s)
    return LtiSystem(
        kept * one, np.sqrt(-np.expm1(-2.0 * rate * period_s)) * size, one, none, period_s
    )


def _require_continuous(key: str, period_s: float | None) -> None:
    if period_s is not None:
        raise InputError(f"{key} is one in continuous time; write its transfer function of z")


def _names(given: tuple[str, ...]) -> str | tuple[str, ...]:
    return given[0] if len(given) == 1 else given


def system_from_file(path: Path, variable: str = "") -> LtiSystem:
    """Return the system in a file.

    Parameters
    ----------
    path : Path
        A ``.mat`` file, a plain ``.npz`` file of a, b, c, d and, in discrete time, dt_s, or the
        product of a stage that holds a controller.
    variable : str
        Which system of a ``.mat`` file; not needed where it holds one.

    Raises
    ------
    InputError
        If the file cannot be read, or holds no such system.
    """
    if path.suffix == ".npz":
        return _from_npz(path)
    systems = {
        name: content for name, content in load_mat(path).items() if isinstance(content, LtiSystem)
    }
    if not variable and len(systems) == 1:
        return next(iter(systems.values()))
    if variable in systems:
        return systems[variable]
    names = ", ".join(systems) or "none"
    what = f"no system {variable!r}" if variable else "more than one system, or none"
    raise InputError(f"{path.name}: {what}; there are: {names}; name one as 'variable'")


def _from_npz(path: Path) -> LtiSystem:
    """Return the system of a plain file of a, b, c, d and dt_s, or of a stored `LtiSystem`."""
    arrays = read_arrays(path)
    if HEADER in arrays:
        product = load_product(path)
        product = getattr(product, "controller", product)
        if not isinstance(product, LtiSystem):
            raise InputError(f"{path.name}: holds a {type(product).__name__}, not a system")
        return product
    if missing := [name for name in "abcd" if name not in arrays]:
        raise InputError(f"{path.name}: has no array {missing[0]!r}; a, b, c and d are needed")
    period = arrays.get("dt_s", np.zeros(()))
    if period.size != 1 or period.dtype.kind not in "fiu":
        raise InputError(f"{path.name}: dt_s must be one number, a period in seconds")
    try:
        a, b, c, d = (arrays[name] for name in "abcd")
        return LtiSystem(a, b, c, d, float(period.flat[0]) or None)
    except InputError as error:
        raise InputError(f"{path.name}: {error}") from error
