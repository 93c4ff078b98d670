"""The norms of one plant's closed loop, with the memory of where its gain had peaks."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.structured.closed_loop import Closed, OpenLoop
from hillsphere_controllers.structured.gradients import h2
from hillsphere_controllers.structured.peaks import frequencies, gains, refined_peaks

__all__ = ["Loop", "PlantNorms", "part_of"]

Complex = NDArray[np.complex128]

_STABLE = 1e-11
"""Poles count as stable when their real part is below minus this share of the fastest."""
_NEAR = 0.6
_REMEMBERED = 12
_ROUNDING = 1e-9


@dataclass
class Loop:
    """A stable closed loop and what is known of it.

    Parameters
    ----------
    closed : Closed
        Its matrices.
    response : Response
        From w to z.
    peaks : dict
        Frequencies, rad/s, and gains of the peaks of each channel with an H∞ norm; the last is the
        direct term, at infinity.
    levels : dict
        Logarithm of each channel's weighted norm.
    """

    closed: Closed
    response: Response
    peaks: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    levels: dict[int, float] = field(default_factory=dict)


class PlantNorms:
    """One plant, closed again and again by controllers that differ little.

    Parameters
    ----------
    plant : OpenLoop
        The plant.
    """

    def __init__(self, plant: OpenLoop) -> None:
        self.plant = plant
        self._remembered = np.zeros(0)

    def closed(self, gains_: Array) -> Loop | None:
        """Return the loop with K; None if it is not stable."""
        closed = self.plant.close(gains_)
        if closed is None or not np.isfinite(closed.a).all():
            return None
        response = Response(closed.a, closed.b, closed.c, closed.d)
        poles = response.poles
        if poles.size and not poles.real.max() < -_STABLE * np.abs(poles).max():
            return None
        return Loop(closed, response)

    def seen_above(self, loop: Loop, level: float) -> bool:
        """Say whether a gain at a remembered peak is above a level (a logarithm) already."""
        if not self._remembered.size or not np.isfinite(level):
            return False
        responses = loop.response((1j * self._remembered).astype(complex))
        for c, (rows, columns, channel) in enumerate(self.plant.channels):
            if channel.limit is None and channel.norm == "hinf":
                high = float(gains(responses[:, rows][:, :, columns]).max())
                if high > 0.0 and np.log(self.plant.weights[c] * high) > level:
                    return True
        return False

    def measure(self, loop: Loop) -> None:
        """Find the peaks and norms of all channels."""
        points = frequencies(loop.response.poles, self._remembered)
        responses: Complex | None = None
        for c, (rows, columns, channel) in enumerate(self.plant.channels):
            if channel.norm == "h2":
                high = h2(loop.closed, rows, columns)
            else:
                if responses is None:
                    responses = loop.response((1j * points).astype(complex))

                def part(g: Complex, rows: Integers = rows, columns: Integers = columns) -> Complex:
                    return g[:, rows][:, :, columns]

                values = gains(part(responses))
                at, peak = refined_peaks(loop.response, part, points, values)
                direct = np.linalg.norm(loop.closed.d[np.ix_(rows, columns)], 2)
                loop.peaks[c] = np.append(at, np.inf), np.append(peak, direct)
                high = float(loop.peaks[c][1].max())
            loop.levels[c] = float(np.log(max(self.plant.weights[c] * high, 1e-300)))

    def remember(self, loop: Loop, more: bool) -> None:
        """Take the loop's peaks for the next ones, and of those known all if `more`, or half."""
        if not loop.peaks:
            return
        omega = np.concatenate([o[v >= _NEAR * v.max()] for o, v in loop.peaks.values()])
        fastest = float(np.abs(loop.response.poles).max(initial=0.0))
        omega = omega[omega < 10.0 * fastest]
        kept = self._remembered if more else self._remembered[: _REMEMBERED // 2]
        together = np.concatenate([omega, kept])
        _, first = np.unique(np.round(np.log(together + 1e-300), 2), return_index=True)
        self._remembered = together[np.sort(first)][:_REMEMBERED]

    def forget(self) -> None:
        """Drop what is remembered, so that a start does not depend on those before it."""
        self._remembered = np.zeros(0)

    def missed(self, loop: Loop, above: float) -> bool:
        """Say whether a certified norm shows a peak that was not known, and remember it.

        Channels whose level is below `above` are not looked at.
        """
        found = False
        for c, (rows, columns, channel) in enumerate(self.plant.channels):
            if channel.norm == "h2" or loop.levels[c] < above:
                continue
            norm = hinf_norm(part_of(loop.closed, rows, columns))
            known = np.exp(loop.levels[c]) / self.plant.weights[c]
            if norm.value > known * (1.0 + _ROUNDING) and np.isfinite(norm.frequency_rad_s):
                found = True
                kept = self._remembered[: _REMEMBERED - 1]
                self._remembered = np.insert(kept, 0, norm.frequency_rad_s)
        return found


def part_of(closed: Closed, rows: Integers, columns: Integers) -> LtiSystem:
    """Return the closed loop from some w to some z."""
    return LtiSystem(
        closed.a, closed.b[:, columns], closed.c[rows], closed.d[np.ix_(rows, columns)]
    )
