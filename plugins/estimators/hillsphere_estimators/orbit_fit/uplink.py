"""Frequencies that a transmitter sent: steps and ramps over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = ["Transmission", "join_transmissions", "split_ramps"]

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


def split_ramps(
    t_s: Array, values: Array, rates: tuple[Array, Array] | None, offset: float
) -> tuple[Array, Array, Array]:
    """Return times, frequencies and rates of the pieces of a transmitted frequency.

    A rate holds from its time to that of the next rate. Where frequency or rate begins alone, the
    other goes on.

    Parameters
    ----------
    t_s, values : ndarray, shape (K,)
        Times and frequencies, s and Hz.
    rates : tuple of ndarray or None
        Times (L,) and rates (L,), s and Hz/s.
    offset : float
        Added to the times, s.

    Returns
    -------
    t_s, frequency_hz, rate_hz_s : ndarray, shape (P,)
        As `Transmission` takes them.
    """
    if rates is None:
        return t_s + offset, values, np.zeros(len(t_s))
    times = np.unique(np.concatenate([t_s, rates[0]]))
    times = times[times >= t_s[0]]
    slope = np.zeros(len(times))
    place = np.searchsorted(rates[0], times, side="right") - 1
    slope[place >= 0] = rates[1][place[place >= 0]]
    frequency = np.empty(len(times))
    for k, t in enumerate(times):
        own = np.searchsorted(t_s, t, side="right") - 1
        given = own >= 0 and t_s[own] == t
        frequency[k] = (
            values[own] if given else frequency[k - 1] + slope[k - 1] * (t - times[k - 1])
        )
    return times + offset, frequency, slope


def join_transmissions(
    sent: Mapping[str, list[tuple[Array, Array, Array]]],
) -> dict[str, Transmission]:
    """Return the transmitted frequencies of each participant, in order of time.

    Parameters
    ----------
    sent : mapping of str to list
        Name of the participant → pieces of `split_ramps`.

    Raises
    ------
    InputError
        If two pieces say different things about the same time.
    """
    made = {}
    for name, parts in sent.items():
        t, values, rates = (np.concatenate([part[k] for part in parts]) for k in range(3))
        order = np.argsort(t, kind="stable")
        t, values, rates = t[order], values[order], rates[order]
        new = np.concatenate([[True], np.diff(t) > 0.0])
        again = np.flatnonzero(~new)
        if (values[again] != values[again - 1]).any():
            raise InputError(
                f"data: {name} sends two different TRANSMIT_FREQ at the same time; leave one out"
            )
        made[name] = Transmission(t[new], values[new], rates[new])
    return made
