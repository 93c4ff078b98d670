"""Goals of the D-step: upper bounds of µ at a set of frequencies, to which scalings are fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.dk.fitting import Goal
from hillsphere_controllers.mu.blocks import Block, BlockStructure
from hillsphere_controllers.mu.upper_bound import UpperBound, upper_bound

__all__ = ["Bounds", "core_size", "mu_upper_bounds", "reference_block"]

Complex = NDArray[np.complex128]

_PER_DECADE = 5
"""Grid points per decade. µ is smooth there, and its peaks are handed over by the caller."""
_MOST = 80
"""Grid points at most: each costs an upper bound of µ and a row of the fit."""
_ROOM = 0.003
"""Relative room above µ that the fit may use. Without it the set of scalings that meet the goal has
no interior, and the fit needs too many poles."""
_TOLERANCE = 1e-3
"""Relative accuracy of the upper bounds: a third of the room."""


def reference_block(structure: BlockStructure) -> int | None:
    """Return the block whose D is divided out of all: the largest of those where D is a number."""
    sizes = [b.rows + b.columns if b.kind == "full" or b.rows == 1 else 0 for b in structure.blocks]
    return int(np.argmax(sizes)) if max(sizes) > 0 else None


@dataclass(frozen=True, eq=False)
class Bounds:
    """µ's upper bound of a loop at some frequencies.

    Parameters
    ----------
    structure : BlockStructure
        Of Δ.
    omega_rad_s : ndarray, shape (K,)
        The frequencies, rising.
    matrices : ndarray, shape (K, n, n)
        M there, squared.
    found : tuple of UpperBound
        The bounds.
    """

    structure: BlockStructure
    omega_rad_s: Array
    matrices: Complex
    found: tuple[UpperBound, ...]

    @property
    def values(self) -> Array:
        """Return the bounds (K,)."""
        return np.array([b.value for b in self.found])

    def goal(self, floor: float) -> Goal:
        """Return the goal of a fit: slightly more than the bounds.

        Parameters
        ----------
        floor : float
            Where µ is below that share of its peak, no less than the share is asked for.
        """
        values = self.values
        asked = np.maximum(values, floor * values.max()) * (1.0 + _ROOM)
        square = BlockStructure([b.enclosing_square() for b in self.structure.blocks])
        reference = reference_block(self.structure)
        weights = []
        for one, bound, target in zip(self.matrices, self.found, asked, strict=True):
            centre = upper_bound(one, square, start=bound.scalings, target=float(target))
            d = centre.scalings.d
            if reference is not None:
                at = int(self.structure.starts[reference])
                # a common factor of D does not matter: the reference block has D = 1
                d = d / d[at, at].real
            weights.append(np.linalg.inv(d))
        return Goal(self.omega_rad_s, self.matrices, asked**2, np.array(weights))


def mu_upper_bounds(loop: LtiSystem, structure: BlockStructure, more_rad_s: Array) -> Bounds:
    """Return upper bounds of µ of a stable loop on a grid of frequencies.

    Parameters
    ----------
    loop : LtiSystem
        M, in continuous time.
    structure : BlockStructure
        Of Δ.
    more_rad_s : ndarray, shape (K,)
        Frequencies, such as those of peaks, besides a grid over those of the poles.
    """
    size = np.abs(loop.poles)
    size = size[size > 0.0] if size.any() else np.ones(1)
    low, high = np.log10(size.min()) - 0.5, np.log10(size.max()) + 0.5
    count = min(int(_PER_DECADE * (high - low)) + 2, _MOST)
    omega = np.unique(np.concatenate([[0.0, np.inf], np.logspace(low, high, count), more_rad_s]))
    matrices = structure.pad_to_square(loop.response(omega))
    square = BlockStructure([b.enclosing_square() for b in structure.blocks])
    bounds: list[UpperBound] = []
    for one in matrices:
        start = bounds[-1].scalings if bounds else None
        bounds.append(upper_bound(one, square, start=start, tolerance=_TOLERANCE))
    return Bounds(structure, omega, matrices, tuple(bounds))


def core_size(block: Block) -> int:
    """Return the size of a block's D before it is repeated: that of a full block is a number."""
    return 1 if block.kind == "full" else block.rows
