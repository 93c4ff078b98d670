r"""Gain of the direct terms of a system with delays, for all phases of the delays.

At high frequencies the response tends to that of
:math:`D_{yu} + D_{yw} E (I - D E)^{-1} D_{zu}`, whose delays are phases alone. Delays of one
length have one phase, which is divided as frequency is elsewhere; of several lengths, the phases
are bounded as independent ones, by the structured singular value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_controllers.delays.expansion import Pencil
from hillsphere_controllers.delays.gain_bounds import GainPeak, search_peak
from hillsphere_controllers.mu.blocks import BlockStructure, full, repeated_complex
from hillsphere_controllers.mu.upper_bound import upper_bound

__all__ = ["DirectGain", "bound_direct_gain"]

_ROOM = 1e-9
"""Share by which the bound of the structured singular value is enlarged: its scalings prove it but
for rounding, which is far below."""
_PARTS = 32
"""Intervals of the first division of one turn of the phase."""


@dataclass(frozen=True)
class DirectGain:
    """Bounds of the gain of the direct terms.

    Parameters
    ----------
    lower, upper : float
        Bounds of the largest gain over all phases; the lower one is zero if it is not known that
        the delays, of several lengths, come to have such phases at high frequencies.
    frequency_rad_s : float
        Where the lower one is first reached by the direct terms alone.
    error : float
        Bound of its rounding, relative to it.
    is_exact : bool
        Whether the phases of all delays are one.
    """

    lower: float
    upper: float
    frequency_rad_s: float
    error: float
    is_exact: bool


def bound_direct_gain(pencil: Pencil, loop: Array, tolerance: float) -> DirectGain:
    """Return bounds of the gain of the direct terms for all phases of the delays.

    Parameters
    ----------
    pencil : Pencil
        Of a system with q delays, whose direct loop is strongly stable.
    loop : ndarray, shape (q, q)
        Bound of (I − D E)⁻¹.
    tolerance : float
        Relative distance of the bounds that is tried for.

    Returns
    -------
    DirectGain
        The bounds.
    """
    # delays on a path from an input to an output
    reached = loop @ np.abs(pencil.d_zu).sum(axis=1) > 0.0
    used = np.flatnonzero(reached & (np.abs(pencil.d_yw).sum(axis=0) @ loop > 0.0))
    size = float(np.linalg.norm(pencil.d_yu, 2)) if pencil.d_yu.size else 0.0
    if not used.size:
        return DirectGain(size, size * (1.0 + _ROOM), 0.0, 0.0, True)
    d, into, out = (
        pencil.d[np.ix_(used, used)], pencil.d_zu[used], pencil.d_yw[:, used],
    )  # fmt: skip
    times = pencil.times[used]
    if (times == times[0]).all():
        static = Pencil(
            np.zeros((0, 0)), np.zeros((0, used.size)), np.zeros((used.size, 0)), d,
            np.ones(used.size), np.zeros((0, into.shape[1])), into, np.zeros((len(out), 0)), out,
            pencil.d_yu,
        )  # fmt: skip
        cuts = np.linspace(0.0, 2.0 * np.pi * (1.0 + _ROOM), _PARTS + 1)
        peak = search_peak(static, cuts, 0.1 * tolerance, GainPeak(0.0, 0.0, 0.0, 0.0))
        return DirectGain(
            peak.value, peak.upper, peak.frequency_rad_s / float(times[0]), peak.error, True
        )
    blocks = [*(repeated_complex(1) for _ in used), full(*pencil.d_yu.shape[::-1])]
    whole: NDArray[np.complex128] = np.block([[d, into], [out, pencil.d_yu]]) + 0j
    upper = upper_bound(whole, BlockStructure(blocks), skewed=[used.size]).value
    return DirectGain(0.0, upper * (1.0 + _ROOM), 0.0, 0.0, False)
