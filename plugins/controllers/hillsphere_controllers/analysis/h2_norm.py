r"""The H2 norm: the power of the outputs under white noise of unit intensity.

.. math::

    \|G\|_2^2 = \operatorname{tr}(C P C^\mathsf{T}) = \operatorname{tr}(B^\mathsf{T} Q B), \quad
    A P + P A^\mathsf{T} + B B^\mathsf{T} = 0, \quad
    A^\mathsf{T} Q + Q A + C^\mathsf{T} C = 0,

in discrete time with :math:`A P A^\mathsf{T} - P` and D added [1]_.

References
----------
.. [1] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, sections
   4.4 and 21.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gramians import gramian
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["NormBounds", "h2_norm", "h2_norm_bounds", "h2_rounding"]

_AGREE = 1e-6
"""Relative distance of its bounds up to which the norm is one number."""
_EPS = float(np.finfo(float).eps)
_FINE = float(np.finfo(np.longdouble).eps)
"""Residuals are computed in extended precision, where the machine has one: in double precision they
would be rounding alone, whose bound is a thousand times the error of most norms."""
_REFINEMENTS = 2
"""Corrections of a Gramian by its residual; each takes off what a slow pole lost by rounding."""
_NOTHING = 1e-13
"""Rounding of the squares relative to the sum of the sizes of their terms: a norm below it is zero
but for cancellation."""


@dataclass(frozen=True)
class NormBounds:
    """Bounds of a norm.

    Parameters
    ----------
    lower, upper : float
        The norm of the system, whose entries count as exact, is between them.
    """

    lower: float
    upper: float


def h2_norm(system: LtiSystem) -> float:
    """Return the H2 norm of a system.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.

    Returns
    -------
    float
        Its norm; infinite if it is not stable or, in continuous time, has a direct term.

    Raises
    ------
    ConvergenceError
        If its bounds are farther apart than 1e-6 of it: `h2_norm_bounds` gives them.
    """
    if not system.is_stable or (system.dt_s is None and system.d.any()):
        return np.inf
    direct = float(np.sum(system.d**2))
    if system.order == 0 or 0 in system.shape:
        return float(np.sqrt(direct))
    low, value, high, size = _square(system)
    if value > _NOTHING * size and not high - low <= 2.0 * _AGREE * value:
        raise ConvergenceError(
            f"the H2 norm is only known to be from {np.sqrt(low):.9g} to {np.sqrt(high):.9g}: "
            "scale the states, inputs and outputs, or take poles that hardly matter out"
        )
    return float(np.sqrt(value))


def h2_norm_bounds(system: LtiSystem) -> NormBounds:
    r"""Return bounds of the H2 norm that rounding cannot have displaced.

    The residual R of a computed Gramian P bounds its error: where W is diagonal and exceeds the
    sums of the rows of :math:`|R|`, the true Gramian is within :math:`\pm X`, with
    :math:`A X + X A^\mathsf{T} + W = 0`. That X > 0 also proves that the system is stable.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.

    Returns
    -------
    NormBounds
        Both infinite if the system is not stable or, in continuous time, has a direct term; the
        upper alone if its stability is not proved.
    """
    if not system.is_stable or (system.dt_s is None and system.d.any()):
        return NormBounds(np.inf, np.inf)
    if system.order == 0 or 0 in system.shape:
        direct = float(np.linalg.norm(system.d))
        error = system.d.size * _EPS * direct
        return NormBounds(max(direct - error, 0.0), direct + error)
    low, _, high, _ = _square(system)
    return NormBounds(float(np.sqrt(low)), float(np.sqrt(high)))


def h2_rounding(system: LtiSystem) -> float:
    """Return the H2 norm below which a result is rounding, from the parts that cancel.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.

    Returns
    -------
    float
        Size of the rounding, in the unit of the norm.
    """
    if system.order == 0 or 0 in system.shape:
        return 0.0
    return float(np.sqrt(_NOTHING * _square(system)[3]))


def _square(system: LtiSystem) -> tuple[float, float, float, float]:
    """Return the norm's square between its bounds, and the sum of the sizes of its terms."""
    made, _ = balance_states(system)
    direct, discrete = float(np.sum(system.d**2)), system.dt_s is not None
    b, c = made.b.astype(np.longdouble), made.c.astype(np.longdouble)
    first = _trace(made.a, b @ b.T, made.c, discrete)
    second = _trace(made.a.T, c.T @ c, made.b.T, discrete)
    # Where inputs reach no output, both are what is left of sums of this size.
    size = direct + first[2]
    around = direct * system.d.size * _EPS
    low = direct + max(first[0] - first[1], second[0] - second[1], 0.0) - around
    high = direct + min(first[0] + first[1], second[0] + second[1]) + around
    value = direct + 0.5 * (first[0] + second[0])
    return max(low, 0.0), float(np.clip(value, max(low, 0.0), high)), high, size


def _trace(a: Array, q: Any, c: Array, discrete: bool) -> tuple[float, float, float]:
    """Return tr(C P Cᵀ) of the Gramian P of A and Q, its error, and the sum of its sizes."""
    p = gramian(a, np.asarray(q, dtype=float), discrete=discrete).astype(np.longdouble)
    for _ in range(_REFINEMENTS):
        p = p + gramian(
            a, np.asarray(_residual(a, p, q, discrete)[0], dtype=float), discrete=discrete
        )
    w = _row_sums(a, p, q, discrete)
    # Rows that nothing reaches have no residual, but X must be positive in all.
    w = np.maximum(w, np.finfo(float).tiny) + _EPS * w.max()
    x = gramian(a, np.diag(w), discrete=discrete)
    # X has an error too: it is that of W (1 ± share).
    share = float(np.max(_row_sums(a, x.astype(np.longdouble), np.diag(w), discrete) / w))
    value, size = float(np.sum((c @ p) * c)), float(np.sum((np.abs(c) @ np.abs(p)) * np.abs(c)))
    error = np.inf
    if share < 1.0 and _is_positive(x):
        error = float(np.sum((np.abs(c) @ np.abs(x)) * np.abs(c))) / (1.0 - share)
    return value, error + 2.0 * _EPS * abs(value) + 2.0 * len(a) * _FINE * size, size


def _residual(a: Array, p: Any, q: Any, discrete: bool) -> tuple[Any, Any]:
    """Return the residual (n, n) of a Lyapunov equation and a bound of its own rounding."""
    b, r = np.abs(a), np.abs(p)
    if discrete:
        return (
            a @ p @ a.T - p + q,
            (2 * len(a) + 3) * _FINE * (b @ r @ b.T + r + np.abs(q)),
        )
    return a @ p + p @ a.T + q, (len(a) + 3) * _FINE * (b @ r + r @ b.T + np.abs(q))


def _row_sums(a: Array, p: Any, q: Any, discrete: bool) -> Array:
    """Return sums of the rows (n,) of the sizes of a residual with its rounding."""
    value, rounding = _residual(a, p, q, discrete)
    return np.asarray(np.sum(np.abs(value) + rounding, axis=1), dtype=float) * (1.0 + 1e-9)


def _is_positive(x: Array) -> bool:
    """Say whether a symmetric matrix is positive definite beyond rounding."""
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(np.diagonal(x))
        scaled = x / root / root[:, None]
    if not np.isfinite(scaled).all():
        return False
    return bool(np.linalg.eigvalsh(scaled)[0] > len(x) ** 2 * _EPS)
