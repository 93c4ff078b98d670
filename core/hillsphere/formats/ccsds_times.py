"""Times of CCSDS messages: calendar dates, and dates by the day of the year.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 7.5.10 (the two forms).
.. [2] CCSDS 301.0-B-4, Time Code Formats, Blue Book, 2010, section 3.5 (ASCII codes A and B).
"""

from __future__ import annotations

import re
import warnings
from calendar import isleap
from collections.abc import Sequence
from datetime import date, timedelta

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch

__all__ = ["date_of_day", "plain_seconds", "read_ccsds_time"]

_PLAIN = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)T([01]\d|2[0-3]):([0-5]\d):([0-5]\d(?:\.\d{1,12})?)Z?", re.ASCII
)
_BY_DAY = re.compile(r"(\d{4})-(\d{3})(T.*)?", re.ASCII)


def read_ccsds_time(text: str, scale: str) -> Epoch:
    """Read ``2007-03-05T10:34:41.4264`` or ``2007-064T10:34:41.4264``, each perhaps with a ``Z``.

    Parameters
    ----------
    text : str
        The time.
    scale : str
        Its time scale, one of `hillsphere.time.SCALES`.

    Returns
    -------
    Epoch
        The instant.

    Raises
    ------
    InputError
        If it is no such time, also for day 000, for day 366 of a common year and for later ones.
    """
    plain = text.strip().removesuffix("Z")
    if match := _BY_DAY.fullmatch(plain):
        year, day = int(match[1]), int(match[2])
        plain = f"{date_of_day(year, day).isoformat()}{match[3] or ''}"
    return Epoch.parse(plain, scale)


def date_of_day(year: int, day: int) -> date:
    """Return the date of a day of the year, 1 being the first of January.

    Raises
    ------
    InputError
        If the year has no such day.
    """
    days = 366 if isleap(year) else 365
    if not 1 <= year <= 9999:
        raise InputError(f"the year must be between 1 and 9999, got {year}")
    if not 1 <= day <= days:
        raise InputError(f"the year {year} has the days 001 to {days}, got day {day:03d}")
    return date(year, 1, 1) + timedelta(days=day - 1)


def plain_seconds(texts: Sequence[str], base: Epoch, scale: str) -> Array | None:
    """Return many calendar times at once, by the steps of `read_ccsds_time`.

    Parameters
    ----------
    texts : sequence of str
        K times.
    base : Epoch
        Epoch from which seconds count, in TAI for times in UTC, else in their scale.
    scale : str
        Time scale of the times.

    Returns
    -------
    ndarray, shape (K,)
        Seconds after the base, those of `Epoch.seconds_since` to the last bit. None if a time is of
        another form, in a leap second, in UT1, or wrong: then each must be read for itself.
    """
    matches = [_PLAIN.fullmatch(text) for text in texts]
    if scale == "UT1" or not matches or any(match is None for match in matches):
        return None
    fields = np.array([match.groups() for match in matches if match is not None])
    year, month, day, hour, minute = fields[:, :5].astype(np.intc).T
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        try:
            whole, part = erfa.dtf2d(
                scale, year, month, day, hour, minute, fields[:, 5].astype(float)
            )
        except erfa.ErfaError:
            return None
        if scale == "UTC":
            whole, part = erfa.tttai(*erfa.taitt(*erfa.utctai(whole, part)))
    return np.asarray(((whole - base.day) + (part - base.fraction)) * DAY_S)
