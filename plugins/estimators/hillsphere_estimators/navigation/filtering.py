"""Sensors and a filter in the loop: from true states to the estimate that the law is given."""

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
from hillsphere_estimators.navigation.attitude import TrueAttitude
from hillsphere_estimators.navigation.world import FaultySensors

__all__ = ["FilterLog", "Filtering", "SensorScenes", "update_members"]


@dataclass
class FilterLog:
    """Record of a filter over one block of cases, one entry (…, N) per sample.

    Parameters
    ----------
    error, sigma : list of ndarray, shape (n, N)
        Estimate minus truth, and the standard deviations by the filter.
    nees, nis, used, sent : list of ndarray, shape (N,)
        Normalised errors and innovations squared; number of rows used and of rows sent.
    seen : list of ndarray, shape (B, N)
        Whether each of B sensors measured something.
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
    """Scenes of the sensors, as functions of times (N,) and believed states (n, N).

    Parameters
    ----------
    believed, true : callable
        (t_s, believed) → scene: in the filter's model, and in truth.
    aim : callable
        (believed, true) → states by which the spacecraft point.
    """

    believed: Callable[[Array, Array], Scene]
    true: Callable[[Array, Array], Scene]
    aim: Callable[[Array, Array], Array]


@dataclass(frozen=True)
class _Memory:
    """State of the filter between two samples.

    Parameters
    ----------
    belief : Belief
        After the measurements of the last sample.
    control : ndarray, shape (p, N)
        Controls of the motion model until the next sample.
    constant : ndarray
        Normal numbers of the sensors' constant errors.
    lost : ndarray of bool, shape (N,)
        Cases whose filter has become non-finite, or whose flight has ended.
    drift : ndarray, shape (3 S, N), optional
        True drift of the attitudes, rad; none before the first sample, or without any.
    """

    belief: Belief
    control: Array
    constant: Array
    lost: NDArray[np.bool_]
    drift: Array | None = None


@dataclass(frozen=True)
class Filtering:
    """Sensors of the true states and a filter, as a `hillsphere.simulation.Navigation`.

    Parameters
    ----------
    model : PlantModel or BiasAugmentedModel
        The filter's model of the world.
    within : callable
        scene → that model in this scene.
    faults : FaultySensors
        The true sensors.
    believed : SensorSuite
        The sensors of the filter's model, which state the standard deviations.
    views : SensorScenes
        Scenes of both.
    estimators : tuple of Estimator
        Estimator of the first updates, and that of all others.
    gate_after : int
        Number of the first updates.
    members : tuple of ndarray of bool, shape (m,)
        Rows of each member of a decentralised filter; one for a joint filter.
    start : Belief
        Before the first measurement.
    control : callable
        (estimate (n, N), reference (n, N)) → controls of the motion model.
    goal : ndarray, shape (n, K)
        Reference at the samples.
    interval_s : float
        Time between samples.
    log : FilterLog
        Filled during the flight.
    attitude : TrueAttitude, optional
        True attitude errors of the spacecraft; none by default.
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
    attitude: TrueAttitude | None = None

    @property
    def noise(self) -> int:
        """Normal numbers of each case: the larger of those of the start and those of a sample."""
        turns = 0 if self.attitude is None else self.attitude.noise
        return max(self.faults.suite.draws[0], self.faults.noise + turns)

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
        """Predict, measure and update; return the estimate (n, N) and the new memory.

        Parameters
        ----------
        k : int
            Number of the sample.
        t_s : ndarray, shape (N,)
            Times, s.
        x : ndarray, shape (n, N)
            True states.
        u : ndarray
            Not used: the command follows from the estimate.
        w : ndarray, shape (noise, N)
            Normal numbers.
        memory : _Memory
            Memory of the last sample.
        """
        n, belief = len(self.start.x), memory.belief
        estimator = self.estimators[0 if k < self.gate_after else 1]
        if k:
            belief = estimator.predict(self.model, belief, t_s, memory.control)
        goal = np.repeat(self.goal[:, k : k + 1], len(t_s), axis=1)
        belief, lost = _reset_lost_lanes(
            belief, memory.belief, goal, memory.lost | ~np.isfinite(x).all(axis=0)
        )
        # lost lanes are measured as if they were on the reference, so that all numbers stay finite
        truth = np.where(lost, goal, x)
        look = belief.x[:n]
        aim = self.views.aim(look, truth)
        seen = self.views.believed(t_s, aim)
        sigma = self.believed.sigma(look, t_s, seen)
        scene, drift = self.views.true(t_s, aim), memory.drift
        if self.attitude is not None:
            own = w[self.faults.noise : self.faults.noise + self.attitude.noise]
            drift = self.attitude.advance(drift, self.interval_s, own)
            scene = {**scene, "attitude": self.attitude.turns(drift, own)}
        measured = self.faults.measurements(
            truth, t_s, k * self.interval_s, scene, memory.constant, w[: self.faults.noise], sigma
        )
        after, innovations = update_members(
            estimator, self.within(seen), belief, measured, self.members
        )
        after, lost = _reset_lost_lanes(after, belief, goal, lost)
        self._note(x, after, innovations, measured, lost)
        estimate = np.where(lost, np.nan, after.x[:n])
        told = self.control(after.x[:n], goal)
        return estimate, _Memory(after, told, memory.constant, lost, drift)

    def _note(
        self, x: Array, belief: Belief, innovations: Sequence[Innovation],
        measured: MeasurementSet, lost: NDArray[np.bool_],
    ) -> None:  # fmt: skip
        """Append errors, innovations and sensors of this sample to the log, NaN in lost cases."""
        n, log = len(self.start.x), self.log
        truth = np.concatenate([x, belief.x[n:]])

        def noted(values: Array) -> Array:
            return np.where(lost, np.nan, values)

        log.error.append(noted(belief.x[:n] - x))
        log.sigma.append(noted(belief.sigma[:n]))
        # the simulator's states of ended flights are NaN
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
    """Return the belief after the update of all members, and their innovations.

    Each member updates the common prior by its own rows. The errors of the results are correlated
    by the prior in an unknown way, and are fused one after the other by covariance intersection.

    Parameters
    ----------
    estimator : Estimator
        Estimator of all members.
    model : EstimationModel
        The filter's model.
    belief : Belief
        The common prior.
    measured : MeasurementSet
        All measurements.
    members : sequence of ndarray of bool, shape (m,)
        Rows of each member.
    """
    fused: Belief | None = None
    innovations = []
    for rows in members:
        own = measured
        if len(members) > 1:
            own = replace(measured, present=measured.present & rows[:, None])
        after, innovation = estimator.update(model, belief, own)
        innovations.append(innovation)
        fused = after if fused is None else covariance_intersection(fused, after)[0]
    assert fused is not None
    return fused, innovations


def _reset_lost_lanes(
    new: Belief, old: Belief, goal: Array, lost: NDArray[np.bool_]
) -> tuple[Belief, NDArray[np.bool_]]:
    """Return a belief with finite numbers in lost lanes, and which lanes are lost now.

    A lost lane is put on the reference with its last finite covariance: the batch of lanes is
    computed as a whole, and a lane of NaN would stop it.
    """
    whole = np.isfinite(new.x).all(axis=0) & np.isfinite(new.root).all(axis=(1, 2))
    gone = lost | ~whole
    if not gone.any():
        return new, gone
    x, root = new.x.copy(), new.root.copy()
    x[:, gone] = 0.0
    x[: len(goal), gone] = goal[:, gone]
    root[gone] = np.where(np.isfinite(old.root[gone]), old.root[gone], np.eye(len(x)))
    return Belief(x, root, new.t_s), gone
