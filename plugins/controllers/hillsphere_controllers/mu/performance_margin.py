r"""Robust performance margin: how large Δ may be until the gain reaches a level.

The gain of F_u(M, Δ) is below γ for all Δ smaller than t if the skewed µ of M is below 1/t in which
the performance block has the fixed size 1/γ and the blocks of Δ grow. From above, a Δ of a larger
size is found by which the gain reaches γ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.mu.robustness import performance_structure, robust_stability
from hillsphere_controllers.mu.worst_case_gain import worst_case_gain

__all__ = ["PerformanceMargin", "performance_margin"]

_FACTORS = (1.002, 1.01, 1.03, 1.1, 1.3, 2.0, 5.0)
"""Multiples of the size that is surely allowed at which a Δ that reaches the level is looked for:
near one, where the bounds of µ nearly agree, as they do for complex blocks."""
_REFINED = 4
"""Bisections between the last size at which no such Δ was found and the first at which one was."""


@dataclass(frozen=True, eq=False)
class PerformanceMargin:
    """Bounds of the size of Δ at which the gain reaches a level.

    Parameters
    ----------
    lower : float
        For all Δ smaller than this the gain stays below the level.
    upper : float
        For a Δ of this size it does not; infinite if none was found.
    frequency_rad_s : float
        Where; NaN if none was found.
    values : dict of str to float
        Of the real blocks of that Δ, normalised; empty if none was found.
    undecided_gap : float
        Of the proof of the lower bound, see `CertifiedPeak.undecided_gap`.
    """

    lower: float
    upper: float
    frequency_rad_s: float
    values: dict[str, float]
    undecided_gap: float = 0.0


def performance_margin(
    system: LtiSystem, uncertainty: BlockStructure, level: float, *, gap: float = 0.01
) -> PerformanceMargin:
    """Return bounds of the size of Δ at which the gain reaches a level.

    Parameters
    ----------
    system : LtiSystem
        M, stable; its first outputs and inputs belong to Δ, the others are performance.
    uncertainty : BlockStructure
        Of Δ.
    level : float
        γ > 0.
    gap : float
        As of `certified_peak`.

    Raises
    ------
    InputError
        If the system is not stable or does not fit, the level is not positive, or nothing is left
        for performance.
    """
    if not 0.0 < level < np.inf:
        raise InputError(f"a level of the gain must be > 0 and finite, got {level}")
    structure = performance_structure(system, uncertainty)
    p, m = uncertainty.shape
    outside = LtiSystem(system.a, system.b[:, m:], system.c[p:], system.d[p:, m:], system.dt_s)
    nominal = hinf_norm(outside)
    if nominal.value >= level:
        return PerformanceMargin(0.0, 0.0, nominal.frequency_rad_s, {})
    size = np.ones((system.shape[0], 1))
    size[p:] = 1.0 / level
    scaled = LtiSystem(system.a, system.b, size * system.c, size * system.d, system.dt_s)
    blocks = range(len(uncertainty.blocks))
    proof = certified_peak(scaled, structure, skewed=list(blocks), gap=gap)
    bound, undecided = proof.upper, proof.undecided_gap
    lower = 1.0 / bound if bound > 0.0 else np.inf
    if np.isinf(lower):
        return PerformanceMargin(lower, np.inf, np.nan, {})
    # where a Δ takes the loop to the border of stability, the gain has no bound
    border = robust_stability(system, uncertainty, gap=gap, complex_shares=())
    most, tried = border.margin[1], lower
    reached: tuple[float, float, dict[str, float]] | None = None
    if border.worst is not None:
        reached = most, border.frequency_rad_s, border.worst.values
    for t in (lower * f for f in _FACTORS if 0.0 < lower * f < most):
        worst = worst_case_gain(system, uncertainty, size=t, gap=gap, divide=False)
        if worst.lower >= level:
            reached = t, worst.frequency_rad_s, worst.values
            break
        tried = t
    if reached is None:
        return PerformanceMargin(lower, np.inf, np.nan, {}, undecided)
    for _ in range(_REFINED):
        t = 0.5 * (tried + reached[0])
        if reached[0] - tried <= 0.5 * gap * reached[0]:
            break
        worst = worst_case_gain(system, uncertainty, size=t, gap=gap, divide=False)
        if worst.lower >= level:
            reached = t, worst.frequency_rad_s, worst.values
        else:
            tried = t
    return PerformanceMargin(lower, *reached, undecided)
