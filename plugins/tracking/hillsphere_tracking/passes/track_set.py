"""Several satellites over the rotating Earth, each at its own times in one call."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.model.earth.rotation import to_earth_fixed
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.sgp4_near_earth import COMPILED_FROM, propagate_near_earth
from hillsphere_tracking.sgp4_orbit import Sgp4Orbit

__all__ = ["TrackSet"]

_BLOCK = 8192
"""States that are computed at once: their arrays, 50 kB a row of six, stay in the second cache."""


class TrackSet:
    """Tracks of T satellites that share the start and the orientation of the Earth.

    Satellites of SGP4 that are not in deep space are computed together
    (`sgp4_near_earth.propagate_near_earth`) if the tracks have many times, the others one by one.

    Parameters
    ----------
    tracks : sequence of EarthTrack
        The tracks.

    Raises
    ------
    InputError
        If there is no track, or tracks differ in their start or orientation.
    """

    def __init__(self, tracks: Sequence[EarthTrack]) -> None:
        if not tracks:
            raise InputError("a search for passes needs at least one track, got none")
        first = tracks[0]
        for track in tracks:
            if track.start != first.start or track.orientation is not first.orientation:
                raise InputError(
                    f"the tracks of {first.orbit.name!r} and {track.orbit.name!r} must have the "
                    "same start and the same orientation of the Earth"
                )
        self.tracks = tuple(tracks)
        self.start, self.orientation = first.start, first.orientation
        self._offset_s = np.array([self.start.seconds_since(one.orbit.epoch) for one in tracks])
        self._elements = np.full((7, len(tracks)), np.nan)
        if sum(track.times_s.size for track in tracks) >= COMPILED_FROM:
            for k, track in enumerate(tracks):
                if isinstance(track.orbit, Sgp4Orbit):
                    elements = track.orbit.near_earth_elements
                    self._elements[:, k] = np.nan if elements is None else elements
        self._compiled = ~np.isnan(self._elements[0])

    def parts(self, most_times: int) -> Iterator[TrackSet]:
        """Yield sets of consecutive tracks with at most so many times, or one track, in each."""
        begin, times = 0, 0
        for k, track in enumerate(self.tracks):
            if k > begin and times + track.times_s.size > most_times:
                yield self._part(begin, k)
                begin, times = k, 0
            times += track.times_s.size
        yield self._part(begin, len(self.tracks))

    def _part(self, begin: int, end: int) -> TrackSet:
        part, own = copy(self), slice(begin, end)
        part.tracks = self.tracks[own]
        part._offset_s, part._compiled = self._offset_s[own], self._compiled[own]
        part._elements = self._elements[:, own]
        return part

    def states(self, index: Integers, t_s: Array) -> Array:
        """Return Earth-fixed states, each of its own satellite at its own time.

        Parameters
        ----------
        index : ndarray of int, shape (N,)
            Tracks of the states.
        t_s : ndarray, shape (N,)
            Times after the start, between the beginning and the end of the tracks, s.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities relative to the rotating Earth, m/s.

        Raises
        ------
        PropagationError
            If an orbit is not defined at one of the times.
        """
        x = np.empty((6, t_s.size))
        together = self._compiled[index]
        for block in range(0, t_s.size, _BLOCK):
            own = slice(block, block + _BLOCK)
            if together[own].all():
                x[:, own] = self._together(index[own], t_s[own])
            else:
                x[:, own] = self._one_by_one(index[own], t_s[own])
        return x

    def _together(self, index: Integers, t_s: Array) -> Array:
        code, x = propagate_near_earth(self._elements[:, index], t_s + self._offset_s[index])
        if code.any():
            # the orbit's own error names the satellite and the time
            bad = int(np.argmax(code != 0))
            self.tracks[int(index[bad])].states(t_s[bad : bad + 1])
        return to_earth_fixed("teme", x, self.start, t_s, self.orientation)

    def _one_by_one(self, index: Integers, t_s: Array) -> Array:
        x = np.empty((6, t_s.size))
        for track in np.unique(index).tolist():
            own = np.flatnonzero(index == track)
            if self._compiled[track]:
                x[:, own] = self._together(index[own], t_s[own])
            else:
                x[:, own] = self.tracks[track].states(t_s[own])
        return x
