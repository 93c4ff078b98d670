"""Epochs in a named time scale, as two-part Julian dates, which resolve nanoseconds.

The calendar, leap seconds and the change between scales come from ERFA, the library behind the
standards of the International Astronomical Union.

References
----------
.. [1] IERS Conventions (2010), IERS Technical Note 36, chapter 10 (time scales).
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S
from hillsphere.base.errors import InputError

__all__ = ["J2000", "SCALES", "Epoch"]

SCALES = ("TDB", "TT", "TAI", "UTC")
"""Names of the time scales that `Epoch` accepts."""

_ISO = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d{1,12})?))?)?")


@dataclass(frozen=True)
class Epoch:
    """An instant: a two-part Julian date in a time scale.

    Parameters
    ----------
    day : float
        Julian date of the day's beginning, a multiple of one half.
    fraction : float
        Days since then. In UTC a quasi-Julian day: one with a leap second has 86401 s.
    scale : str
        One of `SCALES`.
    """

    day: float
    fraction: float
    scale: str = "TDB"

    @classmethod
    def parse(cls, text: str, scale: str = "TDB") -> Epoch:
        """Read a date and time of the proleptic Gregorian calendar.

        Parameters
        ----------
        text : str
            ``"2027-06-01"``, ``"2027-06-01T12:30"`` or ``"2027-06-01T12:30:00.5"``.
        scale : str
            Time scale of the text.

        Returns
        -------
        Epoch
            The instant.

        Raises
        ------
        InputError
            If the text is no such date or the scale is not known.
        """
        _check_scale(scale)
        match = _ISO.fullmatch(text.strip())
        if match is None:
            raise InputError(f"expected a time such as '2027-06-01T12:30:00', got {text[:40]!r}")
        year, month, day, hour, minute = (int(part or 0) for part in match.groups()[:5])
        second = float(match.group(6) or 0.0)
        try:
            with warnings.catch_warnings():
                # A UTC date beyond the last leap second announced is "dubious", not wrong.
                warnings.simplefilter("ignore", erfa.ErfaWarning)
                whole, part = erfa.dtf2d(scale, year, month, day, hour, minute, second)
        except erfa.ErfaError as error:
            raise InputError(f"{text!r} is no date: {error}") from error
        # ERFA takes 24:00 and 61 s and rolls them over; a user who writes them has slipped.
        epoch = cls(float(whole), float(part), scale)
        slipped = hour > 23 or minute > 59 or second >= 61.0
        if second >= 60.0 and not slipped:
            # only the last minute of a day with a leap second has a second 60
            slipped = ":60." not in epoch.isot(np.zeros(1), 9)[0]
        if slipped:
            raise InputError(f"{text!r} is no time of day")
        return epoch

    def to(self, scale: str) -> Epoch:
        """Return the same instant in another scale.

        TDB − TT is the analytic difference at the geocentre (below 1.7 ms).

        Raises
        ------
        InputError
            If the scale is not known.
        """
        _check_scale(scale)
        if scale == self.scale:
            return self
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            tt = _to_tt(self)
            if scale == "TT":
                pair = tt
            elif scale == "TDB":
                pair = erfa.tttdb(*tt, _tdb_minus_tt(*tt))
            elif scale == "TAI":
                pair = erfa.tttai(*tt)
            else:
                pair = erfa.taiutc(*erfa.tttai(*tt))
        return Epoch(float(pair[0]), float(pair[1]), scale)

    def seconds_since(self, other: Epoch) -> float:
        """Return the time elapsed since another epoch, in SI seconds of this epoch's scale.

        UTC days differ in length, so two epochs in UTC are compared in TAI.
        """
        scale = "TAI" if self.scale == "UTC" else self.scale
        here, there = self.to(scale), other.to(scale)
        return ((here.day - there.day) + (here.fraction - there.fraction)) * DAY_S

    def isot(self, offsets_s: Array, digits: int = 6) -> list[str]:
        """Return the calendar dates of instants after this epoch.

        Parameters
        ----------
        offsets_s : ndarray, shape (K,)
            Seconds after this epoch, in its scale (in UTC: SI seconds).
        digits : int
            Decimals of the second.

        Returns
        -------
        list of str
            ``"2027-06-01T12:30:00.000000"``, rounded.
        """
        days = np.atleast_1d(np.asarray(offsets_s, dtype=float)) / DAY_S
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            if self.scale == "UTC":
                tai = self.to("TAI")
                day, fraction = erfa.taiutc(np.full(days.shape, tai.day), tai.fraction + days)
            else:
                day, fraction = np.full(days.shape, self.day), self.fraction + days
            year, month, date, clock = erfa.d2dtf(self.scale, digits, day, fraction)
        return [
            f"{y:04d}-{m:02d}-{d:02d}T{c['h']:02d}:{c['m']:02d}:{c['s']:02d}"
            + (f".{c['f']:0{digits}d}" if digits else "")
            for y, m, d, c in zip(year, month, date, clock, strict=True)
        ]


def _check_scale(scale: str) -> None:
    if scale not in SCALES:
        raise InputError(f"no time scale {scale!r}; known: {', '.join(SCALES)}")


def _to_tt(epoch: Epoch) -> tuple[float, float]:
    pair = (epoch.day, epoch.fraction)
    if epoch.scale == "UTC":
        pair = erfa.taitt(*erfa.utctai(*pair))
    elif epoch.scale == "TAI":
        pair = erfa.taitt(*pair)
    elif epoch.scale == "TDB":
        pair = erfa.tdbtt(*pair, _tdb_minus_tt(*pair))
    return float(pair[0]), float(pair[1])


def _tdb_minus_tt(day: float, fraction: float) -> float:
    """Return TDB − TT, s, at the geocentre.

    The argument may be in TT or TDB: the two differ by 2 ms, which changes the result by less than
    1e-12 s.
    """
    return float(erfa.dtdb(day, fraction, 0.0, 0.0, 0.0, 0.0))


J2000 = Epoch(2451544.5, 0.5, "TDB")
"""2000 January 1, 12 h TDB."""
