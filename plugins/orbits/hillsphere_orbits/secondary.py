"""Secondary bifurcations along a curve of periodic orbits: location and classification.

Besides 1, 1 the multipliers of an orbit are two pairs λ, 1/λ with the stability indices
b = λ + 1/λ. Along a family the kinds of bifurcation are roots of smooth functions of M alone, so
that the multipliers need not be matched from orbit to orbit. With
P(β) = (β − b₁)(β − b₂) = β² − σβ + τ,

========================  ===============================================================
``fold``, ``branching``   P(2) = 0, a pair 1, 1: a fold if the integral of motion turns
                          there (the family goes on, no other begins), else another
                          family of the same period begins (a symmetry breaks);
                          ``tangent`` where the integral is not known
``doubling``              P(−2) = 0, a pair −1, −1: orbits of twice the period begin
``d:n``                   P(2 cos 2πd/n) = 0: orbits of n times the period begin
``krein``                 σ² − 4τ = 0, two pairs meet and leave the unit circle (complex
                          instability; Neimark–Sacker in a dissipative system) or the
                          real axis
========================  ===============================================================

Where the motion out of the plane is separate each plane has its own index, and its own roots.

References
----------
.. [1] Broucke, R., Stability of periodic orbits in the elliptic, restricted three-body problem,
   AIAA J. 7, 1969, p. 1003 (the plane of σ and τ).
.. [2] Howard, J. E., MacKay, R. S., Linear stability of symplectic maps, J. Math. Phys. 28, 1987,
   p. 1036 (bifurcations as boundaries in that plane).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import cos, pi
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import bracketed_roots
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.stability import pair_indices
from hillsphere_orbits.stability import is_decoupled, stability_indices

__all__ = ["Secondary", "secondary"]

_NOISE = 1e-8  # of an index: values nearer to a root than this count as without sign
_LINEAR, _SQUARE = 1e-11, 1e-13  # rounding of traces of M and of M², relative to its elements
_PASSES = 3  # of the parabola through a near miss
_BESIDE = 1e-2  # of the distance of two samples: where the integral is looked at
_TURNS = 0.1  # of that distance: an extremum of the integral so near is a fold

_Test: TypeAlias = Callable[[Array], Array]
"""Monodromy matrices (n, n, N) → values (N,): NaN too near a root, infinite where not defined."""


@dataclass(frozen=True)
class Secondary:
    """Secondary bifurcations, ordered along the curve.

    Parameters
    ----------
    kind : tuple of str, length E
        ``"fold"``, ``"branching"``, ``"tangent"``, ``"doubling"``, ``"krein"`` or ``"d:n"``.
    plane : tuple of str, length E
        ``"planar"`` or ``"vertical"``; empty where the motions are coupled.
    position : ndarray, shape (E,)
        Place on the curve: sample number and the fraction of the way to the next one.
    index : ndarray of complex, shape (2, E)
        Both stability indices there: planar and vertical, or the dominant one first.
    """

    kind: tuple[str, ...]
    plane: tuple[str, ...]
    position: Array
    index: NDArray[np.complex128]


def secondary(
    at: Callable[[Array], Array],
    monodromy: Array,
    *,
    integral: Callable[[Array], Array] | None = None,
    resonances: Sequence[tuple[int, int]] = (),
    width: float = 1e-9,
) -> Secondary:
    """Find and classify the secondary bifurcations along a curve of periodic orbits.

    Sign changes of the test functions between samples bracket the roots; where one of them comes
    near zero and turns back, it is sampled at the vertex of the parabola through three samples, so
    that a pair of roots in between is not overlooked. All brackets are narrowed together. A root
    that only touches zero (an index at −2 of an orbit with two mirrors) is none.

    Parameters
    ----------
    at : callable
        Positions u (N,) within [0, K − 1] → monodromy matrices (n, n, N) of the corrected orbits
        there; ``at(i)`` is sample i.
    monodromy : ndarray, shape (6, 6, K) or (4, 4, K)
        Of the samples along the curve, K ≥ 2, in normalised units.
    integral : callable, optional
        Positions u (N,) → integral of motion (N,), by which folds are told from branchings.
    resonances : sequence of (int, int)
        d:n that are sought, n ≥ 3.
    width : float
        Positions are found to this width.

    Returns
    -------
    Secondary
        All bifurcations, in the order of position; possibly empty.

    Raises
    ------
    InputError
        If there are fewer than two samples or a resonance is none.
    """
    count = monodromy.shape[2]
    if count < 2:
        raise InputError(f"secondary bifurcations need two samples of the curve, got {count}")
    if bad := [f"{d}:{n}" for d, n in resonances if not (n >= 3 and 0 < 2 * d < n)]:
        raise InputError(f"resonances d:n need n ≥ 3 and 0 < d < n/2, got {', '.join(bad)}")
    tests = _tests(monodromy, resonances)
    places = np.arange(count, dtype=float)
    rows: list[tuple[int, float, float, float, float]] = []
    for k, (_, _, test) in enumerate(tests):
        rows += [
            (k, *bracket) for bracket in _brackets(*_with_turns(at, test, places, test(monodromy)))
        ]
    if not rows:
        return Secondary((), (), np.empty(0), np.empty((2, 0), dtype=complex))
    which = np.array([row[0] for row in rows], dtype=np.intp)
    low, high, f_low, f_high = np.array([row[1:] for row in rows]).T

    def values_at(u: Array) -> Array:
        matrices, out = at(u), np.empty(u.size)
        for k in np.unique(which):
            own = which == k
            out[own] = tests[k][2](matrices[:, :, own])
        # without a certain sign the root is known as closely as rounding permits
        return np.where(np.isfinite(out), out, 0.0)

    u = bracketed_roots(values_at, low, high, f_low, f_high, np.full(low.shape, width))
    order = np.argsort(u, kind="stable")
    u, which = u[order], which[order]
    kinds = [tests[k][0] for k in which]
    planes = [tests[k][1] for k in which]
    return Secondary(
        tuple(_classify_tangent_bifurcations(integral, kinds, planes, u, count - 1.0)),
        tuple(planes),
        u,
        _indices(at(u)),
    )


def _tests(monodromy: Array, resonances: Sequence[tuple[int, int]]) -> list[tuple[str, str, _Test]]:
    """Return (kind, plane, test function) of all bifurcations sought."""
    targets = [("tangent", 2.0), ("doubling", -2.0)]
    # multipliers exp(±2πi d/n) have the index 2 cos(2π d/n)
    targets += [(f"{d}:{n}", 2.0 * cos(2.0 * pi * d / n)) for d, n in resonances]
    if monodromy.shape[0] == 4 or bool(np.all(is_decoupled(monodromy))):
        planes = ("planar", "vertical")[: 1 if monodromy.shape[0] == 4 else 2]
        return [
            (kind, plane, _of_plane(row, value))
            for row, plane in enumerate(planes)
            for kind, value in targets
        ]
    coupled = [(kind, "", _of_pairs(value)) for kind, value in targets]
    return [*coupled, ("tangent", "", _beside_neutral), ("krein", "", _collision)]


def _of_plane(row: int, target: float) -> _Test:
    def test(monodromy: Array) -> Array:
        index = stability_indices(monodromy)[row]
        size = np.max(np.abs(monodromy), axis=(0, 1))
        return _sure(index - target, _NOISE * (1.0 + np.abs(index)) + _LINEAR * size)

    return test


def _of_pairs(target: float) -> _Test:
    def test(monodromy: Array) -> Array:
        first, second = pair_indices(monodromy)
        size = np.max(np.abs(monodromy), axis=(0, 1))
        # P(β) = (β − b₁)(β − b₂), real also for a complex pair
        values = ((target - first) * (target - second)).real
        values = _sure(values, _NOISE * (1.0 + np.abs(first)) + _SQUARE * size**2)
        # the sign of a pair that cannot be told from 1, 1 is rounding: `_beside_neutral` looks on
        return np.where((second == 2.0) & (target == 2.0), np.inf, values)

    return test


def _beside_neutral(monodromy: Array) -> Array:
    """Return 2 − b of the dominant pair where the other one is 1, 1 to rounding."""
    first, second = pair_indices(monodromy)
    values = _sure(2.0 - first.real, _NOISE * (1.0 + np.abs(first)))
    return np.where(second == 2.0, values, np.inf)


def _collision(monodromy: Array) -> Array:
    first, second = pair_indices(monodromy)
    size = np.max(np.abs(monodromy), axis=(0, 1))
    # (b₁ − b₂)² = σ² − 4τ: negative under complex instability
    gap = ((first - second) ** 2).real
    return _sure(gap, _NOISE * (1.0 + np.abs(first) ** 2) + _SQUARE * size**2)


def _sure(values: Array, noise: Array) -> Array:
    return np.asarray(np.where(np.abs(values) > noise, values, np.nan))


def _brackets(u: Array, values: Array) -> list[tuple[float, float, float, float]]:
    """Return (u, u, value, value) on both sides of every change of sign that is certain."""
    known = ~np.isnan(values)
    u, values = u[known], values[known]
    both = np.isfinite(values[1:]) & np.isfinite(values[:-1])
    i = np.flatnonzero(both & ((values[1:] > 0.0) != (values[:-1] > 0.0)))
    return list(zip(u[i], u[i + 1], values[i], values[i + 1], strict=True))


def _with_turns(
    at: Callable[[Array], Array], test: _Test, u: Array, values: Array
) -> tuple[Array, Array]:
    """Add samples where the function comes near zero and turns back between samples."""
    for _ in range(_PASSES):
        triples = np.lib.stride_tricks.sliding_window_view(values, 3)
        places = np.lib.stride_tricks.sliding_window_view(u, 3)
        a, b, c = triples.T
        p, q, r = places.T
        with np.errstate(invalid="ignore", divide="ignore"):
            toward = (b > 0.0) & (b <= a) & (b <= c) | (b < 0.0) & (b >= a) & (b >= c)
            # the parabola through three samples in Newton's form
            first, last = (b - a) / (q - p), (c - b) / (r - q)
            bend = (last - first) / (r - p)
            vertex = 0.5 * (p + q - first / bend)
            least = a + (vertex - p) * (first + bend * (vertex - q))
            # sample the vertex if the parabola passes zero there, or comes to less than half the
            # value
            near = toward & np.isfinite(least) & ((least > 0.0) != (b > 0.0))
            near |= toward & np.isfinite(least) & (np.abs(least) < 0.5 * np.abs(b))
        near &= np.min(np.abs(places - vertex[:, None]), axis=1) > 1e-6 * (r - p)
        if not np.any(near):
            break
        more = np.unique(np.clip(vertex[near], p[near], r[near]))
        u, order = np.concatenate([u, more]), np.argsort(np.concatenate([u, more]), kind="stable")
        values = np.concatenate([values, test(at(more))])[order]
        u = u[order]
    return u, values


def _classify_tangent_bifurcations(
    integral: Callable[[Array], Array] | None,
    kinds: Sequence[str],
    planes: Sequence[str],
    u: Array,
    last: float,
) -> list[str]:
    """Separate folds from branchings: at a fold the integral of motion has an extremum."""
    classified = list(kinds)
    pairs = [k for k, kind in enumerate(kinds) if kind == "tangent"]
    # The integral is the coordinate of the plane's own family: it cannot turn out of the plane.
    for k in [k for k in pairs if planes[k] == "vertical"]:
        classified[k] = "branching"
    asked = [k for k in pairs if planes[k] != "vertical"]
    if integral is None or not asked:
        return classified
    middle = np.clip(u[asked], _BESIDE, last - _BESIDE)
    before, here, after = (integral(middle + step) for step in (-_BESIDE, 0.0, _BESIDE))
    slope, bend = after - before, after - 2.0 * here + before
    # the vertex of the parabola lies −slope/(2 bend) of the spacing from the middle
    place = middle - u[asked]
    for k, s, b, shift in zip(asked, slope, bend, place, strict=True):
        # at a fold the integral has its extremum at the root; at a branching it passes with a slope
        offset = abs(shift - 0.5 * _BESIDE * s / b) if b != 0.0 else np.inf
        classified[k] = "fold" if offset < _TURNS * _BESIDE else "branching"
    return classified


def _indices(monodromy: Array) -> NDArray[np.complex128]:
    if monodromy.shape[0] == 4 or bool(np.all(is_decoupled(monodromy))):
        return np.array(stability_indices(monodromy), dtype=complex)
    return pair_indices(monodromy)
