"""Readers of measured angles, line by line: CSV tables and CCSDS tracking data messages.

Tables are those of `hillsphere.formats.angle_table`.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain

from hillsphere.errors import InputError
from hillsphere.formats.angle_table import AngleRow, AngleTable
from hillsphere.formats.ccsds_entries import Leniency
from hillsphere.formats.tdm_reading import records_and_faults
from hillsphere.time import Epoch
from hillsphere_tracking.live.angle_pairs import PairedAngles

__all__ = ["Measurement", "measurements"]

_MESSAGE = re.compile(r"CCSDS_TDM_VERS|COMMENT\b|<(\?xml|!--|([\w.-]+:)?(ndm|tdm)\b)")
"""How a message begins. Anything else is a line of a table, perhaps a bad one: noise on a serial
line must not make a message of it."""
Measurement = AngleRow
"""Measured azimuth (from north eastwards) and elevation; `place` is ``"file:line"``."""


def measurements(
    lines: Iterable[str], where: str, epoch: Epoch | None = None
) -> Iterator[Measurement]:
    """Return an iterator of measurements, which reads lines as they arrive.

    Parameters
    ----------
    lines : iterable of str
        A table, or a tracking data message in either form.
    where : str
        Name of the file, used in error messages.
    epoch : Epoch, optional
        Origin of times that are given in seconds.

    Returns
    -------
    iterator of Measurement
        Measurements in the order of the input. The iterator can be continued after an error; the
        bad line is then skipped.

    Raises
    ------
    InputError
        From the iterator, with file and line: if a line is not a measurement, or angles are out of
        range or not finite. If the metadata of a message are invalid the iteration ends there.
    """
    rest = iter(lines)
    head: list[str] = []
    for line in rest:
        head.append(line)
        text = line.lstrip("\ufeff \t\r\n")
        if text and not text.startswith("#"):
            break
    else:
        text = ""
    whole = chain(head, rest)
    if _MESSAGE.match(text):
        return _Message(whole, where)
    return AngleTable(whole, where, epoch, " with --epoch")


class _Message(Iterator[Measurement]):
    """Iterator over the measurements of a tracking data message."""

    def __init__(self, lines: Iterable[str], where: str) -> None:
        # What is harmless stops no pass: unknown keywords, their order, comments anywhere.
        leniency = Leniency(strict=False, warn=lambda message: None)
        self._records = records_and_faults(lines, where, leniency)
        self._faults: deque[InputError] = deque()
        self._pairing = PairedAngles(self._faults.append)

    def __next__(self) -> Measurement:
        if self._faults:
            raise self._faults.popleft()
        for record in self._records:
            if isinstance(record, InputError):
                raise record
            if pair := self._pairing.add(record):
                return Measurement(
                    pair.place, pair.epoch, pair.azimuth_rad, pair.elevation_rad, None
                )
            if self._faults:
                raise self._faults.popleft()
        self._pairing.finish()
        if self._faults:
            raise self._faults.popleft()
        raise StopIteration
