"""What ends a flight early, as the Spec declares it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.closed_loop.course import Course, Rows
from hillsphere.closed_loop.specs import LimitsSpec
from hillsphere.interfaces import Array, Integers
from hillsphere.simulation import Limit

__all__ = ["limits_of"]


def limits_of(spec: LimitsSpec, rows: Rows, course: Course, begun: Array) -> list[Limit]:
    """Return what ends the flights of one batch beside the plant's events.

    Parameters
    ----------
    spec : LimitsSpec
        As declared.
    rows : Rows
        Of the plant.
    course : Course
        What is followed.
    begun : ndarray, shape (N,)
        When the cases begin; they are numbered by their place in the batch.

    Returns
    -------
    list of Limit
        Positive within; without dimension.
    """
    found: list[Limit] = []
    errors = (
        ("position_error", spec.position_error_m, rows.distance),
        ("velocity_error", spec.velocity_error_m_s, rows.speed),
    )
    for name, most, size in errors:
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

        found.append(Limit(name, near))
    least, farthest = spec.distance_min_m, spec.distance_max_m

    def distances(x: Array) -> Array:
        each = x[rows.positions].reshape(rows.vectors, -1, x.shape[1])
        return np.asarray(np.sqrt(np.sum(each * each, axis=1)))

    if least is not None:
        found.append(
            Limit("distance_min", lambda t, x, cases: distances(x).min(axis=0) / least - 1.0)
        )
    if farthest is not None:
        found.append(
            Limit(
                "distance_max",
                lambda t, x, cases: 1.0 - distances(x).max(axis=0) / farthest,
                "escape",
            )
        )
    return found
