"""The interfaces between the core and its plugins: one small Protocol per kind.

A component is made from its bound `Spec` and holds configuration, no hidden state. N is always
the number of independent cases, the last axis of an array. Interfaces of kinds that no plugin
fills yet appear here together with the first one that does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.contracts import Contract
from hillsphere.presentation import Presentation

if TYPE_CHECKING:
    from pathlib import Path

    from hillsphere.campaign.cases import CaseResults
    from hillsphere.campaign.tasks import Executor
    from hillsphere.earth.geodetic import Station
    from hillsphere.earth.orientation import EarthOrientation
    from hillsphere.estimation import Belief, Innovation, MeasurementSet
    from hillsphere.lti import LtiSystem
    from hillsphere.simulation.protocols import ContinuousLaw
    from hillsphere.symbolic import Expr, Params, Vec3
    from hillsphere.time import Epoch

Array: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class Parameter:
    """A number in a model's equations that may become a run-time parameter.

    Parameters
    ----------
    name : str
        Unique within the model, e.g. ``"gm"`` or ``"C2,0"``.
    value : float
        Nominal value, SI.
    unit : str
        E.g. ``"m3/s2"``, ``"-"``.
    positive : bool
        Whether only values above zero mean anything: a case of a campaign that draws another is
        not computed.
    """

    name: str
    value: float
    unit: str = "-"
    positive: bool = False


@dataclass(frozen=True)
class Variable:
    """A state or control of a plant.

    Parameters
    ----------
    name : str
        Unique within the plant.
    length, time : int
        Exponents of its dimension: a speed is ``Variable("vx", 1, -1)``. They fix the unit and
        the factor between physical and normalised values.
    frame : str
        Frame in which it is expressed; ``""`` for the plant's own.
    unit : str
        Overrides the unit that follows from the exponents (``"rad"`` for an angle).
    """

    name: str
    length: int = 0
    time: int = 0
    frame: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Scales:
    """Units of length and time in which a plant's numbers are of order one."""

    length_m: float
    time_s: float

    def of(self, variables: Sequence[Variable]) -> Array:
        """SI size of one normalised unit of each variable, shape (n,)."""
        return np.array([self.length_m**v.length * self.time_s**v.time for v in variables])


class GravityModel(Protocol):
    """Gravity of one body as expressions, exactly differentiable.

    The engine derives array evaluators and gradients from it (`hillsphere.gravity`).
    """

    @property
    def frame(self) -> str:
        """Body-fixed frame of positions, potential and acceleration."""
        ...

    @property
    def gm_m3_s2(self) -> float:
        """Nominal gravitational parameter of the whole, m³/s²."""
        ...

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the numbers that may be set at run time; `p` below holds one of each."""
        ...

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the body-fixed position r, m."""
        ...

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s²."""
        ...


@runtime_checkable
class ArrayGravityModel(Contract, Protocol):
    """Gravity that cannot be written as an expression (a table, a polyhedron)."""

    @property
    def frame(self) -> str:
        """Body-fixed frame."""
        ...

    @property
    def gm_m3_s2(self) -> float:
        """Nominal gravitational parameter of the whole, m³/s²."""
        ...

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the numbers that may be set at run time, in the order of `p` below."""
        ...

    def potential_array(self, r: Array, p: Array) -> Array:
        """Return +U, m²/s², shape (N,), at r (3, N), m, with parameters p (k, N)."""
        ...

    def acceleration_array(self, r: Array, p: Array) -> Array:
        """Return ∇U, m/s², shape (3, N)."""
        ...


@runtime_checkable
class SeriesGravity(Contract, Protocol):
    """Gravity as a series that is sure to converge only outside a sphere about the centre."""

    @property
    def series_radius_m(self) -> float | None:
        """Radius of that sphere as far as the model knows it, m; None if there is no series."""
        ...


@runtime_checkable
class BoundedGravity(Contract, Protocol):
    """A gravity model, of expressions or arrays, that bounds the size of its acceleration.

    From it events are proved (`hillsphere.dynamics.enclosures`). A `GravityModel` that is written
    in plain arithmetic needs none; one that differentiates a potential does.
    """

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s², wherever the distance from the centre is as given.

        The distance, m, is an interval, as what `p` holds; written with the functions of
        `hillsphere.symbolic`.
        """
        ...


@runtime_checkable
class SlopedSurface(Contract, Protocol):
    """A surface whose function is Lipschitz continuous: contact with it can be proved."""

    @property
    def steepest_per_m(self) -> float:
        """Lipschitz constant of the surface function, 1/m, everywhere off the centre."""
        ...


@runtime_checkable
class Piecewise(Contract, Protocol):
    """A `GravityModel` whose expressions change branch (`hillsphere.symbolic.select`)."""

    def switches(self, r: Vec3, p: Params) -> tuple[Expr, ...]:
        """Return functions that vanish where the branch changes, at the body-fixed position r, m.

        Without dimension and of order one about the body, with a slope at their zeros. The
        position may be any expression: do not differentiate by it.
        """
        ...


@runtime_checkable
class Surface(Contract, Protocol):
    """A body with a surface: positive outside, zero on it, negative inside."""

    def surface(self, r: Vec3) -> Expr:
        """Return the implicit surface function at the body-fixed position r, m."""
        ...

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the semi-axes of the (bounding) ellipsoid along x, y, z, m."""
        ...


@runtime_checkable
class ArraySurface(Contract, Protocol):
    """A `Surface` that cannot be written as an expression (a polyhedron, a grid of radii)."""

    def surface_array(self, r: Array) -> Array:
        """Return the implicit surface function (N,) at body-fixed positions r (3, N), m.

        Without dimension, of order one about the body and continuous.
        """
        ...

    def normal_array(self, r: Array) -> Array:
        """Return the unit outward normals (3, N) where the rays from the centre through r pass."""
        ...

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return half the extent along x, y, z, m, of a box about the centre that holds all."""
        ...


@runtime_checkable
class Enclosed(Contract, Protocol):
    """A surface of which is known how far from the centre it reaches, in whatever direction."""

    @property
    def largest_radius_m(self) -> float:
        """Radius of the smallest sphere about the centre that holds the body, m."""
        ...


class Plant(Protocol):
    """Equations of motion in a named frame, SI.

    A plant whose gravity is an `ArrayGravityModel` also offers `ExternalInputs`; one with an
    integral of motion `ConservedQuantity`, with a time-reversal symmetry `MirrorSymmetry`; one
    whose expressions change branch offers `PiecewisePlant`, and one some of whose events are no
    expressions `ExternalEvents`.
    `hillsphere.dynamics.system` makes a system of equations of it, normalised or not.
    """

    @property
    def frame(self) -> str:
        """Name of the frame of the states, see `hillsphere.frames`."""
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


class OrbitProblem(Protocol):
    """Equations whose solutions are the periodic orbits of one family.

    m unknowns z satisfy F(z) = 0, where F has rank m − 1: a curve of orbits, which continuation
    follows on any plant.
    """

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the m unknowns, in order; scaled to be of order one."""
        ...

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return F (k, N) and dF/dz (k, m, N) at z (m, N); k ≥ m − 1, of rank m − 1 if F = 0."""
        ...

    def state(self, z: Array) -> Array:
        """Return the initial states (n, N), normalised."""
        ...

    def period(self, z: Array) -> Array:
        """Return the full periods (N,), normalised."""
        ...


@runtime_checkable
class OrbitFamily(Contract, Protocol):
    """A one-parameter family of periodic orbits of a plant."""

    @property
    def plant(self) -> Plant:
        """Equations of motion."""
        ...

    @property
    def problem(self) -> tuple[OrbitProblem, str]:
        """The equations that a member solves, and in words why these."""
        ...


@dataclass(frozen=True)
class GuidanceTask:
    """From where to where guidance is to plan a flight, and in which time.

    Parameters
    ----------
    start : ndarray, shape (n,)
        All states of the plant at the start, SI.
    end_position_m, end_velocity_m_s : ndarray, shape (d,)
        The plant's positions and velocities at the end, in their order.
    duration_s : float
        Length of the flight.
    time_s : float
        Time at the start.
    up : ndarray, shape (d,), or None
        Unit vector away from the ground at the end, if the flight ends on one.
    """

    start: Array
    end_position_m: Array
    end_velocity_m_s: Array
    duration_s: float
    time_s: float = 0.0
    up: Array | None = None


@dataclass(frozen=True)
class GuidedFlight:
    """A planned flight, as functions of the time since its start.

    Parameters
    ----------
    duration_s : float
        Its length.
    states : callable
        t (K,) → the plant's states (n, K), SI.
    command : callable
        t (K,) → its controls (p, K), SI, just after t where they jump.
    breaks_s : ndarray, shape (B,)
        Times between which the command is smooth, rising from 0 to the duration.
    account : str
        How it was found and how well, in a few words.
    """

    duration_s: float
    states: Callable[[Array], Array]
    command: Callable[[Array], Array]
    breaks_s: Array
    account: str = ""


@runtime_checkable
class Guidance(Contract, Protocol):
    """Plans a flight between two states of a plant, with the command that flies it.

    Where there is no such flight the method raises, a named error that says what cannot be met.
    """

    def plan(self, plant: Plant, task: GuidanceTask) -> GuidedFlight:
        """Return a flight that begins at the start and ends at the end of the task."""
        ...


@runtime_checkable
class Compensator(Contract, Protocol):
    """A run-time law that acts at samples: what it sees to what the actuator is told.

    Pure functions of arrays, lane by lane: the law keeps nothing between calls, its memory is the
    array `xc` that `hillsphere.simulation` carries for it. Laws that act between samples too are
    `hillsphere.simulation.ContinuousLaw`.
    """

    @property
    def period_s(self) -> float:
        """Time between two samples."""
        ...

    @property
    def actuation(self) -> Literal["hold", "impulse"]:
        """Whether u is held until the next sample (m/s²), or added to the velocities (m/s)."""
        ...

    def initial(self, n_cases: int) -> Array:
        """Return the law's own states (m, N) before the first sample; m may be zero."""
        ...

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (p, N) and the law's states (m, N) after sample k; change no argument.

        t_s (N,) is the time, y (q, N) what the navigation gives (the plant's states, SI), ref
        (q, N) what it should be. u has one row per control of the plant, in their order, for
        ``"hold"``; one per velocity, in the order of the states, for ``"impulse"``.
        """
        ...


@runtime_checkable
class SynthesisedLaw(Contract, Protocol):
    """A law, at samples or continuous, that may wait for the controller of an earlier stage."""

    @property
    def complete(self) -> bool:
        """Whether it has a controller of its own; one without takes no step."""
        ...

    def flying(self, controller: LtiSystem) -> Compensator | ContinuousLaw:
        """Return the law with this controller; period and actuation stay."""
        ...


@dataclass(frozen=True)
class Channel:
    """One thing that a sensor measures.

    Parameters
    ----------
    name : str
        Unique within the sensor.
    unit : str
        SI, e.g. ``"rad"``, ``"m"``, ``"m/s"``.
    kind : {"linear", "angle", "direction"}
        A number; an angle, whose differences go the short way round; a unit vector.
    """

    name: str
    unit: str
    kind: Literal["linear", "angle", "direction"] = "linear"

    @property
    def rows(self) -> int:
        """Number of rows that it takes in an array of measurements."""
        return 3 if self.kind == "direction" else 1


Scene: TypeAlias = Mapping[str, Array]
"""What surrounds a sensor at the times of its measurements, by name; the last axis is N or 1."""


@runtime_checkable
class Sensor(Contract, Protocol):
    """What is measured of a state, and with which errors.

    Pure functions on N lanes: states x (n, N), SI, positions first, at times t_s (N,), s. All
    randomness comes in as standard normal numbers, drawn by whoever repeats the cases
    (`hillsphere.seeds`). Each sensor documents what it takes from the scene.
    """

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is measured; together m rows."""
        ...

    @property
    def draws(self) -> tuple[int, int]:
        """How many normal numbers the constant errors of a case take, and each measurement."""
        ...

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return what a perfect sensor shows, SI, (m, N), visible or not."""
        ...

    def visible(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        """Say where there is something to measure, (N,)."""
        ...

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviations of the random errors, SI, (m, N)."""
        ...

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return what is measured, SI, (m, N); NaN where nothing is.

        constant (k, N) and noise (l, N) are standard normal, k and l as `draws` says.
        """
        ...


@runtime_checkable
class StationSensor(Sensor, Protocol):
    """A `Sensor` at a ground station that measures azimuth and elevation, in this order.

    From the scene it takes ``"earth_fixed"``, shape (3, 3, N): what turns positions of the states'
    frame to Earth-fixed ones (`hillsphere.earth.rotation.earth_fixed`).
    """

    @property
    def station(self) -> Station:
        """Where it truly stands."""
        ...

    def believed_stations(self, constant: Array) -> tuple[Station, ...]:
        """Return where trackers are told that it stands, for each of N cases.

        constant (k, N) are the normal numbers behind the constant errors, as for `measure`.
        """
        ...

    def bias(self, x: Array, t_s: Array, scene: Scene, constant: Array) -> Array:
        """Return the systematic errors, measured minus true, rad, (2, N)."""
        ...


class Context(Protocol):
    """What the pipeline gives a running stage."""

    @property
    def seed(self) -> int:
        """Root seed of the mission."""
        ...

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a generator that depends on the mission's seed, the stage and the stream only."""
        ...

    def info(self, message: str) -> None:
        """Write a line to the run's log."""
        ...

    @property
    def fingerprint(self) -> str:
        """SHA-256 of all that the stage's result depends on, in hexadecimal digits."""
        ...

    @property
    def executor(self) -> Executor:
        """Where campaigns, and stages by `hillsphere.workers`, do what they divide."""
        ...

    def workspace(self) -> Path:
        """Return a directory that outlives an interruption, until the product is stored."""
        ...

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Show progress; the returned function advances it and raises if the run was stopped.

        `note` says what stands behind the bar; it is called whenever the bar is drawn.
        """
        ...


class Stage(Protocol):
    """One step of a mission.

    ``run(ctx, **inputs)`` takes one product per field of its Spec's ``needs`` by keyword and
    returns an instance of its Spec's ``produces``; ``present(product, **inputs)`` shows it.
    Annotate both with the concrete product classes.
    """

    @property
    def run(self) -> Callable[..., Any]:
        """Do the work."""
        ...

    @property
    def present(self) -> Callable[..., Presentation]:
        """Return metrics, tables and figures of the product."""
        ...


@runtime_checkable
class NeedsCheck(Contract, Protocol):
    """A `Stage` with keys that name what the stages that it needs make: stations, trackers.

    What its keys make impossible by themselves, or with what they refer to, a component refuses
    when it is made.
    """

    @property
    def check_needs(self) -> Callable[..., None]:
        """Refuse keys that cannot be met: ``check_needs(**needs)``.

        It is called before any stage runs, with the components of those stages where `Stage.run`
        gets their products, and raises `hillsphere.errors.InputError`. A message that begins with a
        key of the stage (``stations: …``) is told at that key's line. The component may be of any
        class whose stage yields the product that is needed.
        """
        ...


@runtime_checkable
class CaseStage(Contract, Protocol):
    """A `Stage` that can be repeated over many cases, by ``monte_carlo`` and ``sweep``.

    Its cases are independent: what comes of one depends on nothing but its inputs, its noise and
    its lane's width (see `CaseBatch`).

    It may have a method ``prepare_cases(names, **inputs)``, called in each worker before the blocks
    with inputs of these names: what it compiles there does not count against a block's time limit.
    It may have a method ``case_warnings(product)``, given what its own run yielded, which returns
    sentences that warn of all its cases: they stand in every campaign that repeats it.
    """

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return what may differ from case to case, with nominal values, SI.

        Each is named by its path from the stage's own Spec: a run-time parameter of the plant that
        the field ``plant`` refers to is ``"plant.gravity.C2,0"``; what belongs to the stage itself
        has a plain name (``"state.x"``). A nominal value that only the products of earlier stages
        fix is NaN.
        """
        ...

    @property
    def run_cases(self) -> Callable[..., CaseResults]:
        """Compute one block: ``run_cases(batch, history=False, **inputs)``.

        `history` is True where all histories are wanted, or names and patterns (``*``) of those
        that are; others may be kept as well (see `hillsphere.campaign.cases.kept_histories`).
        `inputs` are the products of the stage's needs, as for `Stage.run`. No context is given:
        the call is pure, may run in another process, and shows no progress.
        """
        ...


class Dispersion(Protocol):
    """How some quantities of a mission are distributed about their nominal values."""

    @property
    def of(self) -> str:
        """Table of the mission that they belong to, ``"gravity.phobos"``."""
        ...

    @property
    def keys(self) -> tuple[str, ...]:
        """Their names there: parameters of a model, ``"state.x"``; ``*`` is any characters."""
        ...

    @property
    def unit(self) -> str:
        """SI unit that its quantities must have, as `Parameter.unit`; ``""`` for any."""
        ...

    def quantiles(self, u: Array, nominal: Array) -> Array:
        """Return values (k, N), SI, for numbers u (k, N) in (0, 1), independent and uniform.

        nominal (k,) are the nominal values. Correlation is brought in here.
        """
        ...

    def mean(self, nominal: Array) -> Array:
        """Return the mean values (k,), SI."""
        ...

    def covariance(self, nominal: Array) -> Array:
        """Return the covariance (k, k), SI: for filters."""
        ...

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return least and largest values (k,), SI, at so many standard deviations: for LFTs.

        A distribution of bounded support never exceeds it.
        """
        ...


class EstimationModel(Protocol):
    """What an estimator believes of the world: motion, its noise, and what sensors would show.

    Pure functions of columns, each of which belongs to a case: K columns hold, for instance, the
    sigma points of all cases, and `case` (K,) says which column is whose. States are SI.
    """

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states (n, K) at times t1_s (K,) of those x (n, K) at t0_s (K,), s.

        control (p, K) is that of the case of each column; p may be zero.
        """
        ...

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots G (N, n, r) of the covariance G Gᵀ that noise adds meanwhile.

        x (n, N), t0_s and t1_s (N,), control (p, N): one column a case.
        """
        ...

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return what perfect sensors show of x (n, K) at t_s (K,), SI, (m, K).

        In the order of the rows of a `hillsphere.estimation.MeasurementSet`; what is not measured
        may be anything.
        """
        ...


@runtime_checkable
class LinearisedModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` that knows its derivatives; else they are taken by differences."""

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the derivatives (N, n, n) of `advance` by the states x (n, N)."""
        ...

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        """Return the derivatives (N, m, n) of `observe` by the states x (n, N)."""
        ...


@runtime_checkable
class ConsiderModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` some of whose states are not estimated, only reckoned with."""

    @property
    def considered(self) -> NDArray[np.bool_]:
        """Which states no measurement may change, (n,)."""
        ...


@runtime_checkable
class Estimator(Contract, Protocol):
    """From measurements to a belief of the states, N independent cases at once.

    Pure functions of frozen beliefs; streaming is N = 1.
    """

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times t_to_s (N,), s, under the controls (p, N)."""
        ...

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after the measurements, taken at its own time, and what they brought.

        Rows that are not present change nothing.
        """
        ...


State = TypeVar("State")


class Tracker(Protocol[State]):
    """From a nominal orbit and measured angles to where an antenna must point.

    Pure functions of frozen states, N cases at once, independent of each other. Times are SI
    seconds after the epoch given to `initial`; angles are radians, azimuth from north over east.
    """

    @property
    def short_period(self) -> bool:
        """Whether its elements are mean ones to which it adds the short-period terms of J2."""
        ...

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = ...,
    ) -> State:
        """Return the state before the first measurement.

        elements (6, N) are nominal mean elements a, e, i, Ω, ω, M (m, rad) of Brouwer's theory in
        the frame ``teme``, at times t_s (N,) or (1,); the stations one, or one a case.
        """
        ...

    def update(
        self, state: State, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array
    ) -> State:
        """Return the state after one measurement a case.

        t_s, az_rad, el_rad are (N,); where an angle is not finite, the case has no measurement.
        sigma_rad, (), (N,) or (2, N), are the standard deviations of both angles or of each.
        """
        ...

    def predict(
        self, state: State, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return what the antenna will show at times (K,) or (K, N), and how surely.

        Azimuth in [0, 2π) and elevation up to π/2, (K, N), contain the angle biases that the state
        knows of, and the times are those by which the measurements are dated, with the clock's bias
        that it knows of. Without `biased` all that is taken off: it is where the satellite is at
        the true times. The covariance (2, 2, K, N), rad², is that of the answer on the sky, finite
        at the zenith: of cross-elevation (azimuth times cos h) and elevation.
        """
        ...
