r"""Upper bound of µ by scalings D and G, at one frequency or for several at once.

With D > 0 and G of the structure's form (D commutes with every Δ, G is Hermitian and not zero for
real blocks only), µ(M) ≤ β wherever

.. math::

    F = \beta^2 D - M^\mathsf{H} D M - j (G M - M^\mathsf{H} G) \succ 0

[1]_. The least β is a generalised eigenvalue problem, solved here by the method of centres [2]_:
at the centre of the D and G that are feasible for the present β², those of least
−log det F − log det D under tr D = n, found by Newton's method, the largest generalised eigenvalue
is well below β², and gives the next one.

In a skewed problem only some blocks have the level β² and the others have one: then every Δ whose
other blocks are no larger than one leaves I − M Δ invertible while the skewed blocks stay below
1/β. With a performance block skewed, β bounds the worst-case gain.

References
----------
.. [1] M. K. H. Fan, A. L. Tits, J. C. Doyle (1991), Robustness in the presence of mixed parametric
   uncertainty and unmodeled dynamics, IEEE Transactions on Automatic Control 36(1), 25-38.
.. [2] S. Boyd, L. El Ghaoui (1993), Method of centers for minimizing generalized eigenvalues,
   Linear Algebra and its Applications 188, 63-111.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.scalings import Basis, Scalings, dg_form, level

__all__ = ["UpperBound", "analytic_centre", "upper_bound", "upper_bounds"]

Complex = NDArray[np.complex128]

_STEP = 0.1
"""Share of the gap between the level and the one reached that the next level keeps. A smaller share
lowers the level faster but starts Newton's method farther from the next centre."""
_DECREMENT = 0.7
"""Newton decrement at which a centre on the way is near enough: below one, full steps converge
quadratically, and the next level needs no more."""
_CENTRED = 1e-3
"""Newton decrement of a centre that is itself the result, see `analytic_centre`."""
_MOST_STEPS = 200
"""Levels at most. Each takes off nine tenths of the gap, so that a bound of nine digits needs about
ten; the limit ends stagnation."""
_MOST_NEWTON = 60
"""Newton steps for one centre at most; a self-concordant barrier needs a few from the last
centre."""
_VOID = 1e-13
"""Curvature added along G, relative to the largest. Entries of G on rows of M that are zero have
none, and the Newton equations would be singular."""
_SMALLEST = 1e-150
"""Size of M below which its square is no number of double precision."""
_ZERO = 1e-9
"""Of the norm: rounding of entries of that norm has as much to do with a smaller µ."""
_LONGEST = 1e2
"""Newton steps in one: without a centre, a line has no end."""


@dataclass(frozen=True)
class UpperBound:
    """An upper bound of µ and the scalings that prove it.

    Parameters
    ----------
    value : float
        µ is no larger.
    scalings : Scalings
        With which F is positive for every β above the value.
    """

    value: float
    scalings: Scalings


def upper_bound(
    matrix: Complex | Array,
    structure: BlockStructure,
    *,
    skewed: Sequence[int] | None = None,
    start: Scalings | None = None,
    target: float | None = None,
    tolerance: float = 1e-6,
) -> UpperBound:
    """Return the least upper bound of µ that D and G scalings give.

    Parameters
    ----------
    matrix : ndarray, shape (p, m) or (K, p, m)
        M, complex; of several matrices the bound is one for all, by the same scalings.
    structure : BlockStructure
        Of Δ.
    skewed : sequence of int, optional
        Blocks whose size the bound is about, the others being no larger than one; all, if left out.
    start : Scalings, optional
        To begin with, such as those of a frequency nearby.
    target : float, optional
        A bound that suffices: once it is proved, the centre of the scalings that prove it is
        returned, from which there is the most room to all sides.
    tolerance : float
        Relative change of the bound's square at which it ends.

    Returns
    -------
    UpperBound
        The bound; zero for a matrix of zeros. Infinite, in a skewed problem, if scalings do not
        show that the other blocks alone leave I − M Δ invertible.

    Raises
    ------
    InputError
        If the matrix does not fit the structure or is not of finite numbers, a skewed block is none
        of its, there is none, or the tolerance is out of range.

    Notes
    -----
    Blocks whose units differ by more than some 1e8 make the bound loose (9.4 times for 1e10): scale
    them.
    """
    if not 0.0 <= tolerance < 1.0:
        raise InputError(f"a tolerance must be from 0 to 1, got {tolerance}")
    if skewed is not None and not len(skewed):
        raise InputError("a skewed problem needs a block whose size the bound is about")
    squared = structure.pad_to_square(matrix)
    squared = squared[None] if squared.ndim == 2 else squared
    size = float(np.linalg.norm(squared, 2, axis=(1, 2)).max())
    n = structure.size
    free = structure.indices(range(len(structure.blocks)) if skewed is None else skewed)
    unscaled = Scalings(np.eye(n, dtype=complex), np.zeros((n, n), dtype=complex))
    if size <= _SMALLEST:  # their squares would be none; unscaled, they are no worse
        return UpperBound(size, unscaled)
    m = squared / size
    basis = Basis(structure, free, 1.0 / size**2)
    begun = _initial_level(m, structure, basis, start, size)
    if begun is None:
        return UpperBound(np.inf, unscaled)
    # coordinates in which the optimisation is well scaled, and a start in them
    white = _Whitened(m, basis)
    best = (begun[0] / white.norm**2, *white.there(begun[1], begun[2]))
    x = white.basis.parameters(*best[1:])
    goal = -np.inf if target is None else (target / size / white.norm) ** 2
    zero = (_ZERO / white.norm) ** 2
    # a first level well above the one known, so that its centre is easy to reach
    beta2 = max(1.3 * best[0], best[0] + 1e-6)
    for _ in range(_MOST_STEPS):
        if best[0] < (1.0 - 1e-9) * goal:
            d, g = white.back(best)
            whole = n / float(np.trace(d).real)
            # of M as it is: what is fitted to these scalings has its units
            begun_there = basis.parameters(d * whole, g * whole)
            level_there = (target / size) ** 2 if target is not None else np.inf
            d, g = basis.matrices(_centre(m, basis, begun_there, level_there))
            reached = level(m, d, g, free, basis.fixed)
            if reached < level_there:
                return UpperBound(size * float(np.sqrt(max(reached, 0.0))), Scalings(d, size * g))
            break
        # centre for the present level; its own level is the new bound
        x, scalings = white.centre(x, beta2)
        reached, gained = scalings[0], best[0] - scalings[0]
        if gained > 0.0:
            best = scalings
        # converged: the centre has met the level
        if best[0] <= zero or beta2 - reached <= tolerance * abs(best[0]):
            if best[0] < (1.0 - 1e-9) * goal:
                continue
            break
        if gained <= 0.0 and beta2 - best[0] <= 10.0 * tolerance * abs(best[0]):
            break
        if not reached < beta2:  # rounding rules out more
            break
        beta2 = reached + _STEP * (beta2 - reached)
    value = size * white.norm * float(np.sqrt(max(best[0], 0.0)))
    # G grows with M's unit: F of the matrix as given has G·size
    d, g = white.back(best)
    return UpperBound(value, Scalings(d, size * g))


def analytic_centre(
    matrix: Complex | Array, structure: BlockStructure, scalings: Scalings, bound: float
) -> Scalings:
    """Return the centre of the scalings that prove a bound of µ.

    Parameters
    ----------
    matrix : ndarray, shape (p, m)
        M.
    structure : BlockStructure
        Of Δ.
    scalings : Scalings
        That prove it.
    bound : float
        Above that of the scalings.

    Returns
    -------
    Scalings
        The scalings at the centre.

    Raises
    ------
    InputError
        If the matrix does not fit the structure.
    """
    squared = structure.pad_to_square(matrix)[None]
    size, n = float(np.linalg.norm(squared[0], 2)), structure.size
    basis = Basis(structure, np.ones(n, dtype=bool), 1.0)
    white = _Whitened(squared / size, basis)
    begun = basis.parameters(*white.there(scalings.d, scalings.g / size))
    _, centred = white.centre(begun, (bound / size / white.norm) ** 2, _CENTRED)
    d, g = white.back(centred)
    return Scalings(d, size * g)


def upper_bounds(
    matrices: Complex | Array,
    structure: BlockStructure,
    *,
    skewed: Sequence[int] | None = None,
    tolerance: float = 1e-6,
) -> list[UpperBound]:
    """Return bounds of several matrices (K, p, m); each search starts from the last scalings.

    Parameters
    ----------
    matrices : ndarray, shape (K, p, m)
        The matrices, complex.
    structure : BlockStructure
        Of Δ.
    skewed : sequence of int, optional
        Numbers of the blocks that alone grow; by default all do.
    tolerance : float
        Relative distance from the least bound at which a search ends.

    Returns
    -------
    list of UpperBound
        Bound and scalings of each.
    """
    made: list[UpperBound] = []
    for matrix in matrices:
        start = made[-1].scalings if made else None
        made.append(upper_bound(matrix, structure, skewed=skewed, start=start, tolerance=tolerance))
    return made


def _initial_level(
    m: Complex, structure: BlockStructure, basis: Basis, start: Scalings | None, size: float
) -> tuple[float, Complex, Complex] | None:
    """Return a level with its scalings; None without one."""
    n = basis.n
    zero = np.zeros((n, n), dtype=complex)
    d = basis.osborne(m)
    best = (level(m, d, zero, basis.free, basis.fixed), d, zero)
    if start is not None:
        # scalings of a neighbouring frequency, in the units of m
        d = start.d * (n / np.trace(start.d).real)
        g = start.g / size * (n / np.trace(start.d).real)
        warm = level(m, d, g, basis.free, basis.fixed)
        if warm < best[0]:
            best = (warm, d, g)
    if not np.isfinite(best[0]):
        made = _scale_fixed_blocks(m, structure, basis)
        if made is None:
            return None
        best = (level(m, *made, basis.free, basis.fixed), *made)
        if not np.isfinite(best[0]):
            return None
    if not basis.free.all():
        best = _reweight_skewed(m, basis, best)
    return best


class _Whitened:
    """Matrices in coordinates in which Osborne's D is I, divided by their norm there.

    A D that spans many decades, as where blocks have very different units, would otherwise be far
    from every centre under its trace, and µ far below the norm.
    """

    def __init__(self, m: Complex, basis: Basis) -> None:
        self.root = np.sqrt(np.diagonal(basis.osborne(m)).real)
        made = self.root[:, None] * m / self.root
        self.norm = max(float(np.linalg.norm(made, 2, axis=(1, 2)).max()), _SMALLEST)
        self.m = made / self.norm
        self.basis = basis.at(basis.fixed / self.norm**2)
        self._less = np.where(basis.of_g, 0.3, 1.0)

    def there(self, d: Complex, g: Complex) -> tuple[Complex, Complex]:
        """Return D, of trace n, and G in these coordinates."""
        both = np.outer(self.root, self.root)
        whole = len(d) / float(np.trace(d / both).real)
        return d / both * whole, g / both * (whole / self.norm)

    def centre(
        self, x: Array, b: float, decrement_at_end: float = _DECREMENT
    ) -> tuple[Array, tuple[float, Complex, Complex]]:
        """Return the centre for a level b above that of x: parameters, and level, D and G."""
        x = _centre(self.m, self.basis, x, b, decrement_at_end)
        scalings = self._scalings_at(x)
        # what rounding may have added grows with G, which a µ of zero lets grow without end
        while (smaller := self._scalings_at(x * self._less))[0] < scalings[0]:
            x, scalings = x * self._less, smaller
        return x, scalings

    def _scalings_at(self, x: Array) -> tuple[float, Complex, Complex]:
        d, g = self.basis.matrices(x)
        return level(self.m, d, g, self.basis.free, self.basis.fixed), d, g

    def back(self, scalings: tuple[float, Complex, Complex]) -> tuple[Complex, Complex]:
        """Return D and G of the matrices as they were."""
        _, d, g = scalings
        both = np.outer(self.root, self.root)
        return d * both, self.norm * (g * both)


def _reweight_skewed(
    m: Complex, basis: Basis, best: tuple[float, Complex, Complex]
) -> tuple[float, Complex, Complex]:
    """Return scalings, with their level, whose skewed part has a better weight than those found."""
    # line search over the weight of the skewed part, from coarse to fine factors; where nothing
    # leads back from it, µ is zero, and the weight would grow without end
    for factor in (30.0, 5.0, 1.5):
        for way in (factor, 1.0 / factor):
            share = np.where(basis.free, np.sqrt(way), 1.0)
            while best[0] > _ZERO**2:
                d, g = (share[:, None] * one * share for one in best[1:])
                whole = basis.n / np.trace(d).real
                reached = level(m, d * whole, g * whole, basis.free, basis.fixed)
                if not reached < best[0]:
                    break
                best = (reached, d * whole, g * whole)
    return best


def _scale_fixed_blocks(
    m: Complex, structure: BlockStructure, basis: Basis
) -> tuple[Complex, Complex] | None:
    """Return scalings of finite level, from a bound of the blocks that are not skewed alone."""
    kept = ~basis.free
    inner = BlockStructure(
        [b.enclosing_square() for k, b in enumerate(structure.blocks) if kept[structure.starts[k]]]
    )
    part = m[:, kept][:, :, kept]
    # feasible only if the fixed blocks alone have µ below their level
    proved = upper_bound(part, inner, target=float(np.sqrt(basis.fixed)))
    if proved.value**2 >= basis.fixed:
        return None
    d, g = np.zeros((2, basis.n, basis.n), dtype=complex)
    at = np.ix_(kept, kept)
    d[at], g[at] = proved.scalings.d, proved.scalings.g
    room = basis.fixed * d[at] - dg_form(part, d[at], g[at])
    side = m[:, basis.free][:, :, kept]
    taken = np.linalg.eigvals(np.linalg.solve(room, side.conj().swapaxes(1, 2) @ side)).real.max()
    # so small that the skewed rows take half of the room that F leaves
    small = min(0.5 / max(float(taken), 1e-12), float(np.trace(d).real))
    d[basis.free, basis.free] = small
    whole = basis.n / np.trace(d).real
    return d * whole, g * whole


def _centre(
    m: Complex, basis: Basis, x: Array, b: float, decrement_at_end: float = _DECREMENT
) -> Array:
    """Return the parameters of the centre for a level b above that of x."""
    value = basis.potential(m, x, b)
    if not np.isfinite(value):
        return x
    for _ in range(_MOST_NEWTON):
        gradient, hessian = basis.derivatives(m, x, b)
        step = _newton(basis, x, gradient, hessian)
        # square of the Newton decrement
        decrement = float(-gradient @ step)
        if not decrement > 0.0:
            return x
        # damped Newton step 1/(1 + λ), which stays inside for a self-concordant barrier
        length = 1.0 if decrement < 0.25 else 1.0 / (1.0 + np.sqrt(decrement))
        # the damped step is always inside; a longer one is tried as long as it pays
        made = _search_line(m, basis, x, step, b, value, length)
        if made is None:
            return x
        x, value = made
        # without a centre (G of a µ that is zero may grow forever) any proof of zero will do
        if np.sqrt(decrement) < decrement_at_end or np.isfinite(basis.potential(m, x, 0.0)):
            return x
    return x


def _newton(basis: Basis, x: Array, gradient: Array, hessian: Array) -> Array:
    """Return the step (k,) that keeps the trace of D."""
    units = basis.units(x)
    whole = hessian * np.outer(units, units)
    # rows of M that are zero but for rounding make entries of G void: those do not move
    whole[np.diag_indices_from(whole)] += _VOID * np.diagonal(whole).max() * basis.of_g
    sides = np.column_stack([-gradient * units, basis.trace * units])
    try:
        # positive, since the barrier is convex
        free, along = cho_solve(cho_factor(whole, check_finite=False), sides, check_finite=False).T
    except np.linalg.LinAlgError:  # but for rounding
        free, along = np.linalg.solve(whole, sides).T
    # Lagrange multiplier of tr D = n
    multiplier = (sides[:, 1] @ free) / (sides[:, 1] @ along)
    return np.asarray(units * (free - multiplier * along))


def _search_line(
    m: Complex, basis: Basis, x: Array, step: Array, b: float, value: float, length: float
) -> tuple[Array, float] | None:
    """Return the best of some points along a step that is better than x, None without one."""
    best: tuple[Array, float] | None = None
    while 1e-10 < length < _LONGEST:
        there = x + length * step
        new = basis.potential(m, there, b)
        if best is not None and not new < best[1]:
            return best
        if new < value:
            best = (there, new)
            length *= 2.0
        else:
            length *= 0.5
    return best
