"""Limits that end a flight early, as the Spec declares them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.engine.course import Course, Rows
from hillsphere.simulation import Limit
from hillsphere_flight.specs import LimitsSpec

__all__ = ["limits_of"]


def limits_of(spec: LimitsSpec, rows: Rows, course: Course, begun: Array) -> list[Limit]:
    """Return the limits on the flights of one batch.

    Each is a distance or speed divided by its limit, and so Lipschitz continuous: a length changes
    by no more than the sum of the changes of its components. The location of events relies on
    these Lipschitz constants and on the bound `drift` of the rate of the reference.

    Parameters
    ----------
    spec : LimitsSpec
        As declared.
    rows : Rows
        Rows of the plant's positions and velocities.
    course : Course
        The reference.
    begun : ndarray, shape (N,)
        Start times of the cases, s; cases are numbered by their place in the batch.

    Returns
    -------
    list of Limit
        Without dimension, positive inside the limit.
    """
    limits: list[Limit] = []
    speed, acceleration = course.fastest()

    def slopes(which: Sequence[int], size: float) -> Array:
        constants = np.zeros(len(rows.names))
        constants[list(which)] = 1.0 / size
        return constants

    errors = (
        ("position_error", spec.position_error_m, rows.distance, rows.positions, speed),
        ("velocity_error", spec.velocity_error_m_s, rows.speed, rows.velocities, acceleration),
    )
    for name, most, size, which, drift in errors:
        if most is None:
            continue

        def near(
            t: Array,
            x: Array,
            cases: Integers,
            size: Callable[[Array], Array] = size,
            most: float = most,
        ) -> Array:
            return np.asarray(1.0 - size(x - course.at(t - begun[cases])) / most)

        limits.append(Limit(name, near, lipschitz=slopes(which, most), drift=drift / most))
    least, farthest = spec.distance_min_m, spec.distance_max_m

    def distances(x: Array) -> Array:
        each = x[rows.positions].reshape(rows.vectors, -1, x.shape[1])
        return np.asarray(np.sqrt(np.sum(each * each, axis=1)))

    if least is not None:
        limits.append(
            Limit(
                "distance_min",
                lambda t, x, cases: distances(x).min(axis=0) / least - 1.0,
                lipschitz=slopes(rows.positions, least),
            )
        )
    if farthest is not None:
        limits.append(
            Limit(
                "distance_max",
                lambda t, x, cases: 1.0 - distances(x).max(axis=0) / farthest,
                "escape",
                lipschitz=slopes(rows.positions, farthest),
            )
        )
    return limits
