"""Bodies around the Sun in an estimator's model: motion, sensors, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers, Plant, Scales, Scene
from hillsphere.sensor_suite import SensorSuite
from hillsphere_estimators.plant_model import PlantModel

__all__ = ["BodiesModel"]

_MOTION_STEP = 1e-6
"""Step of the differences that give the derivatives of the motion, in units of the plant's scales.
Central differences err by its square, 1e-12, and by rounding over it, 1e-16/1e-6 = 1e-10: a step
ten times larger or smaller moves the balance to either side."""
_SENSOR_STEP = 1e-5
"""Step of the differences that give the derivatives of a sensor, as a part of the least distance to
what it sees. They are one-sided and err by this part of themselves; states about the Sun, 1e11 m,
are rounded to 1e-5 m, which a much smaller step would not exceed."""
_AT_ONCE = 200_000
"""Columns for which sensors are evaluated at once: an array of twelve states then has 20 MB. More
columns are no faster."""


class BodiesModel(PlantModel):
    """A `PlantModel` of the first bodies of a plant, in scenes that change with time.

    As a `hillsphere.interfaces.LinearisedModel` it has derivatives by finite differences. A sensor
    is evaluated only for changes of the states on which it depends.

    Parameters
    ----------
    plant : Plant
        Its bodies have six states each and do not act on each other.
    suite : SensorSuite
        Its sensors.
    scenes : mapping of float to Scene
        By time, s, arrays (…, N) or (…, 1).
    bodies : int
        Number of estimated bodies, from the first.
    reach_m : float
        Least distance between a sensor and what it observes.
    noise : callable, optional
        See `PlantModel`.
    step_s : float
        Longest step of the step map.
    noise_step_s : float
        Time over which random accelerations are held.

    Raises
    ------
    InputError
        If the plant has fewer bodies.
    """

    def __init__(
        self,
        plant: Plant,
        suite: SensorSuite,
        scenes: Mapping[float, Scene],
        bodies: int,
        *,
        reach_m: float,
        noise: Callable[[Array], Array] | None = None,
        step_s: float = 3600.0,
        noise_step_s: float = 3600.0,
    ) -> None:
        if len(plant.states) % 6 or len(plant.states) < 6 * bodies:
            raise InputError(
                f"{bodies} bodies need a plant of six states each, this one has "
                f"{len(plant.states)} states"
            )
        super().__init__(plant, suite, noise=noise, step_s=step_s, noise_step_s=noise_step_s)
        self._scenes = scenes
        self.n = 6 * bodies
        self._copies = len(plant.states) // self.n + 1
        self._seen: dict[int, Integers] = {}
        self._steps = _MOTION_STEP * plant.scales.of(plant.states)[: self.n]
        near = Scales(reach_m, plant.scales.time_s)
        self._near = _SENSOR_STEP * near.of(plant.states)[: self.n]

    @property
    def times_s(self) -> tuple[float, ...]:
        """Times whose scenes are known, s."""
        return tuple(self._scenes)

    def beside(self, copies: int) -> Self:
        """Return the same model for `copies` copies of all cases, one after the other."""
        made = copy(self)
        made._scenes = {
            t: {
                name: value if value.shape[-1] == 1 else np.concatenate([value] * copies, axis=-1)
                for name, value in scene.items()
            }
            for t, scene in self._scenes.items()
        }
        return made

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states (n, K) later."""
        return super().advance(self._all(x), t0_s, t1_s, control, case)[: self.n]

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots (N, n, r) of the covariance of the process noise."""
        roots = super().process_noise(self._all(x), t0_s, t1_s, control)
        return roots if len(roots[0]) == self.n else np.zeros((x.shape[1], self.n, 1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the measurements of perfect sensors, all at one time."""
        return self.suite.observe(x, t_s, _select_cases(self.scene(t_s), case))

    def scene(self, t_s: Array) -> Scene:
        """Return the scene of the sensors at a time that all cases share."""
        return self._scenes[float(t_s[0])]

    def scene_of(self, times_s: Array, cases: int) -> dict[str, Array]:
        """Return the scene of columns that count times, then cases."""
        scenes = [self._scenes[float(t)] for t in times_s]
        return _stack_scenes(scenes, np.arange(len(scenes) * cases), cases)

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the transition matrices (N, n, n) of the motion, one block for each body.

        The bodies do not act on each other, so that one state of every body is changed at once.
        """
        cases, bodies = x.shape[1], self.n // 6
        points = np.repeat(x[:, None], 12, axis=1)
        steps = np.empty((6, bodies))
        for body in range(bodies):
            rows = slice(6 * body, 6 * body + 6)
            steps[:, body] = self._steps[rows]
            change = steps[:, body, None, None] * np.eye(6)[:, :, None]
            points[rows, :6] += change
            points[rows, 6:] -= change
        moved = self.advance(
            points.reshape(self.n, -1), np.tile(t0_s, 12), np.tile(t1_s, 12),
            np.tile(control, 12), np.tile(np.arange(cases), 12),
        ).reshape(self.n, 12, cases)  # fmt: skip
        phi = np.zeros((cases, self.n, self.n))
        for body in range(bodies):
            rows = slice(6 * body, 6 * body + 6)
            slope = (moved[rows, :6] - moved[rows, 6:]) / (2.0 * steps[:, body, None])
            phi[:, rows, rows] = slope.transpose(2, 0, 1)
        return phi

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        """Return the derivatives (N, m, n) of `observe` by the states."""
        scene = self.scene(t_s)
        slopes = np.zeros((self.suite.rows, self.n, x.shape[1]))
        for i, rows in enumerate(self._rows):
            slopes[rows] = self._slopes_of(i, x, t_s, scene)[1]
        return slopes.transpose(2, 0, 1)

    def path(self, x: Array, times_s: Array) -> tuple[Array, Array]:
        """Return states along the arc, and their derivatives by the states at its start.

        Parameters
        ----------
        x : ndarray, shape (n, N)
            States at the first time.
        times_s : ndarray, shape (K,)
            Times, s.

        Returns
        -------
        path : ndarray, shape (n, K, N)
            States.
        phi : ndarray, shape (N, K, n, n)
            Derivatives by the states at the start.
        """
        n, cases = x.shape
        step = self._steps
        points = np.repeat(x[:, None], 2 * n + 1, axis=1)
        own = np.arange(n)
        points[own, 1 + own] += step[:, None]
        points[own, 1 + n + own] -= step[:, None]
        now = points.reshape(n, -1)
        none, case = np.zeros((0, now.shape[1])), np.arange(now.shape[1])
        states = [now]
        for before, after in pairwise(times_s.tolist()):
            last, then = (np.full(now.shape[1], t) for t in (before, after))
            now = self.advance(now, last, then, none, case)
            states.append(now)
        every = np.array(states).reshape(len(times_s), n, 2 * n + 1, cases)
        slopes = (every[:, :, 1 : n + 1] - every[:, :, n + 1 :]) / (2.0 * step[:, None])
        return every[:, :, 0].transpose(1, 0, 2), slopes.transpose(3, 0, 1, 2)

    def along(self, path: Array, times_s: Array, present: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the predicted measurements along an arc, and their derivatives by the states.

        Parameters
        ----------
        path : ndarray, shape (n, K, N)
            States.
        times_s : ndarray, shape (K,)
            Times, s.
        present : ndarray of bool, shape (m, K, N)
            Rows that are evaluated; the others hold zeros.

        Returns
        -------
        shown : ndarray, shape (m, K, N)
            Measurements, SI.
        slopes : ndarray, shape (m, n, K, N)
            Derivatives by the states at that time.
        """
        n, count, cases = path.shape
        flat, asked = path.reshape(n, -1), present.reshape(len(present), -1)
        times = np.repeat(times_s, cases)
        scenes = [self._scenes[float(t)] for t in times_s]
        shown = np.zeros(asked.shape)
        slopes = np.zeros((len(asked), n, asked.shape[1]))
        for i, rows in enumerate(self._rows):
            every = np.flatnonzero(asked[rows].any(axis=0))
            for first in range(0, every.size, _AT_ONCE // (n + 1)):
                some = every[first : first + _AT_ONCE // (n + 1)]
                scene = _stack_scenes(scenes, some, cases)
                shown[rows, some], slopes[rows, :, some] = self._slopes_of(
                    i, flat[:, some], times[some], scene
                )
        return shown.reshape(present.shape), slopes.reshape(len(asked), n, count, cases)

    @property
    def _rows(self) -> list[slice]:
        sizes = [sum(channel.rows for channel in block) for block in self.suite.blocks]
        ends = np.cumsum(sizes)
        return [slice(int(end) - m, int(end)) for end, m in zip(ends, sizes, strict=True)]

    def _slopes_of(self, i: int, x: Array, t_s: Array, scene: Scene) -> tuple[Array, Array]:
        """Return the measurements (m, N) of one sensor and their derivatives (m, n, N)."""
        sensor, block, cases = self.suite.sensors[i], self.suite.blocks[i], x.shape[1]
        if i not in self._seen:
            self._seen[i] = self._dependence(i, x, t_s, scene)
        seen = self._seen[i]
        k = len(seen)
        points = np.repeat(x[:, None], k + 1, axis=1)
        points[seen, 1 + np.arange(k)] += self._near[seen, None]
        # the step that was truly added, after rounding
        width = points[seen, 1 + np.arange(k)] - x[seen]
        lanes = np.tile(np.arange(cases), k + 1)
        z = sensor.observe(points.reshape(self.n, -1), t_s[lanes], _select_cases(scene, lanes))
        z = z.reshape(-1, k + 1, cases)
        off = z[:, 1:] - z[:, :1]
        row = 0
        for channel in block:
            if channel.kind == "angle":
                # an angle may wrap between the two points
                off[row] -= 2.0 * np.pi * np.rint(off[row] / (2.0 * np.pi))
            row += channel.rows
        slopes = np.zeros((len(z), self.n, cases))
        slopes[:, seen] = off / width
        return z[:, 0], slopes

    def _dependence(self, i: int, x: Array, t_s: Array, scene: Scene) -> Integers:
        """Return the states that change a sensor's measurements, by trial on a few cases."""
        few = np.arange(min(8, x.shape[1]))
        x, t_s, scene = x[:, few], t_s[few], _select_cases(scene, few)
        sensor = self.suite.sensors[i]
        before = sensor.observe(x, t_s, scene)
        states = []
        for state in range(self.n):
            moved = x.copy()
            moved[state] += self._near[state]
            if not np.array_equal(sensor.observe(moved, t_s, scene), before):
                states.append(state)
        return np.array(states, dtype=np.int64)

    def _all(self, x: Array) -> Array:
        """Return states of all bodies of the plant; those that are not estimated repeat others."""
        if len(x) == self._n:
            return x
        return np.ascontiguousarray(np.tile(x, (self._copies, 1))[: self._n])


def _select_cases(scene: Scene, case: Integers) -> dict[str, Array]:
    """Return the scene of some cases."""
    return {
        name: value if value.shape[-1] == 1 else np.take(value, case, axis=-1)
        for name, value in scene.items()
    }


def _stack_scenes(scenes: list[Scene], some: Integers, cases: int) -> dict[str, Array]:
    """Return the scene of columns that count times, then cases."""
    time, case = np.divmod(some, cases)
    scene_of_columns: dict[str, Array] = {}
    for name, value in scenes[0].items():
        if value.shape[-1] == 1:
            scene_of_columns[name] = value
        else:
            every = np.stack([scene[name] for scene in scenes], axis=-2)
            scene_of_columns[name] = every[..., time, case]
    return scene_of_columns
