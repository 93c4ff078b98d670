"""Recording of flights at their samples, by histories and by observers."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.simulation.block import Moment, Recorder
from hillsphere.engine.simulation.outcomes import History

__all__ = ["Moment", "Observer", "Table"]


class Observer(Protocol):
    """Observes flights sample by sample, for instance to reduce histories to a few numbers.

    An optional method ``follower(first, count)``, like `recorder`, returns a
    `hillsphere.engine.simulation.block.Follower`, which is called after the propagation between two
    samples with the states at the ends of its sub-steps.
    """

    def recorder(self, first: int, count: int) -> Recorder:
        """Return the recorder of one block, with the `count` cases from index `first` on.

        The recorder is called with a `Moment` at every sample while a lane flies, and once at the
        end with the final states. Lanes beyond `count` only fill the block.
        """
        ...


class Table:
    """Records every sample of N flights.

    Parameters
    ----------
    total, samples : int
        Numbers of cases and samples.
    """

    def __init__(self, total: int, samples: int) -> None:
        self._total, self._samples = total, samples
        self._arrays: dict[str, Array] = {}

    def recorder(self, first: int, count: int) -> Recorder:
        """Return the recorder of the `count` cases from index `first` on."""
        cases = slice(first, first + count)

        def record(now: Moment) -> None:
            rows = {"time_s": now.t[None], "dv_m_s": now.dv[None], "x": now.x}
            if now.y is not None and now.ref is not None:
                rows |= {"y": now.y, "ref": now.ref}
            if now.own is not None and now.done is not None:
                rows |= {"own": now.own, "u": now.done}
            for name, row in rows.items():
                values = np.where(now.flying, row, np.nan)[:, :count]
                self._array(name, len(row))[:, now.k, cases] = values

        return record

    def history(self) -> History:
        """Return the recorded samples."""
        return History(
            time_s=self._array("time_s", 1)[0],
            x=self._array("x", 0),
            y=self._array("y", 0),
            ref=self._array("ref", 0),
            u=self._array("u", 0),
            own=self._array("own", 0),
            dv_m_s=self._array("dv_m_s", 1)[0],
        )

    def _array(self, name: str, rows: int) -> Array:
        if name not in self._arrays:
            samples = self._samples + (name in ("time_s", "dv_m_s", "x"))
            self._arrays[name] = np.full((rows, samples, self._total), np.nan)
        return self._arrays[name]
