"""What a Tracking Data Message holds: metadata, and one series of numbers for each keyword.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, sections 3.2 to 3.5.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from math import pi
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch

__all__ = ["Series", "TdmHeader", "TdmMeta", "TdmSegment", "angle_series"]

_NOTHING: Mapping[str, str] = MappingProxyType({})
_CORRECTIONS = {
    "ANGLE_1": "CORRECTION_ANGLE_1", "ANGLE_2": "CORRECTION_ANGLE_2", "RANGE": "CORRECTION_RANGE",
    "DOPPLER_INSTANTANEOUS": "CORRECTION_DOPPLER", "DOPPLER_INTEGRATED": "CORRECTION_DOPPLER",
    "MAG": "CORRECTION_MAG", "RCS": "CORRECTION_RCS", "RECEIVE_FREQ": "CORRECTION_RECEIVE",
    "TRANSMIT_FREQ": "CORRECTION_TRANSMIT",
}  # fmt: skip
"""Keywords of the data, without the number of a participant, and of their corrections."""
_NUMBER = re.compile(r"(?<=FREQ)_[1-5]")
_SAME_S = 1e-9
"""Two angles whose times differ by no more belong together, s: messages give microseconds, and a
difference of two Julian dates is exact to about 1e-11 s."""


class Series(NamedTuple):
    """Values (K,) of one keyword, SI, at times (K,), s after the epoch of the segment."""

    t_s: Array
    values: Array


@dataclass(frozen=True)
class TdmHeader:
    """Header of a message.

    Parameters
    ----------
    version : str
        ``"1.0"`` or ``"2.0"``.
    creation_date : str
        When the message was made, UTC, as it stands there; empty if it is not given.
    originator : str
        Who made it; empty if it is not given.
    message_id : str
        Its identifier; may be empty.
    comments : tuple of str
        Comments of the header, one a line.
    """

    version: str = "2.0"
    creation_date: str = ""
    originator: str = ""
    message_id: str = ""
    comments: tuple[str, ...] = ()


@dataclass(frozen=True)
class TdmMeta:
    """Metadata of a segment. What a message does not state is empty, None or 0 here.

    Parameters
    ----------
    participants : tuple of str
        Stations and spacecraft, in the order of their numbers 1, 2, …, at most 5.
    path : tuple of int
        Numbers of the participants along the path of the signal, from the transmitter to the
        receiver, of a sequential measurement.
    time_system : str
        Time scale of the data: one of `hillsphere.time.SCALES`.
    fields : mapping of str to str
        All keywords of the metadata with their text.
    path_1, path_2 : tuple of int
        The two paths of a differenced measurement, which is the value along `path_2` minus that
        along `path_1`.
    mode : str
        ``"SEQUENTIAL"``, ``"SINGLE_DIFF"`` (differenced) or ``""``.
    timetag_ref : str
        Whether times are those of ``"RECEIVE"`` or ``"TRANSMIT"``; ``""`` for what is usual:
        reception, for `TRANSMIT_FREQ` and such transmission.
    integration_interval_s : float, optional
        Time over which a Doppler measurement or a normal point was averaged.
    integration_ref : str
        Whether a time is the ``"START"``, ``"MIDDLE"`` or ``"END"`` of that interval, or ``""``.
    freq_offset_hz : float
        To be added to every received frequency to obtain that of the signal.
    range_mode : str
        ``"COHERENT"``, ``"CONSTANT"``, ``"ONE_WAY"`` or ``""``.
    range_modulus : float
        The range is the measured one plus an unknown whole multiple of this, in the unit of the
        series `RANGE` (m if `range_units` is ``"km"``); 0 if it is unambiguous.
    range_units : str
        Unit of ranges in the message: ``"km"`` (m in the series), ``"s"`` or ``"RU"`` (range units,
        which only an agreement between the parties defines).
    angle_type : str
        ``"AZEL"`` (azimuth from north eastwards, elevation), ``"RADEC"`` (right ascension,
        declination), ``"XEYN"`` (X east, Y north), ``"XSYE"`` (X south, Y east) or ``""``.
    reference_frame : str
        Frame of ``"RADEC"``.
    turnaround : tuple of int, optional
        Numerator and denominator of the ratio of the frequencies down and up of a coherent
        transponder.
    transmit_delays_s, receive_delays_s : mapping of int to float
        Fixed delay of the equipment of a participant, by its number.
    corrections : mapping of str to float
        Keywords such as ``"CORRECTION_RANGE"``; values in the unit of the series that they correct,
        aberrations in rad.
    corrections_applied : bool, optional
        Whether the data contain the corrections already.
    data_quality : str
        ``"RAW"``, ``"VALIDATED"``, ``"DEGRADED"`` or ``""``, which means raw.
    ephemeris_names : mapping of int to str
        Name of the ephemeris with which a participant was tracked, by its number.
    interpolation : str
        Method for phase counts between the given ones: ``"HERMITE"``, ``"LAGRANGE"``, ``"LINEAR"``
        or ``""``.
    interpolation_degree : int, optional
        Its degree.
    data_types : tuple of str
        Keywords that the message announces.
    start, stop : Epoch, optional
        Span of the data that the message announces, in UTC.
    track_id, transmit_band, receive_band : str
        Identifier of the track, and bands as the parties name them.
    doppler_count_bias_hz : float
        To be subtracted from the rate of Doppler counts.
    doppler_count_scale : int
        By which Doppler counts are to be divided.
    doppler_count_rollover : bool, optional
        Whether the counter has overflown during the track.
    comments : tuple of str
        Comments of the metadata, one a line.
    """

    participants: tuple[str, ...]
    path: tuple[int, ...] = ()
    time_system: str = "UTC"
    fields: Mapping[str, str] = field(default_factory=lambda: _NOTHING)
    path_1: tuple[int, ...] = ()
    path_2: tuple[int, ...] = ()
    mode: str = ""
    timetag_ref: str = ""
    integration_interval_s: float | None = None
    integration_ref: str = ""
    freq_offset_hz: float = 0.0
    range_mode: str = ""
    range_modulus: float = 0.0
    range_units: str = "km"
    angle_type: str = ""
    reference_frame: str = ""
    turnaround: tuple[int, int] | None = None
    transmit_delays_s: Mapping[int, float] = field(default_factory=dict)
    receive_delays_s: Mapping[int, float] = field(default_factory=dict)
    corrections: Mapping[str, float] = field(default_factory=dict)
    corrections_applied: bool | None = None
    data_quality: str = ""
    ephemeris_names: Mapping[int, str] = field(default_factory=dict)
    interpolation: str = ""
    interpolation_degree: int | None = None
    data_types: tuple[str, ...] = ()
    start: Epoch | None = None
    stop: Epoch | None = None
    track_id: str = ""
    transmit_band: str = ""
    receive_band: str = ""
    doppler_count_bias_hz: float = 0.0
    doppler_count_scale: int = 1
    doppler_count_rollover: bool | None = None
    comments: tuple[str, ...] = ()

    @property
    def station(self) -> str:
        """The receiving participant, which measures the angles; the first one without a path."""
        path = self.path or self.path_1
        return self.participants[path[-1] - 1 if path else 0]

    def correction_of(self, keyword: str) -> float:
        """Return what must be added to a series to correct it, in its unit.

        It is 0 if there is no such correction or the data contain it already.

        Raises
        ------
        InputError
            If an angle lacks a correction of aberration: one number does not say by how much
            either angle changes.
        """
        if self.corrections_applied is not False:
            return 0.0
        if keyword in ("ANGLE_1", "ANGLE_2"):
            for key in ("CORRECTION_ABERRATION_YEARLY", "CORRECTION_ABERRATION_DIURNAL"):
                if self.corrections.get(key, 0.0) != 0.0:
                    raise InputError(
                        f"{key} has not been applied to the angles, and one number does not say "
                        "how it changes each of them; expected CORRECTIONS_APPLIED = YES"
                    )
        return self.corrections.get(_CORRECTIONS.get(_NUMBER.sub("", keyword), ""), 0.0)


@dataclass(frozen=True)
class TdmSegment:
    """One segment of a message: tracking data with common metadata.

    Parameters
    ----------
    meta : TdmMeta
        What the data are. Differenced and degraded data are here as well: a user of the data looks
        at `TdmMeta.mode` and `TdmMeta.data_quality`.
    epoch : Epoch
        Origin of the times: the earliest record.
    series : mapping of str to Series
        By keyword of the standard, as the message states them (`corrected` adds what
        is missing), in SI units: angles ``"ANGLE_1"`` and ``"ANGLE_2"`` in rad; ``"RANGE"`` in m,
        or in s or range units if `TdmMeta.range_units` says so; range rates
        ``"DOPPLER_INSTANTANEOUS"`` and ``"DOPPLER_INTEGRATED"`` in m/s; frequencies
        ``"RECEIVE_FREQ"``, ``"RECEIVE_FREQ_1"``, ``"TRANSMIT_FREQ_1"``, … in Hz, their rates
        ``"TRANSMIT_FREQ_RATE_1"``, … in Hz/s; all units are in `hillsphere.formats.tdm.UNITS`.
    comments : tuple of str
        Comments of the data, one a line.
    counts : mapping of str to ndarray of bytes, shape (K,)
        The digits of Doppler and phase counts as they stand in the message: these have more than a
        double holds. `exact_counts` gives them as two doubles.
    header : TdmHeader
        Of the message; shared by its segments.
    time_digits : int
        Decimals of the seconds in which times are written, up to 9.
    """

    meta: TdmMeta
    epoch: Epoch
    series: Mapping[str, Series]
    comments: tuple[str, ...] = ()
    counts: Mapping[str, NDArray[np.bytes_]] = field(default_factory=dict)
    header: TdmHeader = TdmHeader()
    time_digits: int = 6

    def corrected(self, keyword: str) -> Series:
        """Return a series with the corrections of the metadata that it does not contain yet.

        Raises
        ------
        InputError
            As for `TdmMeta.correction_of`.
        """
        t_s, values = self.series[keyword]
        return Series(t_s, values + self.meta.correction_of(keyword))

    def angle_pairs(self) -> tuple[Array, Array, Array]:
        """Return times (K,), s, and the first and second angles (K,), rad, corrected.

        An elevation beyond 90°, of a mount that has gone over the top, which only lenient reading
        accepts, is turned into that of the direction, with the opposite azimuth.

        Returns
        -------
        tuple of ndarray
            In order of time; empty without angles. `TdmMeta.angle_type` says what they are.

        Raises
        ------
        InputError
            If an angle lacks the other one of the same time.
        """
        if not {"ANGLE_1", "ANGLE_2"} & self.series.keys():
            return np.empty(0), np.empty(0), np.empty(0)
        for keyword, other in (("ANGLE_1", "ANGLE_2"), ("ANGLE_2", "ANGLE_1")):
            if keyword not in self.series:
                raise InputError(f"the segment has {other} without {keyword}; both are needed")
        first, second = self.corrected("ANGLE_1"), self.corrected("ANGLE_2")
        if first.t_s.shape != second.t_s.shape or np.any(np.abs(first.t_s - second.t_s) > _SAME_S):
            raise InputError(
                "some ANGLE_1 has no ANGLE_2 of the same time, or the reverse; both are needed"
            )
        if self.meta.angle_type != "AZEL":
            return first.t_s, first.values, second.values
        over = self.series["ANGLE_2"].values > 0.5 * pi
        azimuth = np.where(over, np.remainder(first.values + pi, 2.0 * pi), first.values)
        return first.t_s, azimuth, np.where(over, pi - second.values, second.values)

    @property
    def t_s(self) -> Array:
        """Times (K,) of the pairs of angles, s; see `angle_pairs`."""
        return self.angle_pairs()[0]

    @property
    def azimuth_rad(self) -> Array:
        """Azimuths (K,) from north eastwards, corrected; see `angle_pairs`."""
        return self._horizontal()[0]

    @property
    def elevation_rad(self) -> Array:
        """Elevations (K,), corrected; see `angle_pairs`."""
        return self._horizontal()[1]

    def _horizontal(self) -> tuple[Array, Array]:
        _, first, second = self.angle_pairs()
        if first.size and self.meta.angle_type != "AZEL":
            raise InputError(
                f"the angles are no azimuth and elevation: ANGLE_TYPE = "
                f"{self.meta.angle_type or '(missing)'}"
            )
        return first, second

    def exact_counts(self, keyword: str) -> tuple[Array, Array]:
        """Return the two parts (K,) of counts, whose sum has about 32 digits.

        Parameters
        ----------
        keyword : str
            ``"RECEIVE_PHASE_CT_1"`` or another keyword of `counts`.

        Returns
        -------
        tuple of ndarray
            The nearest doubles, as in `series`, and what is left. Differences are to be taken of
            each part before they are added.
        """
        high = self.series[keyword].values
        low = [
            float(Decimal(text.decode()) - Decimal(value))
            for text, value in zip(self.counts[keyword].tolist(), high.tolist(), strict=True)
        ]
        return high, np.array(low)


def angle_series(t_s: Array, first_rad: Array, second_rad: Array) -> dict[str, Series]:
    """Return the two series of angles, all of shape (K,), at common times.

    Raises
    ------
    InputError
        If the shapes differ.
    """
    if not t_s.shape == first_rad.shape == second_rad.shape:
        raise InputError(
            f"times and both angles must have the same shape, got {t_s.shape}, "
            f"{first_rad.shape} and {second_rad.shape}"
        )
    return {"ANGLE_1": Series(t_s, first_rad), "ANGLE_2": Series(t_s, second_rad)}
