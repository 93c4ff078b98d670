"""Plants: equations of motion in a named frame, and optional properties of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.quantities import Parameter, Scales, Variable

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import Expr, Params

__all__ = [
    "ArrayConserved",
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

    Optional protocols: `ExternalInputs` for gravity that is an `ArrayGravityModel`,
    `ConservedQuantity` for an integral of motion (`ArrayConserved` with such gravity),
    `MirrorSymmetry` for a time-reversal symmetry, `PiecewisePlant` for expressions that change
    branch, `ExternalEvents` for events that are not expressions.
    `hillsphere.engine.dynamics.system` composes the system of equations, normalised or in SI.
    """

    @property
    def frame(self) -> str:
        """Name of the frame of the states, see `hillsphere.testing.frames`."""
        ...

    @property
    def states(self) -> tuple[Variable, ...]:
        """States in order: positions, then velocities, then others."""
        ...

    @property
    def controls(self) -> tuple[Variable, ...]:
        """Controls in order; may be empty."""
        ...

    @property
    def scales(self) -> Scales:
        """Units of length and time in which the plant's numbers are of order one."""
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
        """Return event functions by name (``"impact"`` …); a fall through zero ends the flight."""
        ...


@runtime_checkable
class ExternalInputs(Contract, Protocol):
    """A plant with terms that are functions of arrays, not expressions (tabulated gravity).

    Its `derivative` uses them as plain variables, ``symbolic.variable(name)``, with the names in
    `external`. The step map evaluates them at every Runge–Kutta stage; the Taylor propagator,
    which needs derivatives in time, refuses such a plant.
    """

    @property
    def external(self) -> tuple[Variable, ...]:
        """Names of the m terms in order; empty for a plant of expressions alone."""
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
    """A plant with events that are functions of arrays (contact with a polyhedron).

    Its `events`, and nothing else of the plant, use them as plain variables with the names in
    `event_terms`. The step map evaluates them where it checks events, not at every stage; the
    Taylor propagator, which needs events as series in time, refuses such an event.
    """

    @property
    def event_terms(self) -> tuple[Variable, ...]:
        """Names of the m terms in order; empty if all events are expressions."""
        ...

    def event_terms_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the terms, SI, shape (m, N); arguments as for `ExternalInputs.external_array`."""
        ...


@runtime_checkable
class ConservedQuantity(Contract, Protocol):
    """A plant with an integral of motion, constant along every uncontrolled flight.

    An integral of a spacecraft's motion is C = W − ½v², with W a function of the position alone and
    v the speed in the plant's frame: the negative of the energy per mass, half of the textbook's
    Jacobi constant 2W − v². At one place a larger C means a slower flight. Stages that turn a
    difference of C into a difference of speed (transfers, nearby resonances) rely on sign and
    factor; the zero of W is the plant's choice. Other systems may conserve any quantity that a
    stage only compares.
    """

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        """Return the integral, SI, in the dimension of `integral_variable`."""
        ...

    @property
    def integral_variable(self) -> Variable:
        """Name and dimension of the integral."""
        ...


@runtime_checkable
class ArrayConserved(Contract, Protocol):
    """A plant whose integral of motion is a function of arrays, not an expression.

    Its gravity is an `ArrayGravityModel` (a polyhedron, a table), whose potential has no
    expression. Sign and factor are those of `ConservedQuantity`.
    """

    def integral_array(self, x: Array) -> Array:
        """Return the integral (N,), m²/s², at states (n, N), SI, with nominal parameters."""
        ...


@runtime_checkable
class MirrorSymmetry(Contract, Protocol):
    """A plant whose equations are unchanged by time reversal with sign changes of some states."""

    @property
    def mirrors(self) -> Mapping[str, tuple[int, ...]]:
        """Name of the mirror plane (``"xz"``) → sign of each state under time reversal."""
        ...


@runtime_checkable
class PiecewisePlant(Contract, Protocol):
    """A plant whose derivative changes branch, its own or that of a `Piecewise` gravity model."""

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return switching functions, which vanish where the branch changes.

        They are without dimension, of order one, and have non-zero slope at their zeros. The Taylor
        propagator begins a new series where one of them changes sign; they do not end a flight.
        """
        ...


@runtime_checkable
class TimedPlant(Contract, Protocol):
    """A plant with named terms of its derivative that depend only on time and parameters.

    If many lanes share their times, as the sigma points of a filter do, these terms are computed
    once for all of them.
    """

    def time_terms(self, t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return the terms by name; no parameter may have one of these names.

        If `p` of `Plant.derivative` holds one of these names, the derivative must use that value in
        place of its own expression.
        """
        ...
