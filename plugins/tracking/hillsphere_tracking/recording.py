"""Simulated records of a sensor over time, for many cases with independent random numbers."""

from __future__ import annotations

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.seeds import draws
from hillsphere.errors import InputError
from hillsphere.interfaces.sensing import Scene, Sensor

__all__ = ["draw_constants", "record"]


def draw_constants(
    sensor: Sensor, seed: int, stage: str, cases: Integers, name: str = "sensor"
) -> Array:
    """Draw the normal numbers of the errors that are constant within a case.

    Parameters
    ----------
    sensor : Sensor
        The sensor; its `draws` gives the count k.
    seed : int
        Root seed of the mission.
    stage : str
        Name of the stage.
    cases : ndarray of int, shape (N,)
        Numbers of the cases.
    name : str
        Distinguishes sensors whose errors are independent.

    Returns
    -------
    ndarray, shape (k, N)
        Normal numbers; they depend on seed, stage, case and name only.
    """
    return draws(seed, stage, cases, f"{name} constants", (sensor.draws[0],))


def record(
    sensor: Sensor,
    x: Array,
    t_s: Array,
    scene: Scene,
    *,
    seed: int,
    stage: str,
    cases: Integers,
    name: str = "sensor",
    occasion: str = "",
) -> Array:
    """Simulate the measurements of N cases at K common times.

    Parameters
    ----------
    sensor : Sensor
        The sensor.
    x : ndarray, shape (n, K, N) or (n, K, 1)
        States, SI; the second form if all cases share one trajectory.
    t_s : ndarray, shape (K,)
        Times, s.
    scene : mapping of str to ndarray
        Quantities of the environment that the sensor needs; the last axis is K or 1.
    seed, stage, cases, name
        As for `draw_constants`. A shorter record of a case is the beginning of a longer one.
    occasion : str
        Distinguishes records of one sensor whose noise is independent.

    Returns
    -------
    ndarray, shape (m, K, N)
        Measurements, SI; NaN where the sensor measures nothing.

    Raises
    ------
    InputError
        If the shapes do not match.
    """
    times, n_cases = np.atleast_1d(np.asarray(t_s, dtype=float)), len(cases)
    states = np.asarray(x, dtype=float)
    if states.ndim != 3 or states.shape[1] != times.size or states.shape[2] not in (1, n_cases):
        raise InputError(
            f"states must be (n, {times.size}, {n_cases}) or (n, {times.size}, 1), got "
            f"{states.shape}"
        )
    # one lane for each pair of time and case, cases running fastest
    shape = (states.shape[0], times.size, n_cases)
    lanes = np.broadcast_to(states, shape).reshape(shape[0], -1)
    around = {
        name: value if value.shape[-1] == 1 else np.repeat(value, n_cases, axis=-1)
        for name, value in scene.items()
    }
    constant, per_measurement = draw_constants(sensor, seed, stage, cases, name), sensor.draws[1]
    stream = f"{name} noise {occasion}".rstrip()
    noise = draws(seed, stage, cases, stream, (times.size, per_measurement))
    measured = sensor.measure(
        lanes,
        np.repeat(times, n_cases),
        around,
        np.tile(constant, times.size),
        noise.transpose(1, 0, 2).reshape(per_measurement, -1),
    )
    return measured.reshape(-1, times.size, n_cases)
