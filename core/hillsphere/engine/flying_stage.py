"""The base of stages that fly a plant: blocks of cases, their metrics, statuses and histories."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.course import Rows
from hillsphere.engine.flight_metrics import FlightHistory, FlightMetric
from hillsphere.engine.requirements import Judgement
from hillsphere.engine.simulation.block import BLOCK
from hillsphere.interfaces.cases import CaseBatch, CaseResults, Histories, histories_to_keep
from hillsphere.interfaces.plant import Plant
from hillsphere.interfaces.quantities import Parameter

__all__ = ["FlyingStage", "collect_histories", "metric_errors", "metric_values"]

P = TypeVar("P")
F = TypeVar("F")


class FlyingStage(ABC, Generic[P, F]):
    """A stage that flies blocks of cases of one plant.

    A subclass declares its inputs and its metrics, plans the flights that share the products of
    earlier stages, flies a block and says how its flights ended. Its type parameters are the plan P
    and the block of flights F from which metrics and histories are computed.

    Parameters
    ----------
    plant : Plant
        Its positions and velocities are as many.

    Attributes
    ----------
    kind : str
        Type of the stage; also the stream of the random numbers of its own run.
    plant : Plant
        Equations of motion.
    rows : Rows
        Its positions and velocities.
    """

    kind: ClassVar[str]

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.rows = Rows(plant)
        self._shared: tuple[Mapping[str, Any], P] | None = None

    @property
    @abstractmethod
    def metrics(self) -> tuple[FlightMetric[F], ...]:
        """Metrics of its flights, in the order of results."""

    @abstractmethod
    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return what may differ from case to case; see `CaseStage`."""

    @abstractmethod
    def _make_plan(self, *args: Any, **products: Any) -> P:
        """Return what flights share that are given the same products, by the names of the needs."""

    @abstractmethod
    def _fly_block(self, plan: P, batch: CaseBatch, *, history: bool) -> F:
        """Fly a block of N cases; with its samples if `history` is set."""

    @abstractmethod
    def _judge(self, plan: P, batch: CaseBatch, block: F, values: Array) -> Judgement:
        """Return statuses, causes and failures of flights with these metrics (m, N)."""

    @abstractmethod
    def _histories(self, plan: P, block: F, wanted: bool | Sequence[str]) -> Histories:
        """Return the histories that are wanted of a block flown with its samples."""

    @abstractmethod
    def _compile(self, plan: P, names: Sequence[str]) -> object:
        """Compile the simulation of cases that differ in these inputs."""

    def _step_error(self, block: F) -> Array | None:
        """Return the step error (N,) of a block; None if the stage reports none."""
        return None

    def run_cases(
        self, batch: CaseBatch, history: bool | Sequence[str] = False, **products: Any
    ) -> CaseResults:
        """Fly a block of cases.

        Parameters
        ----------
        batch : CaseBatch
            Inputs by the names of `case_inputs`; noise by its draws.
        history : bool or sequence of str
            Whether to keep all histories, or names and patterns of those to keep.
        **products
            Products of earlier stages, by the names of the stage's needs.

        Returns
        -------
        CaseResults
            The metrics of `metrics`.

        Raises
        ------
        InputError
            If the batch names something that is no input.
        """
        plan = self._plan(**products)
        block = self._fly_checked(plan, batch, history=bool(history))
        return self._results(plan, batch, block, history)

    def prepare_cases(self, names: Sequence[str], **products: Any) -> None:
        """Compile what `run_cases` needs for batches of these inputs."""
        self._compile(self._plan(**products), names)

    def _plan(self, **products: Any) -> P:
        """Return the plan of flights with these products, made once for the same objects."""
        given = {name: product for name, product in products.items() if product is not None}
        if self._shared is not None:
            known, plan = self._shared
            if known.keys() == given.keys() and all(known[n] is given[n] for n in given):
                return plan
        plan = self._make_plan(**given)
        self._shared = (given, plan)
        return plan

    def _own_batch(
        self, seed: int, cases: int, inputs: Mapping[str, float] | None = None
    ) -> CaseBatch:
        """Return the block of the stage's own run.

        A case has the same bits here as in a campaign, whose blocks have as many lanes.

        Parameters
        ----------
        seed : int
            Root seed of the mission.
        cases : int
            Number of different draws; the other lanes repeat the first.
        inputs : mapping of str to float, optional
            Inputs that differ from nominal in all cases, SI.
        """
        lanes = np.arange(BLOCK)
        numbers = np.where(lanes < cases, lanes, 0)
        given = inputs or {}
        values = np.repeat(np.array([*given.values()], dtype=float)[:, None], BLOCK, axis=1)
        return CaseBatch(numbers, numbers, lanes >= cases, tuple(given), values, seed, self.kind)

    def _fly_checked(self, plan: P, batch: CaseBatch, *, history: bool) -> F:
        """Fly a block after a check of the names of its inputs."""
        known = {q.name for q in self.case_inputs()}
        if unknown := [name for name in batch.names if name not in known]:
            raise InputError(f"{self.kind} has no input {', '.join(unknown)}")
        return self._fly_block(plan, batch, history=history)

    def _results(
        self, plan: P, batch: CaseBatch, block: F, history: bool | Sequence[str] = False
    ) -> CaseResults:
        """Return metrics, statuses and wanted histories of a block."""
        values = metric_values(self.metrics, block)
        status, cause, failed = self._judge(plan, batch, block, values)
        return CaseResults(
            tuple(metric.name for metric in self.metrics),
            tuple(metric.unit for metric in self.metrics),
            values,
            status,
            cause,
            failed,
            self._histories(plan, block, history) if history else None,
            self._step_error(block),
        )


def metric_values(metrics: Sequence[FlightMetric[F]], block: F) -> Array:
    """Return the values (m, N) of metrics, SI."""
    return np.array([metric.value(block) for metric in metrics])


def metric_errors(metrics: Sequence[FlightMetric[F]], block: F) -> Array:
    """Return by how much (m, N) the step error may change metrics, SI; zero without an estimate."""
    errors = [None if metric.error is None else metric.error(block) for metric in metrics]
    shape = next((error.shape for error in errors if error is not None), (0,))
    return np.array([np.zeros(shape) if error is None else error for error in errors])


def collect_histories(
    quantities: Sequence[FlightHistory[F]],
    block: F,
    time_s: Array,
    wanted: bool | Sequence[str],
    end_s: Array | None = None,
) -> Histories:
    """Return the histories that are wanted of a block; no other is computed.

    Parameters
    ----------
    quantities : sequence of FlightHistory
        All that the stage can keep.
    block : F
        N flights.
    time_s : ndarray, shape (K, N)
        Times of the samples; NaN after the end of a flight.
    wanted : bool or sequence of str
        All, or names and patterns.
    end_s : ndarray, shape (N,), optional
        When a flight ended after its last sample; NaN where the last sample was the end.
    """
    named = {quantity.name: quantity for quantity in quantities}
    kept = [named[name] for name in histories_to_keep(wanted, tuple(named))]
    ends = None
    if end_s is not None:
        nothing = np.full(len(end_s), np.nan)
        ends = np.array([nothing if q.end is None else q.end(block) for q in kept])
        ends = np.where(np.isnan(end_s), np.nan, ends.reshape(len(kept), len(end_s)))
    return Histories(
        time_s,
        tuple(q.name for q in kept),
        tuple(q.unit for q in kept),
        np.array([q.values(block) for q in kept]),
        end_s,
        ends,
    )
