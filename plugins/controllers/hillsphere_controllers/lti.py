"""Control laws from linear controllers: from a synthesis, a file or matrices."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Variable
from hillsphere.lti import LtiSystem
from hillsphere.symbolic import Expr
from hillsphere_controllers.law_specs import LtiSpec
from hillsphere_controllers.stages.signals import find_signals
from hillsphere_controllers.state_space import error_feedback
from hillsphere_controllers.systems.algebra import series
from hillsphere_controllers.systems.exchange import load_mat
from hillsphere_controllers.systems.sampling import sampled_controller

__all__ = ["ContinuousLti", "LinearLaw", "Lti", "build_flight_controller", "lti"]


@runtime_checkable
class LinearLaw(Contract, Protocol):
    """A law that gives its linear controller at any sampling period, for analysis."""

    @property
    def period_s(self) -> float:
        """Time between two samples."""
        ...

    def at_period(self, period_s: float, controller: LtiSystem | None = None) -> LtiSystem:
        """Return u = K (seen − reference), in continuous time if it acts between samples.

        Of its own controller, or of another one.
        """
        ...


def lti(spec: LtiSpec) -> Lti | ContinuousLti:
    """Make the law: of a sampled controller, or one whose states move between samples."""
    return ContinuousLti(spec) if spec.states == "continuous" else Lti(spec)


def build_flight_controller(spec: LtiSpec, controller: LtiSystem) -> LtiSystem:
    """Return the controller as the law flies it: inputs chosen, filtered, brought to samples.

    Parameters
    ----------
    spec : LtiSpec
        Of the law.
    controller : LtiSystem
        K, as the synthesis gives it.

    Returns
    -------
    LtiSystem
        From what the law sees, as a deviation or an error (`LtiSpec.sees`), to its command, the
        filters included: in continuous time if it runs between samples, else of their period.

    Raises
    ------
    InputError
        If it has no such inputs, or does not fit the period.
    """
    made = controller
    if spec.measurements:
        seen = find_signals(made.inputs, spec.measurements, "measurements")
        made = LtiSystem(made.a, made.b[:, seen], made.c, made.d[:, seen], made.dt_s)
    if made.dt_s is not None and (spec.states == "continuous" or spec.low_pass_hz is not None):
        what = "states = 'continuous'" if spec.states == "continuous" else "low_pass_hz"
        raise InputError(f"{what}: the controller is one in discrete time; leave it out")
    if spec.low_pass_hz is not None:
        corner, one = 2.0 * pi * spec.low_pass_hz, np.eye(made.shape[1])
        made = series(LtiSystem(-corner * one, corner * one, one, 0.0 * one), made)
    if spec.states == "continuous":
        return made
    return sampled_controller(made, spec.period_s, spec.method)


class _Law:
    """Common part of both laws: the controller's origin and its form in flight."""

    def __init__(self, spec: LtiSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self._sign = 1.0 if spec.sees == "error" else -1.0
        self._given: LtiSystem | None = None
        self._controller: LtiSystem | None = None
        given = _load_controller(spec)
        if given is not None:
            self._take(given)

    @property
    def complete(self) -> bool:
        """Whether it has a controller."""
        return self._controller is not None

    @property
    def controller(self) -> LtiSystem:
        """Controller in flight, see `build_flight_controller`."""
        if self._controller is None:
            raise InputError(
                "the law has no controller: give its matrices or a file, or the flight the "
                "synthesis as needs.controller"
            )
        return self._controller

    def at_period(self, period_s: float, controller: LtiSystem | None = None) -> LtiSystem:
        """Return u = K (seen − reference) at another period, see `LinearLaw`."""
        raw = self._given if controller is None else controller
        if raw is None:
            raise InputError("the law has no controller; name one")
        made = build_flight_controller(self.spec.model_copy(update={"period_s": period_s}), raw)
        return replace(made, b=-self._sign * made.b, d=-self._sign * made.d)

    def _take(self, controller: LtiSystem) -> None:
        self._given = controller
        self._controller = build_flight_controller(self.spec, controller)


class Lti(_Law):
    """u = K e, with K brought to the period of the samples, u held.

    Parameters
    ----------
    spec : LtiSpec
        Where the controller comes from. Without file and matrices the law waits for one.

    Raises
    ------
    InputError
        If the file has no such controller, or it does not fit the period.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def flying(self, controller: LtiSystem) -> Lti:
        """Return the law with this controller."""
        made = copy(self)
        made._take(controller)
        return made

    def _take(self, controller: LtiSystem) -> None:
        super()._take(controller)
        made = self.controller
        self._all = np.block([[made.a, made.b], [made.c, made.d]])

    def initial(self, n_cases: int) -> Array:
        """Return the controller's states (m, N), zero."""
        return np.zeros((self.controller.order, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (p, N) and the states (m, N)."""
        made = self.controller
        if len(y) != made.shape[1]:
            raise InputError(
                f"the controller takes {made.shape[1]} values, the law sees {len(y)}; name those "
                "that it was made for (sees of the flight, measurements of the law)"
            )
        both: Array = self._all @ np.concatenate([xc, self._sign * (ref - y)])
        return both[made.order :], both[: made.order]


class ContinuousLti(_Law):
    """u = K e, with filters and K running between samples too, on the e that is held.

    See `hillsphere.simulation.ContinuousLaw`.

    Parameters
    ----------
    spec : LtiSpec
        As for `Lti`.

    Raises
    ------
    InputError
        If the file has no such controller, or it is one in discrete time.
    """

    measurement: Literal["held", "continuous"] = "held"

    def __init__(self, spec: LtiSpec) -> None:
        self.inputs = 0
        self.states: tuple[Variable, ...] = ()
        self.fastest_rad_s = 0.0
        super().__init__(spec)

    def flying(self, controller: LtiSystem) -> ContinuousLti:
        """Return the law with this controller."""
        made = copy(self)
        made._take(controller)
        return made

    def _take(self, controller: LtiSystem) -> None:
        super()._take(controller)
        made = self.controller
        self.inputs = made.shape[1]
        self.states = tuple(Variable(f"law:x{i}") for i in range(made.order))
        self.fastest_rad_s = float(np.abs(made.poles).max(initial=0.0))

    def initial(self, n_cases: int) -> Array:
        """Return the states of filters and controller (m, N), zero."""
        return np.zeros((self.controller.order, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        """Return the states as they are."""
        return xc

    def derivative(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return A x + B e."""
        made = self.controller
        return error_feedback(made.a, self._sign * made.b, xc, y, ref)

    def control(
        self, xc: tuple[Expr, ...], y: tuple[Expr, ...], ref: tuple[Expr, ...], t: Expr
    ) -> tuple[Expr, ...]:
        """Return C x + D e."""
        made = self.controller
        return error_feedback(made.c, self._sign * made.d, xc, y, ref)


def _load_controller(spec: LtiSpec) -> LtiSystem | None:
    """Return the controller of the file or the matrices."""
    if spec.file is not None:
        path = Path(spec.file)
        variables = load_mat(path)
        made = variables.get(spec.variable)
        if not isinstance(made, LtiSystem):
            systems = [name for name, value in variables.items() if isinstance(value, LtiSystem)]
            raise InputError(
                f"{path.name} has no system {spec.variable!r}; its systems: "
                f"{', '.join(systems) or 'none'}"
            )
        return made
    if not (spec.c or spec.d):
        return None
    m, p = len(spec.a), len(spec.c or spec.d)
    q = len((spec.b or spec.d)[0])
    shapes = {"a": (m, m), "b": (m, q), "c": (p, m), "d": (p, q)}
    a, b, c, d = (
        np.array(getattr(spec, key) or np.zeros(shape), dtype=float).reshape(shape)
        for key, shape in shapes.items()
    )
    return LtiSystem(a, b, c, d, None if spec.form == "continuous" else spec.period_s)
