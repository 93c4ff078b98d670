r"""Direct terms from delay to delay: a bound of (I − D E)⁻¹ for Re s ≥ 0, if there is one.

The difference equation w = E D w that they make is strongly stable, that is for all small changes
of the delays, just if the spectral radius of D diag(e^{jθ}) is below one for all θ [1]_. A
similarity V that commutes with E and brings the norm of V⁻¹ D V below one proves it.

References
----------
.. [1] J. K. Hale, S. M. Verduyn Lunel (1993), Introduction to Functional Differential Equations,
   Springer, section 9.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov
from scipy.sparse.csgraph import connected_components

from hillsphere.interfaces import Array
from hillsphere_controllers.delays.expansion import bound_perturbed
from hillsphere_controllers.mu.blocks import BlockStructure, repeated_complex
from hillsphere_controllers.mu.lower_bound import lower_bound
from hillsphere_controllers.mu.upper_bound import upper_bound

__all__ = ["DirectLoop", "bound_direct_loop"]

_SURE = 1e-6
"""A norm or spectral radius counts as below or above one if it is so by this share: the bound of
the inverse grows as its reciprocal, and rounding of small matrices is far below it."""


@dataclass(frozen=True)
class DirectLoop:
    """What is known about the direct loop.

    Parameters
    ----------
    inverse_bound : ndarray, shape (q, q), or None
        Bound of the entries of (I − D E)⁻¹ for Re s ≥ 0; None without one.
    stable : bool or None
        True with a bound, False if infinitely many poles are on the right, None if undecided.
    reason : str
        Why there is no bound.
    """

    inverse_bound: Array | None
    stable: bool | None
    reason: str = ""


def bound_direct_loop(d: Array, times: Array) -> DirectLoop:
    """Return a bound of (I − D E)⁻¹ on the right of the axis.

    Parameters
    ----------
    d : ndarray, shape (q, q)
        D, from the delayed signals to those that are to be delayed.
    times : ndarray, shape (q,)
        Delays, s.

    Returns
    -------
    DirectLoop
        The bound, or why there is none.
    """
    q = len(d)
    count, labels = connected_components(d != 0.0, directed=True, connection="strong")
    places = [np.flatnonzero(labels == k) for k in range(count)]
    order = np.concatenate([*places, np.zeros(0, dtype=int)]).astype(int)
    size = np.abs(d)
    # all parts at once by the sizes of the entries; this includes loops without feedback
    bound = bound_perturbed(size[None], np.eye(q)[None])[0]
    if np.isfinite(bound).all():
        return DirectLoop(bound, True)
    coordinates, doubt = [], ""
    for at in places:
        made, stable, reason = _scale_part(d[np.ix_(at, at)], times[at])
        if stable is False:
            return DirectLoop(None, False, reason)
        doubt = doubt or reason
        coordinates.append(made)
    if doubt:
        return DirectLoop(None, None, doubt)
    # norms of the blocks in these coordinates, triangular in some order of the parts
    v = block_diag(*coordinates)
    inverse = np.linalg.inv(v)
    turned = inverse @ d[np.ix_(order, order)] @ v
    ends = np.cumsum([0, *(at.size for at in places)])
    norms = np.array(
        [
            [np.linalg.norm(turned[a:b, c:e], 2) for c, e in pairwise(ends)]
            for a, b in pairwise(ends)
        ]
    ) * (1.0 + 0.1 * _SURE)
    if not _radius(norms) < 1.0 - 0.1 * _SURE:
        return DirectLoop(None, None, "the neutral part is too near instability to be bounded")
    part = np.repeat(np.arange(count), np.diff(ends))
    spread = np.linalg.inv(np.eye(count) - norms)[np.ix_(part, part)]
    bound = np.zeros((q, q))
    bound[np.ix_(order, order)] = np.abs(v) @ np.maximum(spread, 0.0) @ np.abs(inverse)
    return DirectLoop(bound * (1.0 + _SURE), True)


def _scale_part(d: Array, times: Array) -> tuple[Array, bool | None, str]:
    """Return V of one part, whether it is stable, and why that is not known or not so."""
    q = len(d)
    if q == 1 or (times == times[0]).all():
        # E is a multiple of I, and any V commutes with it
        radius = _radius(d)
        chain = f"the direct loop of the delays of {times[0]:g} s has the gain {radius:.6g}"
        if radius > 1.0 + _SURE:
            return np.eye(q), False, f"{chain}: a chain of infinitely many poles is on the right"
        if radius >= 1.0 - _SURE:
            return np.eye(q), None, f"{chain}: a chain of poles tends to the axis"
        gramian = solve_discrete_lyapunov(d.T, np.eye(q))
        # Dᵀ X D = X − I makes the norm of X^½ D X^-½ less than one
        factor = np.linalg.cholesky(0.5 * (gramian + gramian.T)).T
        return np.asarray(np.linalg.inv(factor)), True, ""
    structure = BlockStructure([repeated_complex(1)] * q)
    upper = upper_bound(d, structure)
    root = np.sqrt(np.abs(np.diagonal(upper.scalings.d)))
    if np.linalg.norm(root[:, None] * d / root, 2) < 1.0 - 0.5 * _SURE:
        return np.diag(1.0 / root), True, ""
    lower = lower_bound(d, structure, scalings=upper.scalings).value
    what = f"the direct loop of the delays of {', '.join(f'{one:g}' for one in times)} s"
    if lower > 1.0 + _SURE:
        reason = (
            f"{what} is not strongly stable: for some phases its gain is {lower:.6g}, so that "
            "arbitrarily small changes of the delays make infinitely many poles unstable"
        )
    else:
        reason = (
            f"the gain of {what} is from {lower:.6g} to {upper.value:.6g} over all phases: strong "
            "stability is undecided"
        )
    return np.eye(q), None, reason


def _radius(matrix: Array) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max(initial=0.0))
