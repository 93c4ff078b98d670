"""Orbits of Earth satellites from ephemerides: CCSDS OEM, or SPK kernels of SPICE."""

from __future__ import annotations

import copy
import re
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.errors import InputError, PropagationError
from hillsphere.formats.ephemeris_files import eme2000_to_icrf
from hillsphere.formats.oem import OemSegment, read_oem
from hillsphere.formats.oem_interpolation import OemInterpolant, interpolant_of
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import InertialFrame, to_inertial
from hillsphere.time import Epoch

__all__ = ["EphemerisOrbit", "ephemeris_orbits_of", "orbits_of_segments"]

_SAME_S = 1e-6
"""Spans of segments that are nearer than this, s, follow each other without a gap: messages state
times in microseconds at least."""
_END_S = 1e-6
"""Time (s) by which the span is exceeded at its ends: differences of epochs are rounded."""
_REALISATIONS = re.compile(r"(ITRF)(-?\d{2,4})?|(ICRF|GCRF)\d?|EME2000|J2000|TEME|TEMEOFDATE")
_FASTEST_M_S = 1e5
"""Speed about the Earth above which the numbers have other units: bodies of the solar system pass
it at 73 km/s at most, and 0.1 km/s in m/s are read as 100 km/s."""
_KNOWN = "EME2000, ICRF, GCRF, ITRF or TEME"


class EphemerisOrbit:
    """Orbit from consecutive segments of an ephemeris, interpolated as the message recommends.

    States are never interpolated across the limit of two segments, where a manoeuvre may lie, and
    there are none outside the useable spans. States in EME2000 are turned by the frame bias to the
    axes of the GCRS [1]_; ICRF about the Earth is the GCRF; states in the ITRF (its realisations
    differ by centimetres) are turned by the Earth's orientation at their times.

    Parameters
    ----------
    name : str
        Name of the satellite.
    segments : sequence of OemSegment
        In order of time, about the Earth, in one frame, each beginning where the one before ends.
    orientation : EarthOrientation
        UT1 and polar motion, for states in the ITRF; by default UT1 = UTC without polar motion.

    Attributes
    ----------
    epoch : Epoch
        First instant with a state, UTC.
    last_s : float
        Time from there to the last one.
    warnings : tuple of str
        How the states are interpolated, and what the reader of the message noticed.

    Raises
    ------
    InputError
        If centre, frame or interpolation cannot be used, or the speeds are those of other units.

    References
    ----------
    .. [1] IERS Conventions (2010), IERS Technical Note 36, section 5.3.2 (frame bias).
    """

    def __init__(
        self,
        name: str,
        segments: Sequence[OemSegment],
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> None:
        self.name = name
        self._orientation = orientation
        first = segments[0]
        fastest = max(float(np.linalg.norm(one.x[3:6], axis=0).max()) for one in segments)
        if fastest > _FASTEST_M_S:
            raise InputError(
                f"satellite {name!r}: the ephemeris has speeds of {fastest / 1e3:.6g} km/s about "
                "the Earth, which nothing has; the standard's units are km and km/s: are these "
                "states in m and m/s?"
            )
        self.catalogue_number = first.object_id
        self._axes = _axes_of(first)
        self.frame: InertialFrame = "teme" if self._axes == "TEME" else "gcrs"
        self._interpolants = tuple(map(interpolant_of, segments))
        begin, _ = self._interpolants[0].span_s
        self.epoch = first.epoch.after(begin).to("UTC")
        self._own = np.array([one.span_s for one in self._interpolants])
        # The segment's seconds may be those of TDB, whose length differs from the SI second's by
        # parts in 1e10: the ends of each span are converted, and times between them linearly.
        self._spans = np.array(
            [
                [one.segment.epoch.after(t).to("UTC").seconds_since(self.epoch)
                 for t in one.span_s]
                for one in self._interpolants
            ]
        )  # fmt: skip
        self.last_s = float(self._spans[-1, 1])
        methods = dict.fromkeys(map(str, self._interpolants))
        noticed = dict.fromkeys(told for one in segments for told in one.warnings)
        self.warnings = (
            f"{name}: {' and '.join(methods)} of the states of its ephemeris.", *noticed
        )  # fmt: skip

    def turned_by(self, orientation: EarthOrientation) -> EphemerisOrbit:
        """Return the orbit with another orientation of the Earth, for states in the ITRF."""
        other = copy.copy(self)
        other._orientation = orientation
        return other

    def states(self, t_s: Array) -> Array:
        """Return states at times after the epoch.

        Parameters
        ----------
        t_s : ndarray, shape (N,)
            SI seconds after the epoch, in any order.

        Returns
        -------
        ndarray, shape (6, N)
            Positions, m, and velocities, m/s, in the orbit's frame.

        Raises
        ------
        PropagationError
            If a time lies outside the useable spans.
        """
        t = np.atleast_1d(np.asarray(t_s, dtype=float))
        there = self.exists(t)
        if not there.all():
            outside = float(t[np.argmin(there)])
            raise PropagationError(
                f"satellite {self.name!r} {self.end_reason(outside)}; ask for times within"
            )
        x = np.empty((6, t.size))
        # at the common end of two segments the later one holds
        place = np.clip(np.searchsorted(self._spans[:, 0], t, side="right") - 1, 0, None)
        for k in np.unique(place):
            here = place == k
            x[:, here] = self._interpolants[k](np.interp(t[here], self._spans[k], self._own[k]))
        if self._axes == "EME2000":
            x = eme2000_to_icrf(x)
        elif self._axes == "ITRF":
            x = to_inertial("gcrs", x, self.epoch, t, self._orientation)
        return x

    def exists(self, t_s: Array) -> NDArray[np.bool_]:
        """Return whether each of the times (N,), s after the epoch, lies within the spans."""
        t = np.asarray(t_s, dtype=float)
        return np.asarray((t >= -_END_S) & (t <= self.last_s + _END_S))

    def end_reason(self, t_s: float) -> str:
        """Return why there is no state at a time, as the end of a sentence."""
        return f"has no state at {t_s:.6g} s: its ephemeris covers {self.covered()}"

    def covered(self) -> str:
        """Return the span in words."""
        return " to ".join(self.epoch.isot(np.array([0.0, self.last_s]), 0)) + " UTC"


def ephemeris_orbits_of(
    text: str,
    where: str,
    *,
    lenient: bool = False,
    orientation: EarthOrientation = UT1_IS_UTC,
) -> tuple[EphemerisOrbit, ...]:
    """Read orbits from an Orbit Ephemeris Message.

    Parameters
    ----------
    text : str
        The message, as text or XML.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether harmless departures from the standard become warnings of the orbits.
    orientation : EarthOrientation
        For states in the ITRF.

    Returns
    -------
    tuple of EphemerisOrbit
        In the order of the text: one for each object, or, where an object's useable spans leave
        gaps, one for each part without a gap, numbered from the second on.

    Raises
    ------
    InputError
        If the text departs from the standard, or see `orbits_of_segments`.
    """
    return orbits_of_segments(read_oem(text, where, lenient=lenient), where, orientation)


def orbits_of_segments(
    segments: Sequence[OemSegment], where: str, orientation: EarthOrientation = UT1_IS_UTC
) -> tuple[EphemerisOrbit, ...]:
    """Return the orbits of the segments of a file; as `ephemeris_orbits_of`.

    Raises
    ------
    InputError
        If a segment is not about the Earth, is in a frame that is not converted, or overlaps the
        one before.
    """
    parts: dict[str, list[list[OemSegment]]] = {}
    for number, segment in enumerate(segments, start=1):
        place = f"{where}: segment {number} ({segment.object_name})"
        try:
            _axes_of(segment)
            interpolant_of(segment)
        except InputError as error:
            raise InputError(f"{place}: {error}") from error
        of_object = parts.setdefault(segment.object_name, [])
        if not of_object:
            of_object.append([segment])
            continue
        before = of_object[-1][-1]
        gap = _begin(segment).seconds_since(_end(before))
        if gap < -_SAME_S:
            raise InputError(
                f"{place}: USEABLE_START_TIME: expected a span that begins where that of the "
                f"object's segment before ends or later, got {-gap:.6g} s earlier"
            )
        joined = gap <= _SAME_S and segment.ref_frame == before.ref_frame
        (of_object[-1] if joined else _new(of_object)).append(segment)
    orbits = []
    for name, pieces in parts.items():
        for k, piece in enumerate(pieces, start=1):
            orbit = EphemerisOrbit(name if k == 1 else f"{name} #{k}", piece, orientation)
            orbits.append(orbit)
        for one, other in pairwise(orbits[-len(pieces) :]):
            other.warnings = (
                f"{name}: its ephemeris has no states between {one.covered()[23:]} and "
                f"{other.covered()[:19]} UTC; passes then are not found.", *other.warnings,
            )  # fmt: skip
    return tuple(orbits)


def _new(of_object: list[list[OemSegment]]) -> list[OemSegment]:
    of_object.append([])
    return of_object[-1]


def _axes_of(segment: OemSegment) -> str:
    """Return EME2000, GCRF, ITRF or TEME; refuse other frames and centres by name."""
    if segment.center_name.upper() != "EARTH":
        raise InputError(
            f"CENTER_NAME: expected EARTH, about which passes are found, got {segment.center_name}"
        )
    frame = segment.ref_frame.upper()
    if not _REALISATIONS.fullmatch(frame):
        raise InputError(f"REF_FRAME: expected {_KNOWN}, got {segment.ref_frame}")
    if frame.startswith("TEME"):
        if segment.ref_frame_epoch is not None:
            raise InputError(
                "REF_FRAME_EPOCH: expected TEME of date, without an epoch, got one; convert the "
                "states to GCRF"
            )
        return "TEME"
    if frame.startswith("ITRF"):
        return "ITRF"
    return "EME2000" if frame in ("EME2000", "J2000") else "GCRF"


def _begin(segment: OemSegment) -> Epoch:
    return segment.epoch.after(_span(segment)[0])


def _end(segment: OemSegment) -> Epoch:
    return segment.epoch.after(_span(segment)[1])


def _span(segment: OemSegment) -> tuple[float, float]:
    return OemInterpolant(segment, "HERMITE", 1, False).span_s
