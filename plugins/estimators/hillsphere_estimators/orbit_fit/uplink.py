"""Frequencies that a transmitter sent: steps and ramps over time."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = ["Transmission"]

_EARLY_S = 1.0
"""Time before the first frequency for which it is taken: steps of differences, and the rounding of
times to seconds."""


class Transmission:
    """A frequency that is linear between given times.

    Parameters
    ----------
    t_s : ndarray, shape (K,)
        Times at which a piece begins, rising.
    frequency_hz : ndarray, shape (K,)
        Frequencies there.
    rate_hz_s : ndarray, shape (K,)
        Rates from there to the next time; after the last one without end.

    Raises
    ------
    InputError
        If there is no time, or they do not rise.
    """

    def __init__(self, t_s: Array, frequency_hz: Array, rate_hz_s: Array) -> None:
        if not len(t_s) or not (np.diff(t_s) > 0.0).all():
            raise InputError("transmit frequencies need times that rise, one at least")
        self.t_s = np.asarray(t_s, dtype=float)
        self.reference_hz = float(frequency_hz[0])
        """The first frequency, from which the others are counted."""
        self._off = np.asarray(frequency_hz, dtype=float) - self.reference_hz
        self._rate = np.asarray(rate_hz_s, dtype=float)
        steps = np.diff(self.t_s)
        pieces = self._off[:-1] * steps + 0.5 * self._rate[:-1] * steps**2
        self._cycles = np.concatenate([[0.0], np.cumsum(pieces)])

    def offset(self, t_s: Array) -> Array:
        """Return the frequency (N,) less `reference_hz` at times (N,), Hz."""
        piece = self._piece(t_s)
        return np.asarray(self._off[piece] + self._rate[piece] * (t_s - self.t_s[piece]))

    def mean_offset(self, begin_s: Array, end_s: Array) -> Array:
        """Return the mean (N,) over intervals of the frequency less `reference_hz`, Hz.

        Within one piece it is the frequency in the middle, which loses no digits.
        """
        one, other = self._piece(begin_s), self._piece(end_s)
        middle = self.offset(0.5 * (begin_s + end_s))
        across = (self._phase(end_s, other) - self._phase(begin_s, one)) / (end_s - begin_s)
        return np.asarray(np.where(one == other, middle, across))

    def check(self, t_s: Array) -> None:
        """Raise `InputError` if a time is before the first frequency.

        A constant frequency holds before as well, as does a single one.
        """
        if len(self.t_s) == 1 and self._rate[0] == 0.0:
            return
        early = self.t_s[0] - float(np.min(t_s))
        if early > _EARLY_S:
            raise InputError(
                f"a signal was sent {early:.3g} s before the first TRANSMIT_FREQ; give the "
                "frequencies from one light time before the first reception on"
            )

    def _piece(self, t_s: Array) -> np.ndarray[tuple[int, ...], np.dtype[np.intp]]:
        return np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, len(self.t_s) - 1)

    def _phase(self, t_s: Array, piece: np.ndarray[tuple[int, ...], np.dtype[np.intp]]) -> Array:
        since = t_s - self.t_s[piece]
        grown = self._off[piece] * since + 0.5 * self._rate[piece] * since**2
        return np.asarray(self._cycles[piece] + grown)
