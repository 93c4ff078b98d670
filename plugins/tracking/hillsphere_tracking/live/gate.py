"""Gate for measurements: only measurements of the present pass, in order of time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from hillsphere.time import Epoch
from hillsphere_tracking.live.measurements import Measurement

__all__ = ["Gate"]

_FAR_OFF_S = 60.0
"""Time (s) from now beyond which a measurement is of another pass or of a wrong clock. Clocks
without NTP are some seconds off; an hour's mistake in the time zone is beyond it."""


_AHEAD_S = 1.0
"""Time (s) by which a measurement may be further ahead of now than those before it, without being
held back. The delay of a line from receiver to tracker varies by less, and a stamp from the future
that passes shuts out the measurements of no more than this time."""


class Gate:
    """Accepts usable measurements and reports the others.

    A rejected measurement does not affect later ones: one wrong time does not shut out the correct
    times after it. A measurement that is ahead of now is held back until the next one: if that is
    later still, the clock that dates them is ahead, and both are used; else its time was wrong.

    Of consecutive measurements far from the present, as in a file with earlier passes, only the
    first and the number of further ones are reported.

    Parameters
    ----------
    start : Epoch
        Origin of the times.
    say : callable
        Receives the reports.
    """

    def __init__(self, start: Epoch, say: Callable[[str], None]) -> None:
        self._start, self._say = start, say
        self._before: Measurement | None = None
        self._untold = 0
        self._far_off = False
        self._held: tuple[float, Measurement] | None = None
        self._lead = 0.0

    def admit(
        self, arrived: Sequence[Measurement], now_s: float
    ) -> Iterator[tuple[float, Measurement]]:
        """Yield the usable ones of the measurements that have arrived, with their times (s).

        Parameters
        ----------
        arrived : sequence of Measurement
            In the order of their arrival.
        now_s : float
            Present time after the origin.
        """
        for measurement in arrived:
            t_s = measurement.epoch.seconds_since(self._start)
            if not self._is_present(measurement, t_s, now_s):
                continue
            held, self._held = self._held, None
            if held is not None:
                if t_s > held[0]:
                    self._lead = t_s - now_s
                    if self._is_next(held[1]):
                        yield held
                else:
                    self._say(
                        f"passed over: {held[1].place}: its time is "
                        f"{held[0] - now_s:.3g} s after now, and the next measurement is before it"
                    )
            if t_s - now_s > self._lead + _AHEAD_S:
                self._held = t_s, measurement
                continue
            self._lead = max(t_s - now_s, 0.0)
            if self._is_next(measurement):
                yield t_s, measurement

    def _is_present(self, measurement: Measurement, t_s: float, now_s: float) -> bool:
        if abs(t_s - now_s) > _FAR_OFF_S:
            if self._far_off:
                self._untold += 1
            else:
                when = self._start.isot(np.array([t_s]), 0)[0]
                self._say(
                    f"passed over: {measurement.place}: a measurement of {when}, "
                    f"{abs(t_s - now_s):.0f} s {'after' if t_s > now_s else 'before'} now; an "
                    "earlier pass is tracked with --replay"
                )
            self._far_off = True
            return False
        self.end()
        return True

    def _is_next(self, measurement: Measurement) -> bool:
        before = self._before
        if before is not None and (step := measurement.epoch.seconds_since(before.epoch)) <= 0.0:
            how = "at the same time as" if step == 0.0 else f"{-step:.6g} s before"
            self._say(
                f"passed over: {measurement.place}: this measurement is {how} that of "
                f"{before.place}; times must rise"
            )
            return False
        self._before = measurement
        return True

    def end(self) -> None:
        """Report the number of measurements that were rejected without a report."""
        if self._untold:
            self._say(f"passed over: {self._untold} more such measurements")
        self._untold, self._far_off = 0, False
