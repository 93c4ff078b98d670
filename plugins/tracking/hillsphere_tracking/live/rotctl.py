"""The protocol of rotctld, the network daemon of Hamlib that drives antenna rotators.

A command is a line, an answer one or more: ``P 120.00 35.00`` is answered by ``RPRT 0``, ``p`` by
the azimuth and the elevation, a line each, in degrees, or by ``RPRT`` and a negative number.
"""

from __future__ import annotations

import socket
from math import isfinite
from types import TracebackType
from typing import NoReturn, Self

from hillsphere.errors import HillsphereError

__all__ = ["PORT", "RotatorError", "RotatorLostError", "RotatorRefusedError", "Rotctl"]

PORT = 4533
"""Port of rotctld unless it is told another one."""

_CODES = {
    -1: "invalid parameter: beyond the rotator's own limits?",
    -2: "invalid configuration",
    -3: "out of memory",
    -4: "not implemented",
    -5: "communication with the rotator timed out",
    -6: "input/output error: the rotator cannot be reached",
    -7: "internal error of Hamlib",
    -8: "protocol error between rotctld and the rotator",
    -9: "command rejected by the rotator",
    -10: "argument truncated",
    -11: "not available on this rotator",
    -12: "function not available",
    -13: "bus error",
    -14: "bus busy",
    -15: "invalid handle",
    -16: "invalid function",
    -17: "out of range",
}
"""Hamlib's error codes (rig_errcode_e in its header rig.h)."""

_LONGEST = 256
"""Bytes of an answer at most: those of rotctld are below 40, and another service on the port must
not fill the memory."""


class RotatorError(HillsphereError):
    """Something is wrong with the rotator or the way to it."""


class RotatorLostError(RotatorError):
    """There is no connection, or no answer that can be understood."""


class RotatorRefusedError(RotatorError):
    """The rotator refused a command.

    Parameters
    ----------
    command : str
        The command.
    code : int
        Hamlib's, negative.
    """

    def __init__(self, command: str, code: int) -> None:
        super().__init__(
            f"the rotator refused {command!r}: RPRT {code}, {_CODES.get(code, 'unknown code')}"
        )
        self.code = code


class Rotctl:
    """One connection to rotctld.

    After a `RotatorLostError` the connection is closed: an answer that comes late would be taken
    for that to the next command. Make a new one.

    Parameters
    ----------
    host : str
        Name or address of the machine on which rotctld runs.
    port : int
        Its port.
    timeout_s : float
        How long to wait for the connection and for each answer.

    Raises
    ------
    RotatorLostError
        If there is no connection.
    """

    def __init__(self, host: str, port: int = PORT, timeout_s: float = 2.0) -> None:
        self._name = f"{host}:{port}"
        self._buffer = b""
        try:
            self._socket = socket.create_connection((host, port), timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as error:
            raise RotatorLostError(f"no rotctld at {self._name}: {_reason(error)}") from error

    def set_position(self, azimuth_deg: float, elevation_deg: float) -> None:
        """Send the rotator to a position; it does not wait until it is there.

        Raises
        ------
        RotatorRefusedError
            With the code of Hamlib.
        RotatorLostError
            If the connection is lost.
        """
        self._report(f"P {azimuth_deg:.4f} {elevation_deg:.4f}")

    def position(self) -> tuple[float, float]:
        """Return azimuth and elevation where the rotator stands, degrees; raises as above."""
        first = self._ask("p")
        second = self._line()
        try:
            found = float(first), float(second)
        except ValueError:
            found = float("nan"), 0.0
        if not all(isfinite(angle) for angle in found):
            self._lose(f"was given up: it answered 'p' with {first[:40]!r} and {second[:40]!r}")
        return found

    def stop(self) -> None:
        """Stop the rotator; raises as above."""
        self._report("S")

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()

    def _report(self, command: str) -> None:
        line = self._ask(command)
        if line != "RPRT 0":  # any other report was raised
            self._lose(f"was given up: it answered {command!r} with {line[:40]!r}")

    def _ask(self, command: str) -> str:
        """Send a command; return the first line of the answer unless it reports an error."""
        try:
            self._socket.sendall(f"{command}\n".encode("ascii"))
        except OSError as error:
            self._lose(f"was lost: {_reason(error)}", error)
        line = self._line()
        word, _, code = line.partition(" ")
        if word == "RPRT" and code.lstrip("-").isdigit() and int(code) < 0:
            raise RotatorRefusedError(command, int(code))
        return line

    def _line(self) -> str:
        while b"\n" not in self._buffer:
            try:
                got = self._socket.recv(4096)
            except OSError as error:
                self._lose(f"was lost: {_reason(error)}", error)
            if not got:
                self._lose("was closed")
            self._buffer += got
            if len(self._buffer) > _LONGEST:
                self._lose("was given up: it sent something else than the answers of rotctld")
        line, _, self._buffer = self._buffer.partition(b"\n")
        return line.decode("ascii", "replace").strip()

    def _lose(self, what: str, cause: Exception | None = None) -> NoReturn:
        self.close()
        raise RotatorLostError(f"rotctld at {self._name}: the connection {what}") from cause


def _reason(error: OSError) -> str:
    return "no answer in time" if isinstance(error, TimeoutError) else error.strerror or str(error)
