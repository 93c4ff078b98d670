"""The posterior Cramér-Rao bound along the planned flights of a navigation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers, Scene
from hillsphere_estimators.cramer_rao import cramer_rao
from hillsphere_estimators.plant_model import PlantModel

__all__ = ["bound_along_plan"]


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
    x, cases = starts, starts.shape[1]
    every = np.arange(cases)
    path: list[Array] = []
    controls: list[Array] = []
    sets: list[MeasurementSet] = []
    scenes: dict[float, Scene] = {}
    for k, time in enumerate(times_s.tolist()):
        t = np.full(cases, time)
        if k:
            x = model.advance(x, np.full(cases, times_s[k - 1]), t, controls[-1], every)
        around = scene(t, x)
        scenes[time] = around
        values = model.within(around).observe(x, t, every)
        there = model.suite.visible(x, t, around) & heard(time - float(times_s[0]))[:, None]
        sigma = model.suite.sigma(x, t, around)
        sets.append(
            MeasurementSet.of(t, np.where(there, values, np.nan), sigma, model.suite.blocks)
        )
        path.append(x)
        controls.append(control(x, np.repeat(goal[:, k : k + 1], cases, axis=1)))
    timed: EstimationModel = _ModelInScenes(model, scenes)
    return cramer_rao(timed, path, prior, sets, controls[:-1])
