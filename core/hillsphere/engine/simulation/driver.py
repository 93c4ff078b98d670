"""The closed-loop simulator: N cases through plant, navigation, law and actuator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.seeds import draws
from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.simulation.acting import Act, ByEquations, ByHold, ByImpulse
from hillsphere.engine.simulation.block import (
    BLOCK,
    CAUSES,
    Part,
    Recorder,
    Result,
    Settings,
    fly_block,
)
from hillsphere.engine.simulation.cases import Batch, Cases, batch_of
from hillsphere.engine.simulation.ends import Watch
from hillsphere.engine.simulation.flow import (
    compile_step_map,
    compiled_events,
    compiled_loop,
    velocity_rows,
)
from hillsphere.engine.simulation.legs import Limit
from hillsphere.engine.simulation.navigation import PerfectNavigation
from hillsphere.engine.simulation.outcomes import Flights
from hillsphere.engine.simulation.recording import Moment, Observer, Table
from hillsphere.engine.simulation.references import FixedReference, ZeroReference
from hillsphere.engine.simulation.shared_proofs import proof_of
from hillsphere.interfaces.control import Compensator
from hillsphere.interfaces.loop import Actuator, ContinuousLaw, KnownPoles, Navigation, Reference
from hillsphere.interfaces.plant import Plant

__all__ = ["STEP_REACH", "Simulator", "simulate"]

STEP_REACH = {"rk6": 1.07, "dop853": 3.5}
"""Formula → largest product of step and pole for which the decay of a state is accurate to 1e-3,
see `ContinuousLaw`."""


class Simulator:
    """Closed-loop simulation of any number of cases of one plant and law, compiled once.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    law : Compensator or ContinuousLaw
        The control law.
    reference : Reference or array_like, optional
        Reference of the law; an array (q,) or (q, C) becomes a `FixedReference`. By default zero.
    navigation : Navigation, optional
        Navigation model; by default the law receives the true states.
    actuator : Actuator, optional
        Actuator model; by default commands are executed exactly. It cannot be used with a
        continuous law, whose command is part of the equations: give `Cases.gain`, and limits as
        expressions of the law.
    run_time : sequence of str
        Names of the plant's parameters that differ from case to case.
    limits : sequence of Limit
        Conditions that end a flight, in addition to the plant's events.
    method : {"dop853", "rk6"}
        Formula of the step map.
    substeps : int
        Steps between two samples. Events are checked at their ends. A feedforward in steps has a
        proportional number in each of its steps, and at least one.
    tolerance : float, optional
        Compare each leg with twice as many steps, and double them, lane by lane, until the
        difference in units of the plant's scales is below the tolerance. This takes at least three
        times as long. With terms that are functions of arrays, adaptive steps are used instead, see
        `hillsphere.engine.dynamics.adaptive`.
    most_substeps : int
        With `tolerance`: largest number of steps; a lane that needs more ends as ``step_size``.
    wall_limit_s : float, optional
        Wall-clock time for a block of 64 lanes; flights that have not ended by then end as
        ``time_limit``. This is the only outcome that may differ in a repetition.

    Raises
    ------
    InputError
        If plant, law and options do not match.

    Notes
    -----
    Cases are processed in blocks of 64 lanes by step map, navigation and law; the last block is
    filled with copies of its last case. The bits of a case depend on the width of the blocks, but
    not on its neighbours or on the order of the blocks. A lane that has ended keeps its state; a
    block ends when all its lanes have.
    """

    def __init__(
        self,
        plant: Plant,
        law: Compensator | ContinuousLaw,
        *,
        reference: Reference | ArrayLike | None = None,
        navigation: Navigation | None = None,
        actuator: Actuator | None = None,
        run_time: Sequence[str] = (),
        limits: Sequence[Limit] = (),
        method: str = "dop853",
        substeps: int = 1,
        tolerance: float | None = None,
        most_substeps: int = 1024,
        wall_limit_s: float | None = None,
    ) -> None:
        if not (np.isfinite(law.period_s) and law.period_s > 0):
            raise InputError(f"period_s of the law must be positive, got {law.period_s}")
        if substeps < 1 or (tolerance is not None and most_substeps < 2 * substeps):
            raise InputError(
                "substeps must be at least 1 and, with a tolerance, most_substeps twice as many; "
                f"got {substeps} and {most_substeps}"
            )
        if tolerance is not None and not 0 < tolerance < np.inf:
            raise InputError(f"tolerance must be positive, got {tolerance}")
        if wall_limit_s is not None and not wall_limit_s > 0:
            raise InputError(f"wall_limit_s must be positive, got {wall_limit_s}")
        self.plant, self.law, self.actuator = plant, law, actuator
        self.navigation: Navigation = navigation or PerfectNavigation()
        self._reference = _reference(reference)
        self._limits, self._method, self._run_time = tuple(limits), method, tuple(run_time)
        self._substeps, self._most, self._tolerance = substeps, most_substeps, tolerance
        self._wall_limit_s = wall_limit_s
        self._velocities = velocity_rows(plant)
        if tolerance is None:
            _check_poles(law, method, substeps)
        self.map = self._compile()
        if tolerance is not None and self.map.system.external is not None:
            # array terms are dear: steps by their embedded error instead of flying twice as many
            self.map = StepMap(self.map.system, method, tolerance=tolerance)
            self._tolerance = None
        self._events = compiled_events(self.map.system)

    def fly(
        self,
        cases: Cases,
        samples: int | ArrayLike,
        *,
        seed: int = 0,
        stage: str = "simulation",
        history: bool = False,
        limits: Sequence[Limit] = (),
        observer: Observer | None = None,
        advance: Callable[[int], None] | None = None,
        to_last_sample: bool = False,
    ) -> Flights:
        """Simulate cases.

        Parameters
        ----------
        cases : Cases
            N cases; N may be zero.
        samples : int or array_like of int, shape (N,)
            Number of samples at which the law acts; a flight ends one period after the last one.
        seed : int
            Root seed of the noise.
        stage : str
            Name by which the noise of different stages differs.
        history : bool
            Whether to keep every sample: (n + 2 q + 2 p + 2)·8 bytes each, for each case.
        limits : sequence of Limit
            Further conditions that end these flights.
        observer : Observer, optional
            Receives every sample, and the end, of every block.
        advance : callable, optional
            Called with the number of completed cases, as the result of `Context.track`; in between
            it is called with 0 from time to time.
        to_last_sample : bool
            Whether flights end with their last sample, of which only navigation and command are
            wanted, instead of one period after it. All cases must then have as many samples.

        Returns
        -------
        Flights
            Results in the order of the cases, SI.

        Raises
        ------
        InputError
            If a shape does not match.
        """
        batch = self._batch(cases, samples)
        if to_last_sample and np.unique(batch.samples).size > 1:
            raise InputError("flights to the last sample need the same number of samples")
        tell = advance or (lambda count: None)
        table = Table(len(batch), int(batch.samples.max(initial=0))) if history else None
        budget = bool(np.isfinite(batch.budget).any())
        watch = self._watch(budget, limits)
        results: list[Result] = []
        with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
            for first in range(0, len(batch), BLOCK):
                count = min(BLOCK, len(batch) - first)
                lanes = np.minimum(np.arange(first, first + BLOCK), len(batch) - 1)
                block = batch.lanes(lanes)
                record = _together(
                    [one.recorder(first, count) for one in (table, observer) if one is not None]
                )
                part = self._part(block, count, seed, stage)
                # An observer may follow the sub-steps too; few do.
                follow = getattr(observer, "follower", None)
                results.append(
                    fly_block(
                        self._settings(watch, budget, to_last_sample),
                        part,
                        self._act(block),
                        tell,
                        record,
                        None if follow is None else follow(first, count),
                    )
                )
                tell(count)
        return self._flights(results, len(batch), watch, table)

    def choose_substeps(self, cases: Cases, tol: float) -> int:
        """Find the number of sub-steps that meets a tolerance over the first period.

        The command is zero; the equations of a continuous law are propagated from its initial
        states.

        Parameters
        ----------
        cases : Cases
            Initial states.
        tol : float
            Largest difference to twice as many sub-steps, in units of the plant's scales.

        Returns
        -------
        int
            Number of sub-steps, for `substeps`.

        Raises
        ------
        PropagationError
            If no number of steps meets the tolerance.
        """
        batch = self._batch(cases, 1)
        act = self._act(batch)
        return self.map.choose_steps(act.begin(batch.x0), batch.period, tol, act.p, batch.t0)

    def _compile(self) -> StepMap:
        plant, law = self.plant, self.law
        self._rows, self._command = len(plant.controls), None
        what = "controls"
        if isinstance(law, ContinuousLaw):
            if self.actuator is not None:
                raise InputError(
                    "a continuous law's command is part of the equations, no actuator can come "
                    "between; give Cases.gain, and limits as expressions of the law"
                )
        elif law.actuation == "impulse":
            self._rows, what = len(self._velocities), "velocities"
        elif law.actuation != "hold":
            raise InputError(f"actuation must be 'hold' or 'impulse', got {law.actuation!r}")
        if not self._rows:
            raise InputError(
                f"{type(plant).__name__} has no {what} on which {type(law).__name__} could act"
            )
        if isinstance(law, ContinuousLaw):
            loop, self._command = compiled_loop(plant, law, self._run_time, self._method)
            return loop
        return compile_step_map(
            plant, self._run_time, self._method, controls=law.actuation == "hold"
        )

    def _batch(self, cases: Cases, samples: int | ArrayLike) -> Batch:
        return batch_of(
            cases,
            samples,
            states=len(self.plant.states),
            parameters=self.map.system.run_time[: len(self._run_time)],
            rows=self._rows,
            period_s=self.law.period_s,
            memory=bool(self.law.initial(1).size),
        )

    def _act(self, block: Batch) -> Act:
        law, width = self.law, len(block)
        if isinstance(law, ContinuousLaw):
            assert self._command is not None
            return ByEquations(law, self._command, block.gain, block.p, self._rows, width)
        if law.actuation == "hold":
            return ByHold(law, self.actuator, block.gain, block.p, self._rows, width)
        return ByImpulse(law, self.actuator, block.gain, block.p, self._velocities, width)

    def _watch(self, budget: bool, limits: Sequence[Limit]) -> Watch:
        watched, system = (*self._limits, *limits), self.map.system
        return Watch(
            system,
            self.map.stepper,
            self._events,
            len(self.plant.states),
            watched,
            budget,
            proof_of(system, watched, budget, len(self._run_time)),
        )

    def _settings(self, watch: Watch, budget: bool, to_last_sample: bool) -> Settings:
        return Settings(
            watch=watch,
            n=len(self.plant.states),
            p=self._rows,
            navigation=self.navigation,
            reference=self._reference,
            scale=self.map.system.scale,
            substeps=self._substeps,
            most_substeps=self._most,
            tolerance=self._tolerance,
            budget=budget,
            wall_limit_s=self._wall_limit_s,
            to_last_sample=to_last_sample,
        )

    def _part(self, block: Batch, count: int, seed: int, stage: str) -> Part:
        longest = int(block.samples.max(initial=0))
        # Lanes that only fill the block repeat the last case, and its noise with it.
        copies = np.minimum(np.arange(BLOCK), count - 1)
        cases = block.draws[:count]

        def noise(stream: str, samples: int, rows: int) -> Array:
            if not rows:
                return np.zeros((samples, 0, BLOCK))
            return np.ascontiguousarray(
                draws(seed, stage, cases, stream, (samples, rows))[:, :, copies]
            )

        acting = self.actuator.noise if self.actuator is not None else 0
        return Part(
            x0=block.x0,
            t0=block.t0,
            period=block.period,
            budget=block.budget,
            samples=block.samples,
            cases=block.numbers,
            seen=noise("navigation", longest + 1, self.navigation.noise),
            done=noise("actuator", longest, acting),
            count=count,
        )

    def _flights(
        self, results: Sequence[Result], total: int, watch: Watch, table: Table | None
    ) -> Flights:
        names = dict(enumerate(zip(watch.statuses, watch.names, strict=True))) | CAUSES
        n = len(self.plant.states)

        def joined(parts: Sequence[NDArray[Any]], empty: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([*parts, empty], axis=-1)[..., :total]

        none, zero = np.zeros(0), np.zeros(0, dtype=np.int64)
        ends = [names[c] for c in joined([r.cause for r in results], zero).tolist()]
        return Flights(
            frame=self.plant.frame,
            states=tuple(v.name for v in self.plant.states),
            status=tuple(status for status, _ in ends),
            cause=tuple(cause for _, cause in ends),
            time_s=joined([r.t for r in results], none),
            x=joined([r.x for r in results], np.zeros((n, 0))),
            dv_m_s=joined([r.dv for r in results], none),
            firings=joined([r.firings for r in results], zero),
            samples=joined([r.samples for r in results], zero),
            step_error=joined([r.error for r in results], none),
            history=table.history() if table else None,
        )


def simulate(
    plant: Plant,
    law: Compensator | ContinuousLaw,
    cases: Cases,
    samples: int | ArrayLike,
    **options: Any,
) -> Flights:
    """Simulate cases once: `Simulator` and its `fly` in one call.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    law : Compensator or ContinuousLaw
        The control law.
    cases : Cases
        N cases.
    samples : int or array_like of int, shape (N,)
        Number of samples at which the law acts.
    **options
        Options of `Simulator`, and ``seed``, ``stage``, ``history``, ``observer``, ``advance`` of
        `Simulator.fly`.

    Returns
    -------
    Flights
        Results in the order of the cases, SI.
    """
    names = ("seed", "stage", "history", "observer", "advance")
    flying = {k: options.pop(k) for k in names if k in options}
    return Simulator(plant, law, **options).fly(cases, samples, **flying)


def _together(recorders: Sequence[Recorder]) -> Recorder | None:
    """Return one recorder that calls all of them."""
    if len(recorders) < 2:
        return recorders[0] if recorders else None

    def record(now: Moment) -> None:
        for one in recorders:
            one(now)

    return record


def _check_poles(law: Compensator | ContinuousLaw, method: str, substeps: int) -> None:
    """Raise if the sub-steps are too long for the fastest pole of a continuous law."""
    if not isinstance(law, ContinuousLaw) or not isinstance(law, KnownPoles):
        return
    reach, fastest = STEP_REACH.get(method, inf), law.fastest_rad_s
    if fastest * law.period_s > reach * substeps * (1.0 + 1e-9):
        raise InputError(
            f"substeps: the fastest pole of the law, {fastest:.4g} 1/s, requires {method} steps "
            f"of at most {reach / fastest:.4g} s between its samples, so at least "
            f"{ceil(fastest * law.period_s / reach)} of them; got {substeps}. Raise substeps, or "
            "give a tolerance"
        )


def _reference(given: Reference | ArrayLike | None) -> Reference:
    if given is None:
        return ZeroReference()
    return given if isinstance(given, Reference) else FixedReference(given)
