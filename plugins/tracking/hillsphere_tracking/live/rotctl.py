"""Client of rotctld, the network daemon of Hamlib that drives antenna rotators.

A command is one line, an answer one or more lines. The answer to ``P 120.00 35.00`` is ``RPRT 0``;
the answer to ``p`` is azimuth and elevation in degrees, one per line. Errors are answered by
``RPRT`` and a negative number.
"""

from __future__ import annotations

import socket
from math import isfinite
from types import TracebackType
from typing import NoReturn, Self

from hillsphere.errors import HillsphereError

__all__ = ["PORT", "RotatorError", "RotatorLostError", "RotatorRefusedError", "Rotctl"]

PORT = 4533
"""Default port of rotctld."""

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
"""Bytes of an answer at most: answers of rotctld are below 40, and another service on the port must
not fill the memory."""


class RotatorError(HillsphereError):
    """Error of a rotator or of the connection to it."""


class RotatorLostError(RotatorError):
    """The connection failed, or an answer could not be interpreted."""


class RotatorRefusedError(RotatorError):
    """The rotator refused a command.

    Parameters
    ----------
    command : str
        The command.
    code : int
        Error code of Hamlib, negative.
    """

    def __init__(self, command: str, code: int) -> None:
        super().__init__(
            f"the rotator refused {command!r}: RPRT {code}, {_CODES.get(code, 'unknown code')}"
        )
        self.code = code


class Rotctl:
    """One connection to rotctld.

    After a `RotatorLostError` the connection is closed, and a new one must be opened: a late answer
    would be mistaken for the answer to the next command.

    Parameters
    ----------
    host : str
        Name or address of the machine on which rotctld runs.
    port : int
        Port of rotctld.
    timeout_s : float
        Longest wait for the connection and for each answer.

    Raises
    ------
    RotatorLostError
        If the connection fails.
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
        """Command a position; the method does not wait until the rotator is there.

        Raises
        ------
        RotatorRefusedError
            If the rotator refuses the command.
        RotatorLostError
            If the connection is lost.
        """
        self._report(f"P {azimuth_deg:.4f} {elevation_deg:.4f}")

    def position(self) -> tuple[float, float]:
        """Return azimuth and elevation of the rotator, degrees; raises as `set_position`."""
        first = self._ask("p")
        second = self._line()
        try:
            angles = float(first), float(second)
        except ValueError:
            angles = float("nan"), 0.0
        if not all(isfinite(angle) for angle in angles):
            self._lose(f"was given up: it answered 'p' with {first[:40]!r} and {second[:40]!r}")
        return angles

    def stop(self) -> None:
        """Stop the rotator; raises as `set_position`."""
        self._report("S")

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def __enter__(self) -> Self:
        """Return the connection itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the connection."""
        self.close()

    def _report(self, command: str) -> None:
        line = self._ask(command)
        if line != "RPRT 0":  # any other report was raised
            self._lose(f"was given up: it answered {command!r} with {line[:40]!r}")

    def _ask(self, command: str) -> str:
        """Send a command and return the first line of the answer; raise if it reports an error."""
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
