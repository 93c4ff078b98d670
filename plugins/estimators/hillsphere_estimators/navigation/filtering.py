"""Sensors and a filter in the loop: from true states to what the law believes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Estimator, Scene
from hillsphere.sensor_suite import SensorSuite
from hillsphere_estimators.bias_states import BiasAugmentedModel
from hillsphere_estimators.consistency import nees
from hillsphere_estimators.covariance_intersection import covariance_intersection
from hillsphere_estimators.navigation.world import FaultySensors

__all__ = ["FilterLog", "Filtering", "SensorScenes", "update_members"]


@dataclass
class FilterLog:
    """What a filter did with one block, sample by sample; each entry (…, N).

    Parameters
    ----------
    error, sigma : list of ndarray, shape (n, N)
        Estimate minus truth, and what the filter believes of it.
    nees, nis, used, sent : list of ndarray, shape (N,)
        Normalised errors and innovations squared; rows used, and rows that were sent.
    seen : list of ndarray, shape (B, N)
        Which of B sensors measured something.
    """

    error: list[Array] = field(default_factory=list)
    sigma: list[Array] = field(default_factory=list)
    nees: list[Array] = field(default_factory=list)
    nis: list[Array] = field(default_factory=list)
    used: list[Array] = field(default_factory=list)
    sent: list[Array] = field(default_factory=list)
    seen: list[Array] = field(default_factory=list)


@dataclass(frozen=True)
class SensorScenes:
    """Surroundings of the sensors, at times (N,) and for believed states (n, N).

    Parameters
    ----------
    believed, true : callable
        (t_s, believed) → scene: as the filter has it, and as it is.
    aim : callable
        (believed, true) → states by which the spacecraft turn.
    """

    believed: Callable[[Array, Array], Scene]
    true: Callable[[Array, Array], Scene]
    aim: Callable[[Array, Array], Array]


@dataclass(frozen=True)
class _Memory:
    """Between two samples: belief, what the motion was told, the sensors' constants, lost lanes."""

    belief: Belief
    control: Array
    constant: Array
    lost: NDArray[np.bool_]


@dataclass(frozen=True)
class Filtering:
    """A `hillsphere.simulation.Navigation`: sensors of the true states, and a filter.

    Parameters
    ----------
    model : PlantModel or Biased
        What the filter believes of the world.
    within : callable
        scene → that model in this scene.
    faults : Faults
        The true sensors.
    believed : SensorSuite
        Those that the filter believes in: they state the sigmas.
    views : Views
        Surroundings.
    estimators : tuple of Estimator
        Of the first updates, and of all others.
    gate_after : int
        Number of the first updates.
    members : tuple of ndarray of bool, shape (m,)
        Rows of each member of a decentralised filter; one for a joint one.
    start : Callable
        (t_s, x, w) → belief before the first measurement.
    rows : int
        Number n of the plant's states.
    starting : int
        Normal numbers that `start` takes.
    control : callable
        (estimate (n, N), reference (n, N)) → what the model's motion is told.
    goal : ndarray, shape (n, K)
        Reference at the samples.
    interval_s : float
        Time between samples.
    log : FilterLog
        Filled on the way.
    """

    model: EstimationModel
    within: Callable[[Scene], EstimationModel]
    faults: FaultySensors
    believed: SensorSuite
    views: SensorScenes
    estimators: tuple[Estimator, Estimator]
    gate_after: int
    members: tuple[NDArray[np.bool_], ...]
    start: Belief
    control: Callable[[Array, Array], Array]
    goal: Array
    interval_s: float
    log: FilterLog

    @property
    def noise(self) -> int:
        """Normal numbers of each case: those of the start, or those of a sample."""
        return max(self.faults.suite.draws[0], self.faults.noise)

    def initial(self, t_s: Array, x: Array, w: Array) -> _Memory:
        """Return the belief before the first measurement."""
        belief = self.start
        if isinstance(self.model, BiasAugmentedModel):
            belief = self.model.append_biases(belief)
        constant = w[: self.faults.suite.draws[0]]
        lost = np.zeros(len(t_s), dtype=bool)
        return _Memory(belief, np.zeros((0, len(t_s))), constant, lost)

    def observe(
        self, k: int, t_s: Array, x: Array, u: Array, w: Array, memory: _Memory
    ) -> tuple[Array, _Memory]:
        """Return the estimate (n, N) after the measurements of sample k."""
        n, belief = len(self.start.x), memory.belief
        estimator = self.estimators[0 if k < self.gate_after else 1]
        if k:
            belief = estimator.predict(self.model, belief, t_s, memory.control)
        goal = np.repeat(self.goal[:, k : k + 1], len(t_s), axis=1)
        belief, lost = _reset_lost_lanes(
            belief, memory.belief, goal, memory.lost | ~np.isfinite(x).all(axis=0)
        )
        truth = np.where(lost, goal, x)
        look = belief.x[:n]
        aim = self.views.aim(look, truth)
        seen = self.views.believed(t_s, aim)
        sigma = self.believed.sigma(look, t_s, seen)
        measured = self.faults.measurements(
            truth, t_s, k * self.interval_s, self.views.true(t_s, aim), memory.constant,
            w[: self.faults.noise], sigma,
        )  # fmt: skip
        after, innovations = update_members(
            estimator, self.within(seen), belief, measured, self.members
        )
        after, lost = _reset_lost_lanes(after, belief, goal, lost)
        self._note(x, after, innovations, measured, lost)
        estimate = np.where(lost, np.nan, after.x[:n])
        told = self.control(after.x[:n], goal)
        return estimate, _Memory(after, told, memory.constant, lost)

    def _note(
        self, x: Array, belief: Belief, innovations: Sequence[Innovation],
        measured: MeasurementSet, lost: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        n, log = len(self.start.x), self.log
        truth = np.concatenate([x, belief.x[n:]])

        def noted(values: Array) -> Array:
            return np.where(lost, np.nan, values)

        log.error.append(noted(belief.x[:n] - x))
        log.sigma.append(noted(belief.sigma[:n]))
        finite = np.where(np.isfinite(truth), truth, belief.x)
        log.nees.append(noted(nees(belief, finite, None if len(belief.x) == n else np.arange(n))))
        log.nis.append(noted(np.sum([one.nis for one in innovations], axis=0)))
        log.used.append(np.sum([one.dof for one in innovations], axis=0).astype(float))
        log.sent.append(measured.present.sum(axis=0).astype(float))
        sizes = [sum(channel.rows for channel in block) for block in self.believed.blocks]
        first = np.cumsum([0, *sizes[:-1]])
        log.seen.append(noted(np.logical_or.reduceat(measured.present, first, axis=0)))


def update_members(
    estimator: Estimator,
    model: EstimationModel,
    belief: Belief,
    measured: MeasurementSet,
    members: Sequence[NDArray[np.bool_]],
) -> tuple[Belief, list[Innovation]]:
    """Return the belief after measurements, and what they brought.

    With several members each updates the common belief by its own rows; the results, whose errors
    are correlated by what they share, are joined by covariance intersection, one after the other.
    """
    found: Belief | None = None
    innovations = []
    for rows in members:
        own = measured
        if len(members) > 1:
            own = replace(measured, present=measured.present & rows[:, None])
        after, innovation = estimator.update(model, belief, own)
        innovations.append(innovation)
        found = after if found is None else covariance_intersection(found, after)[0]
    assert found is not None
    return found, innovations


def _reset_lost_lanes(
    new: Belief, old: Belief, goal: Array, lost: NDArray[np.bool_]
) -> tuple[Belief, NDArray[np.bool_]]:
    """Return a belief whose lost lanes are harmless numbers, and which are lost now."""
    whole = np.isfinite(new.x).all(axis=0) & np.isfinite(new.root).all(axis=(1, 2))
    gone = lost | ~whole
    if not gone.any():
        return new, gone
    x, root = new.x.copy(), new.root.copy()
    x[:, gone] = 0.0
    x[: len(goal), gone] = goal[:, gone]
    root[gone] = np.where(np.isfinite(old.root[gone]), old.root[gone], np.eye(len(x)))
    return Belief(x, root, new.t_s), gone
