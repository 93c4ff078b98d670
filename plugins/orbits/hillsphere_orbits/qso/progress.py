"""Progress of a family that is followed, from its first correction on."""

from __future__ import annotations

from collections.abc import Callable
from math import log
from typing import Protocol

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["FamilyProgress"]

_PARTS = 100
"""Parts of the bar of one pass along the family: per cent of the way in amplitude."""


class _Tracker(Protocol):
    """What `hillsphere.interfaces.Context` has for this."""

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Show a bar."""
        ...


class FamilyProgress:
    """Bars for the first orbit and for each pass along a family, with the amplitude reached.

    Members lie the closer, the smaller the amplitude, so that equal ratios of amplitudes count as
    equal parts of the way.

    Parameters
    ----------
    context : Context or None
        Where to show; nowhere if None.
    row : int
        Row of the unknowns that is the amplitude, normalised.
    unit_km : float
        Unit of length, km.
    """

    def __init__(self, context: _Tracker | None, row: int, unit_km: float) -> None:
        self._context, self._row, self._unit_km = context, row, unit_km
        self._advance: Callable[[int], None] = lambda count: None
        self._range = (1.0, 1.0)
        self._reached = (1.0, 1.0)
        self._members = self._iterations = self._parts = 0

    def begin_correction(self, iterations: int) -> None:
        """Show the correction of the first orbit, of as many iterations at most."""
        self._iterations = 0
        self._open("first orbit", iterations, lambda: f"iteration {self._iterations}")

    def watch_iterate(self, z: Array) -> None:
        """Count an iterate of that correction."""
        self._iterations += 1
        self._advance(1)

    def begin_pass(self, low: float, high: float, start: float) -> None:
        """Show a pass between two amplitudes from a member on."""
        self._range, self._reached = (low, high), (start, start)
        self._members = self._parts = 0
        self._open("orbits along the family", _PARTS, self._describe)

    def watch_member(self, z: Array) -> None:
        """Count a member."""
        self._members += 1
        x = float(z[self._row, 0])
        self._reached = (min(self._reached[0], x), max(self._reached[1], x))
        done = log(_inside(self._reached[1], self._range) / _inside(self._reached[0], self._range))
        whole = log(self._range[1] / self._range[0])
        parts = int((_PARTS - 1) * min(1.0, done / whole)) if whole > 0.0 else 0
        self._advance(max(0, parts - self._parts))
        self._parts = max(self._parts, parts)

    def _describe(self) -> str:
        least, most = (x * self._unit_km for x in self._reached)
        low, high = (x * self._unit_km for x in self._range)
        return (
            f"{self._members} orbits, x = {least:.4g} to {most:.4g} km of {low:.4g} to {high:.4g}"
        )

    def _open(self, what: str, total: int, note: Callable[[], str]) -> None:
        if self._context is not None:
            self._advance = self._context.track(f"quasi-satellite orbits: {what}", total, note)


def _inside(x: float, limits: tuple[float, float]) -> float:
    return float(np.clip(x, *limits))
