"""Equations of motion in a named frame, and what a plant may offer besides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.quantities import Parameter, Scales, Variable

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import Expr, Params

__all__ = [
    "ConservedQuantity",
    "ExternalEvents",
    "ExternalInputs",
    "MirrorSymmetry",
    "PiecewisePlant",
    "Plant",
    "TimedPlant",
]


class Plant(Protocol):
    """Equations of motion in a named frame, SI.

    A plant whose gravity is an `ArrayGravityModel` also offers `ExternalInputs`; one with an
    integral of motion `ConservedQuantity`, with a time-reversal symmetry `MirrorSymmetry`; one
    whose expressions change branch offers `PiecewisePlant`, and one some of whose events are no
    expressions `ExternalEvents`.
    `hillsphere.engine.dynamics.system` makes a system of equations of it, normalised or not.
    """

    @property
    def frame(self) -> str:
        """Name of the frame of the states, see `hillsphere.testing.frames`."""
        ...

    @property
    def states(self) -> tuple[Variable, ...]:
        """States in order; positions, then velocities, then others."""
        ...

    @property
    def controls(self) -> tuple[Variable, ...]:
        """Controls in order (may be none)."""
        ...

    @property
    def scales(self) -> Scales:
        """Natural units."""
        ...

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all run-time parameters, those of injected models prefixed (``"gravity.gm"``)."""
        ...

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI, for states x, controls u, time t (s) and parameters p."""
        ...

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return functions whose fall through zero ends a flight (``"impact"`` …)."""
        ...


@runtime_checkable
class ExternalInputs(Contract, Protocol):
    """A plant some of whose terms are functions of arrays, not expressions (tabulated gravity).

    Its `derivative` uses them as plain variables, ``symbolic.variable(name)``, of the names listed
    in `external`. The step map evaluates them at every Runge–Kutta stage; the Taylor propagator,
    which must differentiate in time, cannot take such a plant.
    """

    @property
    def external(self) -> tuple[Variable, ...]:
        """The m terms in order; empty for a plant that is wholly symbolic."""
        ...

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the terms, SI, shape (m, N).

        The arguments are the states x (n, N), SI, times t (N,), s, and all of the plant's
        `parameters`, in their order, p (k, N).
        """
        ...

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        """Return the derivatives of the terms by the states, SI, shape (m, n, N)."""
        ...


@runtime_checkable
class ExternalEvents(Contract, Protocol):
    """A plant some of whose events are functions of arrays (contact with a polyhedron).

    Its `events` use them as plain variables of the names listed in `event_terms`; nothing else of
    the plant may. The step map evaluates them where it watches events, not at every stage; the
    Taylor propagator, which needs the events as series in time, refuses such an event.
    """

    @property
    def event_terms(self) -> tuple[Variable, ...]:
        """The m terms in order; empty for a plant whose events are all expressions."""
        ...

    def event_terms_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the terms, SI, shape (m, N); arguments as for `ExternalInputs.external_array`."""
        ...


@runtime_checkable
class ConservedQuantity(Contract, Protocol):
    """A plant with an integral of motion."""

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        """Return the integral, SI."""
        ...

    @property
    def integral_variable(self) -> Variable:
        """Its name and dimension."""
        ...


@runtime_checkable
class MirrorSymmetry(Contract, Protocol):
    """A plant that is unchanged when time runs backwards and some states change sign."""

    @property
    def mirrors(self) -> Mapping[str, tuple[int, ...]]:
        """Mirror name (``"xz"``: the plane that stays) → sign of each state under time reversal."""
        ...


@runtime_checkable
class PiecewisePlant(Contract, Protocol):
    """A plant whose derivative changes branch, its own or that of a `Piecewise` gravity model."""

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return functions that vanish where the branch changes.

        Without dimension and of order one, with a slope at their zeros. The Taylor propagator
        begins a new series where one of them changes sign; they end no flight.
        """
        ...


@runtime_checkable
class TimedPlant(Contract, Protocol):
    """A plant that names terms of its derivative that depend on time and parameters only.

    Where many lanes fly at the same times, as the sigma points of a filter do, these are computed
    once for all of them instead of in every lane.
    """

    def time_terms(self, t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return the terms by their names, which no parameter has.

        `Plant.derivative` may find some of these names in its `p` and must then use what stands
        there in place of its own expressions.
        """
        ...
