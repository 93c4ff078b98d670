"""Pairs of azimuth and elevation from the records of a tracking data message, as they arrive."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import pi
from typing import NamedTuple

from hillsphere.errors import InputError
from hillsphere.formats.tdm_reading import TdmRecord
from hillsphere.time import Epoch

__all__ = ["AnglePair", "PairedAngles"]

_ANGLES = ("ANGLE_1", "ANGLE_2")


class AnglePair(NamedTuple):
    """Azimuth from north eastwards and elevation at one time, rad, corrected."""

    place: str
    epoch: Epoch
    azimuth_rad: float
    elevation_rad: float


class PairedAngles:
    """Pairs each ANGLE_1 with the ANGLE_2 of the same time.

    The two keywords may alternate, or all values of one may precede all values of the other.

    Parameters
    ----------
    tell : callable, optional
        Receives the error of an angle that cannot be used; by default the error is raised.
    """

    def __init__(self, tell: Callable[[InputError], None] | None = None) -> None:
        self._waiting: deque[TdmRecord] = deque()
        self._tell = tell

    def add(self, record: TdmRecord) -> AnglePair | None:
        """Add a record; return the pair that it completes, or None.

        Raises
        ------
        InputError
            If the angles are no azimuth and elevation, an angle has no partner, or a correction
            cannot be added, and no callback was given.
        """
        waiting = self._waiting
        if waiting and waiting[0].meta is not record.meta:
            self.finish()
        if record.keyword not in _ANGLES:
            return None
        if record.meta.corrections_applied is None and any(
            value for key, value in record.meta.corrections.items() if "ANGLE" in key
        ):
            self._report(
                f"{record.place}: the message has corrections of the angles and does not say "
                "whether they are applied: CORRECTIONS_APPLIED = YES or NO"
            )
            return None
        if record.meta.angle_type != "AZEL":
            self._report(
                f"{record.place}: ANGLE_TYPE = {record.meta.angle_type or '(missing)'}: only "
                "azimuth and elevation, AZEL, can be tracked; convert the angles"
            )
            return None
        while waiting and waiting[0].keyword != record.keyword:
            other = waiting[0]
            apart = record.epoch.seconds_since(other.epoch)
            # Times rise within a keyword, so that the earlier of the two can have no partner any
            # more. Equal times are equal to 1 ns: messages give microseconds.
            if apart < -1e-9:
                self._report_unpaired(record)
                return None
            waiting.popleft()
            if apart <= 1e-9:
                return self._pair(record, other)
            self._report_unpaired(other)
        waiting.append(record)
        return None

    def finish(self) -> None:
        """Report the angles that have no partner at the end of the data, as `add` does."""
        while self._waiting:
            self._report_unpaired(self._waiting.popleft())

    def _pair(self, record: TdmRecord, other: TdmRecord) -> AnglePair | None:
        angles = {r.keyword: r.value for r in (other, record)}
        try:
            azimuth, elevation = (angles[k] + record.meta.correction_of(k) for k in _ANGLES)
        except InputError as error:
            self._report(f"{record.place}: {error}")
            return None
        if abs(elevation) > pi / 2:
            self._report(f"{record.place}: the corrected elevation is not from -90° to 90°")
            return None
        return AnglePair(record.place, record.epoch, azimuth, elevation)

    def _report_unpaired(self, record: TdmRecord) -> None:
        other = _ANGLES[record.keyword == _ANGLES[0]]
        self._report(
            f"{record.place}: {record.keyword} has no {other} of the same time; both are needed"
        )

    def _report(self, message: str) -> None:
        fault = InputError(message)
        if self._tell is None:
            raise fault
        self._tell(fault)
