r"""Disk margins: simultaneous changes of gain and phase, in all channels at once.

A loop stays stable for every factor on it, each channel its own, of the disk

.. math::

    f = \frac{1 + \tfrac{1 - σ}{2} α δ}{1 - \tfrac{1 + σ}{2} α δ}, \quad |δ| < 1, \qquad
    α = 1 / \sup_ω μ\left( S(jω) + \tfrac{σ - 1}{2} I \right)

[1]_, with the structured singular value for diagonal δ. The skew σ = 0 treats rise and fall of the
gain alike, σ = 1 gives the margin of S, σ = −1 that of T. For full matrices δ, factors that also
mix the channels, µ is the largest singular value. The result is conservative: the inverse of a
bound of µ that holds at all frequencies.

References
----------
.. [1] P. Seiler, A. Packard, P. Gahinet (2020), An introduction to disk margins, IEEE Control
   Systems Magazine 40(5), 78-95.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.blocks import BlockStructure, repeated_complex
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.systems.algebra import append, close_with_gain, feedback, gain

__all__ = ["DiskMargin", "Factors", "disk_margin", "disk_margin_of_both_ends"]

Factors = Literal["diagonal", "full"]
_GAP = 1e-4
"""By how much the bound of µ at all frequencies is above the largest at one of them."""


@dataclass(frozen=True)
class DiskMargin:
    """A disk margin: the factors on the loop for which it stays stable.

    Parameters
    ----------
    alpha : float
        Size of the disk; 0 if the closed loop is not stable.
    skew : float
        σ.
    frequency_rad_s : float
        Where the smallest factor outside acts; NaN if the closed loop is not stable.
    gain_lower, gain_upper : float
        Real factors of the disk. A lower one below zero is given as it is; the upper one is
        infinite where the disk has no end on that side.
    phase_rad : float
        Largest change of phase alone in the disk, both ways; π if all are in it.
    """

    alpha: float
    skew: float
    frequency_rad_s: float
    gain_lower: float
    gain_upper: float
    phase_rad: float


def disk_margin(loop: LtiSystem, skew: float = 0.0, *, factors: Factors = "diagonal") -> DiskMargin:
    """Return the disk margin of a loop, all its channels changed at once.

    Parameters
    ----------
    loop : LtiSystem
        L, as many outputs as inputs, closed by negative feedback; see
        `hillsphere_controllers.analysis.margins.loop_margins`.
    skew : float
        σ.
    factors : {"diagonal", "full"}
        Whether each channel has its own factor, or the factors may mix channels, too.

    Returns
    -------
    DiskMargin
        The margin.

    Raises
    ------
    InputError
        If L is not square, or the skew not finite.
    ConvergenceError
        If the norm, or µ, has no certain bound from above.
    """
    p, m = loop.shape
    if p != m or p == 0:
        raise InputError(f"a loop has as many outputs as inputs, got {p} and {m}")
    if not np.isfinite(skew):
        raise InputError(f"a skew must be finite, got {skew}")
    s = feedback(gain(np.eye(p)), loop)
    return _disk_of_sensitivity(s, skew, factors)


def disk_margin_of_both_ends(
    plant: LtiSystem,
    controller: LtiSystem,
    skew: float = 0.0,
    *,
    factors: Factors = "diagonal",
) -> DiskMargin:
    """Return the disk margin for changes at the controls and at the measurements at once.

    Parameters
    ----------
    plant, controller : LtiSystem
        G from u to y and K from the error to u, u = K (r − y).
    skew : float
        σ.
    factors : {"diagonal", "full"}
        Whether each channel has its own factor, or the factors may mix channels, too.

    Returns
    -------
    DiskMargin
        The margin, for factors on all controls and all measurements.

    Raises
    ------
    InputError
        If sizes or sampling periods do not fit, or the skew is not finite.
    ConvergenceError
        If the norm, or µ, has no certain bound from above.
    """
    (p, m), (k, q) = plant.shape, controller.shape
    if (k, q) != (m, p):
        raise InputError(f"a plant of {p} × {m} needs a controller of {m} × {p}, got {k} × {q}")
    if not np.isfinite(skew):
        raise InputError(f"a skew must be finite, got {skew}")
    bare = [LtiSystem(s.a, s.b, s.c, s.d, s.dt_s) for s in (plant, controller)]
    # signals (u, y): what enters G is u, what enters K is −y
    loop = append(*bare)
    turn = np.zeros((m + p, p + m))
    turn[:m, p:], turn[m:, :p] = np.eye(m), -np.eye(p)
    closed = close_with_gain(loop, turn)
    # the sensitivity at the two ends: from what is added to (u, −y) to the sum
    s = LtiSystem(closed.a, closed.b, turn @ closed.c, np.eye(m + p) + turn @ closed.d, closed.dt_s)
    return _disk_of_sensitivity(s, skew, factors)


def _disk_of_sensitivity(s: LtiSystem, skew: float, factors: Factors) -> DiskMargin:
    # S + (σ − 1)/2 I, whose µ over δ gives 1/α
    shifted = LtiSystem(s.a, s.b, s.c, s.d + 0.5 * (skew - 1.0) * np.eye(len(s.d)), s.dt_s)
    norm = hinf_norm(shifted)
    if not np.isfinite(norm.value):
        return DiskMargin(0.0, skew, np.nan, 1.0, 1.0, 0.0)
    if not np.isfinite(norm.upper):
        raise ConvergenceError(
            "the norm of the sensitivity could not be bounded from above; scale the loop's data"
        )
    largest, frequency = norm.upper, norm.frequency_rad_s
    if factors == "diagonal" and len(s.d) > 1 and largest > 0.0:
        structure = BlockStructure([repeated_complex(1)] * len(s.d))
        peak = certified_peak(shifted, structure, gap=_GAP)
        if peak.upper < largest:
            largest, frequency = peak.upper, peak.frequency_rad_s
    alpha = 1.0 / largest if largest > 0.0 else np.inf
    return DiskMargin(alpha, skew, frequency, *_gain_and_phase(alpha, skew))


def _gain_and_phase(alpha: float, skew: float) -> tuple[float, float, float]:
    """Return the ends of the real factors around one, and the largest phase."""
    if not np.isfinite(alpha):
        return -np.inf, np.inf, np.pi
    # f = (1 + u δ)/(1 − v δ); its real ends are at δ = ±1
    u, v = 0.5 * (1.0 - skew) * alpha, 0.5 * (1.0 + skew) * alpha
    low = (1.0 - u) / (1.0 + v) if v > -1.0 else -np.inf
    high = (1.0 + u) / (1.0 - v) if v < 1.0 else np.inf
    # |δ| < 1 is |f − 1| < |u + v f|; with f = exp(jφ): 2 (1 + u v) cos φ > 2 − u² − v²
    left, right = 2.0 * (1.0 + u * v), 2.0 - u * u - v * v
    if left <= 0.0 or right <= -left:
        return low, high, np.pi
    return low, high, float(np.arccos(min(right / left, 1.0)))
