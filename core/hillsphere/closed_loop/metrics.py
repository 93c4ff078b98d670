"""Numbers that sum up a flight, and what is required of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.closed_loop.course import Rows
from hillsphere.closed_loop.specs import RequirementsSpec
from hillsphere.interfaces import Array
from hillsphere.simulation import BLOCK, Flights
from hillsphere.simulation.block import Recorder

__all__ = ["METRICS", "UNITS", "Deviations", "judge", "measure", "requirement"]

METRICS = (
    "dv",
    "final_position_error",
    "final_velocity_error",
    "largest_position_error",
    "largest_velocity_error",
    "duration",
    "firings",
)
UNITS = ("m/s", "m", "m/s", "m", "m/s", "s", "-")

_REQUIRED = {
    "dv": "dv_m_s",
    "final_position_error": "final_position_error_m",
    "final_velocity_error": "final_velocity_error_m_s",
    "largest_position_error": "largest_position_error_m",
    "largest_velocity_error": "largest_velocity_error_m_s",
}


class Deviations:
    """Largest deviations from the reference at the samples: an `Observer`, without histories.

    Parameters
    ----------
    rows : Rows
        Of the plant.
    goal : ndarray, shape (n, K + 1)
        Reference at each sample and at the end of the last.
    total : int
        Number of cases.
    first : int
        Sample from which they count.

    Attributes
    ----------
    largest : ndarray, shape (2, N)
        Of position, m, and velocity, m/s.
    """

    def __init__(self, rows: Rows, goal: Array, total: int, first: int) -> None:
        self.largest = np.zeros((2, total))
        order = [*rows.positions, *rows.velocities]
        # One row-wise copy per sample; plants whose states are already in this order need none.
        self._order = slice(0, len(order)) if order == list(range(len(order))) else order
        self._goal = np.ascontiguousarray(goal[order].T)[:, :, None]
        self._first = first
        axes = len(rows.positions) // rows.vectors
        self._starts = np.arange(0, len(order), axes)
        self._vectors = rows.vectors

    def recorder(self, first: int, count: int) -> Recorder:
        """Return what is told of one block."""
        squares = np.zeros((2 * self._vectors, BLOCK))
        place = slice(first, first + count)
        goal, order, starts, begin = self._goal, self._order, self._starts, self._first
        last = len(goal) - 1

        def record(
            k: int,
            t: Array,
            x: Array,
            y: Array | None,
            ref: Array | None,
            done: Array | None,
            flying: NDArray[np.bool_],
        ) -> None:
            if k >= begin:
                gap = x[order] - goal[k]
                gap *= gap
                np.maximum(squares, np.add.reduceat(gap, starts), out=squares, where=flying)
            if k == last:
                each = squares.reshape(2, self._vectors, BLOCK).max(axis=1)
                self.largest[:, place] = np.sqrt(each)[:, :count]

        return record


def measure(rows: Rows, flights: Flights, goal: Array, begun: Array, largest: Array) -> Array:
    """Return the metrics of flights.

    Parameters
    ----------
    rows : Rows
        Of the plant.
    flights : Flights
        N of them.
    goal : ndarray, shape (n, N)
        Reference when they ended.
    begun : ndarray, shape (N,)
        When they began, s.
    largest : ndarray, shape (2, N)
        Of `Deviations`; the deviation at the end counts too.

    Returns
    -------
    ndarray, shape (m, N)
        In the order of `METRICS`.
    """
    distance, speed = rows.distance(flights.x - goal), rows.speed(flights.x - goal)
    return np.array(
        [
            flights.dv_m_s,
            distance,
            speed,
            np.maximum(largest[0], distance),
            np.maximum(largest[1], speed),
            flights.time_s - begun,
            flights.firings.astype(float),
        ]
    )


def judge(
    flights: Flights, values: Array, success: Sequence[str], require: RequirementsSpec
) -> tuple[tuple[str, ...], tuple[str, ...], NDArray[np.bool_]]:
    """Say how flights ended and which failed.

    Parameters
    ----------
    flights : Flights
        N of them.
    values : ndarray, shape (m, N)
        Their metrics.
    success : sequence of str
        Statuses that are no failure.
    require : RequirementsSpec
        Largest values of metrics.

    Returns
    -------
    status, cause : tuple of str
        Those of the flights; of one that ended well but beyond what is required
        ``"requirement"`` and the name of the metric, the first in order.
    failed : ndarray of bool, shape (N,)
        Whether that counts as a failure.
    """
    status, cause = list(flights.status), list(flights.cause)
    failed = ~np.isin(np.array(status), list(success))
    for row, metric in enumerate(METRICS):
        most = requirement(require, metric)
        if most is None:
            continue
        beyond = ~failed & ~(values[row] <= most)
        for lane in np.flatnonzero(beyond).tolist():
            status[lane], cause[lane] = "requirement", metric
        failed |= beyond
    return tuple(status), tuple(cause), failed


def requirement(require: RequirementsSpec, metric: str) -> float | None:
    """Return the largest value that a metric may have; None for any."""
    most: float | None = getattr(require, _REQUIRED[metric]) if metric in _REQUIRED else None
    return most
