"""The norms of one plant's closed loop, with the memory of where its gain had peaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.analysis.hinf_norm import hamiltonian_eigenvalues, hinf_norm
from hillsphere_controllers.structured.closed_loop import Closed, OpenLoop
from hillsphere_controllers.structured.gradients import h2
from hillsphere_controllers.structured.peaks import (
    frequencies,
    gains,
    local_peaks,
    refined_peaks,
)

__all__ = ["Loop", "PlantNorms", "part_of"]

Complex = NDArray[np.complex128]

_STABLE = 1e-11
"""Poles count as stable when their real part is below minus this share of the fastest."""
_NEAR = 0.6
_NEAR_LIMIT = -0.5
"""Logarithms of norms relative to their limits above this are known well."""
_REMEMBERED = 12
_ROUNDING = 1e-9
_IMAGINARY = 1e-2
"""Eigenvalues this near the imaginary axis, relative to their size, are looked at."""


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
    rough : dict
        Frequencies and gains of the channels whose peaks were not refined yet.
    """

    closed: Closed
    response: Response
    peaks: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    levels: dict[int, float] = field(default_factory=dict)
    rough: dict[int, tuple[Array, Array]] = field(default_factory=dict)


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
        self._free = [channel.limit is None for _, _, channel in plant.channels]

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
        """Find the peaks and norms of all channels, roughly: to the next frequency looked at."""
        points = frequencies(loop.response.poles, self._remembered)
        responses: Complex | None = None
        for c, (rows, columns, channel) in enumerate(self.plant.channels):
            if channel.norm == "h2":
                loop.levels[c] = self._level(c, h2(loop.closed, rows, columns))
                continue
            if responses is None:
                responses = loop.response((1j * points).astype(complex))
            values = gains(responses[:, rows][:, :, columns])
            loop.rough[c] = points, values
            inner = local_peaks(values)
            self._take(loop, c, points[inner], values[inner])

    def highest(self, loop: Loop) -> float:
        """Return the logarithm of the largest weighted norm without a limit, −inf if none is."""
        free = (level for c, level in loop.levels.items() if self._free[c])
        return max(free, default=-np.inf)

    def refine(self, loop: Loop, above: float) -> None:
        """Refine the peaks of channels whose weighted norm is roughly above a logarithm.

        Those with a limit are refined where they are near it.
        """
        for c in list(loop.rough):
            rows, columns, channel = self.plant.channels[c]
            if loop.levels[c] < (above if channel.limit is None else _NEAR_LIMIT):
                continue

            def part(g: Complex, rows: Integers = rows, columns: Integers = columns) -> Complex:
                return g[:, rows][:, :, columns]

            self._take(loop, c, *refined_peaks(loop.response, part, *loop.rough.pop(c)))

    def _take(self, loop: Loop, c: int, at: Array, high: Array) -> None:
        rows, columns, _ = self.plant.channels[c]
        direct = np.linalg.norm(loop.closed.d[np.ix_(rows, columns)], 2)
        loop.peaks[c] = np.append(at, np.inf), np.append(high, direct)
        loop.levels[c] = self._level(c, float(loop.peaks[c][1].max()))

    def _level(self, c: int, norm: float) -> float:
        return float(np.log(max(self.plant.weights[c] * norm, 1e-300)))

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
        """Say whether the level-set method shows a gain that was not known, and remember where.

        Parameters
        ----------
        loop : Loop
            The loop.
        above : float
            Logarithm of the level that weighted norms are tested against, or the channel's own
            where that is higher; of those with a limit, the limit.
        """
        found = False
        for c, (rows, columns, channel) in enumerate(self.plant.channels):
            if channel.norm == "h2":
                continue
            least = above if channel.limit is None else 0.0
            level = np.exp(max(loop.levels[c], least)) / self.plant.weights[c] * (1.0 + _ROUNDING)

            def part(g: Complex, rows: Integers = rows, columns: Integers = columns) -> Complex:
                return g[:, rows][:, :, columns]

            higher = _higher(part_of(loop.closed, rows, columns), loop.response, part, level)
            if higher is not None:
                found = True
                kept = self._remembered[: _REMEMBERED - 1]
                self._remembered = np.insert(kept, 0, higher)
        return found


def _higher(
    system: LtiSystem, response: Response, part: Callable[[Complex], Complex], level: float
) -> float | None:
    """Return a frequency at which the gain of a part is above a level; None if there is none."""
    if np.linalg.norm(system.d, 2) > (1.0 - 1e-6) * level:  # the method's matrix is singular there
        norm = hinf_norm(system)
        above = norm.value > level and np.isfinite(norm.frequency_rad_s)
        return norm.frequency_rad_s if above else None
    values = hamiltonian_eigenvalues(system, level)
    crossed = np.abs(values[np.abs(values.real) <= _IMAGINARY * np.abs(values)].imag)
    if not crossed.size:
        return None
    omega = np.unique(np.append(crossed, 0.0))  # the gain may be above from zero on
    omega = np.concatenate([omega, 0.5 * (omega[1:] + omega[:-1])])
    high = gains(part(response((1j * omega).astype(complex))))
    best = int(np.argmax(high))
    return float(omega[best]) if high[best] > level else None


def part_of(closed: Closed, rows: Integers, columns: Integers) -> LtiSystem:
    """Return the closed loop from some w to some z."""
    return LtiSystem(
        closed.a, closed.b[:, columns], closed.c[rows], closed.d[np.ix_(rows, columns)]
    )
