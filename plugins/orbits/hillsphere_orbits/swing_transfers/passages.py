"""Transfers that one swing orbit offers: every departure with every arrival."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.transfers.meetings import Meetings

__all__ = ["Passages", "passages"]

_EQUAL = 1e-7  # costs that differ by less are those of mirror images


@dataclass(frozen=True)
class Passages:
    """Ways along N closed swing orbits from one orbit to another, K in all, normalised.

    Parameters
    ----------
    lane : ndarray of int, shape (K,)
        The swing orbit.
    departure, arrival : ndarray of int, shape (K,)
        Numbers of the meetings with the two orbits.
    total, tof : ndarray, shape (K,)
        Both speed changes together, and the time in between, less than a period.
    angle : ndarray, shape (K,)
        Mean of the angles at which the orbits meet, rad.
    """

    lane: NDArray[np.intp]
    departure: NDArray[np.intp]
    arrival: NDArray[np.intp]
    total: Array
    tof: Array
    angle: Array

    def cheapest(self, lanes: int) -> NDArray[np.intp]:
        """Return the number of the cheapest passage of each lane; −1 for a lane without one.

        Of those that cost the same (mirror images do) it is the quickest.
        """
        least = np.full(lanes, np.inf)
        np.minimum.at(least, self.lane, self.total)
        # mirror images cost the same to rounding: the quickest of them, then the first
        equal = np.flatnonzero(self.total <= least[self.lane] + _EQUAL)
        quickest = np.full(lanes, np.inf)
        np.minimum.at(quickest, self.lane[equal], self.tof[equal])
        chosen = np.full(lanes, -1)
        best = equal[self.tof[equal] == quickest[self.lane[equal]]]
        # the first of several that are equal in time as well
        chosen[self.lane[best][::-1]] = best[::-1]
        return chosen


def passages(start: Meetings, end: Meetings, period: Array) -> Passages:
    """Pair every meeting with the departure orbit with every one with the arrival orbit.

    Parameters
    ----------
    start, end : Meetings
        Of the same N swing orbits, by lane.
    period : ndarray, shape (N,)
        Their periods.

    Returns
    -------
    Passages
        By lane.
    """
    # all pairs of a departure and an arrival on the same lane, without a loop
    count = np.bincount(end.lane, minlength=period.size)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.intp)
    repeats = count[start.lane]
    i = np.repeat(np.arange(start.lane.size), repeats)
    within = np.arange(i.size) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    j = first[start.lane[i]] + within
    lane = start.lane[i]
    # a swing orbit is periodic: the next arrival after the departure
    tof = (end.time[j] - start.time[i]) % period[lane]
    return Passages(lane, i, j, start.dv[i] + end.dv[j], tof, 0.5 * (start.angle[i] + end.angle[j]))
