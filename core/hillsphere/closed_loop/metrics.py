"""Numbers that sum up a flight, and what is required of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.closed_loop.course import Rows
from hillsphere.closed_loop.largest import Largest
from hillsphere.closed_loop.specs import RequirementsSpec
from hillsphere.interfaces import Array
from hillsphere.simulation import Flights

__all__ = [
    "LANDING_MISS",
    "METRICS",
    "judge",
    "measure",
    "metric_names",
    "metric_units",
    "requirement",
]

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

LANDING_MISS = "landing_miss"
"""Distance from where a flight ended to the end of its reference, in the plant's frame.

Of flights along a reference that may end by an impact. The final position error is no such miss: it
is the distance from where the reference is at that time, and a reference that a late flight follows
has gone on below the ground by then.
"""

_REQUIRED = {
    "dv": "dv_m_s",
    "final_speed": "final_speed_m_s",
    "early": "early_s",
    "final_position_error": "final_position_error_m",
    "final_velocity_error": "final_velocity_error_m_s",
    "largest_position_error": "largest_position_error_m",
    "largest_velocity_error": "largest_velocity_error_m_s",
    LANDING_MISS: "landing_miss_m",
}

_TOUCHDOWN = "touchdown_speed"
_SAME_TIME = 1e-9


def metric_names(lands: bool) -> tuple[str, ...]:
    """Return `METRICS`, of flights that land somewhere with `LANDING_MISS`."""
    return (*METRICS, LANDING_MISS) if lands else METRICS


def metric_units(command: str, lands: bool) -> tuple[str, ...]:
    """Return the units of `metric_names` for a law that commands in this unit."""
    units = ("m/s", "m", "m/s", "m", "m/s", "s", "-", "m/s", "s", command)
    return (*units, "m") if lands else units


def measure(
    rows: Rows,
    flights: Flights,
    goal: Array,
    begun: Array,
    planned_s: float,
    largest: Largest,
    site: Array | None = None,
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
        At the samples; the deviation at the end counts too, of a later flight at the planned end.
    site : ndarray, shape (n,), or None
        Reference at its end, where flights land.

    Returns
    -------
    ndarray, shape (m, N)
        In the order of `metric_names`.
    """
    distance, speed = rows.distance(flights.x - goal), rows.speed(flights.x - goal)
    lasted = flights.time_s - begun
    late = lasted > planned_s * (1.0 + _SAME_TIME)
    planned = largest.at_planned_end(flights.x, lasted)
    values = [
        flights.dv_m_s,
        distance,
        speed,
        np.maximum(largest.deviations[0], np.where(late, planned[0], distance)),
        np.maximum(largest.deviations[1], np.where(late, planned[1], speed)),
        lasted,
        flights.firings.astype(float),
        rows.speed(flights.x),
        planned_s - lasted,
        largest.command,
    ]
    if site is not None:
        values.append(rows.distance(flights.x - site[:, None]))
    return np.array(values)


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
        (metric, row, requirement(require, metric))
        for metric, row in zip(metric_names(len(values) > len(METRICS)), values, strict=True)
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
