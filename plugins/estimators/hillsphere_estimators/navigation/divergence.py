"""Which filters have diverged, and which say so.

A filter that has diverged may go on for ever, certain of states that are not so. A simulation knows
by its errors. A real system has its innovations, which are then far larger than it expects, set
after set, or its gate leaves most of them out. One set alone says little: an outlier does the same
to it. Sensors that are not as believed look alike, even where the estimate is good: that is an
alarm, but no divergence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hillsphere.interfaces import Array
from hillsphere.simulation import Flights
from hillsphere_estimators.navigation.metrics import Record

__all__ = [
    "DIVERGED_WITHOUT_ALARM",
    "DIVERGED_WITH_ALARM",
    "detect_divergence",
    "endings",
    "format_ending",
]

DIVERGED_WITH_ALARM, DIVERGED_WITHOUT_ALARM = "diverged (innovations)", "diverged (errors)"
"""Endings of flights with an estimate that has diverged."""
_ALARM_SETS = 5
"""Last sets of measurements, of those that brought anything, that all have to say so."""
_FALSE_ALARM = 1e-6
"""Of a consistent filter to be beyond a limit."""


def detect_divergence(nis: Array, used: Array, sent: Array, beyond: float) -> NDArray[np.bool_]:
    """Return which flights' innovations are far outside of what chance explains.

    Parameters
    ----------
    nis, used, sent : ndarray, shape (K, N)
        Normalised innovations squared, the rows that were used of them, and those that were sent.
        The first set counts for nothing: it meets a wide prior.
    beyond : float
        So many times the degrees of freedom, which are the mean of a consistent filter, is too
        much, if one of 1e6 consistent ones would not exceed it; that matters below five rows.

    Returns
    -------
    ndarray of bool, shape (N,)
        Those of which each of the last five sets that brought anything had too large a NIS, or
        less than half of its rows within the gate; of flights with fewer sets all, by NIS alone.
    """
    there = sent[1:] > 0.0
    last = there & (np.cumsum(there[::-1], axis=0)[::-1] <= _ALARM_SETS)
    many = last.sum(axis=0)
    shut = (used[1:] < 0.5 * sent[1:]) & (many == _ALARM_SETS)
    out = _exceeds_limit(nis[1:], used[1:], beyond) | shut
    return np.asarray((many > 0) & (out | ~last).all(axis=0))


def endings(
    record: Record, flights: Flights, beyond: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return how flights ended.

    Parameters
    ----------
    record : Record
        What was measured of them.
    flights : Flights
        As the simulation has it.
    beyond : float
        The factor of `detect_divergence`. A NEES at the end beyond this factor times the number of
        states counts as diverged, likewise.

    Returns
    -------
    status, cause : tuple of str
        Of each flight. ``diverged`` is one whose filter is no number any more (``filter``), or
        whose NEES is too large at the end: with an alarm (``innovations``), or without
        (``errors``).
    """
    status, cause = list(flights.status), list(flights.cause)
    lost = np.isnan(record.nees[-1])
    wrong = _exceeds_limit(record.nees[-1], np.array(float(len(record.error))), beyond)
    alarm = detect_divergence(record.nis, record.used, record.sent, beyond)
    for lane in range(len(status)):
        if wrong[lane]:
            status[lane], cause[lane] = "diverged", "innovations" if alarm[lane] else "errors"
        elif not lost[lane]:  # what comes after the last measurement is none of its business
            status[lane], cause[lane] = "completed", ""
        elif status[lane] == "completed":
            status[lane], cause[lane] = "diverged", "filter"
    return tuple(status), tuple(cause)


def format_ending(status: str, cause: str) -> str:
    """Return both in one."""
    return f"{status} ({cause})" if cause and cause != status else status


def _exceeds_limit(squares: Array, dof: Array, beyond: float) -> NDArray[np.bool_]:
    some = np.maximum(dof, 1.0)
    limit = np.maximum(beyond * some, chi2.isf(_FALSE_ALARM, some))
    return np.asarray((dof > 0.0) & (squares > limit))
