"""When lanes that fly together stop to take the next flights."""

from __future__ import annotations

from bisect import insort
from collections.abc import Callable
from math import ceil, sqrt

__all__ = ["LaneRefill"]

_STOP = 30.0
"""Time of a stop in steps of a batch: reading the states of lanes, choosing and loading others. For
the point-mass Hill problem, whose steps are among the cheapest, 20 to 40 were measured."""
_FIRST_STEPS = 256
"""Steps until the first stop and, among flights that differ, between all: the prediction of a close
pass is poor. For flights of 100 to 4500 steps 512 took a sixth longer."""
_WAIT = 1.4
"""Expected excess of the largest of eight normal numbers over their mean, in deviations [1]_."""
_KNOWN = 24
"""Steps of a flight from which its own progress, and no longer the mean, predicts its end."""
_MARGIN = 1.03
"""Factor on an expected number of steps, so that the lane has ended when the batch stops."""
_LEAST_STEPS = 16
"""Least number of steps between two stops, about half the time of one."""


class LaneRefill:
    """Numbers of steps between the stops of a batch, from those of the flights that have ended.

    A lane that has ended waits until the batch stops. Let flights take m steps in the mean, with
    deviation s, and a stop the time of S steps. If all lanes begin together, a flight waits about
    1.4 s [1]_, and costs a stop. If the batch stops whenever k lanes have ended, a flight waits
    k m/(2 n) in a batch of n, and costs n/k stops, at best √(2 m S) together. The cheaper way is
    taken: the first for flights that resemble each other, the second for those that do not.

    What is chosen here decides only when lanes take flights, never their bits.

    References
    ----------
    .. [1] H. A. David, H. N. Nagaraja (2003), Order Statistics, 3rd ed., Wiley, section 4.2.
    """

    def __init__(self, width: int) -> None:
        self._taken, self._width = [0] * width, width
        self._ended: list[int] = []
        self._sum, self._squares = 0.0, 0.0

    def note(self, steps: list[int], ended: list[int]) -> None:
        """Add the steps of each lane since the last stop, and learn from lanes that have ended."""
        taken = [before + now for before, now in zip(self._taken, steps, strict=True)]
        for lane in ended:
            insort(self._ended, taken[lane])
            self._sum += taken[lane]
            self._squares += float(taken[lane]) ** 2
            taken[lane] = 0
        self._taken = taken

    def steps(self, progress: Callable[[], list[float]]) -> int:
        """Return the number of steps until the next stop.

        Parameters
        ----------
        progress : callable
            Returns the part 0 to 1 of its flight that each lane has flown.

        Returns
        -------
        int
            Steps.
        """
        ended = len(self._ended)
        if ended < 2:
            return _FIRST_STEPS
        mean = self._sum / ended
        deviation = sqrt(max(self._squares / ended - mean * mean, 0.0))
        if _WAIT * deviation + _STOP < sqrt(2.0 * mean * _STOP):
            return ceil(mean + 4.0 * deviation) + _LEAST_STEPS
        median = self._ended[ended // 2]
        left = sorted(
            taken / part - taken if taken >= _KNOWN and part > 0.0 else max(median - taken, 1.0)
            for taken, part in zip(self._taken, progress(), strict=True)
        )
        best, chosen, waited, before = float("inf"), left[0], 0.0, left[0]
        for k, now in enumerate(left, start=1):
            waited += (k - 1) * (now - before)
            before = now
            cost = (waited + _STOP * self._width) / k
            if cost <= best:
                best, chosen = cost, now
        return int(min(max(_MARGIN * chosen + 1.0, _LEAST_STEPS), _FIRST_STEPS))
