"""The posterior Cramér-Rao bound along the planned flight of a navigation."""

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
    """A model in whose surroundings each time has its own."""

    model: PlantModel
    scenes: dict[float, Scene]

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states later."""
        return self.model.advance(x, t0_s, t1_s, control, case)

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots of the noise."""
        return self.model.process_noise(x, t0_s, t1_s, control)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return what sensors show."""
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
    """Return the bounds at the times of the measurements, along undisturbed flights.

    There the law is told the truth: a filter comes close to it with the first measurements. How far
    the law then moves the spacecraft, and against what background, decides what is seen.

    Parameters
    ----------
    model : PlantModel
        What is believed of the world, with sensors that are differentiable.
    starts : ndarray, shape (n, N)
        States at which the flights begin.
    prior : ndarray, shape (N, n, n)
        Covariances there.
    times_s : ndarray, shape (K,)
        Times of the plant.
    goal : ndarray, shape (n, K)
        Reference.
    control : callable
        (estimate, reference), each (n, N) → what the motion is told.
    scene : callable
        (t_s (N,), believed (n, N)) → surroundings.
    heard : callable
        Time since the start → rows (m,) that are not silent.

    Returns
    -------
    sequence of Belief
        N cases; the covariances are the bounds.
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
