"""Numbers that sum up a flight, and what is required of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.closed_loop.course import Rows
from hillsphere.closed_loop.specs import RequirementsSpec
from hillsphere.interfaces import Array
from hillsphere.simulation import BLOCK, Flights, Moment
from hillsphere.simulation.block import Recorder
from hillsphere.simulation.flow import thrust_vectors

__all__ = ["METRICS", "Largest", "judge", "measure", "metric_units", "requirement"]

METRICS = (
    "dv",
    "final_position_error",
    "final_velocity_error",
    "largest_position_error",
    "largest_velocity_error",
    "duration",
    "firings",
    "final_speed",
    "early",
    "largest_command",
)
"""What sums up a flight.

The speed at the end is that in the plant's frame: of a flight that ends on the surface the one with
which it touches. Early is how long before its planned end a flight ended: that of the reference, or
of the last sample if this comes first; negative of one that ended later. The largest command is
that of the law alone, without what the reference brings, at the samples. Nothing beyond the planned
end counts among the largest of a flight that has overtime.
"""

_REQUIRED = {
    "dv": "dv_m_s",
    "final_speed": "final_speed_m_s",
    "early": "early_s",
    "final_position_error": "final_position_error_m",
    "final_velocity_error": "final_velocity_error_m_s",
    "largest_position_error": "largest_position_error_m",
    "largest_velocity_error": "largest_velocity_error_m_s",
}


_TOUCHDOWN = "touchdown_speed"
_SAME_TIME = 1e-9


def metric_units(command: str) -> tuple[str, ...]:
    """Return the units of `METRICS` for a law that commands in this unit."""
    return ("m/s", "m", "m/s", "m", "m/s", "s", "-", "m/s", "s", command)


class Largest:
    """Largest deviations and commands at the samples: an `Observer`, without histories.

    Parameters
    ----------
    rows : Rows
        Of the plant.
    goal : ndarray, shape (n, K + 1)
        Reference at each sample and at the end of the last.
    total : int
        Number of cases.
    first, final : int
        Samples from which, and until which, deviations count; commands before the latter.
    commands : int
        Number of rows of a command.

    Attributes
    ----------
    deviations : ndarray, shape (2, N)
        Of position, m, and velocity, m/s, from the reference; of several spacecraft the largest.
    command : ndarray, shape (N,)
        Size of what the law commands, likewise.
    """

    def __init__(
        self, rows: Rows, goal: Array, total: int, first: int, final: int, commands: int
    ) -> None:
        self.deviations, self.command = np.zeros((2, total)), np.zeros(total)
        self._thrusts = thrust_vectors(commands)
        order = [*rows.positions, *rows.velocities]
        # One row-wise copy per sample; plants whose states are already in this order need none.
        self._order = slice(0, len(order)) if order == list(range(len(order))) else order
        self._goal = np.ascontiguousarray(goal[order].T)[:, :, None]
        self._first, self._final = first, final
        axes = len(rows.positions) // rows.vectors
        self._starts = np.arange(0, len(order), axes)
        self._vectors = rows.vectors

    def recorder(self, first: int, count: int) -> Recorder:
        """Return what is told of one block."""
        squares = np.zeros((2 * self._vectors, BLOCK))
        place = slice(first, first + count)
        goal, order, starts, begin = self._goal, self._order, self._starts, self._first
        last, final = len(goal) - 1, self._final

        most = np.zeros(BLOCK)

        def record(now: Moment) -> None:
            if begin <= now.k <= final:
                gap = now.x[order] - goal[now.k]
                gap *= gap
                np.maximum(squares, np.add.reduceat(gap, starts), out=squares, where=now.flying)
            if now.own is not None and now.k < final:
                size = np.add.reduce((now.own * now.own).reshape(self._thrusts, -1, BLOCK), axis=1)
                np.maximum(most, np.maximum.reduce(size, axis=0), out=most, where=now.flying)
            if now.k == last:
                each = squares.reshape(2, self._vectors, BLOCK).max(axis=1)
                self.deviations[:, place] = np.sqrt(each)[:, :count]
                self.command[place] = np.sqrt(most)[:count]

        return record


def measure(
    rows: Rows, flights: Flights, goal: Array, begun: Array, planned_s: float, largest: Largest
) -> Array:
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
    planned_s : float
        How long they were to last.
    largest : Largest
        At the samples; the deviation at an end that is not later than planned counts too.

    Returns
    -------
    ndarray, shape (m, N)
        In the order of `METRICS`.
    """
    distance, speed = rows.distance(flights.x - goal), rows.speed(flights.x - goal)
    lasted = flights.time_s - begun
    late = lasted > planned_s * (1.0 + _SAME_TIME)
    return np.array(
        [
            flights.dv_m_s,
            distance,
            speed,
            np.maximum(largest.deviations[0], np.where(late, 0.0, distance)),
            np.maximum(largest.deviations[1], np.where(late, 0.0, speed)),
            lasted,
            flights.firings.astype(float),
            rows.speed(flights.x),
            planned_s - lasted,
            largest.command,
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
        ``"requirement"`` and the name of the metric, the first in order after ``"early"``,
        ``"late"`` and ``"touchdown_speed"``, the final speed of one that ended by an impact.
    failed : ndarray of bool, shape (N,)
        Whether that counts as a failure.
    """
    status, cause = list(flights.status), list(flights.cause)
    failed = ~np.isin(np.array(status), list(success))
    touched = np.array(status) == "impact"
    early, final_speed = (values[METRICS.index(name)] for name in ("early", "final_speed"))
    # A crash far from the site, or a hard one, is told as such, not by the miss.
    rules = [
        ("early", early, require.early_s),
        ("late", -early, require.late_s),
        (_TOUCHDOWN, final_speed, require.touchdown_speed_m_s),
    ]
    rules += [
        (metric, values[row], requirement(require, metric)) for row, metric in enumerate(METRICS)
    ]
    for metric, reached, most in rules:
        if most is None:
            continue
        beyond = ~failed & ~(reached <= most)
        if metric == _TOUCHDOWN:
            beyond &= touched
        for lane in np.flatnonzero(beyond).tolist():
            status[lane], cause[lane] = "requirement", metric
        failed |= beyond
    return tuple(status), tuple(cause), failed


def requirement(require: RequirementsSpec, metric: str) -> float | None:
    """Return the largest value that a metric may have; None for any."""
    if metric == "largest_command":
        held: float | None = require.largest_acceleration_m_s2
        return require.largest_impulse_m_s if held is None else held
    most: float | None = getattr(require, _REQUIRED[metric]) if metric in _REQUIRED else None
    return most
