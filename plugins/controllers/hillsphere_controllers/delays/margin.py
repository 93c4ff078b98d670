r"""Delay margin: the extra delay of all channels at once up to which a loop stays stable.

The proof of `stability.cover_axis` holds for all delays of an interval. As long as no pole is on
the axis, the number of poles on the right does not change; they stay below a bound that no delay
enters. Intervals of the extra delay are taken one after the other until none is proved that is as
long as the tolerance; just beyond, poles are counted on the right.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere_controllers.delays.algebra import delay, feedback
from hillsphere_controllers.delays.direct_loop import bound_direct_loop
from hillsphere_controllers.delays.stability import (
    balance_pencil,
    bound_frequency,
    cover_axis,
    judge_stability,
)
from hillsphere_controllers.delays.system import DelayOperand, as_delay_system

__all__ = ["DelayMargin", "delay_margin"]

_MOST = 2000
"""Intervals of the axis at most for one interval of the delay: where more are needed, a shorter
interval of the delay is cheaper."""
_FIRST = 0.1
"""First half interval of the delay, times the bound of the poles: a turn of 0.1 rad there."""
_SHARE = 0.125
"""Share of the tolerance below which an interval of the delay is not halved again: the proof ends
before the margin by about as much, and so far beyond are poles counted first."""
_BEYOND = (1.0, 2.0, 4.0, 8.0)
"""Distances beyond the proved delay at which poles are counted, times that share."""


@dataclass(frozen=True)
class DelayMargin:
    """Bounds of the delay margin.

    Parameters
    ----------
    lower_s : float
        Stable for all extra delays from zero to this, by proof; zero if the loop is not stable.
    upper_s : float
        Not stable for this extra delay, by proof; infinite where none was found.
    reason : str
        Why the bounds are apart by more than the tolerance; empty otherwise.
    """

    lower_s: float
    upper_s: float
    reason: str = ""


def delay_margin(loop: DelayOperand, longest_s: float, *, tolerance: float = 1e-3) -> DelayMargin:
    """Return bounds of the extra delay that a loop closed by negative feedback tolerates.

    Parameters
    ----------
    loop : DelaySystem or LtiSystem
        As many outputs as inputs; every channel gets the extra delay.
    longest_s : float
        Delay up to which it is looked for, s.
    tolerance : float
        Relative distance of the bounds, from 1e-6.

    Returns
    -------
    DelayMargin
        The bounds.

    Raises
    ------
    InputError
        If the loop is not square, or a number out of range.
    """
    given = as_delay_system(loop, "the loop")
    p, m = given.shape
    if p != m or not p:
        raise InputError(f"a loop has as many outputs as inputs, got {p} × {m}")
    if not (0.0 < longest_s < np.inf and 1e-6 <= tolerance < 1.0):
        raise InputError(
            f"a longest delay > 0 s and a tolerance from 1e-6 to 1 are needed, got {longest_s} "
            f"and {tolerance}"
        )
    now = judge_stability(feedback(given, np.eye(p)))
    if now.stable is not True:
        upper = 0.0 if now.stable is False else np.inf
        return DelayMargin(0.0, upper, now.reason)
    pencil = balance_pencil(feedback(delay(1.0, p) @ given, np.eye(p)))
    extra = np.zeros(len(pencil.times))
    extra[:p] = 1.0
    # delays that are equal now need not stay so: their phases count as independent
    direct = bound_direct_loop(pencil.d, np.arange(1.0, len(pencil.times) + 1.0))
    if direct.inverse_bound is None:
        reason = "its direct terms are not strongly stable with an extra delay"
        return DelayMargin(0.0, np.inf, reason)
    radius = 1.01 * bound_frequency(pencil, direct)
    proved, half = 0.0, min(_FIRST / radius, 0.5 * longest_s)
    while proved < longest_s:
        half = min(half, 0.5 * (longest_s - proved))
        middle = proved + half
        times = np.where(extra > 0.0, middle, pencil.times)
        at = replace(pencil, times=times)
        # a share more, for the rounding of the ends
        spread = extra * (half + 1e-15 * middle) * (1.0 + 1e-12)
        if not cover_axis(at, radius, spread=spread, most=_MOST)[1]:
            proved, half = middle + half, 2.0 * half
        else:
            half *= 0.5
            if 2.0 * half < _SHARE * tolerance * max(proved, tolerance / radius):
                break
    if proved >= longest_s * (1.0 - 1e-12):
        return DelayMargin(longest_s, np.inf, "")
    for share in _BEYOND:
        later = proved + _SHARE * share * tolerance * max(proved, tolerance / radius)
        found = judge_stability(feedback(delay(later, p) @ given, np.eye(p)))
        if found.stable is False:
            apart = later > proved * (1.0 + tolerance * (1.0 + 1e-9))
            return DelayMargin(proved, later, "the bounds are apart" if apart else "")
    return DelayMargin(
        proved, np.inf, "poles come near the axis there, but none was found on the right beyond"
    )
