"""Initial constant scalings, so that units do not decide where the alternation ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import minimize

from hillsphere.errors import HillsphereError, Interrupted
from hillsphere.interfaces import Array
from hillsphere_controllers.dk.goals import core_size, reference_block
from hillsphere_controllers.dk.multipliers import Multiplier
from hillsphere_controllers.mu.blocks import BlockStructure

__all__ = ["constant_multipliers", "constant_scalings"]

_SWEPT = 2.0 * np.log(10.0) * np.arange(-4.0, 4.1, 0.5)
"""Logarithms of the D that all blocks but one begin with: gains from 1e-4 to 1e4."""
_EVALUATIONS = 15
"""Of the search besides, per block."""


def constant_scalings(
    structure: BlockStructure, gamma: Callable[[Sequence[Multiplier]], float]
) -> tuple[Multiplier, ...]:
    """Return the constant scalings with the lowest γ of the K-step that was found.

    Parameters
    ----------
    structure : BlockStructure
        Of Δ.
    gamma : callable
        What the K-step reaches with scalings.
    """
    fixed = reference_block(structure)
    count = len(structure.blocks)
    moving = [k for k in range(count) if k != (count - 1 if fixed is None else fixed)]

    def made(logs: Array) -> tuple[Multiplier, ...]:
        d = np.ones(count)
        d[moving] = np.exp(logs)
        return tuple(
            Multiplier.constant(b, d[k] * np.eye(core_size(b)), fixed=k == fixed)
            for k, b in enumerate(structure.blocks)
        )

    def cost(logs: Array) -> float:
        try:
            return float(np.log(gamma(made(logs))))
        except Interrupted:
            raise
        except HillsphereError:
            return np.inf

    if not moving:
        return made(np.zeros(0))
    # first one common factor over eight decades, then each by itself (Nelder and Mead)
    swept = [cost(np.full(len(moving), log)) for log in _SWEPT]
    begun = np.full(len(moving), _SWEPT[int(np.argmin(swept))])
    if not np.isfinite(min(swept)):
        return made(np.zeros(len(moving)))
    corners = np.vstack([begun, begun + 0.7 * np.eye(len(moving))])
    options = {"maxfev": _EVALUATIONS * len(moving), "initial_simplex": corners}
    minimum = minimize(cost, begun, method="Nelder-Mead", options=options)
    return made(minimum.x)


def constant_multipliers(structure: BlockStructure, sizes: Array) -> tuple[Multiplier, ...]:
    """Return constant scalings of the sizes (n,) of the diagonal of D of the squared matrix."""
    fixed = reference_block(structure)
    return tuple(
        Multiplier.constant(
            b, (1.0 if k == fixed else sizes[span].mean()) * np.eye(core_size(b)), fixed=k == fixed
        )
        for k, (b, span) in enumerate(zip(structure.blocks, structure.spans(), strict=True))
    )
