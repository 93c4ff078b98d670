"""Link to a rotator: sends the newest command, and reconnects after a lost connection."""

from __future__ import annotations

import threading
from collections.abc import Callable
from time import monotonic

from hillsphere_tracking.live.rotctl import RotatorError, RotatorLostError, Rotctl

__all__ = ["RotatorLink"]

_FIRST_WAIT_S = 0.25
"""Wait (s) before the first attempt to connect again: a daemon that restarts is there after it, and
few commands are lost."""
_LONGEST_WAIT_S = 8.0
"""Longest wait (s) between two attempts: of a pass of ten minutes no more than this is lost after
the rotator is back, and the log stays short."""


class RotatorLink:
    """Sends commands from a separate thread, so that a slow rotator does not delay the tracker.

    If commands arrive faster than the rotator answers, only the newest one is sent. A lost
    connection is opened again, after waits that double from 0.25 s to 8 s.

    Parameters
    ----------
    connect : callable
        Opens a connection, or raises `RotatorLostError`.
    say : callable
        Receives a line when the connection is lost or restored, and when a command is refused.
    """

    def __init__(self, connect: Callable[[], Rotctl], say: Callable[[str], None]) -> None:
        self._connect, self._say = connect, say
        self._wake = threading.Condition()
        self._newest: tuple[float, float] | None = None
        self._ending = False
        self._client: Rotctl | None = None
        self._refusal = ""
        self.sent = 0
        self._thread = threading.Thread(target=self._run, name="rotator", daemon=True)

    def start(self) -> tuple[float, float]:
        """Connect and return the position of the rotator, azimuth and elevation in degrees.

        Raises
        ------
        RotatorError
            If the rotator cannot be reached or does not report its position.
        """
        client = self._connect()
        try:
            position = client.position()
        except RotatorError:
            client.close()
            raise
        self._client = client
        self._thread.start()
        return position

    def point(self, azimuth_deg: float, elevation_deg: float) -> None:
        """Replace the command to be sent next; returns at once."""
        with self._wake:
            self._newest = (azimuth_deg, elevation_deg)
            self._wake.notify()

    def end(self, within_s: float = 5.0) -> bool:
        """Stop the rotator and disconnect.

        Parameters
        ----------
        within_s : float
            Longest wait for the thread.

        Returns
        -------
        bool
            Whether the rotator received the command to stop.
        """
        with self._wake:
            self._ending, self._newest = True, None
            self._wake.notify()
        if self._thread.is_alive():
            self._thread.join(within_s)
        if self._thread.is_alive():
            return False
        try:
            with self._client or self._connect() as client:
                client.stop()
        except RotatorError as error:
            self._say(f"the rotator was not stopped: {error}")
            return False
        return True

    def _run(self) -> None:
        wait, again_at = _FIRST_WAIT_S, monotonic()
        while True:
            with self._wake:
                self._wake.wait_for(self._is_due)
                while self._client is None and not self._ending and monotonic() < again_at:
                    self._wake.wait(again_at - monotonic())
                if self._ending:
                    return
                command, self._newest = self._newest, None
            try:
                if self._client is None:
                    self._client = self._connect()
                    self._say("the rotator is connected again")
                if command is not None:
                    self._send(self._client, command)
                wait = _FIRST_WAIT_S
            except RotatorLostError as error:
                self._client = None
                again_at = monotonic() + wait
                self._say(f"{error}; trying again in {wait:g} s")
                wait = min(2.0 * wait, _LONGEST_WAIT_S)

    def _is_due(self) -> bool:
        return self._ending or self._newest is not None

    def _send(self, client: Rotctl, command: tuple[float, float]) -> None:
        try:
            client.set_position(*command)
        except RotatorLostError:
            raise
        except RotatorError as error:
            # report a refusal once: the next command, 0.1 s later, meets the same one
            reason = str(error).partition(": ")[2]
            if reason != self._refusal:
                self._say(str(error))
            self._refusal = reason
        else:
            self._refusal = ""
            self.sent += 1
