r"""H∞ and H2 norms of systems with delays.

The gains are bounded on intervals of frequency (`gain_bounds`). Beyond the last one, the response
is that of the direct terms, for any phases of the delays, and a part that falls with the frequency:
with :math:`\bar X` of `stability`, :math:`|(jω I - X)^{-1}| \le (ω I - \bar X)^{-1}`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.analysis.h2_norm import h2_norm as h2_norm_without_delays
from hillsphere_controllers.analysis.hinf_norm import HinfNorm
from hillsphere_controllers.analysis.hinf_norm import hinf_norm as hinf_norm_without_delays
from hillsphere_controllers.delays.direct_gain import bound_direct_gain
from hillsphere_controllers.delays.direct_loop import bound_direct_loop
from hillsphere_controllers.delays.expansion import Pencil, bound_perturbed
from hillsphere_controllers.delays.gain_bounds import GainPeak, bound_gains, search_peak
from hillsphere_controllers.delays.stability import (
    balance_pencil,
    bound_frequency,
    judge_stability,
)
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.systems.algebra import close_with_gain

__all__ = ["bound_tail", "h2_norm", "hinf_norm"]

_FINE = 1e-9
"""Tolerance where no delays are left, that of `hillsphere_controllers.analysis.hinf_norm`."""
_FIRST = 64
"""Intervals of the first look, evenly spaced up to twice the bound of the poles, and again in the
logarithm of frequency."""
_DECADES = 4.0
"""Decades below the bound of the poles at which the logarithmic spacing begins; a peak below is
found by subdivision."""
_FARTHEST = 2.0**60
"""Last frequency relative to twice the bound of the poles at which the tail is looked at: a part
that falls as 1/ω is then rounding."""
_WAVES = 300.0
"""Turns of the longest delay at the last frequency, where it joins direct terms: each needs some
hundred intervals if the norm is reached at infinity. The bound of the tail is what it is there."""
_NEAR = 1e-6
"""Share of the bound of the direct terms below which the rest of the tail does not matter."""
_TURNS, _SAMPLES = 64.0, 4097
"""Turns of the shortest delay, and frequencies, at which a system without states is looked at, if
its delays have several lengths; its upper bound is of all phases."""
_EPS = float(np.finfo(float).eps)


def hinf_norm(system: DelaySystem, tolerance: float = 1e-4) -> HinfNorm:
    """Return the H∞ norm of a system with delays: a gain that it has, and a proved upper bound.

    Parameters
    ----------
    system : DelaySystem
        Any.
    tolerance : float
        Relative distance between the bounds that is tried for, from 1e-10. The number of intervals
        grows as its root.

    Returns
    -------
    HinfNorm
        Infinite if the system is not stable. At infinite frequency the value is the limit superior.
        The upper bound is farther away where the direct terms meet several delays of different
        lengths, whose phases are bounded as if they were independent.

    Raises
    ------
    InputError
        If the tolerance is out of range.
    ConvergenceError
        If the stability is undecided, or a bound of the direct terms is not found: then no norm is
        known.
    """
    if not 1e-10 <= tolerance < 1.0:
        raise InputError(f"tolerance must be from 1e-10 to 1, got {tolerance}")
    inner = _drop_delays_at_ends(system)
    if not inner.delays_s:
        return hinf_norm_without_delays(inner.system, min(tolerance, _FINE))
    stability = judge_stability(inner)
    if stability.stable is None:
        raise ConvergenceError(f"whether the system is stable is undecided: {stability.reason}")
    if not stability.stable:
        return HinfNorm(np.inf, np.nan, np.inf)
    if 0 in system.shape:
        return HinfNorm(0.0, 0.0, 0.0)
    return _search(balance_pencil(inner), tolerance)


def _search(pencil: Pencil, tolerance: float) -> HinfNorm:
    """Return the norm of a stable system."""
    direct = bound_direct_loop(pencil.d, pencil.times)
    loop = direct.inverse_bound
    if loop is None:
        raise ConvergenceError(f"the direct terms are not bounded: {direct.reason}")
    high = bound_direct_gain(pencil, loop, tolerance)
    if not len(pencil.a):
        if high.is_exact:
            return HinfNorm(high.lower, high.frequency_rad_s, high.upper, high.error)
        cuts = np.linspace(0.0, _TURNS * 2.0 * np.pi / pencil.times.min(), _SAMPLES)
        gains = bound_gains(pencil, cuts, np.zeros(cuts.size))[0]
        best = int(np.argmax(gains))
        return HinfNorm(float(gains[best]), float(cuts[best]), high.upper)
    top = bound_frequency(pencil, direct)
    cuts = np.unique(
        np.concatenate(
            [
                np.linspace(0.0, 2.0 * top, _FIRST + 1),
                top * np.logspace(-_DECADES, np.log10(2.0), _FIRST),
            ]
        )
    )
    gains, errors, _ = bound_gains(pencil, cuts, np.zeros(cuts.size))
    best = int(np.argmax(gains))
    size = float(gains[best])
    known = GainPeak(size, float(cuts[best]), float(errors[best]) / size if size else 0.0, 0.0)
    if high.lower > known.value:
        known = GainPeak(high.lower, np.inf, high.error, 0.0)
    end, tail = bound_tail(pencil, loop, high.upper, known.value * (1.0 + tolerance), cuts[-1])
    if end > cuts[-1]:
        octaves = np.arange(1, round(np.log2(end / cuts[-1])) + 1)
        cuts = np.concatenate([cuts, cuts[-1] * 2.0**octaves])
    peak = search_peak(pencil, cuts, tolerance, known)
    upper = max(peak.upper, tail, peak.value) * (1.0 + 4.0 * _EPS)
    return HinfNorm(peak.value, peak.frequency_rad_s, upper, peak.error)


def bound_tail(
    pencil: Pencil, loop: Array, direct: float, level: float, start: float
) -> tuple[float, float]:
    """Return a frequency, start · 2ᵏ, and a bound of gains beyond it, below the level if it can.

    Parameters
    ----------
    pencil : Pencil
        Of a system.
    loop : ndarray, shape (q, q)
        Bound of the inverse of its direct loop.
    direct : float
        Bound of its direct terms.
    level, start : float
        The level asked for, and the first frequency, rad/s.

    Returns
    -------
    end_rad_s : float
        The frequency.
    tail : float
        Bound of the largest gain above it; infinite if none was found.
    """
    bar = np.abs(pencil.a) + np.abs(pencil.b) @ loop @ np.abs(pencil.c)
    into = np.abs(pencil.b_u) + np.abs(pencil.b) @ loop @ np.abs(pencil.d_zu)
    out = np.abs(pencil.c_y) + np.abs(pencil.d_yw) @ loop @ np.abs(pencil.c)
    waves = bool(pencil.d_yw.any() and (pencil.c.any() or pencil.d_zu.any()))
    waves |= bool(pencil.d.any() or (pencil.b.any() and pencil.d_zu.any()))
    longest = float(pencil.times.max(initial=0.0)) if waves else 0.0
    end = start
    while True:
        # |(jω I − X)⁻¹ B̄| ≤ (I − X̄/ω)⁻¹ B̄/ω, which falls with ω
        inside = bound_perturbed(bar[None] / end, into[None] / end)[0]
        rest = float(np.linalg.norm(out @ inside)) * (1.0 + 1e-9) if into.size else 0.0
        tail = direct + rest if np.isfinite(inside).all() else np.inf
        near = rest <= _NEAR * direct and tail > level
        too_far = end >= _FARTHEST * start or end * longest > 2.0 * np.pi * _WAVES
        if tail <= level or (np.isfinite(tail) and (near or too_far)):
            return end, tail
        end *= 2.0


def h2_norm(system: DelaySystem) -> float:
    """Return the H2 norm of a system whose delays are at its inputs and outputs.

    These are of gain one at all frequencies, and the norm is that of the system without them.

    Parameters
    ----------
    system : DelaySystem
        With delays through which an input must go, and nothing else does, or an output.

    Returns
    -------
    float
        The norm; infinite if the system is not stable or has a direct term.

    Raises
    ------
    InputError
        If a delay is inside: in a loop, between states, or in one of several paths.
    ConvergenceError
        As `hillsphere_controllers.analysis.h2_norm.h2_norm`.
    """
    inner = _drop_delays_at_ends(system)
    if inner.delays_s:
        late = ", ".join(f"{one:g}" for one in inner.delays_s)
        raise InputError(
            f"the H2 norm with delays inside the system is not computed: delays of {late} s are "
            "neither at one input nor at one output alone; h2_norm of approximate_delays gives "
            "that of a Padé approximation"
        )
    return h2_norm_without_delays(inner.system)


def _drop_delays_at_ends(system: DelaySystem) -> DelaySystem:
    """Return the system without the delays that every signal of one input or output takes alone."""
    while True:
        places = range(len(system.delays_s))
        place = next((k for k in places if _is_at_an_end(system, k)), None)
        if place is None:
            return system
        system = _drop_delay(system, place)


def _is_at_an_end(system: DelaySystem, place: int) -> bool:
    """Return whether a delay takes one input alone, which goes nowhere else, or so an output."""
    p, m = system.shape
    row, column = p + place, m + place
    b, c, d = system.system.b, system.system.c, system.system.d
    if not c[row].any() and np.count_nonzero(d[row]) == 1 and not d[row, m:].any():
        from_input = int(np.flatnonzero(d[row])[0])
        if not b[:, from_input].any() and np.count_nonzero(d[:, from_input]) == 1:
            return True
    if not b[:, column].any() and np.count_nonzero(d[:, column]) == 1 and not d[p:, column].any():
        to_output = int(np.flatnonzero(d[:, column])[0])
        return not c[to_output].any() and np.count_nonzero(d[to_output]) == 1
    return False


def _drop_delay(system: DelaySystem, place: int) -> DelaySystem:
    """Return the system with one delay zero."""
    (p, m), s = system.shape, system.system
    back = np.zeros((s.shape[1], s.shape[0]))
    back[m + place, p + place] = 1.0
    closed = close_with_gain(s, back)
    rows = [i for i in range(s.shape[0]) if i != p + place]
    columns = [j for j in range(s.shape[1]) if j != m + place]
    times = tuple(one for k, one in enumerate(system.delays_s) if k != place)
    return replace(system, system=closed[rows, columns], delays_s=times)
