"""Gate for measurements: only measurements of the present pass, in order of time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.time import Epoch
from hillsphere_tracking.live.measurements import Measurement

__all__ = ["Gate"]

_FAR_OFF_S = 60.0
"""Time (s) from now beyond which a measurement is of another pass or of a wrong clock. Clocks
without NTP are some seconds off; an hour's mistake in the time zone is beyond it."""


class Gate:
    """Accepts usable measurements and reports the others.

    A rejected measurement does not affect later ones: one wrong time does not shut out the correct
    times after it. Of consecutive measurements far from the present, as in a file with earlier
    passes, only the first and the number of further ones are reported.

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

    def lets_in(self, measurement: Measurement, t_s: float, now_s: float) -> bool:
        """Return whether a measurement at `t_s` can be used at the present time `now_s` (s)."""
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
