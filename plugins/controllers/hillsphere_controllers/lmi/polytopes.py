r"""Gain and stability of all plants in a convex hull (a polytope), by Lyapunov functions.

With :math:`\dot x = A x + B w`, z = C x + D w and a multiplier F that all plants share,

.. math::

    \begin{bmatrix} 0 & P & 0 \\ P & 0 & 0 \\ 0 & 0 & -\gamma^2 I \end{bmatrix}
    + [C\ 0\ D]^\mathsf{T} [C\ 0\ D]
    + F [A\ {-I}\ B] + ([A\ {-I}\ B])^\mathsf{T} F^\mathsf{T} \prec 0, \qquad P \succ 0

at the corners gives the gain γ for all plants of the hull: a Schur complement makes it linear in
the plant and in P, which may therefore differ from corner to corner [1]_, [2]_. One common P gives
it for plants that change with time, however fast. In discrete time P stands as diag(−P, P).

References
----------
.. [1] D. Peaucelle, D. Arzelier, O. Bachelier, J. Bernussou (2000), A new robust D-stability
   condition for real convex polytopic uncertainty, Systems & Control Letters 40(1), 21-30.
.. [2] M. C. de Oliveira, R. E. Skelton (2001), Stability tests for constrained linear systems, in:
   Perspectives in Robust Control, Lecture Notes in Control and Information Sciences 268.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gramians import lyapunov_solution
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import InfeasibleError, SynthesisFailedError
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import corners, random_values
from hillsphere_controllers.lmi.solving import check_order, cp, minimise
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["HullGain", "corner_systems", "hull_gain", "hull_stability"]

_MARGINS = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4)
"""Amounts, relative to the unit coordinates, by which the inequalities must hold, smallest first.
The first whose solution passes the check with rounding taken off is used; a larger margin costs
more of the bound."""
_LINEAR = 1e-9
"""Matrices count as linear in a parameter if the middle of its range differs by less than this from
the mean of the ends: rounding of a few operations, far below an actual curvature."""
_SMALL = 1e-6
"""Share of the trace of CᵀC that is added to it, so that states that C does not show keep a
positive definite Gramian and the coordinates exist."""
_ROUNDING = 1e-14
"""Error of an eigenvalue per row of a matrix, relative to its largest entry: about 45 units of
rounding, taken off before an inequality counts as proved."""


@dataclass(frozen=True, eq=False)
class HullGain:
    """A gain that no plant of a hull exceeds, and the Lyapunov matrix that proves it.

    Parameters
    ----------
    bound : float
        The L2 gain from w to z is no larger.
    lowest : float
        The largest H∞ norm of the corners: no bound is less.
    lyapunov : tuple of ndarray
        P (n, n), one for each corner, or the same for all.
    margin : float
        How far the largest eigenvalue of all inequalities, in their scaled states, is below zero;
        computed from P and the multipliers.
    """

    bound: float
    lowest: float
    lyapunov: tuple[Array, ...]
    margin: float


def corner_systems(of: Lft) -> tuple[LtiSystem, ...]:
    """Return the systems at all combinations of the bounds of uncertain parameters.

    Their hull contains all systems if each matrix is linear in each parameter by itself.

    Parameters
    ----------
    of : Lft
        The uncertain system, all of whose uncertainties are real parameters.

    Returns
    -------
    tuple of LtiSystem
        The 2^k corners for k parameters.

    Raises
    ------
    InputError
        If an uncertainty is not a real parameter, there are too many, or the matrices are not
        linear in one of them.
    """
    ends = corners(of.uncertainties)
    values = random_values(of.uncertainties, 8)
    for one in of.uncertainties:
        low, high, middle = ({**values, one.name: np.full(8, value)} for value in (
            one.lower, one.upper, 0.5 * (one.lower + one.upper),
        ))  # fmt: skip
        for first, last, between in zip(
            *(of.matrices(v) for v in (low, high, middle)), strict=True
        ):
            size = max(float(np.abs(first).max(initial=0.0)), float(np.abs(last).max(initial=0.0)))
            if np.abs(0.5 * (first + last) - between).max(initial=0.0) > _LINEAR * size:
                raise InputError(
                    f"the matrices are not linear in {one.name!r}: the hull of the corners does "
                    "not contain what lies between; use µ, or bound the difference and add it"
                )
    count = len(next(iter(ends.values()))) if ends else 1
    return tuple(of.at({name: row[i] for name, row in ends.items()}) for i in range(count))


def hull_gain(systems: Sequence[LtiSystem], *, common: bool = False) -> HullGain:
    """Return a bound of the gain of all systems in the convex hull of some.

    For one system it is its H∞ norm (the bounded real lemma).

    Parameters
    ----------
    systems : sequence of LtiSystem
        The corners, of one size, of at most 20 states, all in continuous or discrete time.
    common : bool
        One P for all: holds for systems that move within the hull, too.

    Returns
    -------
    HullGain
        The bound, checked by the eigenvalues of the inequalities.

    Raises
    ------
    InputError
        If systems do not fit each other or are too large.
    InfeasibleError
        If no gain is proved: there are no such P and F.
    SynthesisFailedError
        If a corner is not stable, or the solver found nothing to rely on.
    """
    given = _check_corners(systems)
    norms = [hinf_norm(system).value for system in given]
    unit = max(norms)
    if not np.isfinite(unit):
        raise SynthesisFailedError(f"corner {int(np.argmax(norms))} of the hull is not stable")
    unit = unit or 1.0
    t = _coordinates(given)
    hull = _Hull([_scale_system(system, t, unit) for system in given], common)
    reason = SynthesisFailedError(
        "the gain of the hull is not proved: the matrices found do not pass their check; scale "
        "states, inputs and outputs to order one"
    )
    for margin in _MARGINS:
        try:
            bound, certificate = hull.least(margin)
        except InfeasibleError:  # nor will it hold by more
            raise
        except SynthesisFailedError as error:
            reason = error
            continue
        if certificate > 0.0:
            made = tuple(_restore_lyapunov(p.value, t) * unit**2 for p in hull.lyapunov)
            return HullGain(bound * unit, max(norms), made, certificate)
    raise reason


def hull_stability(
    systems: Sequence[LtiSystem], *, common: bool = False
) -> tuple[Array, ...] | None:
    """Return Lyapunov matrices that prove all systems in a convex hull stable.

    Parameters
    ----------
    systems : sequence of LtiSystem
        The corners, as for `hull_gain`; inputs and outputs do not matter.
    common : bool
        One P for all: proves stability of systems that move within the hull, too.

    Returns
    -------
    tuple of ndarray or None
        P (n, n), one for each corner; None if there are no such, which does not mean that a system
        of the hull is unstable.

    Raises
    ------
    InputError
        If systems do not fit each other or are too large.
    SynthesisFailedError
        If the solver found nothing to rely on.
    """
    given = _check_corners(systems)
    if not all(system.is_stable for system in given):
        return None
    t = _coordinates(given)
    n = given[0].order
    bare = [
        LtiSystem(s.a, np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0)), s.dt_s) for s in given
    ]
    hull = _Hull([_scale_system(system, t, 1.0) for system in bare], common)
    if hull.widest() <= 0.0:
        return None
    return tuple(_restore_lyapunov(p.value, t) for p in hull.lyapunov)


class _Hull:
    """The inequalities at all corners, in P, one or several, and the multiplier F."""

    def __init__(self, systems: Sequence[LtiSystem], common: bool) -> None:
        n, (p, m) = systems[0].order, systems[0].shape
        count = 1 if common else len(systems)
        made = [cp.Variable((n, n), symmetric=True) for _ in range(count)]
        self._systems, self._common = systems, common or len(systems) == 1
        self.lyapunov = made * (len(systems) if common else 1)
        self._multiplier = cp.Variable((2 * n + m + p, n))

    def _whole(self, i: int, square: Any) -> Any:
        """Return the matrix of corner i, which is to be negative."""
        s, lyapunov = self._systems[i], self.lyapunov[i]
        n, (p, m) = s.order, s.shape
        # [A −I B], with zero columns for the rows of z in the Schur complement
        across = np.hstack([s.a, -np.eye(n), s.b, np.zeros((n, p))])
        none, zero = np.zeros((n, n)), np.zeros
        upper = (none, lyapunov, lyapunov, none)
        if s.dt_s is not None:
            upper = (-lyapunov, none, none, lyapunov)
        energy = [[upper[0], upper[1]], [upper[2], upper[3]]]
        if m or p:
            rows = [
                [*energy[0], zero((n, m)), s.c.T],
                [*energy[1], zero((n, m)), zero((n, p))],
                [zero((m, n)), zero((m, n)), -square * np.eye(m), s.d.T],
                [s.c, zero((p, n)), s.d, -np.eye(p)],
            ]
            energy = [[e for e in row if 0 not in e.shape] for row in rows]
            energy = [row for row in energy if row]
        if self._common:  # then F is none: what it may add leaves the inequality for ẋ = A x + B w
            basis = np.vstack(
                [
                    np.eye(n, n + m + p),
                    np.hstack([s.a, s.b, np.zeros((n, p))]),
                    np.eye(m + p, n + m + p, n),
                ]
            )
            return basis.T @ cp.bmat(energy) @ basis
        term = self._multiplier @ across
        return cp.bmat(energy) + term + term.T

    def inequalities(self, square: Any, margin: Any) -> list[Any]:
        """Return the inequalities of all corners, each with a margin."""
        made = []
        for i, lyapunov in enumerate(self.lyapunov):
            whole = self._whole(i, square)
            made += [whole << -margin * np.eye(whole.shape[0])]
            made += [lyapunov >> margin * np.eye(lyapunov.shape[0])]
        return made

    def least(self, margin: float) -> tuple[float, float]:
        """Find the least gain for which all holds by a margin, and the margin that there is."""
        square = cp.Variable(nonneg=True)
        minimise(square, self.inequalities(square, margin), "gain of a hull")
        bound = float(np.sqrt(square.value * (1.0 + margin)))
        return bound, self._margin(bound**2)

    def widest(self) -> float:
        """Find matrices of a mean trace of one that hold by the largest margin; return it."""
        margin = cp.Variable()
        whole = sum(cp.trace(p) for p in self.lyapunov)
        count = len(self.lyapunov) * self._systems[0].order
        minimise(-margin, [*self.inequalities(0.0, margin), whole == count], "stability of a hull")
        return self._margin(0.0)

    def _margin(self, square: float) -> float:
        """Return the margin of the inequalities, less rounding."""
        margin = np.inf
        for i, lyapunov in enumerate(self.lyapunov):
            whole = np.asarray(self._whole(i, square).value)
            for matrix in (-whole, np.asarray(lyapunov.value)):
                rounding = _ROUNDING * float(np.abs(matrix).max()) * len(matrix)
                margin = min(margin, float(np.linalg.eigvalsh(matrix)[0]) - rounding)
        return margin


def _check_corners(systems: Sequence[LtiSystem]) -> tuple[LtiSystem, ...]:
    given = tuple(systems)
    if not given:
        raise InputError("a hull needs at least one system")
    if len({(s.order, s.shape, s.dt_s) for s in given}) > 1:
        raise InputError("the corners of a hull must have one size and one sampling period")
    check_order(given[0].order)
    return given


def _coordinates(systems: Sequence[LtiSystem]) -> Array:
    """Return T, x = T x̃, in which the corners' mean observability Gramian is the identity."""
    scale = balance_states(systems[0])[1]
    total = np.zeros((len(scale), len(scale)))
    for system in systems:
        a, c = system.a / scale[:, None] * scale, system.c * scale
        cost = c.T @ c
        cost = cost + _SMALL * (float(np.trace(cost)) or 1.0) * np.eye(len(a))
        if system.dt_s is None:
            total += lyapunov_solution(a.T, cost)
        else:
            total += solve_discrete_lyapunov(a.T, cost)
    values, vectors = np.linalg.eigh(total / np.trace(total))
    values = np.maximum(values, 1e-12 * values[-1])
    return np.asarray(scale[:, None] * vectors / np.sqrt(values) / np.sqrt(np.trace(total)))


def _scale_system(system: LtiSystem, t: Array, unit: float) -> LtiSystem:
    inside: Array = np.linalg.solve(t, np.hstack([system.a @ t, system.b])).astype(float)
    n = system.order
    return LtiSystem(
        inside[:, :n], inside[:, n:], system.c @ t / unit, system.d / unit, system.dt_s
    )


def _restore_lyapunov(lyapunov: Array, t: Array) -> Array:
    """Return P for x of P̃ for x̃."""
    half = np.linalg.solve(t.T, lyapunov)
    return np.asarray(np.linalg.solve(t.T, half.T))
