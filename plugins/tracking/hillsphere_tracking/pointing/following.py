"""Passes followed with a plan and without: the commands to the axes, and what the beam misses."""

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
        One period apart.
    """

    primary_rad: Array
    secondary_rad: Array


def naive_course(direction: Array, mount: Mount, start_rad: float | None = None) -> Course:
    """Return where an antenna without a plan sends its axes.

    The primary goes the short way round from one command to the next. At a stop it rewinds by a
    whole turn if that leads to the target, else it waits. Nothing is flipped.

    Parameters
    ----------
    direction : ndarray, shape (3, K)
        Unit vectors east, north, up to follow.
    mount : Mount
        Whose stops matter.
    start_rad : float, optional
        The primary begins on the turn nearest to this angle; by default to the middle of its stops.

    Returns
    -------
    Course
        What the axes are told; they may be too slow for it.
    """
    plain, secondary = mount.on_target(direction)
    low, high = mount.primary.lower_rad, mount.primary.upper_rad
    start = 0.5 * (low + high) if start_rad is None else start_rad
    course = np.unwrap(plain)
    course += 2.0 * pi * np.rint((start - course[0]) / (2.0 * pi))
    return Course(_within_stops(course, low, high), secondary)


def follow_courses(courses: Sequence[Course], mount: Mount, period_s: float) -> tuple[Course, ...]:
    """Return how a mount's axes follow courses within their limits.

    Parameters
    ----------
    courses : sequence of Course
        Each begins with the axes at rest where it begins.
    mount : Mount
        With the limits of its axes.
    period_s : float
        Between the commands of a course.

    Returns
    -------
    tuple of Course
        Of the same lengths.
    """
    # all at once, the shorter ones waiting at their ends: the loop over time is what costs
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
    """Return a course without jumps, rewound where it meets a stop."""
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
