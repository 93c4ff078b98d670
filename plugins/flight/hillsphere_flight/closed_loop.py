"""The stage ``closed_loop``: a plant under a control law that follows a reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.problems import did_you_mean
from hillsphere.engine.course import Course, course_along, course_at
from hillsphere.engine.flight_metrics import FlightMetric
from hillsphere.engine.flying_stage import (
    FlyingStage,
    collect_histories,
    metric_errors,
    metric_values,
)
from hillsphere.engine.requirements import Judgement, judge_flights
from hillsphere.engine.start_states import covariance_of_start, with_placed_start_of
from hillsphere.engine.surroundings import Surroundings
from hillsphere.errors import InputError
from hillsphere.interfaces.cases import CaseBatch, CaseResults, Histories
from hillsphere.interfaces.control import Compensator, SynthesisedLaw
from hillsphere.interfaces.plant import Plant
from hillsphere.interfaces.quantities import Parameter
from hillsphere.interfaces.stages import Context
from hillsphere.presentation import Presentation
from hillsphere.products import ControlDesign, FlightSet
from hillsphere.simulation import (
    Cases,
    ContinuousLaw,
    Flights,
    SampledReference,
    Simulator,
)
from hillsphere_flight.checks import check, lands, refuse_ended_at_start
from hillsphere_flight.flown_block import FlownBlock, fill_rows
from hillsphere_flight.foresight import check_first_step, check_start
from hillsphere_flight.histories import flight_histories, late_ends
from hillsphere_flight.largest import Largest, PlannedEnd
from hillsphere_flight.limits import limits_of
from hillsphere_flight.metrics import LANDING_METRICS, METRICS, fit_units
from hillsphere_flight.parts import (
    Effectiveness,
    actuator_of,
    command_rows,
    law_input_rows,
    navigation_of,
    unit_of,
)
from hillsphere_flight.presentation import present_flight, warnings_of
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import MOST_SAMPLES, ClosedLoopSpec

__all__ = ["ClosedLoopStage"]

_PLANT = "plant."
_SAFETY = 2.0
"""Factor on the difference to a flight with half the steps. Where the integration converges at its
order, the difference is the error of the coarser flight within some per cent; the factor 2 allows
for flights that converge more slowly."""

_ENDS = 1e-9
"""Part of a period by which a duration may differ from whole periods by rounding alone. With less,
one that is computed from hours or days could gain or lose a sample; a larger part would ignore a
real rest of a period."""


@dataclass(frozen=True)
class _Loop:
    """What flights with one reference and one controller share.

    Parameters
    ----------
    law : Compensator or ContinuousLaw
        The control law.
    course : Course
        The reference at any time.
    planned_s : float
        Planned duration: until the last sample, or the end of the reference if this comes first.
    site : ndarray, shape (n,), or None
        Landing site, the end of the reference, of flights that may end by an impact.
    beyond : ndarray, shape (p,)
        Acceleration of the reference beyond its end; see `Course.acceleration_beyond`.
    samples : int
        Number K of samples at which the law acts, those of the overtime included.
    goal : ndarray, shape (n, K + 1)
        Reference states at the samples and at the end of the last period, SI.
    reference : SampledReference
        The states among them that the law sees, with the command of the reference.
    simulators : dict
        Compiled simulations by names of run-time parameters and number of sub-steps; each is made
        when it is first needed.
    """

    law: Compensator | ContinuousLaw
    course: Course
    planned_s: float
    site: Array | None
    beyond: Array
    samples: int
    goal: Array
    reference: SampledReference
    simulators: dict[tuple[tuple[str, ...], int], Simulator]


class ClosedLoopStage(FlyingStage[_Loop, FlownBlock]):
    """A plant under a control law: the nominal flight, and blocks of cases for campaigns.

    Parameters
    ----------
    spec : ClosedLoopSpec
        With its references bound.

    Raises
    ------
    InputError
        If plant, law and Spec do not fit together.
    """

    kind = "closed_loop"

    def __init__(self, spec: ClosedLoopSpec) -> None:
        plant: Plant = spec.plant.get()
        self._given_form = spec.start
        self.spec = spec = with_placed_start_of(spec, plant)
        self.law: Compensator | ContinuousLaw = spec.law.get()
        super().__init__(plant)
        self._seen = law_input_rows(self.rows, self.law, spec.sees)
        self._navigation = navigation_of(spec.navigation, self.rows, self._seen)
        self.commands = command_rows(self.plant, self.rows, self.law)
        self._actuator = actuator_of(spec.actuator, self.law, len(self.commands))
        self._effectiveness = Effectiveness(self.commands)
        check(spec, self.rows, self.law, self._command_kind())
        if not self.commands:
            kind = type(self.plant).__name__
            raise InputError(f"law: {kind} has no controls on which {type(self.law).__name__} acts")
        if spec.duration_s is not None:
            try:
                _periods(spec.duration_s, self.law.period_s)
            except InputError as error:
                raise InputError(f"duration_s: {error}") from error
        self._start = self._given_start()
        known = [q.name for q in self.case_inputs()]
        if unknown := [name for name in spec.flight_inputs if name not in known]:
            hint = did_you_mean(unknown[0], known, otherwise="there are")
            raise InputError(f"flight_inputs: no input {unknown[0]!r}{hint}")
        declared = (*METRICS, *LANDING_METRICS) if lands(spec) else METRICS
        self._metrics = fit_units(declared, self._command_units()[0])

    @property
    def metrics(self) -> tuple[FlightMetric[FlownBlock], ...]:
        """Metrics of its flights: `LANDING_METRICS` only of those that land."""
        return self._metrics

    def check_needs(self, reference: object = None, controller: object = None) -> None:
        """Refuse a start that ends the flight, and a law whose input does not fit.

        Only starts that are known before any stage runs are checked; `run` checks a start on the
        reference of an earlier stage.
        """
        spec, rows = self.spec, self.rows
        course = self._held() if spec.needs.reference is None else None
        x = self._start if course is None else np.where(np.isnan(self._start), course.start,
                                                        self._start)  # fmt: skip
        given = spec.flight_inputs
        moved = [
            given.get(f"state.{name}", value) + given.get(f"offset.{name}", 0.0)
            for name, value in zip(rows.names, x.tolist(), strict=True)
        ]
        begun = given.get("start_time", spec.start.time_s)
        values = {
            name.removeprefix(_PLANT): value
            for name, value in given.items()
            if name.startswith(_PLANT)
        }
        check_start(self.plant, spec, rows, np.array(moved), begun, values, course)
        if course is not None:
            check_first_step(self.law, x[self._seen], begun, len(self.commands))

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return what may differ from case to case, see `ClosedLoopSpec`."""
        start = self._start if self.spec.needs.reference else self._held().start
        start = np.where(np.isnan(self._start), start, self._start)
        units = [unit_of(v) for v in self.plant.states]
        names, spec = self.rows.names, self.spec
        inputs = [replace(q, name=_PLANT + q.name) for q in self.plant.parameters()]
        inputs += [
            Parameter(f"state.{name}", float(value), unit)
            for name, value, unit in zip(names, start, units, strict=True)
        ]
        inputs += [
            Parameter(f"offset.{name}", 0.0, u) for name, u in zip(names, units, strict=True)
        ]
        inputs.append(Parameter("start_time", spec.start.time_s, "s"))
        if spec.limits.dv_m_s is not None:
            inputs.append(Parameter("dv_budget", spec.limits.dv_m_s, "m/s"))
        return (*inputs, *self._effectiveness.inputs())

    def start_covariance(self) -> Array:
        """Return the covariance (6, 6) of the start, see `covariance_of_start`."""
        return covariance_of_start(self._given_form, self.plant)

    def run(
        self,
        ctx: Context,
        reference: FlightSet | None = None,
        controller: ControlDesign | None = None,
    ) -> ClosedLoopFlight:
        """Fly the nominal case.

        Parameters
        ----------
        ctx : Context
            Seed and progress.
        reference : FlightSet, optional
            Trajectory to follow.
        controller : ControlDesign, optional
            Controller of a synthesis, for a law that takes one.

        Returns
        -------
        ClosedLoopFlight
            With the navigation and actuator errors of draw 0, and `ClosedLoopSpec.flight_inputs`.

        Raises
        ------
        InputError
            If an event of the plant or a limit ends the flight before its law acts.
        """
        loop = self._plan(reference=reference, controller=controller)
        batch = self._own_batch(ctx.seed, 1, self.spec.flight_inputs)
        advance = ctx.track("closed loop", loop.samples)
        block = self._fly_checked(loop, batch, history=True)
        refuse_ended_at_start(block.flights)
        step_error = None
        if self.spec.tolerance is None:
            finer = self._fly_block(loop, batch, history=False, finer=True)
            moved = (finer.flights.x - block.flights.x)[self.rows.positions, 0]
            step_error = float(np.sqrt(np.sum(moved**2)))
        advance(loop.samples)
        return self._product(loop, block, self._results(loop, batch, block), step_error)

    def present(
        self,
        product: ClosedLoopFlight,
        reference: FlightSet | None = None,
        controller: ControlDesign | None = None,
    ) -> Presentation:
        """Show the nominal flight."""
        return present_flight(product, self.spec)

    def case_warnings(self, product: ClosedLoopFlight) -> tuple[str, ...]:
        """Return the warnings of the nominal flight that hold for all cases."""
        return tuple(warnings_of(product))

    def _given_start(self) -> Array:
        """Return the start as the Spec gives it (n,); NaN where it is that of the reference."""
        start, rows = self.spec.start, self.rows
        x = np.full(len(rows.names), np.nan)
        if start.position_m is not None:
            x[rows.positions] = start.position_m
        if start.velocity_m_s is not None:
            x[rows.velocities] = start.velocity_m_s
        for name, value in start.others.items():
            x[rows.names.index(name)] = value
        return x

    def _make_plan(
        self, reference: FlightSet | None = None, controller: ControlDesign | None = None
    ) -> _Loop:
        """Return what flights with this reference and controller share."""
        law = self.law
        if controller is not None and isinstance(law, SynthesisedLaw):
            law = law.flying(controller.design(self.spec.design))
        spec, period = self.spec, self.law.period_s
        course = self._held() if reference is None else self._along(reference)
        length = course.length_s
        if spec.samples is not None:
            samples = spec.samples
        else:
            duration = length if spec.duration_s is None else spec.duration_s
            samples = _periods(duration + spec.overtime_s, period)
        planned = min(samples * period, length or np.inf)
        site = course.at(np.array([length]))[:, 0] if lands(spec) else None
        held = spec.overtime_command == "held"
        beyond = course.acceleration_beyond(held=held)
        if spec.overtime_s:
            # The last period may end later than the overtime.
            course = course.extended(samples * period - length, held=held)
        times: Array = np.arange(samples + 1, dtype=float) * period
        goal = course.at(times)
        steps = course.steps(times[:-1], period)
        command = course.command(times[:-1]) if steps is None else None
        followed = SampledReference(goal[self._seen], command, steps)
        return _Loop(law, course, planned, site, beyond, samples, goal, followed, {})

    def _held(self) -> Course:
        """Return the reference of a stage that holds one state."""
        target, rows = self.spec.target, self.rows
        x = self._start.copy()
        if target is not None and target.position_m is not None:
            x[rows.positions] = target.position_m
        x[rows.velocities] = 0.0
        if target is not None and target.velocity_m_s is not None:
            x[rows.velocities] = target.velocity_m_s
        return course_at(rows, x)

    def _along(self, product: FlightSet) -> Course:
        course = course_along(self.plant, self.rows, product, self.spec.follow)
        if course.commanded and self._command_kind() == "impulses":
            raise InputError(
                "needs.reference: it comes with a command that is held, the law commands impulses"
            )
        return course

    def _command_kind(self) -> str:
        law = self.law
        impulsive = not isinstance(law, ContinuousLaw) and law.actuation == "impulse"
        return "impulses" if impulsive else "a held acceleration"

    def _run_time(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return those of the inputs that are parameters of the plant, in its order."""
        return tuple(q.name for q in self.plant.parameters() if _PLANT + q.name in names)

    def _simulator(self, loop: _Loop, names: tuple[str, ...], substeps: int) -> Simulator:
        """Return the loop with these parameters of the plant at run time, compiled once."""
        if (names, substeps) not in loop.simulators:
            spec = self.spec
            loop.simulators[names, substeps] = Simulator(
                self.plant,
                loop.law,
                reference=loop.reference,
                navigation=self._navigation,
                actuator=self._actuator,
                run_time=names,
                method=spec.method,
                substeps=substeps,
                tolerance=spec.tolerance,
                most_substeps=spec.most_substeps,
            )
        return loop.simulators[names, substeps]

    def _compile(self, loop: _Loop, names: Sequence[str]) -> Simulator:
        """Compile the simulation of cases that differ in these inputs."""
        return self._simulator(loop, self._run_time(names), self.spec.substeps)

    def _fly_block(
        self, loop: _Loop, batch: CaseBatch, *, history: bool, finer: bool = False
    ) -> FlownBlock:
        """Fly a block; with twice as many sub-steps if `finer` is set."""
        spec = self.spec
        # The plant's order of names: batches with another order share the compiled simulation.
        names = self._run_time(batch.names)
        p = np.array([batch.value(_PLANT + name, 0.0) for name in names])
        width = len(batch.numbers)
        begun = batch.value("start_time", spec.start.time_s)
        nominal = np.where(np.isnan(self._start), loop.course.start, self._start)
        x0 = np.array(
            [
                batch.value(f"state.{name}", value) + batch.value(f"offset.{name}", 0.0)
                for name, value in zip(self.rows.names, nominal, strict=True)
            ]
        )
        budget = spec.limits.dv_m_s
        cases = Cases(
            x0,
            p.reshape(len(names), width),
            gain=self._effectiveness.gain(batch),
            draws=batch.draws,
            t0_s=begun,
            dv_budget_m_s=None if budget is None else batch.value("dv_budget", budget),
        )
        period = self.law.period_s
        first = ceil(spec.errors_from_s / period * (1.0 - _ENDS))
        final = floor(loop.planned_s / period * (1.0 + _ENDS)) if spec.overtime_s else loop.samples
        between = None
        if spec.overtime_s and loop.planned_s - final * period > _ENDS * period:
            impulses = self._command_kind() == "impulses"
            between = PlannedEnd(
                loop.course, loop.planned_s, loop.beyond, final, period,
                impulses=impulses, total=width,
            )  # fmt: skip
        seen = Largest(
            self.rows, loop.goal, width, first, final, len(self.commands), between,
            loop.course, loop.planned_s, begun,
        )  # fmt: skip
        flights = self._simulator(loop, names, spec.substeps * (1 + finer)).fly(
            cases,
            loop.samples,
            seed=batch.seed,
            stage=batch.stream,
            history=history,
            limits=limits_of(spec.limits, self.rows, loop.course, begun),
            observer=seen,
        )
        return FlownBlock(
            self.rows,
            flights,
            loop.goal,
            _final_goal(loop, flights, begun),
            begun,
            loop.planned_s,
            seen,
            loop.site,
            self.plant.scales.of(self.plant.states),
            period,
            len(self.commands),
            self._command_kind() == "impulses",
        )

    def _judge(self, loop: _Loop, batch: CaseBatch, block: FlownBlock, values: Array) -> Judgement:
        """Return statuses, causes and failures of flights; see `judge_flights`."""
        errors = metric_errors(self.metrics, block)
        judged = self._judge_within(block, values, errors)
        # The estimates are sums of bounds. Flights that they leave undecided are flown again with
        # half the steps, and the difference between both gives a closer estimate.
        left = (np.array(judged[0]) == "step_error") & (np.array(judged[1]) != "")
        if left.any() and self.spec.tolerance is None:
            finer = self._fly_block(loop, batch, history=False, finer=True)
            again = metric_values(self.metrics, finer)
            alike = left & (np.array(finer.flights.status) == np.array(block.flights.status))
            moved = np.where(alike, _SAFETY * np.abs(again - values), np.inf)
            judged = self._judge_within(block, values, np.fmin(errors, moved))
        return judged

    def _judge_within(self, block: FlownBlock, values: Array, errors: Array) -> Judgement:
        """Return the judgement of flights with metrics (m, N) that have these errors (m, N)."""
        spec = self.spec
        return judge_flights(
            block.flights, self.metrics, values, errors, spec.require, spec.success,
            spec.largest_step_error,
        )  # fmt: skip

    def _histories(self, loop: _Loop, block: FlownBlock, wanted: bool | Sequence[str]) -> Histories:
        """Return the histories that are wanted; see `flight_histories`."""
        assert block.flights.history is not None
        quantities = flight_histories(
            self.rows.names,
            [unit_of(v) for v in self.plant.states],
            self._seen,
            self.commands,
            self._command_units(),
        )
        time_s = block.flights.history.time_s
        return collect_histories(quantities, block, time_s, wanted, late_ends(block.flights))

    def _step_error(self, block: FlownBlock) -> Array:
        """Return the estimated step error (N,) in natural units of the plant."""
        return block.flights.step_error

    def _command_units(self) -> list[str]:
        if self._command_kind() == "impulses":
            return ["m/s"] * len(self.commands)
        return [unit_of(v) for v in self.plant.controls]

    def _product(
        self, loop: _Loop, block: FlownBlock, results: CaseResults, step_error: float | None
    ) -> ClosedLoopFlight:
        flights = block.flights
        history = flights.history
        assert history is not None
        x = history.x[:, :, 0]
        gap = x - loop.goal
        whole = np.concatenate([x, flights.x[:, :1]], axis=1)[self.rows.positions]
        places = whole.reshape(self.rows.vectors, -1, whole.shape[1])
        distances = np.sqrt(np.sum(places**2, axis=1))
        around = Surroundings.of(self.plant)
        return ClosedLoopFlight(
            frame=self.plant.frame,
            states=self.rows.names,
            state_units=tuple(unit_of(v) for v in self.plant.states),
            controls=self.commands,
            control_units=tuple(self._command_units()),
            seen_states=tuple(self.rows.names[i] for i in self._seen),
            period_s=self.law.period_s,
            time_s=history.time_s[:, 0],
            x=x,
            goal=loop.goal,
            seen=fill_rows(history.y[:, :, 0], len(self._seen)),
            u=fill_rows(history.u[:, :, 0], len(self.commands)),
            own=fill_rows(history.own[:, :, 0], len(self.commands)),
            feedforward=loop.course.command(
                np.arange(loop.samples, dtype=float) * self.law.period_s
            ),
            dv_m_s=history.dv_m_s[:, 0],
            position_error_m=self.rows.distance(gap),
            velocity_error_m_s=self.rows.speed(gap),
            end_s=float(flights.time_s[0]),
            end_x=flights.x[:, 0],
            status=results.status[0],
            cause=results.cause[0],
            failed=bool(results.failed[0]),
            metrics=results.metrics,
            units=results.units,
            values=results.values[:, 0],
            step_error=float(flights.step_error[0]),
            step_error_m=step_error,
            nearest_m=float(np.nanmin(distances)),
            farthest_m=float(np.nanmax(distances)),
            position_rows=tuple(self.rows.positions),
            velocity_rows=tuple(self.rows.velocities),
            body=around.body,
            semi_axes_m=around.semi_axes_m,
            surface_m=around.surface_m,
            prime_meridian_rad=around.prime_meridian_rad,
            series_radius_m=around.series_radius_m,
            hill_distance_m=around.hill_distance_m,
        )


def _periods(duration_s: float, period_s: float) -> int:
    """Return the number of whole periods of a duration, at least one; `InputError` if too many."""
    periods = duration_s / period_s * (1.0 - _ENDS)
    if not periods <= MOST_SAMPLES:
        raise InputError(
            f"a flight of {duration_s:.6g} s has {periods:.3g} periods of {period_s:.6g} s of its "
            f"law; at most {MOST_SAMPLES} can be computed"
        )
    return max(1, ceil(periods))


def _final_goal(loop: _Loop, flights: Flights, begun: Array) -> Array:
    """Return the reference states (n, N) at the ends of flights, SI."""
    goal = np.repeat(loop.goal[:, -1:], len(begun), axis=1)
    short = np.array(flights.status) != "completed"
    if short.any():
        goal[:, short] = loop.course.at((flights.time_s - begun)[short])
    return goal
