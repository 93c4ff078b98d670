"""Earth orientation parameters: UT1 and polar motion.

The Earth's rotation has an irregular part that must be observed. It is given by constants, or by a
table of the International Earth Rotation Service (IERS): the one in the package
``astropy-iers-data``, or a file of the same format.

References
----------
.. [1] IERS Conventions (2010), IERS Technical Note 36, chapter 5 (UT1, polar motion).
.. [2] Explanatory note to finals2000A (readme.finals2000A), IERS Rapid Service/Prediction Centre.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Protocol

import erfa
import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.constants import DAY_S, MODIFIED_JD
from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text
from hillsphere.base.time import Epoch

__all__ = [
    "UT1_IS_UTC",
    "ConstantOrientation",
    "EarthOrientation",
    "EarthOrientationWarning",
    "OrientationAngles",
    "OrientationTable",
    "doubts",
]


class EarthOrientationWarning(UserWarning):
    """Times lie after the end of the table of Earth orientation."""


@dataclass(frozen=True)
class OrientationAngles:
    """Orientation of the Earth at some times.

    Parameters
    ----------
    ut1_minus_tai_s : ndarray, shape (N,)
        UT1 − TAI, which is continuous (UT1 − UTC jumps at leap seconds).
    x_pole_rad, y_pole_rad : ndarray, shape (N,)
        Polar motion.
    """

    ut1_minus_tai_s: Array
    x_pole_rad: Array
    y_pole_rad: Array


class EarthOrientation(Protocol):
    """A source of UT1 and polar motion."""

    def at(self, epoch: Epoch, t_s: Array) -> OrientationAngles:
        """Return the orientation at times (N,), SI seconds after an epoch."""
        ...

    def lapse(self, epoch: Epoch, t_s: Array) -> str | None:
        """Return a sentence for the verdict if the source does not cover the times, else None.

        Times (N,) are SI seconds after the epoch.
        """
        ...


@dataclass(frozen=True)
class ConstantOrientation:
    """Constant UT1 − UTC and polar motion, for spans of hours or for comparisons.

    Parameters
    ----------
    ut1_minus_utc_s : float
        Value at the epoch of t = 0. UT1 − TAI is constant from there on, so that UT1 − UTC changes
        by 1 s at a leap second.
    x_pole_rad, y_pole_rad : float
        Polar motion.

    Raises
    ------
    InputError
        If |UT1 − UTC| exceeds 0.9 s, to which UTC is kept, or the pole is farther off than 1″.
    """

    ut1_minus_utc_s: float = 0.0
    x_pole_rad: float = 0.0
    y_pole_rad: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.ut1_minus_utc_s) <= 0.9:
            raise InputError(f"UT1 − UTC must be within ±0.9 s, got {self.ut1_minus_utc_s}")
        for name in ("x_pole_rad", "y_pole_rad"):
            if not abs(getattr(self, name)) <= erfa.DAS2R:
                raise InputError(f"{name} must be within ±1″ (4.8e-6), got {getattr(self, name)}")

    def at(self, epoch: Epoch, t_s: Array) -> OrientationAngles:
        """Return the orientation at times (N,), SI seconds after an epoch."""
        shape = np.shape(t_s)
        return OrientationAngles(
            np.full(shape, self.ut1_minus_utc_s - _tai_minus_utc(epoch)),
            np.full(shape, self.x_pole_rad),
            np.full(shape, self.y_pole_rad),
        )

    def lapse(self, epoch: Epoch, t_s: Array) -> str | None:
        """Return None: a constant covers all times."""
        return None


UT1_IS_UTC = ConstantOrientation()
"""UT1 = UTC without polar motion, as in older papers: an error of rotation of up to 4e-3°."""


@dataclass(frozen=True, eq=False)
class OrientationTable:
    """Table of daily IERS values, observed and predicted about a year ahead.

    Values between the days are interpolated linearly. UT1 − TAI is interpolated rather than
    UT1 − UTC, which jumps at leap seconds. The errors of interpolation and of tides within a day
    are below 0.1 ms of UT1 and 1 mas of the pole (5 cm on the equator).

    Times before the table are an error. After its end the last values are held, an error that
    grows by about 1 ms per day: `at` gives an `EarthOrientationWarning`, and `lapse` the sentence
    for a verdict.

    Parameters
    ----------
    source : str
        Name of the table in messages.
    mjd_tai : ndarray, shape (K,)
        Modified Julian dates of the values, rising.
    ut1_minus_tai_s, x_pole_rad, y_pole_rad : ndarray, shape (K,)
        The values.
    observed_to_mjd : float
        Modified Julian date of the last observed value; later ones are predictions.

    Raises
    ------
    InputError
        If there are fewer than two dates, they do not rise, or UT1 − TAI jumps by more than 0.1 s:
        then the table holds a leap second that this installation does not know.
    """

    source: str
    mjd_tai: Array
    ut1_minus_tai_s: Array
    x_pole_rad: Array
    y_pole_rad: Array
    observed_to_mjd: float

    def __post_init__(self) -> None:
        if self.mjd_tai.size < 2 or not (np.diff(self.mjd_tai) > 0.0).all():
            raise InputError(f"{self.source}: an Earth orientation table needs rising dates")
        jumps = np.abs(np.diff(self.ut1_minus_tai_s)) > 0.1 * np.diff(self.mjd_tai)
        if jumps.any():
            day = _calendar(self.mjd_tai[1:][jumps][0])
            raise InputError(
                f"{self.source}: UT1 − TAI jumps at {day}: a leap second that this installation "
                "does not know, or a damaged table; update the package pyerfa"
            )

    @classmethod
    def read(cls, path: str | Path) -> OrientationTable:
        """Read a file of the format finals2000A (``.all``, ``.data`` or ``.daily``).

        Values of Bulletin B are preferred to those of Bulletin A.

        Parameters
        ----------
        path : str or Path
            The file.

        Returns
        -------
        OrientationTable
            Up to the last day with UT1 and polar motion.

        Raises
        ------
        InputError
            If the file cannot be read or a line is not of the format.
        """
        source = Path(path).name
        try:
            lines = read_text(path, "ascii").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot read the Earth orientation file {path}: {error}") from error
        rows: list[tuple[float, float, float, float]] = []
        observed = 0
        for number, line in enumerate(lines, start=1):
            try:
                row = _row(line)
            except ValueError:
                raise InputError(
                    f"{path}:{number}: not a line of finals2000A: {line[:70].rstrip()!r}"
                ) from None
            if row is None:  # days to come, for which there is not even a prediction
                break
            rows.append(row)
            observed = len(rows) if line[57:58] == "I" else observed
        if len(rows) < 2:
            raise InputError(f"{path}: no Earth orientation in it; expected a finals2000A file")
        mjd, x, y, ut1_utc = np.array(rows).T
        with warnings.catch_warnings():
            # Predictions may lie beyond the last leap second announced: "dubious", not wrong.
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            tai_utc = erfa.dat(*erfa.jd2cal(MODIFIED_JD, mjd)[:3], 0.0)
        return cls(
            source, mjd + tai_utc / DAY_S, ut1_utc - tai_utc, x * erfa.DAS2R, y * erfa.DAS2R,
            float(mjd[max(observed, 1) - 1]),
        )  # fmt: skip

    @classmethod
    def installed(cls) -> OrientationTable:
        """Return the table of the package ``astropy-iers-data``, read once.

        Raises
        ------
        InputError
            If the package is missing.
        """
        return _installed_table()

    def at(self, epoch: Epoch, t_s: Array) -> OrientationAngles:
        """Return the orientation at times (N,), SI seconds after an epoch."""
        mjd = self._mjd(epoch, t_s)
        if mjd.size and mjd.min() < self.mjd_tai[0]:
            raise InputError(
                f"Earth orientation ({self.source}) begins on {_calendar(self.mjd_tai[0])}, asked "
                f"for {_calendar(mjd.min())}; give UT1 − UTC as a constant"
            )
        if sentence := self._lapse(mjd):
            warnings.warn(sentence, EarthOrientationWarning, stacklevel=2)
        return OrientationAngles(
            *(np.interp(mjd, self.mjd_tai, q)
              for q in (self.ut1_minus_tai_s, self.x_pole_rad, self.y_pole_rad))
        )  # fmt: skip

    def lapse(self, epoch: Epoch, t_s: Array) -> str | None:
        """Return a sentence for the verdict if a time lies beyond the table, else None."""
        return self._lapse(self._mjd(epoch, t_s))

    def _lapse(self, mjd: Array) -> str | None:
        if not mjd.size or mjd.max() <= self.mjd_tai[-1]:
            return None
        return (
            f"Earth orientation ({self.source}) ends on {_calendar(self.mjd_tai[-1])}: UT1 and the "
            "pole are held from there, wrong by about 1 ms of UT1 a day; update the package "
            "astropy-iers-data or give a newer finals2000A file"
        )

    def _mjd(self, epoch: Epoch, t_s: Array) -> Array:
        day, fraction = tai_of(epoch)
        return np.asarray((day - MODIFIED_JD) + (fraction + np.asarray(t_s, dtype=float) / DAY_S))


def doubts(orientation: EarthOrientation, epoch: Epoch, t_s: Array) -> tuple[str, ...]:
    """Return warnings for the verdict about the Earth orientation at some times.

    Parameters
    ----------
    orientation : EarthOrientation
        The source that was used.
    epoch : Epoch
        Origin of the times.
    t_s : ndarray, shape (N,)
        Times, SI seconds after the epoch; the first and the last are enough.

    Returns
    -------
    tuple of str
        Sentences: the table ends before the times, or UT1 = UTC was assumed. Empty if neither.
    """
    sentences = []
    if (lapse := orientation.lapse(epoch, t_s)) is not None:
        sentences.append(lapse + ".")
    if orientation == UT1_IS_UTC:
        sentences.append("UT1 is taken as UTC: the Earth may be turned by up to 4e-3°.")
    return tuple(sentences)


def tai_of(epoch: Epoch) -> tuple[float, float]:
    """Return the two-part Julian date of an epoch in TAI; cached, as it is needed often."""
    tai = _tai(epoch)
    return tai.day, tai.fraction


@lru_cache(maxsize=64)
def _tai(epoch: Epoch) -> Epoch:
    return epoch.to("TAI")


@lru_cache(maxsize=64)
def _tai_minus_utc(epoch: Epoch) -> float:
    utc = epoch.to("UTC")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        year, month, day, fraction = erfa.jd2cal(utc.day, utc.fraction)
        return float(erfa.dat(year, month, day, fraction))


@lru_cache(maxsize=1)
def _installed_table() -> OrientationTable:
    try:
        path = str(import_module("astropy_iers_data").IERS_A_FILE)
    except ImportError:
        raise InputError(
            "Earth orientation needs the package astropy-iers-data (pip install "
            "astropy-iers-data); or give a finals2000A file, or UT1 − UTC as a constant"
        ) from None
    return OrientationTable.read(path)


def _row(line: str) -> tuple[float, float, float, float] | None:
    """Return MJD, x and y of the pole, ″, and UT1 − UTC, s; None if the day has no values."""
    mjd = float(line[7:15])
    ours = [line[18:27], line[37:46], line[58:68]]
    if not all(text.strip() for text in ours):
        return None
    final = [line[134:144], line[144:154], line[154:165]]
    x, y, ut1_utc = map(float, final if all(text.strip() for text in final) else ours)
    if not (abs(x) < 1.0 and abs(y) < 1.0 and abs(ut1_utc) <= 1.0):
        raise ValueError
    return mjd, x, y, ut1_utc


def _calendar(mjd: float) -> str:
    year, month, day, _ = erfa.jd2cal(MODIFIED_JD, mjd)
    return f"{year:04d}-{month:02d}-{day:02d}"
