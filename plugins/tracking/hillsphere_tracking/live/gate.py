"""Which measurements belong to the pass that is tracked: about now, and one after the other."""

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
    """Lets in what can be used, and tells of the rest.

    What is passed over leaves no trace: a wrong time does not shut out the right ones after it. Of
    measurements far from now that follow each other, as of a file with earlier passes, the first is
    told, and then how many more there were.

    Parameters
    ----------
    start : Epoch
        From which times count.
    say : callable
        Is given the lines.
    """

    def __init__(self, start: Epoch, say: Callable[[str], None]) -> None:
        self._start, self._say = start, say
        self._before: Measurement | None = None
        self._untold = 0
        self._far_off = False

    def lets_in(self, found: Measurement, t_s: float, now_s: float) -> bool:
        """Return whether a measurement of a time can be used now."""
        if abs(t_s - now_s) > _FAR_OFF_S:
            if self._far_off:
                self._untold += 1
            else:
                when = self._start.isot(np.array([t_s]), 0)[0]
                self._say(
                    f"passed over: {found.place}: a measurement of {when}, "
                    f"{abs(t_s - now_s):.0f} s {'after' if t_s > now_s else 'before'} now; an "
                    "earlier pass is tracked with --replay"
                )
            self._far_off = True
            return False
        self.end()
        before = self._before
        if before is not None and (step := found.epoch.seconds_since(before.epoch)) <= 0.0:
            how = "at the same time as" if step == 0.0 else f"{-step:.6g} s before"
            self._say(
                f"passed over: {found.place}: this measurement is {how} that of {before.place}; "
                "times must rise"
            )
            return False
        self._before = found
        return True

    def end(self) -> None:
        """Tell how many were passed over without a word."""
        if self._untold:
            self._say(f"passed over: {self._untold} more such measurements")
        self._untold, self._far_off = 0, False
