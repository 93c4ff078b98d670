"""Values of CCSDS messages, checked: texts, words, times, numbers with units, and covariances.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 7 (syntax).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isfinite

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import SCALES, Epoch
from hillsphere.formats.ccsds_entries import Entry, Leniency, read_scaled
from hillsphere.formats.ccsds_times import read_ccsds_time
from hillsphere.formats.oem_encodings import COVARIANCE, STATE
from hillsphere.formats.oem_segments import (
    ALIASES,
    COVARIANCE_FRAMES,
    FRAMES,
    hint_of_frame,
    is_covariance_frame,
    is_frame,
    least_eigenvalue,
)

__all__ = [
    "TRIANGLE",
    "check_definite",
    "check_moving_frame",
    "check_text",
    "check_word",
    "read_epoch",
    "read_frame",
    "read_number",
    "read_time_system",
    "read_triangle",
]

TRIANGLE = tuple(key for row in COVARIANCE for key in row)
"""Keywords of the lower triangle of a covariance, row by row."""
_CLOCKS = {
    "GMST": "an angle of the Earth's rotation",
    "MET": "a mission elapsed time, whose origin a message does not state",
    "MRT": "a mission relative time, whose origin a message does not state",
    "SCLK": "a spacecraft's clock, whose origin and rate a message does not state",
}
"""Time systems of the standard that are no time scale, and why they cannot be read."""


def check_text(entry: Entry) -> None:
    """Refuse a value that could not stand as one line of another message.

    A line feed in a value could bring further keywords into a file; a sign of equality is that of
    a second keyword on the line.

    Raises
    ------
    InputError
        If it is not printable or contains ``=``.
    """
    if "=" in entry.value or not entry.value.isprintable():
        raise InputError(
            f"{entry.place}: {entry.key} must be printable text without '=', got "
            f"{entry.value[:40]!r}"
        )


def check_word(
    entry: Entry, is_known: Callable[[str], bool], words: Iterable[str], what: str
) -> None:
    """Refuse a value that is none of the words of the standard, in whatever case."""
    if not is_known(entry.value.upper()):
        hint = did_you_mean(entry.value.upper(), words, otherwise="known")
        raise InputError(f"{entry.place}: {entry.key}: no {what} {entry.value[:60]!r}{hint}")


def read_frame(entry: Entry, leniency: Leniency) -> str:
    """Return the registered frame that a message names.

    Raises
    ------
    InputError
        If no such frame is registered; a customary name of one may be tolerated.
    """
    name = entry.value.upper()
    if not is_frame(name) and name in ALIASES:
        leniency.tolerate(
            f"{entry.place}: {entry.key}: {entry.value} is no registered frame; it is a customary "
            f"name of {ALIASES[name]}"
        )
        return ALIASES[name]
    if not is_frame(name):
        raise InputError(
            f"{entry.place}: {entry.key}: no reference frame {entry.value[:60]!r}"
            f"{hint_of_frame(name)}"
        )
    return name


def check_moving_frame(entry: Entry, what: str = "covariance frame") -> None:
    """Refuse a name of no frame, neither of one that moves with the object nor of another."""
    name = entry.value.upper()
    if not is_covariance_frame(name):
        hint = hint_of_frame(name, (*COVARIANCE_FRAMES, *FRAMES))
        raise InputError(f"{entry.place}: {entry.key}: no {what} {entry.value[:60]!r}{hint}")


def read_time_system(entry: Entry) -> str:
    """Return the time scale that a message names.

    Raises
    ------
    InputError
        If it is no time system, or one that `Epoch` does not have.
    """
    if reason := _CLOCKS.get(entry.value.upper()):
        raise InputError(
            f"{entry.place}: {entry.key}: {entry.value} is {reason}; known: {', '.join(SCALES)}"
        )
    check_word(entry, SCALES.__contains__, SCALES, "time system")
    return entry.value.upper()


def read_epoch(entry: Entry, scale: str) -> Epoch:
    """Return a time of a message; `InputError` with its place and keyword if it is none."""
    try:
        epoch = read_ccsds_time(entry.value, scale)
        if scale == "UT1":
            epoch.to("TAI")  # refused here, with the place, if no table covers it
        return epoch
    except InputError as error:
        raise InputError(f"{entry.place}: {entry.key}: {error}") from error


def read_number(entry: Entry, unit: str, power: int = 0) -> float:
    """Return a number, times a power of ten.

    Parameters
    ----------
    entry : Entry
        Keyword, value and unit.
    unit : str
        The only unit that may stand with it, in any case of letters.
    power : int
        Of ten, that turns the unit into that of the framework.

    Raises
    ------
    InputError
        If it is no finite number, or has another unit.
    """
    if entry.unit and entry.unit.lower() != unit.lower():
        raise InputError(
            f"{entry.place}: {entry.key} must be in {unit or 'no unit'}, got the unit "
            f"{entry.unit[:40]!r}"
        )
    value = read_scaled(entry.value, power)
    if not isfinite(value):
        raise InputError(
            f"{entry.place}: {entry.key} must be a finite number, got {entry.value[:40]!r}"
        )
    return value


def read_triangle(entries: Mapping[str, Entry], units: Mapping[str, str]) -> Array:
    """Return the covariance (6, 6), SI, whose lower triangle a block of entries states in km.

    Raises
    ------
    InputError
        If a number is none, or no rounding of the digits makes the matrix a covariance.
    """
    ordered = [entries[key] for key in TRIANGLE]
    lower = np.zeros((6, 6))
    lower[np.tril_indices(6)] = [read_number(entry, units[entry.key], 6) for entry in ordered]
    matrix = np.asarray(lower + np.tril(lower, -1).T)
    check_definite(matrix, ordered)
    return matrix


def check_definite(matrix: Array, entries: Sequence[Entry]) -> None:
    """Refuse a matrix that no rounding of its digits turns into a covariance.

    A number of p digits is rounded by at most 5e-p of itself, by which an eigenvalue of the 6 × 6
    matrix of correlations, whose elements do not exceed 1, moves by at most 6 times as much. The
    number with most digits tells p, since trailing zeros may be left out.

    Parameters
    ----------
    matrix : ndarray, shape (6, 6)
        Symmetric.
    entries : sequence of Entry
        The 21 numbers of its lower triangle, in the order of `TRIANGLE`.
    """
    for number, key in enumerate(STATE):
        if matrix[number, number] < 0.0:
            entry = entries[TRIANGLE.index(f"C{key}_{key}")]
            raise InputError(
                f"{entry.place}: {entry.key} must be a variance of at least 0, got {entry.value}"
            )
    digits = max(len(re.sub(r"[eE].*|\D", "", entry.value).strip("0")) for entry in entries)
    tolerance = min(max(30.0 * 10.0**-digits, 1e-12), 1e-3)
    if (least := least_eigenvalue(matrix)) < -tolerance:
        raise InputError(
            f"{entries[0].place}: {entries[0].key}: the covariance that begins here must be "
            f"positive semidefinite; its correlations have the eigenvalue {least:.3g}"
        )
