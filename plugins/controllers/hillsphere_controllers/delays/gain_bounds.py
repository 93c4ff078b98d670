r"""Bounds of the gain of a system with delays on intervals of frequency.

On an interval about ω_c, with δ the distance from it, `expansion` gives

.. math::

    G(ω) = G_c + δ G_c' + R, \qquad
    |R| \le |L| \barΘ_2 |X| + |L| \barΘ \bar Y (I - \bar Y)^{-1} |X| + \text{rounding},

with :math:`\barΘ_2 = \operatorname{diag}(0, \tfrac12 T^2 δ^2)` and
:math:`\bar Y = |F| + |H| \barΘ`. The norm of the affine part is convex in δ, hence largest at an
end of the interval; its excess over the gain falls with the square of the width.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.delays.expansion import Pencil, bound_perturbed

__all__ = ["Enclosure", "GainPeak", "bound_gains", "enclose_response", "search_peak"]

Complex = NDArray[np.complex128]

_MOST = 200_000
"""Intervals at most, as in `stability`; the bounds reached by then are returned."""
_NOISE = 4.0
"""Multiple of the rounding of a gain within which its bound is not brought lower by division."""
_EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class GainPeak:
    """The largest gain on intervals.

    Parameters
    ----------
    value : float
        A gain that the response has, but for its error.
    frequency_rad_s : float
        Where.
    error : float
        Bound of its rounding, relative to it.
    upper : float
        Proved bound on all the intervals.
    """

    value: float
    frequency_rad_s: float
    error: float
    upper: float


def search_peak(pencil: Pencil, cuts: Array, tolerance: float, known: GainPeak) -> GainPeak:
    """Return the largest gain between the first and the last of some frequencies.

    Parameters
    ----------
    pencil : Pencil
        Of a system.
    cuts : ndarray, shape (K,)
        Ends of the first intervals, rad/s, in order.
    tolerance : float
        Relative distance of the bounds at which an interval is settled.
    known : GainPeak
        A gain that is reached elsewhere: nothing below it is looked at.

    Returns
    -------
    GainPeak
        The larger one of the known and the new gain. The bound is that of these intervals alone.
    """
    best, count, highest = known, 0, 0.0
    lo, hi = cuts[:-1], cuts[1:]
    while lo.size:
        middle = 0.5 * (lo + hi)
        # the centre is rounded too
        half = 0.5 * (hi - lo) + 2.0 * _EPS * hi
        upper, noise = np.empty(lo.size), np.empty(lo.size)
        for at in pencil.chunks(middle):
            gains, errors, upper[at] = bound_gains(pencil, middle[at], half[at])
            noise[at] = gains + _NOISE * errors
            k = int(np.argmax(gains))
            if gains[k] > best.value:
                error = float(errors[k] / gains[k])
                best = GainPeak(float(gains[k]), float(middle[at][k]), error, 0.0)
        count += lo.size
        settled = upper <= best.value * (1.0 + tolerance)
        if count > _MOST:
            settled[:] = True
        # rounding alone keeps the bound up
        settled |= (upper <= noise) | (half <= 8.0 * _EPS * hi)
        highest = max(highest, float(upper[settled].max(initial=0.0)))
        lo, hi, middle = lo[~settled], hi[~settled], middle[~settled]
        lo, hi = np.concatenate([lo, middle]), np.concatenate([middle, hi])
    return GainPeak(best.value, best.frequency_rad_s, best.error, highest)


def bound_gains(pencil: Pencil, middle: Array, half: Array) -> tuple[Array, Array, Array]:
    """Return gains at frequencies, their rounding errors, and upper bounds near the frequencies.

    Parameters
    ----------
    pencil : Pencil
        Of a system.
    middle, half : ndarray, shape (K,)
        Centres and half widths of intervals, rad/s.

    Returns
    -------
    gains, errors, uppers : ndarray, shape (K,)
        Largest singular values at the centres, bounds of their errors, and bounds of the largest
        singular values on the intervals; infinite where the interval is too wide for a bound.
    """
    made = enclose_response(pencil, middle, half)
    gains = largest_gains(made.centre)
    move = half[:, None, None] * made.slope
    ends = np.maximum(largest_gains(made.centre - move), largest_gains(made.centre + move))
    unit = 4.0 * (pencil.size + 3) * _EPS
    uppers = (ends + np.linalg.norm(made.rest, axis=(1, 2))) * (1.0 + unit)
    uppers[~np.isfinite(uppers)] = np.inf
    return gains, made.errors, uppers


@dataclass(frozen=True)
class Enclosure:
    """The response of a system near K frequencies: that of an affine function, and a rest.

    Parameters
    ----------
    centre, slope : ndarray, shape (K, p, m)
        Response at the frequencies, and its derivative by frequency.
    rest : ndarray, shape (K, p, m)
        Bound of the distance from the affine function on the intervals, entry by entry, rounding
        included; infinite where an interval is too wide for a bound.
    errors : ndarray, shape (K,)
        Bound of the rounding of the response at the frequencies, as a norm.
    """

    centre: Complex
    slope: Complex
    rest: Array
    errors: Array


def enclose_response(pencil: Pencil, middle: Array, half: Array) -> Enclosure:
    """Return the response near frequencies with a bound of what an affine function leaves.

    Parameters
    ----------
    pencil : Pencil
        Of a system.
    middle, half : ndarray, shape (K,)
        Centres and half widths of intervals, rad/s.
    """
    e = pencil.expand(middle)
    n, late, size = len(pencil.a), pencil.late(middle), pencil.size
    turn = pencil.turn(middle, half)
    y = e.residual + e.h_bound * turn[:, None, :]
    x = np.abs(e.x) + e.x_rounding
    bar = bound_perturbed(y, x)
    # without the turn: what rounding alone can have changed at the centre
    there = bound_perturbed(e.residual, x)
    slope = np.empty((middle.size, size), dtype=complex)
    slope[:, :n] = -1j
    slope[:, n:] = -1j * pencil.times * late
    first = e.left @ (slope[:, :, None] * e.x)
    second = np.zeros((middle.size, size))
    second[:, n:] = 0.5 * (half[:, None] * pencil.times) ** 2
    large = np.abs(e.left)
    with np.errstate(invalid="ignore", over="ignore"):
        unit = 4.0 * (size + 3) * _EPS
        phase = 4.0 * _EPS * middle[:, None] * pencil.times
        rounding = unit * (e.out @ x + np.abs(pencil.d_yu)) + e.out @ e.x_rounding
        rounding += (np.abs(pencil.d_yw) * phase[:, None, :]) @ x[:, n:]
        size_l = large + e.out @ (e.h_bound - np.abs(e.h)) + unit * (e.out @ np.abs(e.h))
        size_l[:, :, n:] += unit * np.abs(pencil.d_yw)
        rest = size_l @ (second[:, :, None] * x)
        rest += size_l @ (turn[:, :, None] * (y @ bar)) + e.out @ (e.residual @ bar) + rounding
        # rounding of the slope
        steep = np.abs(slope)[:, :, None]
        most = (1.0 + unit) * (size_l @ (steep * x))
        rest += half[:, None, None] * (most - large @ (steep * np.abs(e.x)))
        errors = np.linalg.norm(rounding + e.out @ (e.residual @ there), axis=(1, 2))
    rest[~np.isfinite(rest)] = np.inf
    return Enclosure(e.g, first, rest, errors)
