r"""Matrices that are polynomials of real parameters, as LFTs with as few copies as can be found.

.. math::

    P(p) = \sum_e P_e\, p_1^{e_1} p_2^{e_2} \cdots

One parameter is factored out of all terms that contain it, with as many copies as the remaining
coefficients have independent columns (or rows), by singular values. The quotient and the terms
without the parameter are stacked and factored likewise, so that common factors need copies once.
Then unreachable and unobservable copies are removed [1]_. The smallest result over different orders
of the parameters is returned. For affine matrices that is the least possible size (rank of each
coefficient [2]_), as it is for one parameter; in general `copies_lower_bound` bounds it from below.

References
----------
.. [1] C. L. Beck, J. Doyle (1999), A necessary and sufficient minimality condition for uncertain
   systems, IEEE Transactions on Automatic Control 44(10), 1802-1813.
.. [2] B. G. Morton (1985), New applications of mu to real-parameter variation problems, Proceedings
   of the 24th IEEE Conference on Decision and Control, 233-238.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, permutations, product
from math import comb

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import real_matrix
from hillsphere_controllers.linear_fractional.reduction import minimal
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.systems.algebra import gain

__all__ = [
    "Terms",
    "affine",
    "copies_lower_bound",
    "evaluate_polynomial",
    "polynomial",
    "scaled_polynomial",
]

Terms = Mapping[tuple[int, ...], Array]
"""Exponents, one for each parameter, → coefficient matrix (p, m)."""

_RANK = 1e-12
"""Singular values of the equilibrated coefficients below this share of the largest count as zero. A
larger value drops terms; a smaller one adds copies that exist only by rounding."""
_NEGLIGIBLE = 1e-3
"""A term of as little, relative to `_RANK`, is rounding."""
_MOST_ORDERS = 24
"""Orders of factoring tried for more than four parameters, where all permutations would be 120 and
more: 4! = 24, the number for four parameters."""


def evaluate_polynomial(terms: Terms, points: Array) -> Array:
    """Return values (N, p, m) of a polynomial at points (k, N).

    Parameters
    ----------
    terms : mapping of tuple of int to ndarray
        Exponents of the k parameters → coefficients (p, m).
    points : ndarray, shape (k, N)
        Values of the parameters.

    Returns
    -------
    ndarray, shape (N, p, m)
        The values.
    """
    return np.asarray(
        sum(
            np.prod(points ** np.array(e)[:, None], axis=0)[:, None, None] * np.asarray(matrix)
            for e, matrix in terms.items()
        )
    )


def affine(
    constant: Array, slopes: Mapping[str, Array], uncertainties: Sequence[Uncertainty]
) -> Lft:
    """Return P₀ + Σ pᵢ Pᵢ with as many copies of pᵢ as the rank of Pᵢ, which is the least.

    Parameters
    ----------
    constant : ndarray, shape (p, m)
        P₀.
    slopes : mapping of str to ndarray
        Name of a parameter → Pᵢ (p, m), per its unit.
    uncertainties : sequence of Uncertainty
        The parameters, real.

    Returns
    -------
    Lft
        The matrix, p × m.

    Raises
    ------
    InputError
        As `polynomial`; or if a name is unknown.
    """
    names = [u.name for u in uncertainties]
    terms: dict[tuple[int, ...], Array] = {(0,) * len(names): real_matrix(constant, "P₀")}
    for name, matrix in slopes.items():
        if name not in names:
            raise InputError(f"no uncertainty {name!r}; there are: {', '.join(names)}")
        terms[tuple(int(name == n) for n in names)] = real_matrix(matrix, name)
    return polynomial(terms, uncertainties)


def polynomial(terms: Terms, uncertainties: Sequence[Uncertainty]) -> Lft:
    """Return a polynomial of real parameters.

    Parameters
    ----------
    terms : mapping of tuple of int to ndarray
        Exponents → coefficients (p, m), in the units of the parameters.
    uncertainties : sequence of Uncertainty
        The parameters, real, in the order of the exponents.

    Returns
    -------
    Lft
        Without states; equal to the polynomial but for rounding.

    Raises
    ------
    InputError
        If exponents or coefficients do not fit.
    """
    checked = _check_terms(terms, uncertainties)
    # p = p₀ + g q with q = δ/(1 + c δ)
    shifted: dict[tuple[int, ...], Array] = {}
    for e, matrix in checked.items():
        for to in product(*(range(k + 1) for k in e)):
            factor = 1.0
            for k, j, u in zip(e, to, uncertainties, strict=True):
                factor *= comb(k, j) * u.slope**j * u.nominal ** (k - j)
            shifted[to] = shifted.get(to, 0.0) + factor * matrix
    return scaled_polynomial(shifted, uncertainties)


def scaled_polynomial(terms: Terms, uncertainties: Sequence[Uncertainty]) -> Lft:
    """Return a polynomial of q = (p − p₀)/g, the scaled distance of parameters from nominal.

    Parameters
    ----------
    terms : mapping of tuple of int to ndarray
        Exponents of the q → coefficients (p, m).
    uncertainties : sequence of Uncertainty
        The parameters p, real, with p₀ and g.

    Returns
    -------
    Lft
        The matrix, p × m.

    Raises
    ------
    InputError
        If exponents or coefficients do not fit.
    """
    checked = _check_terms(terms, uncertainties)
    # ranks are told by singular values: first bring rows and columns to one size
    rows, columns = _sizes(checked)
    even = {e: matrix / rows[:, None] / columns for e, matrix in checked.items()}
    kept = {e: m for e, m in even.items() if np.abs(m).max(initial=0.0) > _RANK * _NEGLIGIBLE}
    zero = (0,) * len(uncertainties)
    kept.setdefault(zero, np.zeros_like(next(iter(checked.values()))))
    best = _smallest_lft(kept, uncertainties)
    m11, m12, m21, m22 = best.parts()
    # q = δ/(1 + c δ): what goes into δ is less by c times what comes out
    curvature = [
        u.curvature for u, t in zip(best.uncertainties, best.times, strict=True) for _ in range(t)
    ]
    matrix = np.block(
        [[m11 - np.diag(curvature), m12 * columns], [rows[:, None] * m21, checked.get(zero, m22)]]
    )
    return Lft(gain(matrix), best.uncertainties, best.times)


def _smallest_lft(terms: Terms, uncertainties: Sequence[Uncertainty]) -> Lft:
    """Return the smallest LFT in q that some orders of the parameters give."""
    least = sum(copies_lower_bound(terms))
    best: Lft | None = None
    for order in _orders(terms, len(uncertainties)):
        for side in ("fewer", "left", "right"):
            smaller = minimal(_lft(_realise(terms, order, side), uncertainties))
            if best is None or smaller.size < best.size:
                best = smaller
            if best.size <= least:
                return best
    assert best is not None
    return best


def copies_lower_bound(terms: Terms, *, seed: int = 0) -> tuple[int, ...]:
    """Return numbers of copies that no LFT of a polynomial can go below, one for each parameter.

    With the others fixed, here at random, it is a polynomial of one parameter, whose least size is
    the rank of the Hankel matrix of its coefficients: in units of the parameters in which the terms
    are about as large, so that theirs do not matter.

    Parameters
    ----------
    terms : mapping of tuple of int to ndarray
        Exponents of the parameters → coefficients (p, m).
    seed : int
        Of the random values of the others.

    Returns
    -------
    tuple of int
        The bound for each parameter.
    """
    count = len(next(iter(terms)))
    unit = _units(terms)
    at = np.random.default_rng(seed).uniform(0.5, 1.5, count)
    terms = {e: np.prod(unit ** np.array(e)) * np.asarray(m) for e, m in terms.items()}
    made = []
    rows, columns = _sizes(terms)
    for v in range(count):
        degree = max(e[v] for e in terms)
        if degree == 0:
            made.append(0)
            continue
        rest: dict[int, Array] = {}
        for e, matrix in terms.items():
            factor = np.prod([at[i] ** e[i] for i in range(count) if i != v])
            even = matrix / rows[:, None] / columns
            rest[e[v]] = rest.get(e[v], 0.0) + factor * even
        none = np.zeros_like(next(iter(rest.values())))
        hankel = np.block(
            [[rest.get(i + j + 1, none) for j in range(degree)] for i in range(degree)]
        )
        # Ho and Kalman: the rank of the Hankel matrix is the order of a minimal realisation
        made.append(_rank(np.linalg.svd(hankel, compute_uv=False), _RANK))
    return tuple(made)


@dataclass(frozen=True)
class _Form:
    """M₁₁ … M₂₂ and which parameter each channel belongs to."""

    m11: Array
    m12: Array
    m21: Array
    m22: Array
    owners: tuple[int, ...]


def _realise(terms: Terms, order: Sequence[int], side: str) -> _Form:
    chosen = next((v for v in order if any(e[v] for e in terms)), None)
    if chosen is None:
        (m22,) = terms.values()
        p, m = m22.shape
        return _Form(np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0)), m22, ())
    v = chosen
    zero = next(iter(terms.values()))
    p, m = zero.shape
    # P = rest + p_v · drawn; the rank of drawn is the number of copies of p_v
    rest = {e: matrix for e, matrix in terms.items() if e[v] == 0}
    drawn = {(*e[:v], e[v] - 1, *e[v + 1 :]): matrix for e, matrix in terms.items() if e[v]}
    columns, s1, _ = np.linalg.svd(np.hstack(list(drawn.values())), full_matrices=False)
    _, s2, rows = np.linalg.svd(np.vstack(list(drawn.values())), full_matrices=False)
    r1, r2 = _rank(s1, _RANK), _rank(s2, _RANK)
    left = side == "left" or (side == "fewer" and r1 <= r2)
    both = sorted({*rest, *drawn, (0,) * len(order)})
    if left:
        factor = columns[:, :r1]
        joined = {
            e: np.vstack([rest.get(e, np.zeros((p, m))), factor.T @ drawn.get(e, np.zeros((p, m)))])
            for e in both
        }
        f = _realise(joined, order, side)
        n = len(f.owners)
        return _Form(
            np.block([[f.m11, np.zeros((n, r1))], [f.m21[p:], np.zeros((r1, r1))]]),
            np.vstack([f.m12, f.m22[p:]]),
            np.hstack([f.m21[:p], factor]),
            f.m22[:p],
            (*f.owners, *(r1 * [v])),
        )
    factor = rows[:r2]
    joined = {
        e: np.hstack([rest.get(e, np.zeros((p, m))), drawn.get(e, np.zeros((p, m))) @ factor.T])
        for e in both
    }
    f = _realise(joined, order, side)
    n = len(f.owners)
    return _Form(
        np.block([[f.m11, f.m12[:, m:]], [np.zeros((r2, n)), np.zeros((r2, r2))]]),
        np.vstack([f.m12[:, :m], factor]),
        np.hstack([f.m21, f.m22[:, m:]]),
        f.m22[:, :m],
        (*f.owners, *(r2 * [v])),
    )


def _lft(form: _Form, uncertainties: Sequence[Uncertainty]) -> Lft:
    owners = np.array(form.owners, dtype=int)
    order = np.argsort(owners, kind="stable")
    matrix = np.block(
        [[form.m11[np.ix_(order, order)], form.m12[order]], [form.m21[:, order], form.m22]]
    )
    there = sorted(set(form.owners))
    return Lft(
        gain(matrix),
        tuple(uncertainties[v] for v in there),
        tuple(int(np.sum(owners == v)) for v in there),
    )


def _orders(terms: Terms, count: int) -> Iterator[tuple[int, ...]]:
    """Yield orders of the parameters: all of few parameters, else some, high degrees first."""
    degree = [max(e[v] for e in terms) for v in range(count)]
    there = sorted((v for v in range(count) if degree[v]), key=lambda v: -degree[v])
    rest = tuple(v for v in range(count) if not degree[v])
    if len(there) <= 4:
        for order in permutations(there):
            yield (*order, *rest)
        return
    for k in range(len(there)):
        yield (*there[k:], *there[:k], *rest)
    for order in islice(permutations(there[::-1]), _MOST_ORDERS - len(there)):
        yield (*order, *rest)


def _sizes(terms: Terms) -> tuple[Array, Array]:
    """Return powers of two, rows (p,) and columns (m,), that entries are about as large as."""
    size = np.max([np.abs(matrix) for matrix in terms.values()], axis=0)
    rows, columns = np.ones(size.shape[0]), np.ones(size.shape[1])
    if size.size:
        for _ in range(3):
            rows *= _power_of_two((size / rows[:, None] / columns).max(axis=1))
            columns *= _power_of_two((size / rows[:, None] / columns).max(axis=0))
    return rows, columns


def _units(terms: Terms) -> Array:
    """Return powers of two (k,), units of the parameters in which the terms are about as large."""
    there = [(e, np.abs(matrix).max(initial=0.0)) for e, matrix in terms.items()]
    sizes = [(e, size) for e, size in there if size > 0.0]
    count = len(next(iter(terms)))
    if not sizes:
        return np.ones(count)
    powers = np.array([[*e, 1.0] for e, _ in sizes])
    slopes = np.linalg.lstsq(powers, np.log2([size for _, size in sizes]), rcond=None)[0]
    return np.asarray(np.exp2(-np.round(slopes[:count])))


def _power_of_two(values: Array) -> Array:
    return np.asarray(np.exp2(np.round(np.log2(np.where(values > 0.0, values, 1.0)))))


def _rank(values: Array, relative: float) -> int:
    return int(np.sum(values > relative * values[0])) if values.size and values[0] > 0.0 else 0


def _check_terms(
    terms: Terms, uncertainties: Sequence[Uncertainty]
) -> dict[tuple[int, ...], Array]:
    if not terms:
        raise InputError("a polynomial needs at least one term")
    names = [u.name for u in uncertainties]
    if len(set(names)) < len(names) or any(u.kind != "real" for u in uncertainties):
        raise InputError(f"a polynomial needs different real parameters, got {', '.join(names)}")
    made: dict[tuple[int, ...], Array] = {}
    for e, matrix in terms.items():
        if len(e) != len(names) or any(k < 0 or k != int(k) for k in e):
            raise InputError(
                f"{len(names)} exponents, whole and ≥ 0, are needed for a term, got {e}"
            )
        made[tuple(int(k) for k in e)] = real_matrix(matrix, f"the coefficient of {e}")
    shapes = {matrix.shape for matrix in made.values()}
    if len(shapes) != 1:
        raise InputError(f"coefficients must be matrices of one shape, got {sorted(shapes)}")
    return made
