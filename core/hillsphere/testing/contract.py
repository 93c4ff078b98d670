"""The exception of the conformance kit, and common functions of its numerical checks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.base.errors import HillsphereError
from hillsphere.interfaces import Array

__all__ = ["ContractViolation", "check_close", "derivative_by_differences", "require"]

# Offsets, in steps, and weights of the central difference of sixth order (Fornberg 1988, table 1).
_STENCIL = ((1, 3.0 / 4.0), (2, -3.0 / 20.0), (3, 1.0 / 60.0))


class ContractViolation(HillsphereError, AssertionError):  # noqa: N818 - read in test reports
    """A component violates the contract of its kind."""


def require(condition: object, message: str) -> None:
    """Raise `ContractViolation` with the message unless the condition holds."""
    if not condition:
        raise ContractViolation(message)


def check_close(what: str, got: Array, expected: Array, scale: Array | float, tol: float) -> None:
    """Require |got − expected| ≤ tol·scale everywhere.

    Parameters
    ----------
    what : str
        Name of the quantity, for the message.
    got, expected : ndarray, shape (..., N)
        Values to compare, of the same shape.
    scale : ndarray or float
        Size to which the difference is relative; it is broadcast.
    tol : float
        Largest relative difference.

    Raises
    ------
    ContractViolation
        If a difference is larger, a shape differs or a value is not finite; the message names the
        worst case.
    """
    require(got.shape == expected.shape, f"{what}: shape {got.shape}, expected {expected.shape}")
    require(np.all(np.isfinite(got)), f"{what}: not finite in cases {_bad_cases(got)}")
    error = np.abs(got - expected) / scale
    if error.size and not float(error.max()) <= tol:
        worst = np.unravel_index(int(np.nanargmax(error)), error.shape)
        raise ContractViolation(
            f"{what}: relative difference {error[worst]:.2e} over {tol:.0e} "
            f"(got {got[worst]:.12g}, expected {expected[worst]:.12g}, case {worst[-1]})"
        )


def derivative_by_differences(function: Callable[[Array], Array], x: Array, steps: Array) -> Array:
    """Return the Jacobian by sixth-order central differences [1]_.

    Parameters
    ----------
    function : callable
        (n, N) → (m, N).
    x : ndarray, shape (n, N)
        Points at which to differentiate.
    steps : ndarray, shape (n, N)
        Step of each input.

    Returns
    -------
    ndarray, shape (m, n, N)
        The Jacobian, with a truncation error of order h⁶ and rounding of order ε/h.

    References
    ----------
    .. [1] Fornberg (1988), Generation of finite difference formulas on arbitrarily spaced grids,
       Math. Comp. 51, table 1.
    """
    n, cases = x.shape
    shifted = [
        x + np.where(np.arange(n)[:, None] == i, sign * reach * steps, 0.0)
        for i in range(n)
        for reach, _ in _STENCIL
        for sign in (1.0, -1.0)
    ]
    values = function(np.ascontiguousarray(np.concatenate(shifted, axis=1)))
    table = values.reshape(values.shape[0], n, len(_STENCIL), 2, cases)
    weights = np.array([weight for _, weight in _STENCIL])
    odd = table[:, :, :, 0] - table[:, :, :, 1]
    return np.asarray(np.einsum("mirc,r->mic", odd, weights) / steps)


def _bad_cases(values: Array) -> list[int]:
    bad = ~np.isfinite(values).reshape(-1, values.shape[-1]).all(axis=0)
    return [int(i) for i in np.flatnonzero(bad)][:10]
