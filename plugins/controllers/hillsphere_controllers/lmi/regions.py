r"""LMI regions: parts of the complex plane that a matrix inequality describes.

.. math::

    \{ z : L + z M + \bar z M^\mathsf{T} \prec 0 \}

All eigenvalues of A lie there just if some X ≻ 0 has L⊗X + M⊗(A X) + Mᵀ⊗(A X)ᵀ ≺ 0 [1]_.

References
----------
.. [1] M. Chilali, P. Gahinet (1996), H∞ design with pole placement constraints: an LMI approach,
   IEEE Transactions on Automatic Control 41(3), 358-367.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_controllers.structured.requirements import PoleRegion

__all__ = ["LmiRegion", "regions"]


@dataclass(frozen=True, eq=False)
class LmiRegion:
    """One convex region, symmetric about the real axis.

    Parameters
    ----------
    level, m : ndarray, shape (k, k)
        L, symmetric, and M.
    """

    level: Array
    m: Array


def regions(of: PoleRegion) -> tuple[LmiRegion, ...]:
    """Return the half-plane, cone and disc whose common part a pole region is."""
    made = []
    if of.decay_1_s > 0.0:
        made.append(LmiRegion(np.array([[2.0 * of.decay_1_s]]), np.array([[1.0]])))
    if of.damping > 0.0:
        cosine = of.damping
        sine = np.sqrt(1.0 - cosine**2)
        made.append(LmiRegion(np.zeros((2, 2)), np.array([[sine, cosine], [-cosine, sine]])))
    if np.isfinite(of.fastest_rad_s):
        # divided by the radius: entries of one size
        shift = np.array([[0.0, 1.0], [0.0, 0.0]]) / of.fastest_rad_s
        made.append(LmiRegion(-np.eye(2), shift))
    return tuple(made)
