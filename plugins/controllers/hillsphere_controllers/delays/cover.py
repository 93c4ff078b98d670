r"""Delays as Padé approximations with their error as uncertain dynamics, for robust synthesis.

With x = ω T and the denominator Q of the diagonal Padé approximation P of order N,

.. math::

    |e^{-jx} - P(jx)| = 2 |\sin \tfrac12 ψ(x)|, \qquad ψ(x) = x - 2 \arg Q(jx), \qquad
    ψ'(x) = \Bigl(\frac{N!}{(2N)!}\Bigr)^2 \frac{x^{2N}}{|Q(jx)|^2} > 0,

since the numerator of 1 − 2 d(arg Q)/dx is a polynomial of degree 2N, and the error is of the order
2N + 1 at zero. With :math:`|Q(jx)| \ge 1`, :math:`ψ \le c x^{2N+1}`,
:math:`c = (N!)^2 / ((2N)!\,(2N+1)!)`. The error therefore rises to 2, where ψ = π, and the gain of

.. math::

    W(s) = 2 (1 + ε) \Bigl(\frac{s T}{s T + a}\Bigr)^r, \qquad r \le 2N + 1,

which rises too, covers it on an interval if it does so at the left end for the error at the right
end. The largest a for which this proves the cover is taken.

A delay of which only a range T ± δ is known has the phase error :math:`ψ(x) \pm ρ x` at most, with
ρ = δ/T. The same proof then holds for :math:`ψ + ρ x`, which rises too but is of the first order at
zero: r is one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from math import factorial

import numpy as np
from scipy.optimize import brentq

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.linear_fractional.algebra import diagonal, dynamics, star
from hillsphere_controllers.linear_fractional.transformation import Lft, constant
from hillsphere_controllers.systems.algebra import series
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.delay import pade_delay

__all__ = ["pade_cover", "pade_error_weight"]

_EXCESS = 0.25
"""ε: the weight tends to 2.5, where the error is 2. A smaller one makes the weight larger at low
frequencies, of which a loop needs the accuracy: for r = 2, a is half of the x at which ψ = π; for
ε = 0.1 it would be a third."""
_STEPS = 4000
"""Intervals of the proof, evenly spaced in the logarithm of x: each covers 0.3 % of x, so that the
error rises by 3 % at most for N = 4 between its ends."""
_SMALL = 1e-3
"""First x of the intervals, relative to that at which ψ = π; below it the power law is used."""
_BISECTIONS = 40
"""Halvings of the range of a: it is known to 12 digits then."""
_PHASE = 1e-9
"""Rounding of ψ at most: the zeros of Q are known to ten digits for N = 8."""
_ROUNDING = 1e-9
"""Share by which the weight exceeds the error at least, far above the rounding of both."""


def pade_cover(
    system: DelaySystem,
    order: int = 1,
    *,
    weight_order: int | None = None,
    spread_s: float | Sequence[float] = 0.0,
) -> Lft:
    """Return an uncertain system without delays that contains the system with delays.

    Each delay is P(s T) + W(s T) Δ with any stable Δ of norm at most one. What holds for all Δ,
    such as the robust stability and performance of a loop, holds for the delays.

    Parameters
    ----------
    system : DelaySystem
        With q delays.
    order : int
        N of the approximations, from 1 to 8.
    weight_order : int, optional
        r of the weights, from 1 to 2N + 1, by default 2; 1 for a delay with a spread. Each delay
        adds N + r states.
    spread_s : float or sequence of float
        How much longer or shorter a delay may be than the system says, s, from 0 to its length; one
        number for all of them. A delay is constant, but anywhere in its range.

    Returns
    -------
    Lft
        With the uncertainties ``delay1`` to ``delayq``, independent even for equal delays.

    Raises
    ------
    InputError
        If there is no delay, an order or a spread is out of range, or the loops with the
        approximations are not well posed.
    """
    if not system.delays_s:
        raise InputError("the system has no delays to cover")
    spreads = np.asarray(spread_s)
    if spreads.dtype.kind not in "iuf" or spreads.shape not in ((), (1,), (len(system.delays_s),)):
        raise InputError(
            f"spread_s: one spread, s, or one for each of {len(system.delays_s)} delays, got "
            f"{spread_s!r}"
        )
    blocks = [
        constant(pade_delay(time, order))
        + dynamics(
            f"delay{k + 1}", weight=pade_error_weight(time, order, weight_order, spread_s=spread)
        )
        for k, (time, spread) in enumerate(
            zip(system.delays_s, np.broadcast_to(spreads, len(system.delays_s)), strict=True)
        )
    ]
    q = len(blocks)
    return star(constant(system.system), diagonal(*blocks), q, q)


def pade_error_weight(
    time_s: float, order: int = 1, weight_order: int | None = None, *, spread_s: float = 0.0
) -> LtiSystem:
    """Return a stable weight that the error of a Padé approximation exceeds at no frequency.

    Parameters
    ----------
    time_s : float
        T, s.
    order : int
        N, from 1 to 8.
    weight_order : int, optional
        r, from 1 to 2N + 1, by default 2; 1 with a spread.
    spread_s : float
        δ, from 0 to T: the approximation of T s stands for all delays from T − δ to T + δ.

    Returns
    -------
    LtiSystem
        W, 1 × 1, of r states, with r zeros at s = 0.

    Raises
    ------
    InputError
        If the time is not positive, or an order or the spread out of range.
    """
    pade_delay(time_s, order)  # refuses what is out of range
    if not 0.0 <= spread_s <= time_s:
        raise InputError(f"a spread must be from 0 to the delay, {time_s:g} s, got {spread_s}")
    most = 1 if spread_s else 2 * order + 1
    r = min(2, most) if weight_order is None else weight_order
    if not 1 <= r <= most:
        range_ = "1 for a delay with a spread" if spread_s else f"from 1 to {most}"
        raise InputError(
            f"the order of the weight must be {range_}, with a Padé approximation of order "
            f"{order}, got {r}"
        )
    corner = _corner(order, r, float(spread_s / time_s)) / time_s
    one = transfer_function([1.0, 0.0], [1.0, corner])
    return series(*[one] * r) * (2.0 * (1.0 + _EXCESS))


@cache
def _corner(order: int, weight_order: int, spread: float) -> float:
    """Return the largest a for which the cover is proved, for ρ."""

    def phase_error(x: Array | float) -> Array:
        return _phase_error(x, order) + spread * np.asarray(x)

    # at x = 1, ψ is 1/12 at most
    full = brentq(
        lambda at: float(phase_error(at)[0]) - np.pi, 1.0 if spread else order, 8.0 * order
    )
    x = np.geomspace(_SMALL * full, full, _STEPS + 1)
    power = factorial(order) ** 2 / (factorial(2 * order) * factorial(2 * order + 1))
    # errors at the right ends; beyond the last one the error is at most 2
    phase = np.minimum(phase_error(x[1:]) + _PHASE, np.pi)
    by_power = power * x[1:] ** (2 * order + 1) + spread * x[1:]
    error = np.minimum(2.0 * np.sin(0.5 * phase), by_power)
    error = np.append(error, 2.0)
    low, high = 0.0, full
    for _ in range(_BISECTIONS):
        a = 0.5 * (low + high)
        gains = _gains(x, a, weight_order)
        # below the first x: c x^(2N+1) + ρ x ≤ 2 (1 + ε) (x/√(x₀² + a²))^r, hardest at x₀
        first = power * x[0] ** (2 * order + 1) + spread * x[0]
        small = first * (1.0 + _ROUNDING) <= gains[0]
        proved = small and bool((gains >= error * (1.0 + _ROUNDING)).all())
        low, high = (a, high) if proved else (low, a)
    return low


def _gains(x: Array, a: float, weight_order: int) -> Array:
    gains = 2.0 * (1.0 + _EXCESS) * (x / np.hypot(x, a)) ** weight_order
    return np.asarray(gains)


def _phase_error(x: Array | float, order: int) -> Array:
    """Return ψ at x, from the zeros of Q, which all lie in the open left half-plane."""
    zeros = pade_delay(1.0, order).poles
    at = np.atleast_1d(np.asarray(x, dtype=float))
    # arg Q(jx) is zero at zero, and each factor turns by less than π
    turned = np.angle(1j * at[:, None] - zeros).sum(axis=1)
    return np.asarray(at - 2.0 * turned)
