"""Clocks of a tracking session: real time, or the time of a replay."""

from __future__ import annotations

from datetime import UTC, datetime
from time import monotonic, sleep
from typing import Protocol

from hillsphere.time import Epoch

__all__ = ["Clock", "RealTime", "Replay"]


class Clock(Protocol):
    """Clock of a session; times are seconds after its start."""

    @property
    def start(self) -> Epoch:
        """Start of the session, UTC."""
        ...

    def now_s(self) -> float:
        """Return the present time, s after the start."""
        ...

    def wait_until(self, t_s: float) -> None:
        """Wait until a time; return at once if it has passed."""
        ...

    def skip_to(self, t_s: float) -> None:
        """Advance the clock to a time if it is a replay; real time cannot be advanced."""
        ...


class RealTime:
    """Clock of the computer, which should be synchronised by NTP or better."""

    def __init__(self) -> None:
        # monotonic: a step of the system clock during a pass would be a step of the antenna
        self._begun = monotonic()
        self.start = Epoch.parse(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S.%f}", "UTC")

    def now_s(self) -> float:
        """Return the seconds since the start."""
        return monotonic() - self._begun

    def wait_until(self, t_s: float) -> None:
        """Sleep until a time."""
        if (left := t_s - self.now_s()) > 0.0:
            sleep(left)

    def skip_to(self, t_s: float) -> None:
        """Do nothing: real time runs."""


class Replay:
    """Clock of a replay, which begins at a given date and runs at a given speed.

    Parameters
    ----------
    start : Epoch
        Date at which the clock begins.
    speed : float
        Seconds of the replay per real second; with 0 the clock never waits.
    """

    def __init__(self, start: Epoch, speed: float) -> None:
        self.start, self._speed = start, speed
        self._begun: float | None = None
        self._reached = self._skipped = 0.0

    def now_s(self) -> float:
        """Return the seconds since the start; the first call starts the clock."""
        if not self._speed:
            return self._reached
        if self._begun is None:
            self._begun = monotonic()
        return self._skipped + (monotonic() - self._begun) * self._speed

    def wait_until(self, t_s: float) -> None:
        """Sleep until a time, unless the speed is 0."""
        self._reached = max(self._reached, t_s)
        if self._speed and (left := t_s - self.now_s()) > 0.0:
            sleep(left / self._speed)

    def skip_to(self, t_s: float) -> None:
        """Begin at a later time; call it before the clock is started."""
        self._reached = self._skipped = max(t_s, 0.0)
