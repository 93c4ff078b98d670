"""Peaks of the gain of a stable system over frequency, fast: what a line search looks at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.analysis.frequency import Response

__all__ = ["frequencies", "gains", "local_peaks", "refined_peaks"]

Complex = NDArray[np.complex128]

_GRID = 40
_KEEP = 0.5
"""Gains below this share of the largest are only bounded from below."""
_PEAKS, _SHARE = 6, 0.55
"""So many peaks are refined, those of at least this share of the largest gain."""
_NEAR = np.array([-1e-3, 0.0, 1e-3])


def frequencies(poles: Complex, remembered: Array) -> Array:
    """Return where the gain may peak, rad/s, in order: 0, about the poles, a grid, earlier peaks.

    Parameters
    ----------
    poles : ndarray, shape (n,)
        Of the system.
    remembered : ndarray, shape (K,)
        Frequencies of earlier peaks, rad/s.
    """
    size, imag, real = np.abs(poles), np.abs(poles.imag), np.abs(poles.real)
    # far above the poles is the direct term's business
    known = remembered[remembered <= 10.0 * size.max(initial=0.0)]
    found = [np.zeros(1), (known[:, None] * (1.0 + _NEAR)).ravel()]
    if poles.size:
        low, high = max(size.min(), 1e-12 * size.max()), size.max()
        grid = np.logspace(np.log10(low) - 1.0, np.log10(high) + 1.0, _GRID)
        found += [size, imag, imag + real, np.maximum(imag - real, 0.0), grid]
    points = np.unique(np.concatenate(found))
    # what is far below the poles is zero; rounding gives real poles imaginary parts
    points[points <= 1e-6 * size.min(initial=np.inf)] = 0.0
    apart = np.diff(points, prepend=-1.0) > 1e-9 * points
    return np.asarray(points[apart])


def gains(matrices: Complex) -> Array:
    """Return the largest singular values (K,) of matrices (K, p, m).

    Those well below the largest of all are only bounded from below, which is what makes it fast.
    """
    count, p, m = matrices.shape
    squares = np.einsum("kij,kij->k", matrices.real, matrices.real)
    squares += np.einsum("kij,kij->k", matrices.imag, matrices.imag)
    rank = min(p, m)
    if rank == 1 or count == 0:
        return np.asarray(np.sqrt(squares))
    found = np.sqrt(squares / rank)
    # σ ≤ ‖G‖_F, and σ at the largest ‖G‖_F is a bound for the largest
    high = np.flatnonzero(squares >= _KEEP**2 * found.max() ** 2)
    some = matrices[high]
    gram = some @ some.conj().swapaxes(1, 2) if p <= m else some.conj().swapaxes(1, 2) @ some
    if rank > 2:  # tighter: ‖GGᴴ‖_F/‖G‖_F ≤ σ ≤ ‖GGᴴ‖_F^½
        size = np.sqrt(np.sum(gram.real**2 + gram.imag**2, axis=(1, 2)))
        found[high] = size / np.sqrt(np.maximum(squares[high], 1e-300))
        near = size >= _KEEP**2 * found.max() ** 2
        high, gram = high[near], gram[near]
    if rank == 2:
        half, off = 0.5 * (gram[:, 0, 0] - gram[:, 1, 1]).real, np.abs(gram[:, 0, 1])
        top = 0.5 * (gram[:, 0, 0] + gram[:, 1, 1]).real + np.hypot(half, off)
    else:
        top = np.asarray(np.linalg.eigvalsh(gram)[:, -1], dtype=float)
    found[high] = np.sqrt(np.maximum(top, 0.0))
    return np.asarray(found)


def local_peaks(values: Array) -> Integers:
    """Return the indices of the largest local maxima of gains (N,), those worth to be refined."""
    inner = np.flatnonzero(
        (values >= np.append(values[1:], -1.0)) & (values >= np.insert(values[:-1], 0, -1.0))
    )
    inner = inner[np.argsort(values[inner], kind="stable")[-_PEAKS:]]
    return np.asarray(inner[values[inner] >= _SHARE * values.max()])


def refined_peaks(
    response: Response, part: Callable[[Complex], Complex], points: Array, values: Array
) -> tuple[Array, Array]:
    """Return the frequencies (K,) and gains (K,) of the largest local maxima.

    Parameters
    ----------
    response : Response
        Of the system.
    part : callable
        Takes the part of responses (K, p, m) whose gain is meant.
    points, values : ndarray, shape (N,)
        Frequencies in order, rad/s, and the gains there.
    """
    inner = local_peaks(values)
    at, high = points[inner], values[inner]
    left = points[np.maximum(inner - 1, 0)]
    right = points[np.minimum(inner + 1, points.size - 1)]
    share = np.array([0.25, 0.5, 0.75])[:, None]

    def look(omega: Array) -> Array:
        return gains(part(response((1j * omega.ravel()).astype(complex)))).reshape(omega.shape)

    column = np.arange(at.size)
    for _ in range(2):
        near = np.concatenate([left + share * (at - left), at + share * (right - at)])
        found = np.concatenate([left[None], near[:3], at[None], near[3:], right[None]])
        inside = look(near)
        levels = np.concatenate(
            [np.full((1, at.size), -1.0), inside[:3], high[None], inside[3:],
             np.full((1, at.size), -1.0)]
        )  # fmt: skip
        best = np.argmax(levels, axis=0)
        left, at, right = found[best - 1, column], found[best, column], found[best + 1, column]
        high = levels[best, column]
    for width in (0.3, 0.02):
        step = width * np.minimum(right - at, np.where(at > left, at - left, np.inf))
        step = np.minimum(step, np.where(at > 0.0, 0.5 * at, np.inf))
        sides = look(np.stack([np.maximum(at - step, 0.0), at + step]))
        bend = sides[0] - 2.0 * high + sides[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            move = np.where(bend < 0.0, 0.5 * step * (sides[0] - sides[1]) / bend, 0.0)
        move = np.clip(np.nan_to_num(move), -(at - left), right - at)
        move = np.where(at > 0.0, move, 0.0)
        tried = look((at + move)[None])[0]
        at, high = np.where(tried > high, at + move, at), np.maximum(tried, high)
    return at, high
