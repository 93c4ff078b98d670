"""Tables of measured azimuths and elevations, line by line (CSV).

A table has the columns time, azimuth, elevation and optionally standard deviation, in degrees, or a
header line with ``utc``, ``azimuth_deg``, ``elevation_deg`` and optionally ``sigma_deg`` in any
order among other columns. A pass log is such a table; lines with ``locked`` 0 are skipped. Times
are dates in UTC or seconds after a given epoch. Lines that begin with ``#`` are comments.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isfinite, nan, radians
from typing import NamedTuple

from hillsphere.base.constants import DAY_S
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch

__all__ = ["AngleRow", "AngleTable"]

_POSITIONS = {"time": 0, "azimuth_deg": 1, "elevation_deg": 2, "sigma_deg": 3}
_TIMES = ("utc", "time", "time_s")
_LOCKED = "locked"
_WIDEST = 1000
"""Characters of a line that are read: a table has nine columns, and the rest of a longer line is no
measurement."""


class AngleRow(NamedTuple):
    """Measured azimuth (from north eastwards) and elevation; `place` is ``"file:line"``."""

    place: str
    epoch: Epoch
    azimuth_rad: float
    elevation_rad: float
    sigma_rad: float | None


class AngleTable(Iterator[AngleRow]):
    """Iterator over the rows of a table, which reads lines as they arrive.

    It can be continued after an error; the bad line is then skipped.

    Parameters
    ----------
    lines : iterable of str
        The table.
    where : str
        Name of the file, used in error messages.
    epoch : Epoch, optional
        Origin of times that are given in seconds.
    remedy : str
        How to give that origin, for the message where it is missing.

    Raises
    ------
    InputError
        From the iterator, with file and line: if a line is no measurement, or angles are out of
        range or not finite.
    """

    def __init__(
        self, lines: Iterable[str], where: str, epoch: Epoch | None = None, remedy: str = ""
    ) -> None:
        self._lines = enumerate(lines, start=1)
        self._where, self._epoch, self._remedy = where, epoch, remedy
        self._columns: dict[str, int] | None = None
        self._width, self._unsure = 0, True

    def __next__(self) -> AngleRow:
        for number, raw in self._lines:
            line = raw.lstrip("\ufeff").strip()
            if not line or line.startswith("#"):
                continue
            place = f"{self._where}:{number}"
            cells = [cell.strip() for cell in line[:_WIDEST].split(",")]
            if self._columns is None and self._read_header(cells, place):
                continue
            try:
                record = self._measurement(cells, place)
            except InputError:
                if self._unsure:
                    # the columns of a table without header are those of its first good line
                    self._columns = None
                raise
            self._unsure = False
            if record is not None:
                return record
        raise StopIteration

    def _read_header(self, cells: list[str], place: str) -> bool:
        """Set the columns from the first line; return whether it is a header line."""
        names = [cell.lower() for cell in cells]
        self._width = len(cells)
        if not any(name in (*_TIMES, *_POSITIONS) for name in names):
            if len(cells) not in (3, 4):
                raise InputError(
                    f"{place}: expected time, azimuth, elevation and, if there is one, standard "
                    f"deviation, separated by commas; got {','.join(cells)[:60]!r}"
                )
            self._columns = {k: i for k, i in _POSITIONS.items() if i < len(cells)}
            return False
        columns = {name: i for i, name in enumerate(names) if name in _POSITIONS}
        times = [i for i, name in enumerate(names) if name in _TIMES]
        missing = [name for name in ("azimuth_deg", "elevation_deg") if name not in columns]
        if missing or len(times) != 1 or len(set(names)) != len(names):
            raise InputError(
                f"{place}: the header must have the columns utc, azimuth_deg, elevation_deg and "
                f"optionally sigma_deg, once each; got {','.join(cells)[:80]!r}"
            )
        if _LOCKED in names:
            columns[_LOCKED] = names.index(_LOCKED)
        self._columns = columns | {"time": times[0]}
        self._unsure = False
        return True

    def _measurement(self, cells: list[str], place: str) -> AngleRow | None:
        assert self._columns is not None
        if len(cells) != self._width:
            raise InputError(f"{place}: expected {self._width} values, got {len(cells)}")
        given = {name: cells[i] for name, i in self._columns.items()}
        if given.get(_LOCKED) == "0" or not (given["azimuth_deg"] or given["elevation_deg"]):
            return None  # without lock the antenna's angles are no measurement of the satellite
        azimuth, elevation = (_number(given[k], k, place) for k in ("azimuth_deg", "elevation_deg"))
        if not -180.0 <= azimuth <= 540.0:
            raise InputError(f"{place}: azimuth must be from -180° to 540°, got {azimuth:.10g}°")
        if not -90.0 <= elevation <= 90.0:
            raise InputError(f"{place}: elevation must be from -90° to 90°, got {elevation:.10g}°")
        sigma = None
        if text := given.get("sigma_deg", ""):
            sigma = radians(_number(text, "sigma_deg", place))
            if sigma <= 0.0:
                raise InputError(f"{place}: sigma_deg must be > 0, got {text}")
        epoch = self._time(given["time"], place)
        return AngleRow(place, epoch, radians(azimuth), radians(elevation), sigma)

    def _time(self, text: str, place: str) -> Epoch:
        try:
            seconds = float(text)
        except ValueError:
            try:
                return Epoch.parse(text.removesuffix("Z"), "UTC")
            except InputError as error:
                raise InputError(f"{place}: {error}") from error
        if not isfinite(seconds):
            raise InputError(f"{place}: expected a finite time, got {text!r}")
        if self._epoch is None:
            raise InputError(
                f"{place}: the time {text} is in seconds; give the epoch of such times"
                f"{self._remedy}"
            )
        tai = self._epoch.to("TAI")
        return Epoch(tai.day, tai.fraction + seconds / DAY_S, "TAI").to("UTC")


def _number(text: str, what: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not isfinite(value):
        raise InputError(f"{place}: {what}: expected a finite number, got {text[:40]!r}")
    return value
