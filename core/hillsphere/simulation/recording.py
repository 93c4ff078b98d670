"""What is told of flights on their way: to histories, and to whoever watches."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.simulation.block import Recorder
from hillsphere.simulation.outcomes import History

__all__ = ["Observer", "Table"]


class Observer(Protocol):
    """Follows flights sample by sample, where only a few numbers of each are wanted."""

    def recorder(self, first: int, count: int) -> Recorder:
        """Return what is told of one block: the `count` cases from place `first` on.

        It is called as ``(k, t (B,), x (n, B), y, ref, done, flying (B,))`` at every sample k while
        a lane flies, and once at the end with None for y, ref and done and with the final states;
        flying then marks the lanes that reached their last sample. Lanes beyond `count` only fill
        the block.
        """
        ...


class Table:
    """Every sample of N flights.

    Parameters
    ----------
    total, samples : int
        Numbers of cases and samples.
    """

    def __init__(self, total: int, samples: int) -> None:
        self._total, self._samples = total, samples
        self._arrays: dict[str, Array] = {}

    def recorder(self, first: int, count: int) -> Recorder:
        """Return what takes the samples of the `count` cases from number `first` on."""
        cases = slice(first, first + count)

        def record(
            k: int,
            t: Array,
            x: Array,
            y: Array | None,
            ref: Array | None,
            done: Array | None,
            flying: NDArray[np.bool_],
        ) -> None:
            rows = {"time_s": t[None], "x": x, "y": y, "ref": ref, "u": done}
            for name, row in rows.items():
                if row is not None:
                    values = np.where(flying, row, np.nan)[:, :count]
                    self._array(name, len(row))[:, k, cases] = values

        return record

    def history(self) -> History:
        """Return what was taken."""
        return History(
            time_s=self._array("time_s", 1)[0],
            x=self._array("x", 0),
            y=self._array("y", 0),
            ref=self._array("ref", 0),
            u=self._array("u", 0),
        )

    def _array(self, name: str, rows: int) -> Array:
        if name not in self._arrays:
            samples = self._samples + (name in ("time_s", "x"))
            self._arrays[name] = np.full((rows, samples, self._total), np.nan)
        return self._arrays[name]
