"""Samples that are flown ahead of the proof that no flight ends between them.

A proof costs about as much for one leg as for many: some hundred operations on arrays of intervals.
A law of impulses coasts for hours between its samples, so that no region of states holds a leg as a
whole and every leg needs a proof of its own. Such legs are flown on as long as no event is below
zero at their ends, and proved together. From the first leg whose proof fails the flight is
repeated, with the proof of that leg at once. Results are those of legs that are proved one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol

import numpy as np

from hillsphere.engine.simulation.legs import Unproved
from hillsphere.engine.simulation.navigation import NavigationErrors, PerfectNavigation
from hillsphere.interfaces.loop import Navigation

__all__ = ["Ahead", "is_repeatable"]

_LEGS = 64
"""Most legs that are proved together: with more, what a proof costs anyway hardly counts."""
_SUB_STEPS = 1 << 15
"""Sub-steps of all lanes from which no more legs are added: their states take some megabytes, and
arrays that exceed the processor's cache take longer."""
_PAUSE = 15
"""Most samples without an attempt, after several that failed because flights were ending."""


class _Watch(Protocol):
    def count_proved(self, flown: list[Unproved], cases: int) -> int: ...


@dataclass(frozen=True, eq=False)
class _Flown:
    """A sample, the state of the block before it, and the leg that followed."""

    k: int
    before: dict[str, Any]
    leg: Unproved


class Ahead:
    """The legs of a block that wait for their proof.

    Parameters
    ----------
    watch : Watch
        What proves them.
    record : callable or None
        Takes each sample, once it is certain.
    cases : int
        Number of the block's first lanes that count; the others repeat the last of them.
    """

    def __init__(self, watch: _Watch, record: Callable[[Any], None] | None, cases: int) -> None:
        self._watch, self._record, self._cases = watch, record, cases
        self._waiting: list[_Flown] = []
        self._moments: list[Any] = []
        self._size = self._pause = self._left = 0

    @property
    def tries(self) -> bool:
        """Whether the next leg may be flown without its proof."""
        return not self._left

    @property
    def full(self) -> bool:
        """Whether no more legs should be added, or the observer should hear what is certain."""
        most = max(len(self._waiting), len(self._moments))
        return most >= _LEGS or self._size >= _SUB_STEPS

    def hear(self, moment: Any) -> None:
        """Take a sample, and pass it on when it is certain."""
        if self._record is not None:
            # copied: a law or a reference may write its next result into the same array
            arrays = ((f.name, getattr(moment, f.name)) for f in fields(moment))
            own = {name: a.copy() for name, a in arrays if isinstance(a, np.ndarray)}
            self._moments.append(replace(moment, **own))

    def add(self, k: int, before: dict[str, Any], leg: Unproved | None) -> None:
        """Add the leg that followed sample k; None if it is proved."""
        self._left = max(0, self._left - 1)
        if leg is not None:
            self._waiting.append(_Flown(k, before, leg))
            self._size += (leg.y.shape[1] - 1) * int(leg.leg.flying[: self._cases].sum())

    def settle(self) -> tuple[int, dict[str, Any]] | None:
        """Prove all legs; return the sample, and the state before it, from which to repeat.

        None if there is nothing to repeat.
        """
        waiting, moments = self._waiting, self._moments
        self._waiting, self._moments, self._size = [], [], 0
        failed = None
        if waiting:
            proved = self._watch.count_proved([one.leg for one in waiting], self._cases)
            failed = waiting[proved] if proved < len(waiting) else None
            self._pause = 0 if failed is None else min(2 * self._pause + 1, _PAUSE)
            self._left = self._pause
        for moment in moments:
            if self._record is not None and (failed is None or moment.k < failed.k):
                self._record(moment)
        return None if failed is None else (failed.k, failed.before)


def is_repeatable(navigation: Navigation) -> bool:
    """Return whether a navigation surely leaves its memory as it was: it has only values."""
    return isinstance(navigation, PerfectNavigation | NavigationErrors)
