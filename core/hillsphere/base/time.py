"""Epochs in a named time scale, as two-part Julian dates, which resolve nanoseconds.

The calendar, leap seconds and the change between scales come from ERFA, the library behind the
standards of the International Astronomical Union.

References
----------
.. [1] IERS Conventions (2010), IERS Technical Note 36, chapters 5 (UT1) and 10 (time scales).
.. [2] IS-GPS-200, Navstar GPS Space Segment/Navigation User Segment Interfaces, section 3.3.4 (GPS
   time, without leap seconds since 6 January 1980, when TAI − UTC was 19 s).
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass
from importlib import import_module

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, MODIFIED_JD
from hillsphere.base.errors import InputError

__all__ = ["J2000", "SCALES", "Epoch"]

SCALES = ("TDB", "TT", "TAI", "UTC", "GPS", "UT1", "TCB", "TCG")
"""Names of the time scales that `Epoch` accepts. UT1 needs the installed table of the Earth's
orientation, and is refused outside it."""
_TAI_MINUS_GPS = 19.0 / DAY_S
"""In days; constant by definition [2]_."""
_UNEVEN = ("UTC", "UT1")
"""Scales whose seconds are not those of a uniform time: intervals are counted in TAI."""

_ISO = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)(?:[T ](\d\d):(\d\d)(?::(\d\d(?:\.\d{1,12})?))?)?", re.ASCII
)


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

        TDB − TT is the analytic difference at the geocentre (below 1.7 ms). UT1 is interpolated in
        the installed table of the Earth's orientation.

        Raises
        ------
        InputError
            If the scale is not known, or UT1 is asked for outside the table.
        """
        _check_scale(scale)
        if scale == self.scale:
            return self
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            pair = _from_tt(_to_tt(self), scale)
        return Epoch(float(pair[0]), float(pair[1]), scale)

    def seconds_since(self, other: Epoch) -> float:
        """Return the time elapsed since another epoch, in SI seconds of this epoch's scale.

        Days of UTC and UT1 differ in length, so two epochs in them are compared in TAI.
        """
        scale = "TAI" if self.scale in _UNEVEN else self.scale
        here, there = self.to(scale), other.to(scale)
        return ((here.day - there.day) + (here.fraction - there.fraction)) * DAY_S

    def after(self, t_s: float) -> Epoch:
        """Return the instant some seconds after this one, in its scale; of UTC and UT1, in TAI."""
        uniform = self.to("TAI") if self.scale in _UNEVEN else self
        return Epoch(uniform.day, uniform.fraction + t_s / DAY_S, uniform.scale)

    def isot(self, offsets_s: Array, digits: int = 6) -> list[str]:
        """Return the calendar dates of instants after this epoch.

        Parameters
        ----------
        offsets_s : ndarray, shape (K,)
            Seconds after this epoch, in its scale (in UTC and UT1: SI seconds).
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
            if self.scale in _UNEVEN:
                tai = self.to("TAI")
                pair = np.full(days.shape, tai.day), tai.fraction + days
                day, fraction = (
                    erfa.taiutc(*pair)
                    if self.scale == "UTC"
                    else erfa.taiut1(*pair, _ut1_minus_tai(tai, days * DAY_S))
                )
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
    elif epoch.scale == "TCB":
        pair = erfa.tcbtdb(*pair)
        pair = erfa.tdbtt(*pair, _tdb_minus_tt(*pair))
    elif epoch.scale == "TCG":
        pair = erfa.tcgtt(*pair)
    elif epoch.scale == "GPS":
        pair = erfa.taitt(pair[0], pair[1] + _TAI_MINUS_GPS)
    elif epoch.scale == "UT1":
        # The difference is a function of TAI and changes by 1 ms a day, so that the second guess,
        # which is a minute off at most, leaves 1 µs, and the third 1e-14 s.
        tai = pair
        for _ in range(3):
            (difference,) = _ut1_minus_tai(Epoch(float(tai[0]), float(tai[1]), "TAI"), np.zeros(1))
            tai = erfa.ut1tai(*pair, difference)
        pair = erfa.taitt(*tai)
    return float(pair[0]), float(pair[1])


def _from_tt(tt: tuple[float, float], scale: str) -> tuple[float, float]:
    if scale == "TT":
        return tt
    if scale == "TCG":
        pair = erfa.tttcg(*tt)
    elif scale in ("TDB", "TCB"):
        pair = erfa.tttdb(*tt, _tdb_minus_tt(*tt))
        pair = erfa.tdbtcb(*pair) if scale == "TCB" else pair
    else:
        pair = erfa.tttai(*tt)
        if scale == "UTC":
            pair = erfa.taiutc(*pair)
        elif scale == "GPS":
            pair = pair[0], pair[1] - _TAI_MINUS_GPS
        elif scale == "UT1":
            tai = Epoch(float(pair[0]), float(pair[1]), "TAI")
            pair = erfa.taiut1(*pair, _ut1_minus_tai(tai, np.zeros(1))[0])
    return float(pair[0]), float(pair[1])


def _ut1_minus_tai(epoch: Epoch, t_s: Array) -> Array:
    """Return UT1 − TAI (N,), s, at times after an epoch in TAI; refused outside the table."""
    # The table itself needs `Epoch`; it is loaded only where UT1 is used.
    table = import_module("hillsphere.base.orientation").OrientationTable.installed()
    mjd = (epoch.day - MODIFIED_JD) + (epoch.fraction + t_s / DAY_S)
    first, last = table.mjd_tai[[0, -1]]
    if not (first <= mjd.min() and mjd.max() <= last):
        span = (
            Epoch(MODIFIED_JD, day, "TAI").isot(np.zeros(1), 0)[0][:10] for day in (first, last)
        )
        raise InputError(
            f"UT1 is known from {' to '.join(span)} only ({table.source}); use another time "
            "scale, or update the package astropy-iers-data"
        )
    return np.asarray(table.at(epoch, t_s).ut1_minus_tai_s)


def _tdb_minus_tt(day: float, fraction: float) -> float:
    """Return TDB − TT, s, at the geocentre.

    The argument may be in TT or TDB: the two differ by 2 ms, which changes the result by less than
    1e-12 s.
    """
    return float(erfa.dtdb(day, fraction, 0.0, 0.0, 0.0, 0.0))


J2000 = Epoch(2451544.5, 0.5, "TDB")
"""2000 January 1, 12 h TDB."""
