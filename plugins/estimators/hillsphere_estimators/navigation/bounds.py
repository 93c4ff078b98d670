"""The posterior Cramér-Rao bound along the planned flights of a navigation."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers, Scene
from hillsphere_estimators.cramer_rao import cramer_rao
from hillsphere_estimators.linearisation import noise_between, transition
from hillsphere_estimators.plant_model import PlantModel

__all__ = ["bound_along_plan"]


_MOST_BYTES = 128 << 20
"""Memory for paths that are kept, 128 MB. A block of 64 flights of two spacecraft takes 4 MB for a
day with a measurement every hour and 21 MB with one every ten minutes."""


@dataclass(frozen=True, eq=False)
class _Path:
    """Undisturbed flights of N cases.

    Parameters
    ----------
    owners : tuple
        Plant and law: while they are referenced here their ids are not used again.
    x : list of ndarray, shape (n, N)
        True states at the K times.
    motion : list of (ndarray, ndarray)
        Transition matrices and roots of the noise between them, see `cramer_rao`.
    """

    owners: tuple[object, ...]
    x: list[Array]
    motion: list[tuple[Array, Array]]

    @property
    def bytes(self) -> int:
        """Memory of the arrays."""
        return sum(x.nbytes for x in self.x) + sum(a.nbytes + b.nbytes for a, b in self.motion)


_PATHS: OrderedDict[tuple[object, ...], _Path] = OrderedDict()
"""Paths in the order of their last use."""
_LOCK = Lock()
"""Held while they are looked up or added: stages may run in threads."""


@dataclass(frozen=True)
class _ModelInScenes:
    """A model whose sensors have another scene at each time.

    Parameters
    ----------
    model : PlantModel
        Motion and sensors.
    scenes : dict of float to Scene
        Scene of the sensors by time, s.
    """

    model: PlantModel
    scenes: dict[float, Scene]

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states (n, N) at later times."""
        return self.model.advance(x, t0_s, t1_s, control, case)

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots (N, n, r) of the covariance of the process noise."""
        return self.model.process_noise(x, t0_s, t1_s, control)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the measurements (m, N) of perfect sensors in the scene of this time."""
        return self.model.within(self.scenes[float(t_s[0])]).observe(x, t_s, case)


def bound_along_plan(
    model: PlantModel,
    starts: Array,
    prior: Array,
    times_s: Array,
    goal: Array,
    control: Callable[[Array, Array], Array],
    scene: Callable[[Array, Array], Scene],
    heard: Callable[[float], NDArray[np.bool_]],
) -> Sequence[Belief]:
    """Return the Cramér-Rao bounds at the times of the measurements, along undisturbed flights.

    On these flights the law is given the true states, to which the estimates come close after the
    first measurements. The motion under the law determines the geometry, and so the information of
    the measurements.

    Parameters
    ----------
    model : PlantModel
        The filter's model of the world, with sensors that are differentiable.
    starts : ndarray, shape (n, N)
        States at which the flights begin.
    prior : ndarray, shape (N, n, n)
        Their covariances.
    times_s : ndarray, shape (K,)
        Times of the plant.
    goal : ndarray, shape (n, K)
        Reference.
    control : callable
        (estimate, reference), each (n, N) → controls of the motion model.
    scene : callable
        (t_s (N,), believed states (n, N)) → scene of the sensors.
    heard : callable
        Time since the start → rows (m,) that are not silent.

    Returns
    -------
    sequence of Belief
        One for each time, of N cases; the covariances are the bounds.
    """
    cases = starts.shape[1]
    plan = _path_along_plan(model, starts, prior, times_s, goal, control)
    sets: list[MeasurementSet] = []
    scenes: dict[float, Scene] = {}
    every = np.arange(cases)
    for time, x in zip(times_s.tolist(), plan.x, strict=True):
        t = np.full(cases, time)
        around = scene(t, x)
        scenes[time] = around
        values = model.within(around).observe(x, t, every)
        there = model.suite.visible(x, t, around) & heard(time - float(times_s[0]))[:, None]
        sigma = model.suite.sigma(x, t, around)
        sets.append(
            MeasurementSet.of(t, np.where(there, values, np.nan), sigma, model.suite.blocks)
        )
    timed: EstimationModel = _ModelInScenes(model, scenes)
    return cramer_rao(timed, plan.x, prior, sets, motion=plan.motion)


def _path_along_plan(
    model: PlantModel,
    starts: Array,
    prior: Array,
    times_s: Array,
    goal: Array,
    control: Callable[[Array, Array], Array],
) -> _Path:
    """Return the undisturbed flights, computed once for all sets of sensors.

    Flights of the same cases of the same plant and law are the same whatever is measured on them;
    the noise of the model and `control` are those of its plant and law, as in the navigation.
    """
    given = [sha256(a.tobytes()).digest() for a in (starts, prior, times_s, goal)]
    how = (model.method, model.step_s, model.noise_step_s)
    key = (id(model.plant), id(model.law), *how, *given)
    with _LOCK:
        kept = _PATHS.get(key)
        if kept is not None:
            _PATHS.move_to_end(key)
            return kept
    # Differences with steps of the first belief: they do not depend on what is measured, and
    # rounding of the states, which small steps of a late belief magnify, matters least.
    cases = starts.shape[1]
    steps = Belief.of(starts, prior, np.full(cases, times_s[0])).root
    x, path, motion = starts, [starts], []
    for k in range(len(times_s) - 1):
        t0, t1 = np.full(cases, times_s[k]), np.full(cases, times_s[k + 1])
        told = control(x, np.repeat(goal[:, k : k + 1], cases, axis=1))
        now = Belief(x, steps, t0)
        # the image of the mean is the next state of the path
        x, phi = transition(model, now, t1, told)
        motion.append((phi, noise_between(model, now, t1, told)))
        path.append(x)
    made = _Path((model.plant, model.law), path, motion)
    with _LOCK:
        _PATHS[key] = made
        while sum(one.bytes for one in _PATHS.values()) > _MOST_BYTES:
            _PATHS.popitem(last=False)
    return made
