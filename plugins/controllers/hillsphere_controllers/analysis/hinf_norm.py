r"""The H∞ norm: the largest singular value of a stable system over all frequencies.

γ exceeds the norm just if the Hamiltonian matrix, with :math:`R = γ^2 I - D^\mathsf{T} D`,

.. math::

    H(γ) = \begin{bmatrix} A + B R^{-1} D^\mathsf{T} C & B R^{-1} B^\mathsf{T} \\
           -C^\mathsf{T} (I + D R^{-1} D^\mathsf{T}) C & -(A + B R^{-1} D^\mathsf{T} C)^\mathsf{T}
           \end{bmatrix}

has no imaginary eigenvalue [1]_; where it has some, they are the frequencies at which a singular
value is γ, and the gain between them is higher [2]_. In floating point an eigenvalue is never quite
imaginary: the frequency response decides at all eigenvalues that are nearly so. The result is a
gain that the system has at a named frequency, and an upper bound that allows for rounding of the
response: the solution of P (s I − A) X = L U X = P B is that of a matrix that differs by no more
than :math:`n ε |L| |U|` [3]_.

References
----------
.. [1] S. Boyd, V. Balakrishnan, P. Kabamba (1989), A bisection method for computing the H∞ norm of
   a transfer matrix and related problems, Mathematics of Control, Signals and Systems 2, 207-219.
.. [2] N. A. Bruinsma, M. Steinbuch (1990), A fast algorithm to compute the H∞-norm of a transfer
   function matrix, Systems & Control Letters 14, 287-293.
.. [3] N. J. Higham (2002), Accuracy and Stability of Numerical Algorithms, 2nd edition, SIAM,
   chapter 9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import zgetrf, zgetri

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response, largest_gains
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous

__all__ = [
    "HinfNorm", "hamiltonian_eigenvalues", "hamiltonians_eigenvalues", "hinf_norm",
    "invert_frequency",
]  # fmt: skip

_MOST_LEVELS = 40
"""Levels at most. The level rises quadratically to the norm: fewer than ten are needed, and the
limit ends cycles by rounding."""
_GRID = 40
"""Frequencies of the first look, evenly spaced in their logarithm; besides those of the poles."""
_NEAR = 1e-2
"""An eigenvalue this near the imaginary axis, relative to its size, is looked at."""
_CLOSE, _MOST_CLOSE = 1e-3, 20
"""Gains as near the largest as that are computed once more from the system as given: where its
matrices are badly conditioned, rounding may change the order."""
_FLAT = 1e-11
"""Relative rise of the gain below which a peak is not searched more finely."""
_NOISE, _FLAT_TOP, _NARROWER = 2e-10, 10.0, 5
"""Above this noise of the gains the peak is looked for once more: in the system as given, within so
many times the noise's root, relative, in so many rounds."""
_SAME = 1e-6
"""Relative distance of poles whose gains need not be looked at twice."""
_DOUBTFUL = 1e-2
"""Relative error of a norm from which on it is not to be relied on."""

_EPS = float(np.finfo(float).eps)
_ROUNDED = 3
"""Frequencies, besides the peak and zero, at which the effect of rounding is looked at."""


@dataclass(frozen=True)
class HinfNorm:
    """A norm and where it is reached.

    Parameters
    ----------
    value : float
        The largest gain found, which the response has at the frequency but for `error`; infinite
        for a system that is not stable.
    frequency_rad_s : float
        Where; may be 0 or, in continuous time, infinite. NaN for a system that is not stable.
    upper : float
        A level that the gain exceeds nowhere, as far as the eigenvalues tell, the effect of
        rounding included; infinite if none was found.
    error : float
        Bound of what rounding can have changed in the value, relative to it. Infinite where
        s I − A is singular but for rounding: its entries do not determine a norm. Above 0.01, see
        `doubt`, scale the states or find the system in better conditioned coordinates.
    """

    value: float
    frequency_rad_s: float
    upper: float
    error: float = 0.0

    @property
    def doubt(self) -> str:
        """A doubt about the value in words; empty if rounding leaves it at least two digits."""
        if not self.error > _DOUBTFUL:
            return ""
        much = f"by {100.0 * self.error:.2g} %" if np.isfinite(self.error) else "by any amount"
        return f"rounding can change its norm, found as {self.value:.6g}, {much}; scale the states"


def hinf_norm(system: LtiSystem, tolerance: float = 1e-9) -> HinfNorm:
    """Return the H∞ norm of a system.

    Parameters
    ----------
    system : LtiSystem
        In continuous time, or in discrete time, whose bilinear image has the same norm.
    tolerance : float
        Relative distance between the bounds.

    Returns
    -------
    HinfNorm
        The norm; infinite if the system is not stable.

    Raises
    ------
    InputError
        If the tolerance is out of range.
    """
    if not 1e-14 <= tolerance < 1.0:
        raise InputError(f"tolerance must be from 1e-14 to 1, got {tolerance}")
    poles = system.poles
    size = poles.real if system.dt_s is None else np.abs(poles) - 1.0
    if not size.max(initial=-np.inf) < 0.0:
        return HinfNorm(np.inf, np.nan, np.inf)
    if system.dt_s is not None:
        made, _ = balance_states(system)
        norm = hinf_norm(continuous(made), tolerance)
        frequency = 2.0 / system.dt_s * float(np.arctan(0.5 * system.dt_s * norm.frequency_rad_s))
        if system.order == 0 or 0 in system.shape:
            return HinfNorm(norm.value, frequency, norm.upper)
        # the image was rounded as well
        high, error = _gain_with_rounding(made, frequency)
        return HinfNorm(norm.value, frequency, max(norm.upper, high), max(norm.error, error))
    direct = float(largest_gains(system.d[None].astype(complex))[0])
    if system.order == 0 or 0 in system.shape:
        return HinfNorm(direct, 0.0, direct)
    search = _Search(system, poles)
    if search.value == np.inf:  # rounding has put a pole on the axis: nothing is told
        return HinfNorm(np.inf, search.frequency, np.inf, np.inf)
    if search.value > direct:
        return search.climb(tolerance)
    # The peak is at infinity, where R is singular: s → ω²/s puts it at zero.
    scale = float(np.exp(np.mean(np.log(np.abs(search.response.poles)))))
    matrices = invert_frequency(system.a, system.b, system.c, system.d, scale)
    inverse = LtiSystem(*matrices)
    norm = _Search(inverse, inverse.poles).climb(tolerance)
    frequency = np.inf if norm.frequency_rad_s == 0.0 else scale**2 / norm.frequency_rad_s
    return HinfNorm(norm.value, float(frequency), norm.upper, norm.error)


class _Search:
    """Search for the largest gain of a stable system of order ≥ 1: the best so far, and where."""

    def __init__(self, system: LtiSystem, poles: NDArray[np.complex128]) -> None:
        self.given = system
        self.system, _ = balance_states(system)
        a, b, c, d = self.system.a, self.system.b, self.system.c, self.system.d
        self.response = Response(a, b, c, d, modes=True)
        self.value, self.frequency = -1.0, 0.0
        self.noise = 0.0
        """Largest relative difference of gains by the Schur form and by the system as given."""
        size = np.abs(self.response.poles)
        # rounding may have moved slow poles of badly scaled systems
        given = _new_poles(poles, self.response.poles)
        low, high = np.log10(size.min()) - 1.0, np.log10(size.max()) + 1.0
        first = np.concatenate(
            [
                [0.0],
                size,
                np.abs(self.response.poles.imag),
                np.abs(given),
                np.abs(given.imag),
                np.sqrt(np.maximum(size**2 - 2.0 * self.response.poles.real**2, 0.0)),
                np.logspace(low, high, _GRID),
            ]
        )
        self.look(first)

    def look(self, omega: Array) -> None:
        """Take the gains at frequencies into account, and refine the best."""
        points = np.unique(np.concatenate([omega, [self.frequency]]))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            responses = self.response(1j * points)
        lost = ~np.isfinite(responses).all(axis=(1, 2))
        if lost.any():  # a pole on the axis but for rounding
            self.value, self.frequency = np.inf, float(points[np.argmax(lost)])
            return
        gains = largest_gains(responses)
        inner = np.flatnonzero(
            (gains >= np.append(gains[1:], -1.0)) & (gains >= np.insert(gains[:-1], 0, -1.0))
        )
        # the four highest local maxima within 10 % of the largest are refined together
        inner = inner[np.argsort(gains[inner])[-4:]]
        inner = inner[gains[inner] >= 0.9 * gains.max()]
        at = points[inner]
        left = points[np.maximum(inner - 1, 0)]
        right = np.append(points, 2.0 * points[-1] + 1e-300)[inner + 1]
        # each round divides the intervals beside a maximum by six
        share = np.linspace(0.0, 1.0, 7)[1:-1, None]
        highest = gains[inner]
        for _ in range(5):
            near = np.concatenate([at[None], left + share * (at - left), at + share * (right - at)])
            near.sort(axis=0)
            high = largest_gains(self.response(1j * near.ravel())).reshape(near.shape)
            best = np.argmax(high, axis=0)
            column = np.arange(at.size)
            left = near[np.maximum(best - 1, 0), column]
            right = near[np.minimum(best + 1, len(near) - 1), column]
            at = near[best, column]
            if (high[best, column] <= (1.0 + _FLAT) * highest).all():
                break
            highest = high[best, column]
        # the last word has the system as it was given, not its scaled Schur form
        close = points[gains >= (1.0 - _CLOSE) * gains.max()][:_MOST_CLOSE]
        tried = np.unique(np.concatenate([at, points[inner], close]))
        exact = largest_gains(self.given.response(tried))
        best_one = int(np.argmax(exact))
        rough = largest_gains(self.response(1j * tried))
        away = np.abs(rough - exact)[exact >= (1.0 - _CLOSE) * exact[best_one]]
        self.noise = max(self.noise, float(away.max()) / max(float(exact[best_one]), 1e-300))
        if exact[best_one] > self.value:
            self.value, self.frequency = float(exact[best_one]), float(tried[best_one])

    def look_beside(self, noise: float) -> None:
        """Look for a higher gain beside the peak in the system as given, not in its Schur form."""
        width = min(_FLAT_TOP * float(np.sqrt(noise)), 0.5)
        for _ in range(_NARROWER):
            points = self.frequency * (1.0 + width * np.linspace(-1.0, 1.0, 9))
            gains = largest_gains(self.given.response(points))
            best = int(np.argmax(gains))
            if gains[best] > self.value:
                self.value, self.frequency = float(gains[best]), float(points[best])
            width *= 0.3

    def climb(self, tolerance: float) -> HinfNorm:
        """Raise the level until the gain reaches it at no nearly imaginary eigenvalue."""
        if self.value == np.inf:
            return HinfNorm(np.inf, self.frequency, np.inf, np.inf)
        if self.value == 0.0:  # at so many frequencies: everywhere
            return HinfNorm(0.0, self.frequency, 0.0)
        for _ in range(_MOST_LEVELS):
            # Bruinsma and Steinbuch (1990): a level just above the best gain; where it is crossed,
            # the gain between the crossings is higher
            level = self.value * (1.0 + tolerance)
            values = hamiltonian_eigenvalues(self.system, level)
            near = np.abs(values.real) <= _NEAR * np.abs(values)
            omega = np.unique(np.abs(values[near].imag))
            if omega.size:
                self.look(np.concatenate([omega, 0.5 * (omega[1:] + omega[:-1])]))
                if self.value == np.inf:
                    return HinfNorm(np.inf, self.frequency, np.inf, np.inf)
            if self.value > level:
                continue
            bound = self._bound_with_rounding(level)
            noise = max(self.noise, bound.error)
            if noise <= _NOISE or self.frequency == 0.0 or not np.isfinite(noise):
                return bound
            self.look_beside(noise)
            if self.value <= level:
                return self._bound_with_rounding(level)
        return self._bound_with_rounding(np.inf)

    def _bound_with_rounding(self, level: float) -> HinfNorm:
        # another frequency may have a lower gain that is less sure
        others = np.unique(np.append(np.abs(self.response.poles), 0.0))
        others = others[others != self.frequency]
        gains = largest_gains(self.response(1j * others))
        few = others[np.argsort(-gains)[:_ROUNDED]]
        high, errors = _gains_with_rounding(self.given, np.append(self.frequency, few))
        error = float(errors[0])
        upper = max(level * (1.0 + max(error, self.noise)), float(high.max()))
        return HinfNorm(self.value, self.frequency, upper, error)


def _new_poles(
    poles: NDArray[np.complex128], others: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return the poles that differ from every one of the others by more than their accuracy."""
    apart = np.abs(poles[:, None] - others).min(axis=1)
    return np.asarray(poles[apart > _SAME * np.abs(poles)])


def _gain_with_rounding(system: LtiSystem, omega: float) -> tuple[float, float]:
    """Return the most that the gain at a frequency can be, and the relative part of rounding."""
    high, error = _gains_with_rounding(system, np.array([omega]))
    return float(high[0]), float(error[0])


def _gains_with_rounding(system: LtiSystem, omega: Array) -> tuple[Array, Array]:
    """Return the most that the gains at frequencies (K,) can be, and the relative rounding (K,).

    Both are infinite where rounding may make s I − A singular.
    """
    s = 1j * omega if system.dt_s is None else np.exp(1j * omega * system.dt_s)
    n, unit = system.order, np.eye(system.order)
    away = s[:, None, None] * unit - system.a
    high, error = np.full(omega.size, np.inf), np.full(omega.size, np.inf)
    factors, inverse = np.empty_like(away), np.empty_like(away)
    order = np.tile(np.arange(n), (omega.size, 1))
    sure = np.ones(omega.size, dtype=bool)
    for i, one in enumerate(away):
        factors[i], swaps, singular = zgetrf(one)
        sure[i] = not singular
        if singular:
            continue
        inverse[i], _ = zgetri(factors[i], swaps)
        row = order[i]
        for k, other in reversed(list(enumerate(swaps.tolist()))):
            if other != k:
                row[k], row[other] = row[other], row[k]
    places = np.flatnonzero(sure)
    factors, inverse, order = factors[places], inverse[places], order[places]
    size, below = np.abs(factors), np.tri(n, k=-1)
    # |L| |U| of the backward error bound, rows in their original order
    changed = (size * below + unit) @ (size * (1.0 - below))
    changed = np.take_along_axis(changed, order[:, :, None], axis=1)
    into, out = inverse @ system.b, system.c @ inverse
    gains = largest_gains((out @ system.b + system.d).astype(complex))
    with np.errstate(all="ignore"):
        changed *= n * _EPS
        if system.dt_s is not None:  # exp(jω dt) is rounded itself
            changed += _EPS * unit
        part = np.abs(inverse) @ changed
    for i, place in enumerate(places.tolist()):
        # (I − R E)⁻¹ R B with |E| no larger than `changed`
        if not np.isfinite(part[i]).all():
            continue
        # the Neumann series of (I − R E)⁻¹ must converge, else rounding may make the matrix
        # singular
        norm = part[i].sum(axis=0).max()
        if norm >= 0.5 and np.abs(np.linalg.eigvals(part[i])).max() >= 0.5:
            continue
        moved = np.abs(out[i]) @ changed[i] @ np.linalg.solve(unit - part[i], np.abs(into[i]))
        away_by, gain = float(np.linalg.norm(moved)), float(gains[i])
        high[place], error[place] = gain + away_by, away_by / gain if gain > 0.0 else 0.0
    return high, error


def hamiltonian_eigenvalues(system: LtiSystem, level: float) -> NDArray[np.complex128]:
    """Return the eigenvalues (2n,) of H at a level above the largest singular value of D.

    Parameters
    ----------
    system : LtiSystem
        In continuous time, of order n.
    level : float
        The level.

    Returns
    -------
    ndarray, shape (2n,)
        Complex eigenvalues; an imaginary one is a frequency where a singular value equals the
        level.
    """
    return hamiltonians_eigenvalues(system.a, system.b, system.c, system.d, np.array(level))


def hamiltonians_eigenvalues(
    a: Array, b: Array, c: Array, d: Array, level: Array
) -> NDArray[np.complex128]:
    """Return the eigenvalues (..., 2n) of H of systems (..., n, n) …, each at its own level.

    Parameters
    ----------
    a, b, c, d : ndarray, shapes (..., n, n), (..., n, m), (..., p, n), (..., p, m)
        Matrices of the systems.
    level : ndarray, shape (...,)
        Level of each.

    Returns
    -------
    ndarray, shape (..., 2n)
        Complex eigenvalues.
    """
    # of the system divided by the level: R = I − DᵀD stays of order one
    root = np.sqrt(level)[..., None, None]
    b, c = b / root, c / root
    n = a.shape[-1]
    made = np.empty((*a.shape[:-2], 2 * n, 2 * n))
    made[..., :n, :n] = a
    if d.any():
        d = d / level[..., None, None]
        turned = d.swapaxes(-1, -2)
        inverse = np.linalg.inv(np.eye(d.shape[-1]) - turned @ d)
        seen = turned @ c
        made[..., :n, :n] += b @ (inverse @ seen)
        made[..., :n, n:] = b @ inverse @ b.swapaxes(-1, -2)
        made[..., n:, :n] = -c.swapaxes(-1, -2) @ c - seen.swapaxes(-1, -2) @ inverse @ seen
    else:
        made[..., :n, n:] = b @ b.swapaxes(-1, -2)
        made[..., n:, :n] = -c.swapaxes(-1, -2) @ c
    made[..., n:, n:] = -made[..., :n, :n].swapaxes(-1, -2)
    return np.asarray(np.linalg.eigvals(made), dtype=complex)


def invert_frequency(
    a: Array, b: Array, c: Array, d: Array, scale: float | Array
) -> tuple[Array, Array, Array, Array]:
    """Return systems (..., n, n) … at ω²/s: zero frequency and infinity change places.

    Parameters
    ----------
    a, b, c, d : ndarray, shapes (..., n, n), (..., n, m), (..., p, n), (..., p, m)
        Matrices of the systems, A not singular.
    scale : float or ndarray, shape (...,)
        ω of each, rad/s.

    Returns
    -------
    tuple of ndarray
        A, B, C and D of the images.
    """
    size = np.asarray(scale)[..., None, None]
    inverse: Array = np.linalg.inv(a / size).astype(float)
    seen = c @ inverse
    return size * inverse, inverse @ b, -seen, d - seen @ b / size
