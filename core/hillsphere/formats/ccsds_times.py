"""Times of CCSDS messages: calendar dates, and dates by the day of the year.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 7.5.10 (the two forms).
.. [2] CCSDS 301.0-B-4, Time Code Formats, Blue Book, 2010, section 3.5 (ASCII codes A and B).
"""

from __future__ import annotations

import re
from calendar import isleap
from datetime import date, timedelta

from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch

__all__ = ["date_of_day", "read_ccsds_time"]

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
