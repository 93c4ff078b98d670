r"""Gain, phase and delay margins of loops with delays, from crossings none of which is missed.

With negative feedback, L = T/(1 − T) for the closed loop T. Where T is stable it has no pole on
the axis, whatever L has, and

.. math::

    |L| = 1 \iff \operatorname{Re} T = \tfrac12, \qquad
    L = -\tfrac1k < 0 \iff T = \frac{1}{1 - k} \text{ real, } T < 0 \text{ or } T > 1 .

On intervals of frequency T is enclosed (`gain_bounds`). An interval that is shown to have no
crossing of either kind, or none of a factor k nearer to one than those known, is settled; others
are halved until they are as narrow as rounding. Beyond the last interval T is too small for a
crossing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.analysis.margins import LoopMargins
from hillsphere_controllers.analysis.margins import loop_margins as margins_without_delays
from hillsphere_controllers.delays.algebra import feedback
from hillsphere_controllers.delays.direct_gain import bound_direct_gain
from hillsphere_controllers.delays.direct_loop import bound_direct_loop
from hillsphere_controllers.delays.expansion import Pencil
from hillsphere_controllers.delays.gain_bounds import enclose_response
from hillsphere_controllers.delays.norms import bound_tail
from hillsphere_controllers.delays.stability import balance_pencil, bound_frequency, judge_stability
from hillsphere_controllers.delays.system import (
    DelayOperand,
    DelaySystem,
    as_delay_system,
    connect_delay_systems,
)

__all__ = ["loop_margins"]

_LARGEST = 1e6
"""Factors of the gain above this, or below its inverse, are not looked for. A loop with a pole at
zero has T = 1 there, but for rounding, which would be a factor of next to nothing."""
_NARROW = 1e-10
"""Half width of an interval, relative to its frequency, at which it counts as a crossing."""
_REST = 1e-12
"""Half width, relative to the first end of the axis, at which an interval about zero does."""
_FIRST = 64
"""Intervals of the first part of the axis, to twice the bound of the poles, and of each octave."""
_OCTAVES = 24
"""Octaves at most: beyond, a loop of 1/ω is 1e-7, and no factor looked for is left."""
_MOST = 200_000
"""Intervals at most, as in `stability`."""


def loop_margins(loop: DelayOperand) -> tuple[LoopMargins, ...]:
    """Return the margins of each channel of a loop with delays, the others closed.

    Parameters
    ----------
    loop : DelaySystem or LtiSystem
        L, as many outputs as inputs, closed by negative feedback; without direct terms.

    Returns
    -------
    tuple of LoopMargins
        One per channel. All crossings lie in intervals that were not excluded by proof, as narrow
        as 1e-10 of their frequency. Factors of the gain are looked for from 1e-6 to 1e6.

    Raises
    ------
    InputError
        If the loop is not square, or has a direct term: crossings have no last one then.
    ConvergenceError
        If the stability is undecided, or too many intervals are left, as where a curve runs along
        the unit circle.
    """
    given = as_delay_system(loop, "the loop")
    p, m = given.shape
    if p != m or not p:
        raise InputError(f"a loop has as many outputs as inputs, got {p} × {m}")
    if not given.delays_s:
        return margins_without_delays(given.system)
    closed = judge_stability(feedback(given, np.eye(p)))
    if closed.stable is None:
        raise ConvergenceError(f"whether the closed loop is stable is undecided: {closed.reason}")
    if not closed.stable:
        return (LoopMargins(False, 1.0, 1.0, np.nan, np.nan, 0.0, np.nan, 0.0, np.nan),) * p
    return tuple(_channel_margins(_single_loop(given, k)) for k in range(p))


def _single_loop(loop: DelaySystem, channel: int) -> DelaySystem:
    """Return the loop of one channel, the others closed."""
    others = -np.eye(loop.shape[0])
    others[channel, channel] = 0.0
    one = np.eye(loop.shape[0])[:, channel : channel + 1]
    return connect_delay_systems((loop,), others, one, one.T)


@dataclass
class _Crossings:
    """Crossings found, and the factors nearest to one."""

    lower: tuple[float, float] = (1.0 / _LARGEST, np.nan)
    upper: tuple[float, float] = (_LARGEST, np.nan)
    unit: list[tuple[float, complex]] = field(default_factory=list)
    count: int = 0

    @property
    def reaches(self) -> tuple[float, float]:
        """T of the two factors: only a real T below the first or above the second is nearer."""
        return 1.0 / (1.0 - self.upper[0]), 1.0 / (1.0 - self.lower[0])

    def search(self, pencil: Pencil, cuts: Array, least: float) -> None:
        """Add the crossings between the first and the last of some frequencies."""
        low, high = cuts[:-1], cuts[1:]
        while low.size:
            self.count += low.size
            if self.count > _MOST:
                raise ConvergenceError(
                    f"the margins are undecided: near {low[0]:.6g} rad/s too many intervals are "
                    "left, since the loop runs along the unit circle or the real axis there"
                )
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            # the centre is rounded too
            wide = half + 4.0 * np.finfo(float).eps * high
            kept = np.empty(low.size, dtype=bool)
            for at in pencil.chunks(middle):
                kept[at] = self._look(pencil, middle[at], half[at], wide[at], least)
            low, high, middle = low[kept], high[kept], middle[kept]
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])

    def _look(
        self, pencil: Pencil, middle: Array, half: Array, wide: Array, least: float
    ) -> np.ndarray:
        """Return which intervals are to be halved; those narrow enough count as crossings."""
        made = enclose_response(pencil, middle, wide)
        t, slope, rest = made.centre[:, 0, 0], made.slope[:, 0, 0], made.rest[:, 0, 0]
        along, across = (wide * np.abs(part) + rest for part in (slope.real, slope.imag))
        below, above = self.reaches
        unit = np.abs(t.real - 0.5) <= along
        real = np.abs(t.imag) <= across
        real &= (t.real - along < below) | (t.real + along > above)
        unknown = ~np.isfinite(rest)
        narrow = half <= np.maximum(_NARROW * middle, least)
        if (unknown & narrow).any():
            raise ConvergenceError("the margins are undecided: rounding hides the response")
        at = np.where(middle <= 2.0 * least, 0.0, middle)
        for k in np.flatnonzero(narrow & unit):
            self.unit.append((float(at[k]), complex(t[k] / (1.0 - t[k]))))
        for k in np.flatnonzero(narrow & real):
            factor = 1.0 - 1.0 / float(t[k].real)
            if t[k].real < 0.0:
                self.upper = min(self.upper, (factor, float(at[k])))
            elif t[k].real > 1.0:
                self.lower = max(self.lower, (factor, float(at[k])))
        return np.asarray((unit | real | unknown) & ~narrow)


def _channel_margins(loop: DelaySystem) -> LoopMargins:
    pencil = balance_pencil(feedback(loop, np.eye(1)))
    direct = bound_direct_loop(pencil.d, pencil.times)
    inverse = direct.inverse_bound
    if inverse is None or bound_direct_gain(pencil, inverse, 1e-3).upper > 0.0:
        raise InputError(
            "a loop with delays and a direct term crosses the axes at frequencies without end: its "
            "margins are not computed; delay_margin gives the extra delay, hinf_norm of the "
            "sensitivity the distance from instability; a fast lag removes the direct term"
        )
    found = _Crossings()
    end = 2.0 * bound_frequency(pencil, direct)
    least = _REST * end
    found.search(pencil, np.linspace(0.0, end, _FIRST + 1), least)
    for _ in range(_OCTAVES):
        _, tail = bound_tail(pencil, inverse, 0.0, np.inf, end)
        # beyond: |T| < 1/2 has no crossing of the unit circle, and a real one no nearer factor
        if tail < 0.5 and tail <= -found.reaches[0]:
            break
        found.search(pencil, np.linspace(end, 2.0 * end, _FIRST + 1), least)
        end *= 2.0
    else:
        raise ConvergenceError(
            f"the margins are undecided: beyond {end:.3g} rad/s the loop is not shown to be small"
        )
    (lower, lower_at), (upper, upper_at) = found.lower, found.upper
    phase, delay = (np.pi, np.nan), (np.inf, np.nan)
    for omega, value in found.unit:
        lag = float(np.angle(-value)) % (2.0 * np.pi)
        phase = min(phase, (min(lag, 2.0 * np.pi - lag), omega), key=lambda pair: pair[0])
        if omega > 0.0:
            delay = min(delay, (lag / omega, omega), key=lambda pair: pair[0])
    return LoopMargins(
        True, 0.0 if np.isnan(lower_at) else lower, np.inf if np.isnan(upper_at) else upper,
        lower_at, upper_at, *phase, *delay,
    )  # fmt: skip
