"""Axis motion of mounts that follow passes, with a plan and without (naive)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.axis_motion import follow
from hillsphere_tracking.pointing.mounts import Mount

__all__ = ["Course", "follow_courses", "naive_course"]


@dataclass(frozen=True, eq=False)
class Course:
    """Angles of both axes over a pass.

    Parameters
    ----------
    primary_rad, secondary_rad : ndarray, shape (K,)
        Angles, one period apart.
    """

    primary_rad: Array
    secondary_rad: Array


def naive_course(direction: Array, mount: Mount, start_rad: float | None = None) -> Course:
    """Return the commands of an antenna without a plan.

    The primary axis takes the shorter way from one command to the next. At a stop it rewinds by a
    full turn if the target is then within reach, else it waits. The mount is never flipped.

    Parameters
    ----------
    direction : ndarray, shape (3, K)
        Unit vectors east, north, up of the target.
    mount : Mount
        The mount, with its stops.
    start_rad : float, optional
        The primary begins on the turn nearest to this angle; by default to the middle of its stops.

    Returns
    -------
    Course
        Commanded angles, which may exceed the rates of the axes.
    """
    plain, secondary = mount.on_target(direction)
    low, high = mount.primary.lower_rad, mount.primary.upper_rad
    start = 0.5 * (low + high) if start_rad is None else start_rad
    # the shorter way between commands, from the turn nearest to the start
    course = np.unwrap(plain)
    course += 2.0 * pi * np.rint((start - course[0]) / (2.0 * pi))
    return Course(_within_stops(course, low, high), secondary)


def follow_courses(courses: Sequence[Course], mount: Mount, period_s: float) -> tuple[Course, ...]:
    """Follow commanded courses within the limits of a mount's axes.

    Parameters
    ----------
    courses : sequence of Course
        Commanded angles; the axes begin at rest on the first command of each course.
    mount : Mount
        The mount, with the limits of its axes.
    period_s : float
        Interval between the commands of a course.

    Returns
    -------
    tuple of Course
        Angles of the axes, with the lengths of the commanded courses.
    """
    # All courses at once, since the loop over time costs most; shorter ones wait at their ends.
    longest = max(course.primary_rad.size for course in courses)

    def together(angles: list[Array]) -> Array:
        return np.column_stack([np.pad(q, (0, longest - q.size), mode="edge") for q in angles])

    primary, _ = follow(
        together([course.primary_rad for course in courses]), period_s, mount.primary
    )
    secondary, _ = follow(
        together([course.secondary_rad for course in courses]), period_s, mount.secondary
    )
    return tuple(
        Course(primary[: course.primary_rad.size, n], secondary[: course.primary_rad.size, n])
        for n, course in enumerate(courses)
    )


def _within_stops(course: Array, low: float, high: float) -> Array:
    """Return a continuous course that is rewound by a full turn where it meets a stop."""
    course = course.copy()
    k = 0
    while True:
        beyond = np.flatnonzero((course[k:] < low) | (course[k:] > high))
        if not beyond.size:
            return course
        k += int(beyond[0])
        turn = 2.0 * pi if course[k] < low else -2.0 * pi
        if low <= course[k] + turn <= high:
            course[k:] += turn
        k += 1
