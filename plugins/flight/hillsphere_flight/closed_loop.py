"""The stage ``closed_loop``: a plant under a law that follows a reference, N cases at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, floor

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.problems import did_you_mean
from hillsphere.engine.course import Course, Rows, course_along, course_at
from hillsphere.engine.start_states import with_placed_start_of
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
    BLOCK,
    Cases,
    ContinuousLaw,
    Flights,
    SampledReference,
    Simulator,
)
from hillsphere_flight.checks import begun_after_its_end, check, lands
from hillsphere_flight.foresight import check_first_step, check_start
from hillsphere_flight.histories import histories_of, with_rows
from hillsphere_flight.largest import Largest, PlannedEnd
from hillsphere_flight.limits import limits_of
from hillsphere_flight.metrics import judge, measure, metric_errors, metric_names, metric_units
from hillsphere_flight.parts import (
    Effectiveness,
    actuator_of,
    command_rows,
    navigation_of,
    seen_rows,
    unit_of,
)
from hillsphere_flight.presentation import present_flight, warnings_of
from hillsphere_flight.products import ClosedLoopFlight
from hillsphere_flight.specs import MOST_SAMPLES, ClosedLoopSpec

__all__ = ["ClosedLoopStage"]

_PLANT = "plant."
_STREAM = "closed_loop"
_SAFETY = 2.0
"""Factor on the difference to a flight with half the steps, which is the error of the coarse one
but for some per cent where the formula converges at its order: twice allows for where not."""
_ENDS = 1e-9


@dataclass(frozen=True)
class _Loop:
    """What flights with one reference and one controller share.

    Parameters
    ----------
    law : Compensator or ContinuousLaw
        What commands.
    course : Course
        What is followed.
    planned_s : float
        How long they are to last: until the last sample, or the end of the reference.
    site : ndarray, shape (n,), or None
        The reference at its end, where flights that may end by an impact are to land.
    beyond : ndarray, shape (p,)
        See `Course.acceleration_beyond`.
    samples : int
        At how many samples the law acts, those of the overtime included.
    goal : ndarray, shape (n, K + 1)
        The reference at them, and at the end of the last.
    reference : SampledReference
        The same as the law sees it.
    simulators : dict
        By names of run-time parameters and number of sub-steps; filled when first needed.
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


class ClosedLoopStage:
    """A plant under a law.

    Parameters
    ----------
    spec : ClosedLoopSpec
        With its references bound.

    Raises
    ------
    InputError
        If plant, law and Spec do not fit together.
    """

    def __init__(self, spec: ClosedLoopSpec) -> None:
        self.plant: Plant = spec.plant.get()
        self.spec = spec = with_placed_start_of(spec, self.plant)
        self.law: Compensator | ContinuousLaw = spec.law.get()
        self.rows = Rows(self.plant)
        self._seen = seen_rows(self.rows, self.law, spec.sees)
        self._navigation = navigation_of(spec.navigation, self.rows, self._seen)
        self.commands = command_rows(self.plant, self.rows, self.law)
        self._actuator = actuator_of(spec.actuator, self.law, len(self.commands))
        self._effectiveness = Effectiveness(self.commands)
        check(spec, self.rows, self.law, self._kind())
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
        self._known: tuple[FlightSet | None, ControlDesign | None, _Loop] | None = None

    def check_needs(self, reference: object = None, controller: object = None) -> None:
        """Refuse a start that ends the flight, and a law that takes other values than it sees.

        As far as both are known before anything runs; of a start on a reference `run` tells it.
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
        found = [replace(q, name=_PLANT + q.name) for q in self.plant.parameters()]
        found += [
            Parameter(f"state.{name}", float(value), unit)
            for name, value, unit in zip(names, start, units, strict=True)
        ]
        found += [Parameter(f"offset.{name}", 0.0, u) for name, u in zip(names, units, strict=True)]
        found.append(Parameter("start_time", spec.start.time_s, "s"))
        if spec.limits.dv_m_s is not None:
            found.append(Parameter("dv_budget", spec.limits.dv_m_s, "m/s"))
        return (*found, *self._effectiveness.inputs())

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
            What is followed.
        controller : ControlDesign, optional
            What a law that waits for one flies.

        Returns
        -------
        ClosedLoopFlight
            With the navigation and actuator errors of draw 0, and `ClosedLoopSpec.flight_inputs`.

        Raises
        ------
        InputError
            If the flight begins below the ground, or beyond where it has escaped.
        """
        loop = self._loop(reference, controller)
        # A lane among 64 as in a campaign, so that the same case has the same bits there.
        lanes = np.zeros(BLOCK, dtype=np.int64)
        inputs = self.spec.flight_inputs
        values = np.repeat(np.array([*inputs.values()], dtype=float)[:, None], BLOCK, axis=1)
        filler = np.arange(BLOCK) > 0
        batch = CaseBatch(lanes, lanes, filler, tuple(inputs), values, ctx.seed, _STREAM)
        advance = ctx.track("closed loop", loop.samples)
        flights, largest = self._fly(loop, batch, history=True)
        begun_after_its_end(flights)
        step_error = None
        if self.spec.tolerance is None:
            finer, _ = self._fly(loop, batch, finer=True)
            moved = (finer.x - flights.x)[self.rows.positions, 0]
            step_error = float(np.sqrt(np.sum(moved**2)))
        advance(loop.samples)
        results = self._results(loop, flights, largest, batch)
        return self._product(loop, flights, results, step_error)

    def run_cases(
        self,
        batch: CaseBatch,
        history: bool | Sequence[str] = False,
        reference: FlightSet | None = None,
        controller: ControlDesign | None = None,
    ) -> CaseResults:
        """Fly a block of cases.

        Parameters
        ----------
        batch : CaseBatch
            Inputs by the names of `case_inputs`; noise by its draws.
        history : bool or sequence of str
            Whether to keep every sample, or of which quantities, see `histories_of`.
        reference : FlightSet, optional
            What is followed.
        controller : ControlDesign, optional
            What a law that waits for one flies.

        Returns
        -------
        CaseResults
            Metrics as `hillsphere_flight.metrics.metric_names` has them.

        Raises
        ------
        InputError
            If the batch names something that is no input.
        """
        loop = self._loop(reference, controller)
        flights, largest = self._fly(loop, batch, history=bool(history))
        return self._results(loop, flights, largest, batch, history)

    def prepare_cases(
        self,
        names: Sequence[str],
        reference: FlightSet | None = None,
        controller: ControlDesign | None = None,
    ) -> None:
        """Compile what `run_cases` needs for batches of these inputs."""
        loop = self._loop(reference, controller)
        self._simulator(loop, self._run_time(names), self.spec.substeps)

    def present(
        self,
        product: ClosedLoopFlight,
        reference: FlightSet | None = None,
        controller: ControlDesign | None = None,
    ) -> Presentation:
        """Show the nominal flight."""
        return present_flight(product, self.spec)

    def case_warnings(self, product: ClosedLoopFlight) -> tuple[str, ...]:
        """Return what the nominal flight warns of, which holds for all cases."""
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

    def _loop(self, product: FlightSet | None, controller: ControlDesign | None = None) -> _Loop:
        """Return what flights with this reference and controller share, made once."""
        known = self._known
        if known is not None and known[0] is product and known[1] is controller:
            return known[2]
        law = self.law
        if controller is not None and isinstance(law, SynthesisedLaw):
            law = law.flying(controller.design(self.spec.design))
        spec, period = self.spec, self.law.period_s
        course = self._held() if product is None else self._along(product)
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
            # To the end of the last period, which may be later than the overtime.
            course = course.extended(samples * period - length, held=held)
        times: Array = np.arange(samples + 1, dtype=float) * period
        goal = course.at(times)
        steps = course.steps(times[:-1], period)
        command = course.command(times[:-1]) if steps is None else None
        reference = SampledReference(goal[self._seen], command, steps)
        loop = _Loop(law, course, planned, site, beyond, samples, goal, reference, {})
        self._known = (product, controller, loop)
        return loop

    def _held(self) -> Course:
        """Return the state that is held."""
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
        if course.commanded and self._kind() == "impulses":
            raise InputError(
                "needs.reference: it comes with a command that is held, the law commands impulses"
            )
        return course

    def _kind(self) -> str:
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

    def _fly(
        self, loop: _Loop, batch: CaseBatch, *, history: bool = False, finer: bool = False
    ) -> tuple[Flights, Largest]:
        """Fly a batch; return the flights, and what was largest in them."""
        spec = self.spec
        known = {q.name for q in self.case_inputs()}
        if unknown := [name for name in batch.names if name not in known]:
            raise InputError(f"closed_loop has no input {', '.join(unknown)}")
        # In the plant's order, whatever that of the batch: one compiled map for all.
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
            impulses = self._kind() == "impulses"
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
        return flights, seen

    def _results(
        self,
        loop: _Loop,
        flights: Flights,
        largest: Largest,
        batch: CaseBatch,
        history: bool | Sequence[str] = False,
    ) -> CaseResults:
        begun = batch.value("start_time", self.spec.start.time_s)
        goal = _goal_of(loop, flights, begun)
        values = measure(self.rows, flights, goal, begun, loop.planned_s, largest, loop.site)
        errors = metric_errors(
            self.rows,
            self.plant.scales.of(self.plant.states),
            flights,
            values,
            self.law.period_s,
            held=self._kind() != "impulses",
        )
        required = self.spec.success, self.spec.require
        limit = self.spec.largest_step_error
        status, cause, failed = judge(flights, values, *required, errors, limit)
        # Estimates are sums of bounds: what they leave open is flown with half the steps.
        left = (np.array(status) == "step_error") & (np.array(cause) != "")
        if left.any() and self.spec.tolerance is None:
            finer, its_largest = self._fly(loop, batch, finer=True)
            its_goal = _goal_of(loop, finer, begun)
            again = measure(
                self.rows, finer, its_goal, begun, loop.planned_s, its_largest, loop.site
            )
            alike = left & (np.array(finer.status) == np.array(flights.status))
            moved = np.where(alike, _SAFETY * np.abs(again - values), np.inf)
            errors = np.fmin(errors, moved)
            status, cause, failed = judge(flights, values, *required, errors, limit)
        return CaseResults(
            metric_names(loop.site is not None),
            metric_units(self._command_units()[0], loop.site is not None),
            values,
            status,
            cause,
            failed,
            self._histories(loop, flights, goal, history),
            flights.step_error,
        )

    def _histories(
        self, loop: _Loop, flights: Flights, goal_end: Array, history: bool | Sequence[str]
    ) -> Histories | None:
        """Return what was kept of the quantities that are wanted."""
        if flights.history is None or not history:
            return None
        return histories_of(
            flights,
            self.rows,
            loop.goal,
            goal_end,
            self._seen,
            self.commands,
            [unit_of(v) for v in self.plant.states],
            self._command_units(),
            history,
        )

    def _command_units(self) -> list[str]:
        if self._kind() == "impulses":
            return ["m/s"] * len(self.commands)
        return [unit_of(v) for v in self.plant.controls]

    def _product(
        self, loop: _Loop, flights: Flights, results: CaseResults, step_error: float | None
    ) -> ClosedLoopFlight:
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
            seen=with_rows(history.y[:, :, 0], len(self._seen)),
            u=with_rows(history.u[:, :, 0], len(self.commands)),
            own=with_rows(history.own[:, :, 0], len(self.commands)),
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
    """Return how many whole periods, one at least, last so long; `InputError` if too many."""
    periods = duration_s / period_s * (1.0 - _ENDS)
    if not periods <= MOST_SAMPLES:
        raise InputError(
            f"a flight of {duration_s:.6g} s has {periods:.3g} periods of {period_s:.6g} s of its "
            f"law; at most {MOST_SAMPLES} can be computed"
        )
    return max(1, ceil(periods))


def _goal_of(loop: _Loop, flights: Flights, begun: Array) -> Array:
    """Return the states (n, N) that were to be reached where flights ended."""
    goal = np.repeat(loop.goal[:, -1:], len(begun), axis=1)
    short = np.array(flights.status) != "completed"
    if short.any():
        goal[:, short] = loop.course.at((flights.time_s - begun)[short])
    return goal
