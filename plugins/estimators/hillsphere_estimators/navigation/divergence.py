"""Detection of divergence, by the errors and by the innovations.

A diverged filter may continue for ever with a small covariance about wrong states. In a simulation
its errors show it. A real system has only the innovations: they exceed their covariance in one set
of measurements after another, or the gate rejects most of them. A single set proves nothing, since
an outlier has the same effect. Sensors that differ from their model raise the same alarm even where
the estimate is good; that is an alarm, but no divergence.
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
"""Endings of flights whose estimate has diverged, with and without an alarm by the innovations."""
_ALARM_SETS = 5
"""Last sets with measurements that must all exceed the limit. One may be an outlier, and with
outliers in 10 % of the sets five in a row have a probability of 1e-5; more would delay the
alarm."""
_FALSE_ALARM = 1e-6
"""Probability with which a consistent filter exceeds a limit."""


def detect_divergence(nis: Array, used: Array, sent: Array, beyond: float) -> NDArray[np.bool_]:
    """Return which flights' innovations are larger than chance explains.

    Parameters
    ----------
    nis, used, sent : ndarray, shape (K, N)
        Normalised innovations squared, number of rows that were used, and number that were sent.
        The first set does not count: it meets the wide prior.
    beyond : float
        Limit of the NIS per degree of freedom, which is 1 on average for a consistent filter. The
        limit is raised where a consistent filter would exceed it more often than once in 1e6, which
        happens below five rows.

    Returns
    -------
    ndarray of bool, shape (N,)
        True if each of the last five sets with measurements had too large a NIS or more than half
        of its rows rejected. In flights with fewer sets all must have too large a NIS.
    """
    there = sent[1:] > 0.0
    # counted from the end: the last sets that have measurements
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
        Measured quantities of the flights.
    flights : Flights
        Their endings by the simulation.
    beyond : float
        The factor of `detect_divergence`. A NEES at the end beyond this factor times the number of
        states counts as diverged, likewise.

    Returns
    -------
    status, cause : tuple of str
        Status and cause of each flight. The status is ``diverged`` if the NEES at the end is too
        large, with an alarm by the innovations (``innovations``) or without (``errors``). It is
        ``not_finite``, cause ``filter``, if the filter's numbers have become non-finite: the case
        is then undecided, a failure of the class ``numerics``.
    """
    status, cause = list(flights.status), list(flights.cause)
    lost = np.isnan(record.nees[-1])
    wrong = _exceeds_limit(record.nees[-1], np.array(float(len(record.error))), beyond)
    alarm = detect_divergence(record.nis, record.used, record.sent, beyond)
    for lane in range(len(status)):
        if wrong[lane]:
            status[lane], cause[lane] = "diverged", "innovations" if alarm[lane] else "errors"
        elif not lost[lane]:  # an ending after the last measurement does not concern navigation
            status[lane], cause[lane] = "completed", ""
        elif status[lane] == "completed":
            status[lane], cause[lane] = "not_finite", "filter"
    return tuple(status), tuple(cause)


def format_ending(status: str, cause: str) -> str:
    """Return status and cause as one text."""
    return f"{status} ({cause})" if cause and cause != status else status


def _exceeds_limit(squares: Array, dof: Array, beyond: float) -> NDArray[np.bool_]:
    """Return where χ² numbers exceed the limit of `detect_divergence`; `dof` are their degrees."""
    some = np.maximum(dof, 1.0)
    limit = np.maximum(beyond * some, chi2.isf(_FALSE_ALARM, some))
    return np.asarray((dof > 0.0) & (squares > limit))
