"""Lower bounds of µ with a block for performance, from the largest gain under bounded Δ.

If a Δ of size 1/β leaves the gain g ≥ β, then µ is β at least, and g where it is below β: with a
block of size 1/g between them, performance closes a loop on the border of stability. The gain is
smooth in the parameters of Δ, and at zero and infinite frequency real, where a search for a real
eigenvalue of all blocks together has nothing to follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.gain_ascent import GainAscent, GainMaximum
from hillsphere_controllers.mu.lower_bound import LowerBound, moving_response, verify_perturbation

__all__ = ["bound_by_gain"]

Complex = NDArray[np.complex128]

_RANDOM = 4
"""Random starts of the ascent at each frequency, besides the known Δ and the nominal one."""
_STEPS = 12
"""Levels at most. The interval between gain and level is about halved by each, so that twelve leave
a thousandth."""
_NEAR = 1e-6
"""Relative difference of lower bounds that is not worth a further ascent."""


def bound_by_gain(
    system: LtiSystem,
    structure: BlockStructure,
    places: Sequence[float],
    low: LowerBound | None,
    high: float,
    *,
    starts: Sequence[Mapping[str, float]] = (),
    seed: int = 0,
) -> LowerBound | None:
    """Return a lower bound of robust performance from the gain under bounded Δ.

    Returns None if no bound above the known one is found.

    Parameters
    ----------
    system : LtiSystem
        M, in continuous time, without poles on the imaginary axis.
    structure : BlockStructure
        Of Δ; the last block is that of performance.
    places : sequence of float
        Frequencies begun at, rad/s; zero and infinity stay where they are, and are left out if a
        block beside that of performance is not real.
    low : LowerBound or None
        The one known.
    high : float
        Upper bound of µ.
    starts : sequence of mapping of str to float
        Normalised values of real blocks, by name, begun at besides.
    seed : int
        Of random starts.
    """
    uncertainty = BlockStructure([b.enclosing_square() for b in structure.blocks[:-1]])
    best, known = None, 0.0 if low is None else low.value
    if not 0.0 < high < np.inf:
        return None
    generator = np.random.default_rng(seed)
    for omega in dict.fromkeys(places):
        # at zero and infinite frequency M is real: complex blocks would need a complex Δ there,
        # which no real system has
        fixed = not 0.0 < omega < np.inf
        if fixed and not uncertainty.purely_real:
            continue
        ascent = GainAscent(moving_response(system, structure, omega), uncertainty, not fixed)
        begun = [_parameters(ascent, one) for one in ({}, *starts)]
        if low is not None and low.value > 0.0:
            begun.append(ascent.unit.parameters(_unit(low, structure, uncertainty.size)))
        begun += [ascent.random(generator) for _ in range(_RANDOM)]
        # no level at or below the one known is of use
        level = known * (1.0 + _NEAR) if known > 0.0 else high
        for _ in range(_STEPS):
            # the largest gain g with Δ of size 1/β, for β = level
            raised = ascent.best(begun, 1.0 / level)
            bound = _bound(ascent, structure, raised, level, omega)
            if bound is not None and bound.value > known:
                best, known = bound, bound.value
            # the gain falls with the level: they meet between the two
            least, most = sorted((level, raised.gain))
            if bound is None or not most > known * (1.0 + _NEAR):
                break
            begun = [raised.x, begun[0]]
            # g falls with β: the bound is the fixed point g(β) = β, bracketed by β and g
            level = 0.5 * (max(least, known) + min(most, high))
    return best


def _unit(low: LowerBound, structure: BlockStructure, size: int) -> Complex:
    """Return the Δ of a bound without performance, squared and of size one at most."""
    rows, columns = structure.places()
    q = np.zeros((structure.size, structure.size), dtype=complex)
    # the bound's Δ has the norm 1/value
    q[columns[:, None], rows] = low.delta * low.value
    return q[:size, :size]


def _parameters(ascent: GainAscent, values: Mapping[str, float]) -> Array:
    """Return the parameters (k,) of named real blocks; others begin at zero, or anywhere."""
    made = []
    for k, block in enumerate(ascent.uncertainty.blocks):
        if block.kind == "real":
            made.append(float(np.clip(values.get(block.name or str(k), 0.0), -1.0, 1.0)))
        else:
            made += [1.0] * _count(ascent, k)
    return np.array(made)


def _count(ascent: GainAscent, block: int) -> int:
    structure = ascent.uncertainty
    return 1 if structure.scalar(block) else 4 * int(structure.sizes[block])


def _bound(
    ascent: GainAscent, structure: BlockStructure, raised: GainMaximum, level: float, omega: float
) -> LowerBound | None:
    """Return the bound that a Δ of size 1/level and its gain prove."""
    if not np.isfinite(raised.gain) or raised.gain > 1e12 * level:
        return None
    m, _ = ascent.at(raised.z)
    n = ascent.uncertainty.size
    try:
        u, s, vh = np.linalg.svd(ascent.performance(raised, 1.0 / level))
    except np.linalg.LinAlgError:
        return None
    if not s[0] > 0.0:
        return None
    delta = np.zeros(m.shape, dtype=complex)
    delta[:n, :n] = raised.q / level
    # the performance block that closes the gain s₁ on the border of stability: Δ_p = v₁ u₁ᴴ/s₁
    delta[n:, n:] = np.outer(vh[0].conj(), u[:, 0].conj()) / s[0]
    fixed = not ascent.moving
    at = omega if fixed else float(omega * np.exp(raised.z))
    return verify_perturbation(m, delta.real + 0j if fixed else delta, structure, at)
