"""Systems of first-order equations made from plants, in SI or normalised units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.bounds import UNWANTED, Bound
from hillsphere.engine.dynamics.compiled import ArrayFunction, Terms, spread
from hillsphere.engine.dynamics.enclosures import Bounded, LinearRows
from hillsphere.engine.dynamics.intervals import Interval, multiply, point
from hillsphere.interfaces.plant import (
    ConservedQuantity,
    ExternalEvents,
    ExternalInputs,
    MirrorSymmetry,
    PiecewisePlant,
    Plant,
    TimedPlant,
)
from hillsphere.interfaces.quantities import Parameter, Variable
from hillsphere.symbolic.expressions import (
    Expr,
    Params,
    constant,
    parameter,
    parameter_names,
    substitute,
    time,
    variable,
    variable_names,
)

__all__ = ["External", "PlantBounds", "System", "system"]

CONTROL = "u:"
"""Prefix of a control among the run-time parameters."""


@dataclass(frozen=True, eq=False)
class External:
    """Terms of the right-hand side that are functions of arrays (see `ExternalInputs`).

    Parameters
    ----------
    variables : tuple of Expr
        The m variables that stand for the terms, SI, in the right-hand side.
    values : callable
        (x (n, N), t (N,), p (k, N)) → (m, N); x and t in the system's units, p its run-time rows.
    jacobian : callable
        The same arguments → (m, n, N), by x in the system's units.
    """

    variables: tuple[Expr, ...]
    values: Callable[[Array, Array, Array], Array]
    jacobian: Callable[[Array, Array, Array], Array]


@dataclass(frozen=True, eq=False)
class System:
    """n first-order equations ẋ = f(t, x; p), ready to be compiled.

    Parameters
    ----------
    states : tuple of Variable
        The n states, with their dimensions.
    x, rhs : tuple of Expr
        Their symbols and time derivatives, in the system's units.
    run_time : tuple of Parameter
        The k run-time parameters in the order of the rows of `p`, with nominal values; always SI.
    events : mapping of str to Expr
        Event functions, whose fall through zero ends a flight; their values are SI.
    integral : Expr or None
        Integral of motion, in the system's units.
    unit : ndarray, shape (n,)
        SI size of one unit of each state; ones if the system is physical.
    scale : ndarray, shape (n,)
        Typical size of each state in the system's units, by which differences are scaled; ones if
        the system is normalised.
    error_scale : ndarray, shape (n,), or None
        Scale of the estimated errors of steps; `scale` if None.
    passing : tuple of int
        Rows whose errors affect the others for about one step only. Their `error_scale` is per unit
        of time, and their errors are multiplied by the step.
    time_unit_s : float
        Unit of time, s; 1 if the system is physical.
    frame : str
        Frame of the states.
    mirrors : mapping of str to tuple of int
        Sign of each state under the plant's time reversals (see `MirrorSymmetry`).
    external : External or None
        Terms that are functions of arrays.
    switches : tuple of Expr
        Switching functions, zero where the right-hand side changes branch (see `PiecewisePlant`).
    event_terms : tuple of (tuple of Expr, Terms), or None
        Variables of the events that are functions of arrays (see `ExternalEvents`), and the
        function that gives their values, SI, from states and times in the system's units.
    time_terms : mapping of str to Expr
        Functions of the system's time alone that the right-hand side uses as parameters of these
        names, outside `p` (see `TimedPlant`).
    bounded : Bounded or None
        Right-hand side and events in interval arithmetic.
    """

    states: tuple[Variable, ...]
    x: tuple[Expr, ...]
    rhs: tuple[Expr, ...]
    run_time: tuple[Parameter, ...]
    events: Mapping[str, Expr]
    integral: Expr | None
    unit: Array
    scale: Array
    time_unit_s: float
    frame: str
    error_scale: Array | None = None
    passing: tuple[int, ...] = ()
    mirrors: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    external: External | None = None
    switches: tuple[Expr, ...] = ()
    event_terms: tuple[tuple[Expr, ...], Terms] | None = None
    time_terms: Mapping[str, Expr] = field(default_factory=dict)
    bounded: Bounded | None = None

    @property
    def errors_in(self) -> Array:
        """Scale (n,) of the estimated errors of steps."""
        return self.scale if self.error_scale is None else self.error_scale

    @property
    def run_time_names(self) -> tuple[str, ...]:
        """Names of the run-time parameters, in the order of the rows of `p`."""
        return tuple(p.name for p in self.run_time)

    def parameters(self, p: ArrayLike | None, cases: int) -> Array:
        """Return run-time parameters as (k, N); nominal ones for None.

        Parameters
        ----------
        p : array_like, shape (k,) or (k, N), or None
            Values, SI.
        cases : int
            N.

        Returns
        -------
        numpy.ndarray, shape (k, N)
            Contiguous.

        Raises
        ------
        InputError
            If the shape does not fit.
        """
        if p is None:
            p = np.array([q.value for q in self.run_time])
        return spread(p, len(self.run_time), cases, "p")

    def function(self, *expressions: Expr) -> ArrayFunction:
        """Compile expressions of the states, time and run-time parameters.

        Parameters
        ----------
        *expressions : Expr
            In the symbols of `x` and of `event_terms`, in the system's units (e.g. `integral`).

        Returns
        -------
        ArrayFunction
            f(x (n, N), p, t) → (m, N).
        """
        terms = self.event_terms if self.external_events(expressions) else None
        return ArrayFunction(expressions, self.x, self.run_time_names, terms=terms)

    def external_events(self, expressions: Sequence[Expr]) -> list[str]:
        """Return the names of the `event_terms` that expressions hold, sorted."""
        if self.event_terms is None:
            return []
        return sorted({*variable_names(expressions)} & {*variable_names(self.event_terms[0])})


def system(
    plant: Plant,
    *,
    run_time: Sequence[str] = (),
    normalised: bool = False,
    controls: bool = False,
    apart: bool = False,
) -> System:
    """Compose the system of equations of a plant.

    Parameters
    ----------
    plant : Plant
        Equations, SI.
    run_time : sequence of str
        Names of ``plant.parameters()`` that stay run-time parameters, in the order of the rows of
        `p`; the others become constants.
    normalised : bool
        Whether states, time, right-hand side and integral are in units of ``plant.scales``
        (x̂ = x/unit, t̂ = t/time_unit). Run-time parameters and the values of events stay SI.
    controls : bool
        Whether the controls are additional run-time parameters, ``"u:" + name``, SI; otherwise
        they are zero.
    apart : bool
        Whether terms that depend on time alone are separated from the right-hand side, in
        `System.time_terms`, for a step map without derivatives and lanes that share their times.

    Returns
    -------
    System
        The system, for the propagators of this package.

    Raises
    ------
    InputError
        If the plant is not consistent, or a name is unknown or given twice.
    """
    kind = type(plant).__name__
    states = tuple(plant.states)
    names = [v.name for v in states]
    if len(set(names)) != len(names) or not names:
        raise InputError(f"{kind}: states need different names, got {names}")
    kept = _run_time(plant, run_time, controls)
    chosen = {q.name for q in kept}

    x = tuple(variable(name) for name in names)
    p: Params = {
        q.name: parameter(q.name) if q.name in chosen else constant(q.value)
        for q in plant.parameters()
    }
    u = tuple(parameter(CONTROL + v.name) if controls else constant(0.0) for v in plant.controls)
    outside = plant if isinstance(plant, ExternalInputs) and plant.external else None
    terms = _time_terms(plant, p) if apart and outside is None else {}
    rhs = tuple(plant.derivative(x, u, time, {**p, **{name: parameter(name) for name in terms}}))
    if len(rhs) != len(x):
        raise InputError(f"{kind}: {len(x)} states but {len(rhs)} derivatives")
    externals = tuple(variable(v.name) for v in outside.external) if outside else ()
    watched = plant if isinstance(plant, ExternalEvents) and plant.event_terms else None
    on_events = tuple(variable(v.name) for v in watched.event_terms) if watched else ()
    events = dict(plant.events(x, time, p))
    switches = tuple(plant.switches(x, time, p)) if isinstance(plant, PiecewisePlant) else ()
    integral = plant.integral(x, p) if isinstance(plant, ConservedQuantity) else None
    known = chosen | set(terms)
    _check_symbols(kind, "derivative", rhs, names + variable_names(externals), known)
    _check_symbols(kind, "time_terms", tuple(terms.values()), (), set())
    terms = {name: terms[name] for name in parameter_names(rhs) if name in terms}
    in_events = names + variable_names(on_events)
    _check_symbols(kind, "events", tuple(events.values()), in_events, chosen)
    _check_symbols(kind, "switches", switches, names, chosen)

    scales = plant.scales
    typical = scales.of(states)
    if not (np.isfinite(typical).all() and (typical > 0).all() and scales.time_s > 0):
        raise InputError(f"{kind}: scales must be positive and finite, got {scales}")
    unit, time_unit = (typical, scales.time_s) if normalised else (np.ones(len(x)), 1.0)
    if normalised:
        to_si = {s: s * size for s, size in zip(x, unit.tolist(), strict=True)}
        to_si[time] = time * time_unit
        rhs = tuple(
            f * (time_unit / size)
            for f, size in zip(substitute(rhs, to_si), unit.tolist(), strict=True)
        )
        events = dict(zip(events, substitute(tuple(events.values()), to_si), strict=True))
        switches = substitute(switches, to_si)
        terms = {name: substitute([e], to_si)[0] for name, e in terms.items()}
        if integral is not None and isinstance(plant, ConservedQuantity):
            size = float(scales.of([plant.integral_variable])[0])
            integral = substitute([integral], to_si)[0] / size
    arguments = _Arguments.of(plant.parameters(), kept, unit, time_unit)
    return System(
        states=states,
        x=x,
        rhs=rhs,
        run_time=kept,
        events=events,
        integral=integral,
        unit=unit,
        scale=typical / unit,
        time_unit_s=time_unit,
        frame=plant.frame,
        mirrors=dict(plant.mirrors) if isinstance(plant, MirrorSymmetry) else {},
        external=_external(outside, arguments) if outside else None,
        switches=switches,
        event_terms=_event_terms(watched, on_events, arguments) if watched else None,
        time_terms=terms,
        bounded=PlantBounds(plant, kept, controls, unit, time_unit),
    )


@dataclass(frozen=True, eq=False)
class PlantBounds:
    """A plant's equations and events in interval arithmetic, in a system's units.

    Parameters
    ----------
    plant : Plant
        Equations, SI.
    run_time : sequence of Parameter
        Parameters in the rows of p, without the controls, which follow them.
    controls : bool
        Whether p has rows of controls.
    unit : ndarray, shape (n,)
        SI size of one unit of each state.
    time_unit_s : float
        Unit of time, s.
    """

    plant: Plant
    run_time: Sequence[Parameter]
    controls: bool
    unit: Array
    time_unit_s: float
    linear: LinearRows | None = None

    def rates(
        self,
        t: Bound,
        y: Sequence[Bound],
        p: Sequence[Interval],
        u: Sequence[Bound] | None = None,
    ) -> list[Bound]:
        """Return bounds of dy/dt; `u`, if given, replaces the rows of controls in p."""
        x, when, values = self._si(t, y, p)
        names = [CONTROL + v.name for v in self.plant.controls]
        rows = {q.name: row for q, row in zip(self.run_time, p, strict=False)}
        if u is None:
            u = [Bound(rows[name]) if self.controls else Bound.of(0.0) for name in names]
        rates = self.plant.derivative(x, tuple(u), when, values)
        sizes = self.unit.tolist()
        if self.time_unit_s == 1.0 and (self.unit == 1.0).all():
            return [Bound.of(f) for f in rates]
        scale = [self.time_unit_s / size for size in sizes]
        return [self._inner(Bound.of(f) * k) for f, k in zip(rates, scale, strict=True)]

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the events."""
        x, when, values = self._si(t, y, p)
        bounds = self.plant.events(x, when, values)
        return [self._inner(Bound.of(e)) for e in bounds.values()]

    def _si(
        self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]
    ) -> tuple[tuple[Bound, ...], Bound, dict[str, Bound]]:
        """Return states, time and all parameters, SI."""
        rows = {q.name: row for q, row in zip(self.run_time, p, strict=False)}
        values = {q.name: Bound(rows.get(q.name, point(q.value))) for q in self.plant.parameters()}
        if self.time_unit_s == 1.0 and (self.unit == 1.0).all():
            return tuple(y[: len(self.unit)]), t, values
        size = self.unit.tolist()
        x = tuple(self._outer(part * s) for part, s in zip(y, size, strict=False))
        return x, self._outer(t * self.time_unit_s), values

    def _outer(self, x: Bound) -> Bound:
        """Convert derivatives by the system's time to derivatives by seconds."""
        return _at_time(x, 1.0 / self.time_unit_s)

    def _inner(self, x: Bound) -> Bound:
        """Convert derivatives by seconds to derivatives by the system's time."""
        return _at_time(x, self.time_unit_s)


def _at_time(x: Bound, k: float) -> Bound:
    rate = None if x.rate is None else multiply(x.rate, point(k))
    if x.second is UNWANTED:
        return Bound(x.value, rate, UNWANTED)
    second = None if x.second is None else multiply(multiply(x.second, point(k)), point(k))
    return Bound(x.value, rate, second)


def _time_terms(plant: Plant, p: Params) -> dict[str, Expr]:
    """Return the plant's terms that depend on time and constants alone."""
    terms = plant.time_terms(time, p) if isinstance(plant, TimedPlant) else {}
    if clash := sorted(set(terms) & set(p)):
        raise InputError(f"{type(plant).__name__}: time_terms have names of parameters: {clash}")
    return {name: e for name, e in terms.items() if not parameter_names([e])}


def _run_time(plant: Plant, names: Sequence[str], controls: bool) -> tuple[Parameter, ...]:
    """Return the requested run-time parameters, then the controls."""
    if isinstance(names, str):
        raise InputError(f"run_time must be a sequence of names, got the string {names!r}")
    kind = type(plant).__name__
    known = {q.name: q for q in plant.parameters()}
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; it has {sorted(known) or 'none'}"
            raise InputError(f"{kind} has no parameter {name!r}{hint}")
    if len(set(names)) != len(names):
        raise InputError(f"run-time parameters given twice: {list(names)}")
    kept = tuple(known[name] for name in names)
    if controls:
        kept += tuple(Parameter(CONTROL + v.name, 0.0, v.unit) for v in plant.controls)
    return kept


def _check_symbols(
    kind: str, what: str, expressions: Sequence[Expr], names: Sequence[str], chosen: set[str]
) -> None:
    """Refuse symbols in expressions that have no value at run time."""
    if unknown := sorted(set(variable_names(expressions)) - set(names)):
        raise InputError(f"{kind}: {what} holds variables that are not states: {unknown}")
    if unknown := sorted(set(parameter_names(expressions)) - chosen):
        raise InputError(f"{kind}: {what} holds parameters that it did not declare: {unknown}")


@dataclass(frozen=True)
class _Arguments:
    """Converts a system's arrays to those of its plant: SI, all parameters, only its states."""

    nominal: Array
    pairs: tuple[tuple[int, int], ...]
    unit: Array
    time_unit: float

    @classmethod
    def of(
        cls,
        declared: Sequence[Parameter],
        kept: Sequence[Parameter],
        unit: Array,
        time_unit: float,
    ) -> _Arguments:
        nominal = np.array([[q.value] for q in declared]).reshape(len(declared), 1)
        rows = {q.name: i for i, q in enumerate(declared)}
        pairs = tuple((rows[q.name], k) for k, q in enumerate(kept) if q.name in rows)
        return cls(nominal, pairs, unit, time_unit)

    def __call__(self, x: Array, t: Array, p: Array) -> tuple[Array, Array, Array]:
        full = np.repeat(self.nominal, x.shape[1], axis=1)
        for row, k in self.pairs:
            full[row] = p[k]
        # A law's states may follow those of the plant.
        return x[: len(self.unit)] * self.unit[:, None], t * self.time_unit, full


def _external(
    plant: ExternalInputs,
    arguments: _Arguments,
) -> External:
    """Wrap a plant's array terms for the system's units and run-time parameters."""
    unit, n, m = arguments.unit, len(arguments.unit), len(plant.external)

    def values(x: Array, t: Array, p: Array) -> Array:
        terms = np.asarray(plant.external_array(*arguments(x, t, p)), dtype=float)
        if terms.shape != (m, x.shape[1]):
            raise InputError(f"external_array must return {(m, x.shape[1])}, got {terms.shape}")
        return terms

    def jacobian(x: Array, t: Array, p: Array) -> Array:
        derivatives = np.asarray(plant.external_jacobian(*arguments(x, t, p)), dtype=float)
        if derivatives.shape != (m, n, x.shape[1]):
            raise InputError(
                f"external_jacobian must return {(m, n, x.shape[1])}, got {derivatives.shape}"
            )
        return derivatives * unit[None, :, None]

    return External(tuple(variable(v.name) for v in plant.external), values, jacobian)


def _event_terms(
    plant: ExternalEvents, variables: tuple[Expr, ...], arguments: _Arguments
) -> tuple[tuple[Expr, ...], Terms]:
    """Wrap the array terms of a plant's events for the system's units and parameters."""

    def values(x: Array, t: Array, p: Array) -> Array:
        terms = np.asarray(plant.event_terms_array(*arguments(x, t, p)), dtype=float)
        if terms.shape != (len(variables), x.shape[1]):
            raise InputError(
                f"event_terms_array must return {(len(variables), x.shape[1])}, got {terms.shape}"
            )
        return terms

    return variables, values
