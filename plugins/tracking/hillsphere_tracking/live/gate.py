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
_AGREE = 5
"""Measurements in a row that are as far ahead of now, for the clock that dates them to be believed
ahead. Fewer may be a burst of wrong stamps, which would shut out the right ones after it; more
would delay the beginning of a pass."""


class Gate:
    """Accepts usable measurements and reports the others.

    A rejected measurement does not affect later ones: one wrong time does not shut out the correct
    times after it. Measurements that are ahead of now are held back: if five in a row are as far
    ahead, the clock that dates them is, and they are used; else their times were wrong.

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
        self._held: list[tuple[float, Measurement]] = []
        self._lead = self._held_lead = 0.0

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
            lead = t_s - now_s
            if lead <= self._lead + _AHEAD_S:
                self._drop_held()
                self._lead = max(lead, 0.0)
                ready = [(t_s, measurement)]
            else:
                if self._held and abs(lead - self._held_lead) > _AHEAD_S:
                    self._drop_held()
                self._held.append((t_s, measurement))
                self._held_lead = lead
                if len(self._held) < _AGREE:
                    continue
                self._say(f"measurements are dated {lead:.3g} s ahead of this clock, and are used")
                ready, self._held, self._lead = self._held, [], lead
            for time, one in ready:
                if self._is_next(one):
                    yield time, one

    def _drop_held(self) -> None:
        """Report the measurements that were held back, and forget them."""
        if self._held:
            more = len(self._held) - 1
            self._say(
                f"passed over: {self._held[0][1].place}: its time is {self._held_lead:.3g} s after "
                "now, and the next measurements are not"
                + (f"; {more} more such measurements" if more else "")
            )
        self._held = []

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
