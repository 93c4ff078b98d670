r"""Multiple shooting: the solution of other equations that is nearest to a given flight.

A flight is given by its states at K + 1 times, the nodes. Of all flights of the new equations that
are continuous at the nodes, the one is sought whose nodes are nearest to their targets r,

.. math:: \min \tfrac12\sum_k (x_k - r_k)^T W_k^{-1} (x_k - r_k) \quad\text{with}\quad
          F_k(x_k) = x_{k+1},\; k = 0 \dots K-1 .

With the matrices :math:`\Phi_k` of the arcs and the gaps :math:`g_k = F_k(x_k) - x_{k+1}` a
Gauss–Newton step solves :math:`A W A^T\lambda = g + A(x - r)`, where row k of A is
:math:`(\dots, -\Phi_k, 1, \dots)`; the new displacement is :math:`W A^T\lambda`. The matrix is
positive definite and has bandwidth 2n: all arcs of all flights are the lanes of one propagation,
and all flights one banded system. Arcs are short, so that neither errors nor instability grow along
the flight, and nothing has to be periodic. Once the nodes have come to rest, or after some steps if
they do not, Newton steps of least length (r = x) close the gaps quadratically.

A target may be a point, or a curve whose point nearest to the node is meant (a periodic orbit, on
which the phase is free): then W is large along the curve, and the point is sought anew in every
step. Where that fails, because the flight slips along its curve by more than a linear step can tell
(a stable orbit near a resonance), the search begins again from a flight that stays near the curve
of itself, and what such a search cannot bring nearer is left where it is.

References
----------
.. [1] Ascher, U. M., Mattheij, R. M. M., Russell, R. D., Numerical Solution of Boundary Value
   Problems for Ordinary Differential Equations, SIAM, 1995, chapter 4 (multiple shooting).
.. [2] Nocedal, J., Wright, S. J., Numerical Optimization, Springer, 2006, chapter 18 (sequential
   quadratic programming).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.arc_search import ArcSearch, ContinuousFlights, Effort, Target

__all__ = ["ContinuousFlights", "Target", "reconverge"]

_SETTLE, _CLOSE = 25, 12
"""Most steps towards the target, and then to close the gaps."""


def reconverge(
    plant: Plant,
    t_s: Array,
    nodes: Array,
    *,
    target: Target | None = None,
    freedom: Array | None = None,
    tolerance: float = 1e-9,
) -> ContinuousFlights:
    """Find flights of a plant near given nodes.

    Parameters
    ----------
    plant : Plant
        The equations; they must not depend on time (an orbit's phase is a state).
    t_s : ndarray, shape (K + 1,)
        Times of the nodes, rising.
    nodes : ndarray, shape (n, K + 1, N)
        States there, SI: where the search begins. States without length (a true anomaly) are
        taken as they are, and must fit each other.
    target : Target, optional
        What the nodes shall be near to; by default `nodes`.
    freedom : ndarray, shape (m, K + 1) or (m, K + 1, N), optional
        How freely each of the m positions and velocities may move (the diagonal of W): 1 by
        default, 0 holds it, as the ends of a transfer.
    tolerance : float
        Largest gap, normalised.

    Returns
    -------
    ContinuousFlights
        Flights that failed are classified, not raised.

    Raises
    ------
    InputError
        If shapes do not fit, times do not rise, or the equations depend on time.
    """
    given = np.asarray(nodes, dtype=float)
    aim: Target = _GivenNodes(given) if target is None else target
    search = ArcSearch(plant, t_s, given, aim, freedom)
    whole = slice(0, given.shape[1])
    search.close(whole, Effort(_SETTLE, _CLOSE, tolerance))
    # flights that failed start again from free flights near the target
    begun = search.begin_freely()
    search.close(whole, Effort(_SETTLE, _CLOSE, tolerance), begun.lanes)
    # Where the way to the nearest flight is too bent for it, any flight near by will do.
    again = search.restart(begun)
    search.close(whole, Effort(0, _SETTLE, tolerance), again)
    return search.flights(tolerance)


class _GivenNodes:
    """The nodes as they were given."""

    def __init__(self, nodes: Array) -> None:
        self._nodes = nodes

    def near(
        self, x: Array, nodes: slice, lanes: NDArray[np.intp], slip: Array
    ) -> tuple[Array, Array | None, Array]:
        return self._nodes[:, nodes][:, :, lanes], None, slip
