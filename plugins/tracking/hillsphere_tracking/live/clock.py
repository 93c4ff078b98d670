"""What time it is for a tracker: now, or a time that runs through what was measured earlier."""

from __future__ import annotations

from datetime import UTC, datetime
from time import monotonic, sleep
from typing import Protocol

from hillsphere.time import Epoch

__all__ = ["Clock", "RealTime", "Replay"]


class Clock(Protocol):
    """Time after the beginning of a session."""

    @property
    def start(self) -> Epoch:
        """When the session began, UTC."""
        ...

    def now_s(self) -> float:
        """Return the seconds since then."""
        ...

    def wait_until(self, t_s: float) -> None:
        """Return at that time, at once if it has passed."""
        ...

    def skip_to(self, t_s: float) -> None:
        """Leave out the time until then, where time can be left out."""
        ...


class RealTime:
    """The computer's clock, which should be set by NTP or better."""

    def __init__(self) -> None:
        # Steps of the clock while a pass is tracked would be steps of the antenna.
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
    """A time that begins at a given date and runs at a given speed.

    Parameters
    ----------
    start : Epoch
        When it begins.
    speed : float
        Seconds of it for each real second; 0: it does not wait at all.
    """

    def __init__(self, start: Epoch, speed: float) -> None:
        self.start, self._speed = start, speed
        self._begun: float | None = None
        self._reached = self._skipped = 0.0

    def now_s(self) -> float:
        """Return the seconds since the start; the first call starts it."""
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
        """Begin then, if that is later; to be called before the time runs."""
        self._reached = self._skipped = max(t_s, 0.0)
