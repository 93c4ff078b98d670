"""Sensitivity of µ to the size of each block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.scalings import dg_form
from hillsphere_controllers.mu.upper_bound import analytic_centre, upper_bound

__all__ = ["sensitivities"]

Complex = NDArray[np.complex128]

_ROOM = 3e-7
"""Above the least bound, relative: so near is the centre's Z to the multiplier of F."""


def sensitivities(matrix: Complex | Array, structure: BlockStructure) -> Array:
    r"""Return the relative change of µ's upper bound with the size of each block.

    At the least β the form F of the scalings (`hillsphere_controllers.mu.upper_bound`) is singular,
    and some Z ≥ 0 with tr(Z F) = 0 makes tr(Z F) stationary in D and G. Rows of M that belong to
    block k, larger by dt, then change β by

    .. math::

        \frac{d \log β}{dt} = \frac{\operatorname{tr}(Z D_k)}{\operatorname{tr}(Z D)},

    with D_k the part of D that is the block's. No share is negative and they sum to one, as they
    have to, since µ is proportional to the size of all blocks together. Where the bound has a kink
    the shares are between those of its two sides.

    Parameters
    ----------
    matrix : ndarray, shape (p, m)
        M, such as that of a system at the frequency of the peak.
    structure : BlockStructure
        With k blocks.

    Returns
    -------
    ndarray, shape (k,)
        d log µ / d log of the block's size.

    Raises
    ------
    InputError
        If the matrix does not fit the structure, or µ is zero, which has no shares.
    """
    squared = structure.pad_to_square(matrix)
    square = BlockStructure([b.enclosing_square() for b in structure.blocks])
    here = upper_bound(squared, square, tolerance=_ROOM)
    if here.value <= 1e-12 * float(np.linalg.norm(squared)):
        raise InputError("µ is zero: no block has a share of it")
    bound = here.value * (1.0 + _ROOM)
    scalings = analytic_centre(squared, square, here.scalings, bound)
    form = bound**2 * scalings.d - dg_form(squared, scalings.d, scalings.g)
    # Z of the barrier, and both factors scaled alike: D may span many decades
    root = np.linalg.cholesky(scalings.d)
    inverse = np.linalg.inv(root)
    z = np.linalg.inv(inverse @ form @ inverse.conj().T)
    weight = np.diagonal(z).real
    made = np.array([weight[span].sum() for span in square.spans()])
    return np.asarray(made / made.sum())
