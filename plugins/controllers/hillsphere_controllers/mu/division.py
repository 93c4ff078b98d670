"""Branch and bound for µ: the ranges of real parameters are divided where scalings fail.

For several real parameters the upper bound of µ can be well above µ. On a part of their ranges it
is closer. A limit that is proved on every part is proved on the whole [1]_. Each part costs one
certified bound, and many parts may be needed. The block with the largest share of the bound
(`sensitivities`) is divided.

References
----------
.. [1] M. P. Newlin, P. M. Young (1997), Mixed µ problems and branch and bound techniques,
   International Journal of Robust and Nonlinear Control 7, 145-164.
"""

from __future__ import annotations

from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.bilinear_images import check_loop
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import find_unproved
from hillsphere_controllers.mu.sensitivities import sensitivities
from hillsphere_controllers.systems.algebra import gain, star

__all__ = ["Division", "prove_by_branch_and_bound", "restrict_to_part"]


@dataclass(frozen=True)
class Division:
    """Parts of the ranges of real parameters.

    Parameters
    ----------
    proved : int
        Parts on which the bound is proved.
    left : int
        Parts on which it is not: zero if the bound is proved.
    """

    proved: int
    left: int


def prove_by_branch_and_bound(
    system: LtiSystem, structure: BlockStructure, limit: float, *, most: int = 64
) -> Division:
    """Prove by branch and bound that µ is below a limit at all frequencies, if possible.

    Parameters
    ----------
    system : LtiSystem
        M, stable.
    structure : BlockStructure
        Of Δ, with a real block at least; a block for performance is one of the others.
    limit : float
        Above µ: where a lower bound exceeds it no number of parts will do.
    most : int
        Parts that are looked at, at most. The search ends as soon as these cannot suffice.

    Returns
    -------
    Division
        Whether it is proved, and the parts that are left.

    Raises
    ------
    InputError
        If the system does not fit, is not stable, has no real block, or the limit is not positive.
    """
    real = np.array([block.kind == "real" for block in structure.blocks])
    if not real.any():
        raise InputError("no block is real: there is no range to be divided")
    if not 0.0 < limit < np.inf:
        raise InputError(f"the limit must be > 0 and finite, got {limit}")
    check_loop(system, structure)
    count = len(structure.blocks)
    waiting: list[tuple[float, int, Array, Array]] = []
    heappush(waiting, (0.0, 0, -np.ones(count), np.ones(count)))
    proved = number = 0
    for looked in range(most):
        # each part that waits has to be looked at once at least
        if not waiting or looked + len(waiting) > most:
            break
        # the part with the largest bound comes first, the older one of equals
        _, _, low, high = heappop(waiting)
        part = restrict_to_part(system, structure, limit, np.where(real, low, -1.0), high)
        if not part.is_stable:  # the middle of the part is a counterexample
            return Division(proved, len(waiting) + 1)
        unproved = find_unproved(part, structure, 1.0)
        if unproved is None:
            proved += 1
            continue
        omega, bound = unproved
        at = part.response(np.array([omega]))[0]
        shares = np.where(real, sensitivities(at, structure), -1.0)
        k = int(np.argmax(shares))
        middle = 0.5 * (low[k] + high[k])
        for end in (0, 1):
            number += 1
            lower, upper = low.copy(), high.copy()
            (lower if end else upper)[k] = middle
            heappush(waiting, (-bound, number, lower, upper))
    return Division(proved, len(waiting))


def restrict_to_part(
    system: LtiSystem, structure: BlockStructure, limit: float, low: Array, high: Array
) -> LtiSystem:
    """Return the system whose Δ of size one spans the part of the ranges, divided by the limit.

    Parameters
    ----------
    system : LtiSystem
        M; outputs and inputs beyond those of the structure stay.
    structure : BlockStructure
        Of Δ.
    limit : float
        Size that the ranges are divided by.
    low, high : ndarray, shape (k,)
        Ends of the range of each block; −1 and 1 of those that are not real.

    Returns
    -------
    LtiSystem
        M with the middle of the part as its nominal Δ.
    """
    p, m = structure.shape
    centre, half = np.zeros((m, p)), np.zeros((m, m))
    for k, (rows, columns) in enumerate(structure.parts()):
        size = 0.5 * (high[k] - low[k]) / limit
        half[rows, rows] = size * np.eye(rows.stop - rows.start)
        if structure.blocks[k].kind == "real":
            middle = 0.5 * (high[k] + low[k]) / limit
            centre[rows, columns] = middle * np.eye(rows.stop - rows.start)
    # Δ = centre + half Δ': z' = z, w = half w' + centre z
    around = gain(np.block([[np.zeros((p, m)), np.eye(p)], [half, centre]]), system.dt_s)
    return star(around, system, p, m)
