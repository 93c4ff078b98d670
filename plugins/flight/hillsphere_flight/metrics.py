"""Numbers that sum up a flight, and what is required of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.cases.case_classes import is_undecided
from hillsphere.engine.course import Rows
from hillsphere.simulation import Flights
from hillsphere_flight.largest import Largest
from hillsphere_flight.specs import RequirementsSpec

__all__ = [
    "LANDING_MISS",
    "METRICS",
    "judge",
    "measure",
    "metric_errors",
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
that of the law alone, without what the reference brings. What is largest is so over the whole
flight, between samples too (`hillsphere_flight.largest`). Nothing beyond the planned
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
        Over the flight; the deviation at the end counts too, of a later flight at the planned end.
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


def metric_errors(
    rows: Rows, scale: Array, flights: Flights, values: Array, period_s: float, *, held: bool
) -> Array:
    r"""Return how far the step error of flights may move their metrics.

    Parameters
    ----------
    rows : Rows
        Of the plant.
    scale : ndarray, shape (n,)
        Natural units of its states, SI.
    flights : Flights
        N of them, each with an estimate e of the largest error of a state in these units.
    values : ndarray, shape (m, N)
        Their metrics.
    period_s : float
        Between samples.
    held : bool
        Whether commands are accelerations; otherwise they are impulses.

    Returns
    -------
    ndarray, shape (m, N)
        In the order of `metric_names`, zero for a flight without an estimate.

    Notes
    -----
    An error of each of d components by at most e units makes a distance wrong by at most
    :math:`\sqrt{d}\,e` units of length, :math:`\delta r`, and a speed by as many of velocity,
    :math:`\delta v`. A law corrects an error of velocity by as much Δv; held for a period, by an
    acceleration of :math:`\delta v` in that time. An event comes sooner or later by the time in
    which the flight covers :math:`\delta r`.
    """
    axes = len(rows.positions) // rows.vectors
    error = np.where(np.isfinite(flights.step_error), flights.step_error, 0.0) * np.sqrt(axes)
    distance = error * float(np.max(scale[rows.positions]))
    speed = error * float(np.max(scale[rows.velocities]))
    final_speed = values[METRICS.index("final_speed")]
    by_event = np.array(flights.status) != "completed"
    # A flight that stands still when it ends may end at any time: infinitely wrong if wrong at all.
    with np.errstate(divide="ignore", invalid="ignore"):
        time = np.where(by_event & (distance > 0.0), distance / final_speed, 0.0)
    of = dict.fromkeys(metric_names(lands=True), np.zeros_like(error)) | {
        "dv": speed,
        "final_position_error": distance,
        "final_velocity_error": speed,
        "largest_position_error": distance,
        "largest_velocity_error": speed,
        "duration": time,
        "final_speed": speed,
        "early": time,
        "largest_command": speed / period_s if held else speed,
        LANDING_MISS: distance,
    }
    return np.array([of[name] for name in metric_names(len(values) > len(METRICS))])


def judge(
    flights: Flights,
    values: Array,
    success: Sequence[str],
    require: RequirementsSpec,
    errors: Array,
    largest_step_error: float,
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
    errors : ndarray, shape (m, N)
        How far the metrics may be wrong, see `metric_errors`.
    largest_step_error : float
        Estimate of the step error beyond which nothing of a flight is decided.

    Returns
    -------
    status, cause : tuple of str
        Those of the flights; of one that ended well but beyond what is required
        ``"requirement"`` and the name of the metric, the first in order after ``"early"``,
        ``"late"`` and ``"touchdown_speed"``, the final speed of one that ended by an impact.
        A flight whose step error leaves open whether it met what is required, and that did not
        surely miss anything else, is ``"step_error"`` with the name of that metric; one with a
        step error beyond the limit is so with no name. One that an event of the plant ended
        before it began is ``"input"``.
    failed : ndarray of bool, shape (N,)
        Whether that counts as a failure; never of an undecided flight, see
        `hillsphere.cases.case_classes`.
    """
    status, cause = list(flights.status), list(flights.cause)
    words = np.array(status)
    never_began = np.isin(words, ("impact", "escape")) & (flights.samples == 0)
    # What is not finite has no error: the flight had left all bounds.
    coarse = (flights.step_error > largest_step_error) & (words != "diverged") & ~never_began
    undecided = is_undecided(words) | never_began | coarse
    failed = ~np.isin(words, list(success)) & ~undecided
    for lane in np.flatnonzero(never_began).tolist():
        status[lane], cause[lane] = "input", f"start ({cause[lane]})"
    for lane in np.flatnonzero(coarse & ~is_undecided(words)).tolist():
        status[lane], cause[lane] = "step_error", ""
    touched = words == "impact"
    early, final_speed = (values[METRICS.index(name)] for name in ("early", "final_speed"))
    of_early, of_speed = (errors[METRICS.index(name)] for name in ("early", "final_speed"))
    # A crash far from the site, or a hard one, is told as such, not by the miss.
    rules = [
        ("early", early, of_early, require.early_s),
        ("late", -early, of_early, require.late_s),
        (_TOUCHDOWN, final_speed, of_speed, require.touchdown_speed_m_s),
    ]
    rules += [
        (metric, row, error, requirement(require, metric))
        for metric, row, error in zip(
            metric_names(len(values) > len(METRICS)), values, errors, strict=True
        )
    ]
    left_open: dict[int, str] = {}
    for metric, reached, error, most in rules:
        if most is None:
            continue
        counts = ~undecided & ~failed
        if metric == _TOUCHDOWN:
            counts &= touched
        beyond = counts & ~(reached <= most)
        either = counts & (error > 0.0) & (np.abs(reached - most) <= error)
        for lane in np.flatnonzero(either).tolist():
            left_open.setdefault(lane, metric)
        beyond &= ~either
        for lane in np.flatnonzero(beyond).tolist():
            status[lane], cause[lane] = "requirement", metric
        failed |= beyond
    for lane, metric in left_open.items():
        if not failed[lane]:
            status[lane], cause[lane] = "step_error", metric
    return tuple(status), tuple(cause), failed


def requirement(require: RequirementsSpec, metric: str) -> float | None:
    """Return the largest value that a metric may have; None for any."""
    if metric == "largest_command":
        held: float | None = require.largest_acceleration_m_s2
        return require.largest_impulse_m_s if held is None else held
    most: float | None = getattr(require, _REQUIRED[metric]) if metric in _REQUIRED else None
    return most
