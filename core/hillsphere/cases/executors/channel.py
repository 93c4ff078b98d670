"""Messages between the run and a worker, on a pair of sockets."""

from __future__ import annotations

import pickle
import socket
import struct
from typing import Any

__all__ = ["Channel"]

_LENGTH = struct.Struct("!Q")
_AT_ONCE = 1 << 20
"""Bytes asked of the socket in one call. It bounds the buffer that each call allocates; longer
messages take several calls."""


class Channel:
    """One end of a connection, which carries messages: bytes after their length.

    Connections of `multiprocessing` wait for the rest of a message once its begin is there. A
    worker that was killed while it sent never sends the rest, and the connection does not close
    either if a process that it started holds it open: the run would wait for ever.

    Parameters
    ----------
    end : socket.socket
        Connected; it belongs to the channel.
    """

    def __init__(self, end: socket.socket) -> None:
        self._socket = end
        self._buffer = bytearray()

    def fileno(self) -> int:
        """Return the descriptor, by which `multiprocessing.connection.wait` waits for it."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def send(self, message: Any) -> None:
        """Send an object, pickled; `OSError` if the other end is gone."""
        self.send_bytes(pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL))

    def send_bytes(self, data: bytes) -> None:
        """Send bytes as they are; `OSError` if the other end is gone."""
        self._socket.sendall(_LENGTH.pack(len(data)))
        self._socket.sendall(data)

    def receive(self) -> bytes:
        """Wait for a message; `EOFError` if the other end closes before it is complete."""
        while (message := self._complete()) is None:
            self._read(0)
        return message

    def arrived(self) -> bytes | None:
        """Return a message if a complete one has arrived, without waiting for it.

        Returns
        -------
        bytes or None
            The message; ``None`` if there is not all of one.

        Raises
        ------
        EOFError
            If the other end is closed and no complete message is left.
        """
        while (message := self._complete()) is None:
            try:
                self._read(socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
        return message

    def _read(self, flags: int) -> None:
        try:
            data = self._socket.recv(_AT_ONCE, flags)
        except ConnectionError as error:
            raise EOFError from error
        if not data:
            raise EOFError
        self._buffer += data

    def _complete(self) -> bytes | None:
        """Take a complete message from what was read."""
        if len(self._buffer) < _LENGTH.size:
            return None
        end = _LENGTH.size + _LENGTH.unpack_from(self._buffer)[0]
        if len(self._buffer) < end:
            return None
        message = bytes(self._buffer[_LENGTH.size : end])
        del self._buffer[:end]
        return message
