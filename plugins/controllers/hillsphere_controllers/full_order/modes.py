"""Stabilisability and detectability by the Popov-Belevitch-Hautus (PBH) test."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from hillsphere.interfaces import Array
from hillsphere_controllers.errors import NotStabilisableError

__all__ = ["axis_mode", "check_modes", "describe_weakest_mode", "is_surely_stable"]

_MODE = 1e-9
"""Smallest singular value of [A − λ I, B], relative to the largest, below which the controls do not
reach the mode. A larger value refuses weakly controllable plants that can be stabilised."""
_NEAR = 1e-6
"""Distance of an eigenvalue from the stability boundary, relative to the largest, below which
rounding may have moved it off the boundary."""
_UNSEEN = 1e-13
"""Smallest singular value of the equilibrated matrix below which C does not show the mode:
rounding, since rows and columns have norm one."""
_CANCELLED = 1e-15
"""Entries of the diagonal of A − λ I below this share of the largest are what rounding leaves of
zero."""
_WEAK = 1e-2
"""Share of B or C that an unstable mode has, below which it is named where a synthesis fails."""
_EPS = float(np.finfo(float).eps)
_ROUNDS = 3
"""Rounds of scaling rows and columns to norm one, each of which disturbs the other; three bring
both close to one."""


def check_modes(a: Array, b: Array, c: Array, *, discrete: bool = False) -> None:
    """Check that the plant is stabilisable and detectable (PBH test).

    Parameters
    ----------
    a, b, c : ndarray, shape (n, n), (n, m), (p, n)
        Matrices from the controls to the measurements; with no columns in b or no rows in c, that
        side is not looked at.
    discrete : bool
        Whether the stable modes are those inside of the unit circle.

    Raises
    ------
    NotStabilisableError
        Naming the mode, and which side lacks it.
    """
    values, moved = _modes_with_rounding(a)
    for value, error in zip(values, moved, strict=True):
        # a mode on the boundary may be found on its stable side
        if (abs(value) < 1.0 - error) if discrete else (value.real < -error):
            continue
        away = a - value * np.eye(len(a))
        for matrix, what, remedy in (
            (np.hstack([away, b]), "the controls do not reach", "an actuator for it"),
            (np.vstack([away, c]).T, "the measurements do not show", "a sensor for it"),
        ):
            if matrix.shape[1] == len(a):
                continue
            # both tests: units alone can make the first fail, and rounding alone the second
            if _lacks_rank(matrix) and _lacks_rank(_equilibrate(matrix)):
                raise NotStabilisableError(
                    f"{what} the mode at {_say(value, error, discrete)}, which is not "
                    f"stable; add {remedy}, or take weights with poles on the "
                    f"{'unit circle' if discrete else 'axis'} out of the plant"
                )


def is_surely_stable(a: Array, *, discrete: bool = False) -> bool:
    """Return whether all eigenvalues of A are stable by more than rounding may have moved them.

    Parameters
    ----------
    a : ndarray, shape (n, n)
        Matrix; its units do not matter.
    discrete : bool
        Whether the stable modes are those inside of the unit circle.
    """
    values, moved = _modes_with_rounding(a)
    size = np.abs(values) - 1.0 if discrete else values.real
    return bool((size + moved < 0.0).all())


def describe_weakest_mode(a: Array, b: Array, c: Array) -> str:
    """Return in words which unstable mode is reached or shown least; empty if none is so little.

    Parameters
    ----------
    a, b, c : ndarray, shape (n, n), (n, m), (p, n)
        Matrices from the controls to the measurements in continuous time, the states balanced.
    """
    if not len(a):
        return ""
    values, left, right = eig(a, left=True, right=True)
    worst = _WEAK, ""
    for k in np.flatnonzero(values.real >= 0.0):
        for size, whole, what in (
            (left[:, k].conj() @ b, b, "the controls reach"),
            (c @ right[:, k], c, "the measurements show"),
        ):
            share = float(np.linalg.norm(size)) / max(float(np.linalg.norm(whole)), 1e-300)
            if share < worst[0]:
                name = _say(values[k], 0.0, discrete=False)
                worst = share, f"{what} the unstable mode at {name} by {share:.1e} of their size"
    return worst[1]


def _modes_with_rounding(a: Array) -> tuple[NDArray[np.complex128], Array]:
    """Return the eigenvalues (n,) of A, and how far rounding of its entries may have moved each.

    To first order |yᴴ| E |x| / |yᴴ x| for E = n ε |A|, with left and right eigenvectors y and x: an
    entry that is zero moves nothing, and no unit of the states counts.
    """
    if not len(a):
        return np.zeros(0, dtype=complex), np.zeros(0)
    values, left, right = eig(a, left=True, right=True)
    spread = np.einsum("ik,ij,jk->k", np.abs(left), np.abs(a), np.abs(right))
    overlap = np.abs(np.sum(left.conj() * right, axis=0))
    moved = len(a) * _EPS * spread / np.maximum(overlap, _EPS)
    # of modes that meet, the condition is no longer finite, and the error grows as the root
    return values, np.minimum(moved, np.sqrt(_EPS) * np.abs(values).max())


def _say(value: complex, error: float, discrete: bool) -> str:
    """Return a mode in words: what rounding makes of zero is zero."""
    real, imaginary = (0.0 if abs(part) <= error else part for part in (value.real, value.imag))
    number = f"{complex(real, imaginary):.6g}" if imaginary else f"{real:.6g}"
    return f"{'z' if discrete else 's'} = {number}"


def axis_mode(a: Array, c: Array, *, discrete: bool = False) -> complex | None:
    """Return a mode on the stability boundary that C does not show, None without one.

    Parameters
    ----------
    a, c : ndarray, shape (n, n), (p, n)
        Matrices.
    discrete : bool
        Whether the boundary is the unit circle.
    """
    values = np.linalg.eigvals(a)
    largest = float(np.abs(values).max(initial=0.0))
    for value in values:
        if discrete:
            if abs(abs(value) - 1.0) > _NEAR:
                continue
            at = complex(value / abs(value))
        elif abs(value.real) > _NEAR * largest:
            continue
        else:
            at = 1j * float(value.imag)
        matrix = _equilibrate(np.vstack([a - at * np.eye(len(a)), c]).T)
        if np.linalg.svd(matrix, compute_uv=False)[-1] <= _UNSEEN:
            return at
    return None


def _lacks_rank(matrix: Array) -> bool:
    values = np.linalg.svd(matrix, compute_uv=False)
    return bool(values[-1] <= _MODE * max(values[0], 1e-300))


def _equilibrate(matrix: Array) -> Array:
    """Return [A − λ I, B] with rows and columns of norm one: of a slow mode the row is small."""
    n = len(matrix)
    even = matrix.copy()
    # what rounding leaves of a − λ is nothing
    size = np.abs(np.diag(even)) <= _CANCELLED * np.abs(np.diag(even)).max()
    even[np.arange(n)[size], np.arange(n)[size]] = 0.0
    for axis in (1, 0) * _ROUNDS:
        norm = np.linalg.norm(even, axis=axis, keepdims=True)
        even = even / np.where(norm > 0.0, norm, 1.0)
    return np.asarray(even)
