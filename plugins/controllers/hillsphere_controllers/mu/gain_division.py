"""Branch and bound for the worst-case gain: the ranges of real parameters are divided.

Scalings prove one bound for the whole box of real parameters. Where that is far above the gain of
any perturbation found, as next to the border of stability, the bound of a part of the box is much
closer, and the largest over the parts holds for the whole [1]_. The part with the largest bound is
divided first, along the parameter with the largest share of it.

References
----------
.. [1] M. P. Newlin, P. M. Young (1997), Mixed µ problems and branch and bound techniques,
   International Journal of Robust and Nonlinear Control 7, 145-164.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.mu.division import restrict_to_part
from hillsphere_controllers.mu.sensitivities import sensitivities

__all__ = ["DividedGain", "divide_gain"]


@dataclass(frozen=True, eq=False)
class DividedGain:
    """Bounds of the gain over parts of the ranges of real parameters.

    Parameters
    ----------
    upper : float
        The largest over the parts of their certified bounds.
    lower : float
        The largest gain at the middle of a part, all other blocks zero.
    values : ndarray, shape (k,)
        Normalised middle of that part, one for each block; zero for those that are not real.
    parts : int
        Parts that the ranges are divided into.
    """

    upper: float
    lower: float
    values: Array
    parts: int


def divide_gain(
    system: LtiSystem,
    uncertainty: BlockStructure,
    structure: BlockStructure,
    upper: float,
    enough: float,
    *,
    gap: float,
    most: int = 24,
) -> DividedGain:
    """Bound the worst-case gain on parts of the ranges of real parameters.

    Parameters
    ----------
    system : LtiSystem
        M, stable, in units in which the gains of performance and of Δ are alike.
    uncertainty, structure : BlockStructure
        Of Δ of size one, and with the full block of performance.
    upper : float
        Bound for the whole ranges.
    enough : float
        A bound that is not worth lowering: a little above a gain that is reached.
    gap : float
        As of `certified_peak`.
    most : int
        Parts that are bounded at most. Each takes as long as the bound of the whole.

    Returns
    -------
    DividedGain
        The bounds; an infinite lower one if the middle of a part makes the loop unstable.
    """
    count = len(uncertainty.blocks)
    real = np.array([block.kind == "real" for block in uncertainty.blocks])
    p, m = uncertainty.shape
    lower, values = 0.0, np.zeros(count)
    whole = (np.where(real, -1.0, 0.0), np.where(real, 1.0, 0.0))
    waiting: list[tuple[float, int, Array, Array, float]] = [(-upper, 0, *whole, np.nan)]
    looked = number = 0
    while looked + 2 <= most and -waiting[0][0] > enough:
        _, _, low, high, omega = heappop(waiting)
        k = _divided_block(system, uncertainty, structure, low, high, omega)
        middle = 0.5 * (low[k] + high[k])
        for end in (0, 1):
            lows, highs = low.copy(), high.copy()
            (lows if end else highs)[k] = middle
            part = restrict_to_part(system, uncertainty, 1.0, *_ranges(real, lows, highs))
            looked += 1
            number += 1
            centre = 0.5 * (lows + highs)
            if not part.is_stable:
                return DividedGain(np.inf, np.inf, centre, looked)
            outside = LtiSystem(part.a, part.b[:, m:], part.c[p:], part.d[p:, m:], part.dt_s)
            reached = hinf_norm(outside).value
            if reached > lower:
                lower, values = reached, centre
            bound, at = -np.inf, np.nan
            with suppress(ConvergenceError):
                proof = certified_peak(part, structure, skewed=[count], gap=gap)
                bound, at = proof.upper, proof.frequency_rad_s
            # what holds for the whole holds for a part
            bound = min(bound, upper) if bound >= 0.0 else upper
            heappush(waiting, (-bound, number, lows, highs, at))
            enough = max(enough, (1.0 + 2.0 * gap) * lower)
    return DividedGain(-waiting[0][0], lower, values, len(waiting))


def _ranges(real: NDArray[np.bool_], low: Array, high: Array) -> tuple[Array, Array]:
    """Return ranges (k,) of all blocks, those that are not real from −1 to 1."""
    return np.where(real, low, -1.0), np.where(real, high, 1.0)


def _divided_block(
    system: LtiSystem,
    uncertainty: BlockStructure,
    structure: BlockStructure,
    low: Array,
    high: Array,
    omega: float,
) -> int:
    """Return the number of the real block with the largest share of a bound, or the widest."""
    width = high - low
    if np.isfinite(omega):
        real = width > 0.0
        part = restrict_to_part(system, uncertainty, 1.0, *_ranges(real, low, high))
        with suppress(InputError):  # µ is zero there
            shares = sensitivities(part.response(np.array([omega]))[0], structure)[: width.size]
            shares = np.where(real, shares, -1.0)
            if shares.max() > 0.0:
                return int(np.argmax(shares))
    return int(np.argmax(width))
