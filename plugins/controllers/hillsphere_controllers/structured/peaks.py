"""Peaks over frequency of the gains of many stable systems at once, fast, for line searches.

Systems of one size are looked at together. What belongs to a frequency or a peak of any of them is
in one flat array, with the number of its system, the owner, beside it; owners are in order, and so
are the frequencies of each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.analysis.frequency import Response

__all__ = ["frequencies", "gains", "local_peaks", "refine_peaks", "responses"]

Complex = NDArray[np.complex128]

_GRID = np.linspace(0.0, 1.0, 40)
_KEEP = 0.5
"""Gains below this share of the largest are only bounded."""
_PEAKS, _SHARE = 6, 0.55
"""So many peaks are refined, those of at least this share of the largest gain."""
_STEPS, _GAINED = 12, 1e-10
"""At most so many steps to a peak; the last one is that which promises no more of σ², relative."""


def frequencies(poles: Complex, remembered: Sequence[Array]) -> tuple[Array, Integers]:
    """Return where the gains may peak: 0, about the poles, a grid, earlier peaks.

    Parameters
    ----------
    poles : ndarray, shape (J, n)
        Of the systems.
    remembered : sequence of ndarray
        Frequencies of earlier peaks of each, rad/s.

    Returns
    -------
    points : ndarray, shape (N,)
        Frequencies, rad/s.
    owner : ndarray of int, shape (N,)
        System of each.
    """
    count, n = poles.shape
    size, imag, real = np.abs(poles), np.abs(poles.imag), np.abs(poles.real)
    # far above all poles the gain is that of the direct term
    fast = size.max(axis=1, initial=0.0)
    known = [w[w <= 10.0 * most] for w, most in zip(remembered, fast.tolist(), strict=True)]
    candidates = [np.zeros((count, 1))]
    if n:
        slow = np.maximum(size.min(axis=1), 1e-12 * fast)
        low, high = np.log10(slow)[:, None] - 1.0, np.log10(fast)[:, None] + 1.0
        grid = 10.0 ** (low + _GRID * (high - low))
        # a resonance lies near |Im λ|, a corner frequency near |λ|; ±|Re λ| are its half-power
        # points
        candidates += [size, imag, imag + real, np.maximum(imag - real, 0.0), grid]
    each = np.hstack(candidates)
    owner = np.repeat(np.arange(count), each.shape[1])
    points = np.concatenate([each.ravel(), *known])
    owner = np.concatenate([owner, np.repeat(np.arange(count), [w.size for w in known])])
    if n:  # what is far below the poles is zero; rounding gives real poles imaginary parts
        points[points <= 1e-6 * size.min(axis=1)[owner]] = 0.0
    order = np.lexsort((points, owner))
    points, owner = points[order], owner[order]
    apart = np.diff(points, prepend=-1.0) > 1e-9 * points
    apart |= np.diff(owner, prepend=-1) > 0
    return points[apart], owner[apart]


def responses(systems: Sequence[Response], points: Array, owner: Integers) -> Complex:
    """Return the responses (N, p, m) of systems at frequencies, rad/s."""
    ends = np.searchsorted(owner, np.arange(len(systems) + 1))
    s = (1j * points).astype(complex)
    made = [r(s[i:j]) for r, i, j in zip(systems, ends[:-1], ends[1:], strict=True) if j > i]
    return np.concatenate(made)


def gains(matrices: Complex, owner: Integers | None = None) -> Array:
    """Return the largest singular values (N,) of matrices (N, p, m).

    Those that cannot be the largest are only bounded from below, which is what makes it fast. With
    owners those that are no high local maximum are bounded from above, so that maxima stay where
    they are.
    """
    count, p, m = matrices.shape
    rank = min(p, m)
    if rank == 1 or count == 0:
        return np.asarray(np.sqrt(_squares(matrices)))
    turned = matrices.conj().swapaxes(1, 2)
    gram = matrices @ turned if p <= m else turned @ matrices
    if rank == 2:
        # 2 × 2: the larger eigenvalue in closed form
        half, off = 0.5 * (gram[:, 0, 0] - gram[:, 1, 1]).real, np.abs(gram[:, 0, 1])
        top = 0.5 * (gram[:, 0, 0] + gram[:, 1, 1]).real + np.hypot(half, off)
        return np.asarray(np.sqrt(np.maximum(top, 0.0)))
    # with H = GGᴴ: (‖H²‖_F/‖H‖_F)^½ ≤ σ ≤ ‖H²‖_F^¼
    first, second = np.sqrt(_squares(gram)), np.sqrt(_squares(gram @ gram))
    low, high = np.sqrt(second / np.maximum(first, 1e-300)), np.sqrt(np.sqrt(second))
    if owner is None:
        bounds, wanted = low, high >= low.max()
    else:
        bounds, wanted = high, high >= _KEEP * _largest_by_owner(low, owner)
        wanted &= high >= np.maximum(*_neighbours(low, owner))
    top = np.asarray(np.linalg.eigvalsh(gram[wanted])[:, -1], dtype=float)
    bounds[wanted] = np.sqrt(np.maximum(top, 0.0))
    return np.asarray(bounds)


def _squares(matrices: Complex) -> Array:
    flat = matrices.reshape(len(matrices), -1)
    return np.asarray(
        np.einsum("kx,kx->k", flat.real, flat.real) + np.einsum("kx,kx->k", flat.imag, flat.imag)
    )


def _largest_by_owner(values: Array, owner: Integers) -> Array:
    """Return the largest value of each one's owner (N,)."""
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    return np.asarray(
        np.repeat(np.maximum.reduceat(values, first), np.diff(first, append=owner.size))
    )


def _neighbours(values: Array, owner: Integers) -> tuple[Array, Array]:
    """Return the values before and after each, −1 where those belong to another."""
    same = owner[1:] == owner[:-1]
    before, after = np.full(values.size, -1.0), np.full(values.size, -1.0)
    before[1:][same], after[:-1][same] = values[:-1][same], values[1:][same]
    return before, after


def local_peaks(values: Array, owner: Integers) -> Integers:
    """Return the indices of the largest local maxima of gains (N,), those worth to be refined."""
    before, after = _neighbours(values, owner)
    inner = np.flatnonzero(
        (values >= after)
        & (values >= before)
        & (values >= _SHARE * _largest_by_owner(values, owner))
    )
    whose = owner[inner]
    order = np.lexsort((-values[inner], whose))
    place = np.arange(inner.size) - np.searchsorted(whose, whose)  # owners stay in order
    return np.asarray(np.sort(inner[order[place < _PEAKS]]))


def refine_peaks(
    systems: Sequence[Response],
    part: Callable[[Complex], Complex],
    points: Array,
    values: Array,
    owner: Integers,
) -> tuple[Array, Array, Integers]:
    """Return the frequencies (K,), gains (K,) and owners (K,) of the largest local maxima.

    Newton's method on 1/σ², which at a single resonance is a parabola. Each peak stays between its
    neighbours; a step that leaves them, or leads lower, is halved.

    Parameters
    ----------
    systems : sequence of Response
        Systems.
    part : callable
        Takes the part of responses (K, p, m) whose gain is meant.
    points, values : ndarray, shape (N,)
        Frequencies in order, rad/s, and the gains there.
    owner : ndarray of int, shape (N,)
        System of each.
    """
    inner = local_peaks(values, owner)
    before, after = _neighbours(points, owner)
    at, left, right = points[inner], before[inner], after[inner]
    left, right = np.where(left < 0.0, at, left), np.where(right < 0.0, at, right)
    whose = owner[inner]
    high, slope, bend = _square_and_derivatives(systems, part, at, whose)
    going = np.ones(at.size, dtype=bool)
    for _ in range(_STEPS):
        up = slope > 0.0
        up |= (at <= 0.0) & (bend > 0.0)  # an even function
        left, right = np.where(up, at, left), np.where(up, right, at)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # Newton's step on 1/σ²: its derivatives by those of σ²
            curved = 2.0 * slope**2 / high - bend
            move = np.where(curved > 0.0, slope / curved, np.inf)
            gained = 0.5 * slope * move / high
        inside = (at + move > left) & (at + move < right)
        # towards the side on which the gain rises, halving the bracket where Newton leaves it
        rest = np.where(up, right, left) - at
        move = np.where(inside, move, 0.5 * rest)
        done = going & inside & ~(gained > _GAINED)  # of a halved step the gain is not known
        at, high = np.where(done, at + move, at), np.where(done, high * (1.0 + gained), high)
        going &= ~done & (np.abs(rest) > 1e-12 * at)
        if not going.any():
            break
        one = np.flatnonzero(going)
        tried = at[one] + move[one]
        level, steep, turned = _square_and_derivatives(systems, part, tried, whose[one])
        better = level > high[one]
        worse = one[~better]  # what lies beyond it is not looked at again
        left[worse] = np.where(move[worse] < 0.0, tried[~better], left[worse])
        right[worse] = np.where(move[worse] > 0.0, tried[~better], right[worse])
        one = one[better]
        at[one], high[one] = tried[better], level[better]
        slope[one], bend[one] = steep[better], turned[better]
    return at, np.sqrt(high), whose


def _square_and_derivatives(
    systems: Sequence[Response],
    part: Callable[[Complex], Complex],
    omega: Array,
    owner: Integers,
) -> tuple[Array, Array, Array]:
    """Return σ₁², and its first and second derivative by ω, (K,) each."""
    ends = np.searchsorted(owner, np.arange(len(systems) + 1))
    made = [
        system.derivatives(omega[i:j])
        for system, i, j in zip(systems, ends[:-1], ends[1:], strict=True)
        if j > i
    ]
    g, first, second = (part(np.concatenate(one)) for one in zip(*made, strict=True))
    if g.shape[1] > g.shape[2]:
        g, first, second = (one.swapaxes(1, 2) for one in (g, first, second))
    turned = g.conj().swapaxes(1, 2)
    values, vectors = np.linalg.eigh(g @ turned)
    u = vectors[:, :, -1:]
    right, moved = turned @ u, first.conj().swapaxes(1, 2) @ u  # Gᴴu, G'ᴴu
    # perturbation of a simple eigenvalue of G Gᴴ: first order uᴴ (GGᴴ)' u, second order with the
    # others' coupling over their distance
    along = vectors.conj().swapaxes(1, 2) @ (first @ right + g @ moved)  # u_kᴴ (GGᴴ)' u
    slope = along[:, -1, 0].real
    bend = 2.0 * _squares(moved)
    bend += 2.0 * (u.conj().swapaxes(1, 2) @ (second @ right))[:, 0, 0].real
    apart = np.maximum(values[:, -1:] - values[:, :-1], 1e-14 * values[:, -1:] + 1e-300)
    bend += 2.0 * np.sum(np.abs(along[:, :-1, 0]) ** 2 / apart, axis=1)
    return np.maximum(values[:, -1], 0.0), slope, bend
