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
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeev, zgetrf, zgetri

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response, largest_gains, squared_gains
from hillsphere_controllers.systems.balancing import balance_states
from hillsphere_controllers.systems.bilinear import continuous

__all__ = [
    "HinfNorm", "hamiltonian_eigenvalues", "hamiltonians_eigenvalues", "hinf_norm",
    "invert_frequency",
]  # fmt: skip

_MOST_LEVELS = 40
"""Levels at most. The level rises quadratically to the norm: fewer than ten are needed, and the
limit ends cycles by rounding."""
_SHARES = np.linspace(0.0, 1.0, 40)
"""Frequencies of the first look, evenly spaced in their logarithm; besides those of the poles."""
_NEAR = 1e-2
"""An eigenvalue this near the imaginary axis, relative to its size, is looked at."""
_CLOSE, _MOST_CLOSE = 1e-3, 20
"""Gains as near the largest as that are computed once more from the system as given: where its
matrices are badly conditioned, rounding may change the order."""
_FLAT = 1e-11
"""Relative rise of the gain below which a peak is not searched more finely."""
_ROUNDS = 8
"""Rounds of narrowing about a peak at most; three or four suffice."""
_NARROWED, _NEAREST = 0.1, 1e-9
"""Distance of the next points from the vertex: a share of the vertex's last move, and no less than
this share of the frequency, at which rounding hides differences of the gain."""
_SLOW = 1e-8
"""Frequencies below this share of the slowest pole's count as zero: the gain, an even function of
frequency, differs by rounding alone."""
_EVEN = 16.0
"""Norms of rows and columns within this factor need no balancing: it costs one digit of sixteen at
most, and LAPACK balances each matrix whose eigenvalues it computes."""
_SURE = 1e-8
"""Distance of the poles from the axis, relative to the largest, above which stability is sure:
the square root of rounding, by which a double eigenvalue moves."""
_BESIDE = 1e-3
"""Relative distance from the best peak within which a gain below the level belongs to it."""
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
    if system.dt_s is not None:
        if not system.is_stable:
            return HinfNorm(np.inf, np.nan, np.inf)
        made, _ = balance_states(system)
        norm = hinf_norm(continuous(made), tolerance)
        frequency = 2.0 / system.dt_s * float(np.arctan(0.5 * system.dt_s * norm.frequency_rad_s))
        if system.order == 0 or 0 in system.shape:
            return HinfNorm(norm.value, frequency, norm.upper)
        # the image was rounded as well
        high, error = _gain_with_rounding(made, frequency)
        return HinfNorm(norm.value, frequency, max(norm.upper, high), max(norm.error, error))
    if system.order == 0 or 0 in system.shape:
        direct = float(largest_gains(system.d[None].astype(complex))[0])
        return HinfNorm(direct, 0.0, direct)
    search = _Search(system)
    if not search.is_stable:
        return HinfNorm(np.inf, np.nan, np.inf)
    search.begin()
    if search.value == np.inf:  # rounding has put a pole on the axis: nothing is told
        return HinfNorm(np.inf, search.frequency, np.inf, np.inf)
    direct = float(largest_gains(system.d[None].astype(complex))[0]) if system.d.any() else 0.0
    if search.value > direct or direct == 0.0:
        return search.climb(tolerance)
    # The peak is at infinity, where R is singular: s → ω²/s puts it at zero.
    scale = float(np.exp(np.mean(np.log(np.abs(search.response.poles)))))
    search = _Search(LtiSystem(*invert_frequency(system.a, system.b, system.c, system.d, scale)))
    search.begin()
    norm = search.climb(tolerance)
    frequency = np.inf if norm.frequency_rad_s == 0.0 else scale**2 / norm.frequency_rad_s
    return HinfNorm(norm.value, float(frequency), norm.upper, norm.error)


class _Search:
    """Search for the largest gain of a stable system of order ≥ 1: the best so far, and where."""

    def __init__(self, system: LtiSystem) -> None:
        self.given = system
        self.system, _ = balance_states(system, _EVEN)
        even = self.system
        self.response = Response(even.a, even.b, even.c, even.d, modes=True)
        self.poles = self.response.poles if even is system else system.poles
        """Of the system as given: rounding may have moved slow poles of badly scaled ones."""
        if not self.poles.real.max() < -_SURE * np.abs(self.poles).max():
            self.poles = system.poles  # by which a system's stability is judged everywhere
        self.is_stable = bool(self.poles.real.max() < 0.0)
        self.value, self.frequency = -1.0, 0.0
        self.noise = 0.0
        """Largest relative difference of gains by the Schur form and by the system as given."""

    def begin(self) -> None:
        """Look at frequencies of the poles, and between and beside them."""
        poles = self.response.poles
        if self.poles is not poles:
            poles = np.concatenate([poles, _new_poles(self.poles, poles)])
        poles = poles[poles.imag >= 0.0]
        size = np.abs(poles)
        low, high = np.log10(size.min()) - 1.0, np.log10(size.max()) + 1.0
        resonant = np.sqrt(np.maximum(size**2 - 2.0 * poles.real**2, 0.0))
        grid = 10.0 ** (low + (high - low) * _SHARES)
        self.look(np.concatenate([[0.0], size, poles.imag, resonant, grid]))

    def look(self, omega: Array) -> None:
        """Take the gains at frequencies into account, and refine the best."""
        points = np.concatenate([omega, [self.frequency, 2.0 * omega.max() + 1e-300]])
        points.sort()
        points = points[np.concatenate([[True], points[1:] > points[:-1]])]
        squares = self._squares(points)
        lost = ~np.isfinite(squares)
        if lost.any():  # a pole on the axis but for rounding
            self.value, self.frequency = np.inf, float(points[np.argmax(lost)])
            return
        around = np.concatenate([squares[1:2], squares, [-1.0]])
        inner = np.flatnonzero((squares >= around[:-2]) & (squares >= around[2:]))
        # the four highest local maxima within 10 % of the largest are refined together
        largest = float(squares.max())
        if inner.size > 1:
            inner = inner[np.argsort(squares[inner])[-4:]]
            inner = inner[squares[inner] >= 0.81 * largest]
        at, high = self._refine(points, squares, inner)
        self._take(at, high)
        if self.noise > _NOISE or not self.response.by_modes:
            # the last word has the system as it was given, not its scaled Schur form
            near = squares >= (1.0 - _CLOSE) ** 2 * largest
            near[inner] = True
            self._take(points[near][:_MOST_CLOSE], squares[near][:_MOST_CLOSE])

    def _squares(self, omega: Array) -> Array:
        """Return squared gains (K,), not finite at a pole."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            responses = self.response(np.asarray(1j * omega, dtype=complex))
            squares = squared_gains(responses) if np.isfinite(responses).all() else None
            if squares is not None and np.isfinite(squares).all():
                return squares
        finite = np.isfinite(responses).all(axis=(1, 2))
        gains = np.full(omega.size, np.inf)
        gains[finite] = largest_gains(responses[finite])
        with np.errstate(over="ignore"):
            return np.asarray(gains**2)

    def _refine(self, points: Array, squares: Array, inner: Integers) -> tuple[Array, Array]:
        """Return local maxima nearer to their peaks, and the squares of their gains.

        Beside a resonance 1/gain² is nearly a parabola of the frequency, whose vertex is computed
        from three points; three much nearer to it follow.
        """
        at, high = points[inner], squares[inner]
        # the gain is an even function of frequency
        before, after = np.maximum(inner - 1, 0), np.minimum(inner + 1, points.size - 1)
        left, right = points[before], points[after]
        left[inner == 0] = -right[inner == 0]
        low = squares[before]
        low[inner == 0] = squares[after][inner == 0]
        values = np.array([low, high, squares[after]])
        places = np.array([left, at, right])
        for _ in range(_ROUNDS):
            vertex, rise = _vertices(places, values)
            vertex = np.where(at > 0.0, vertex, 0.0)  # zero frequency is an extremum itself
            if not ((rise > _FLAT) & (at > 0.0)).any():
                break
            step = np.maximum(_NARROWED * np.abs(vertex - at), _NEAREST * np.abs(at))
            places = np.array([vertex - step, vertex, vertex + step])
            values = self._squares(places.ravel()).reshape(places.shape)
            best = np.argmax(values, axis=0)
            column = np.arange(at.size)
            reached = values[best, column]
            higher = reached > high
            at = np.where(higher, np.abs(places[best, column]), at)
            high = np.maximum(reached, high)
        return at, high

    def _take(self, omega: Array, squares: Array) -> None:
        """Compute gains once more from the system as given, and keep the best."""
        slowest = float(np.abs(self.response.poles).min())
        omega = np.where(omega < _SLOW * slowest, 0.0, omega)
        exact = _exact_gains(self.given, omega)
        best = int(np.argmax(exact))
        away = np.abs(np.sqrt(squares) - exact)[exact >= (1.0 - _CLOSE) * exact[best]]
        self.noise = max(self.noise, float(away.max()) / max(float(exact[best]), 1e-300))
        if exact[best] > self.value:
            self.value, self.frequency = float(exact[best]), float(omega[best])

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
            near = (values.imag >= 0.0) & (np.abs(values.real) <= _NEAR * np.abs(values))
            omega = np.sort(values.imag[near])
            omega = np.concatenate([omega, 0.5 * (omega[1:] + omega[:-1])])
            if omega.size and self._may_be_above(omega, level):
                self.look(omega)
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

    def _may_be_above(self, omega: Array, level: float) -> bool:
        """Return whether the gain is above a level, or nearly so anywhere but at the best peak."""
        if self.noise > _NOISE:
            return True
        squares = self._squares(omega)
        limit = np.where(
            np.abs(omega - self.frequency) <= _BESIDE * self.frequency,
            level**2, ((1.0 - _CLOSE) * level) ** 2,
        )  # fmt: skip
        return not bool((squares <= limit).all())

    def _bound_with_rounding(self, level: float) -> HinfNorm:
        # another frequency may have a lower gain that is less sure
        sizes = {0.0, *np.abs(self.response.poles).tolist()} - {self.frequency}
        few = np.array(sorted(sizes))
        if few.size > _ROUNDED:
            few = few[np.argsort(-self._squares(few))[:_ROUNDED]]
        high, errors = _gains_with_rounding(self.given, np.append(self.frequency, few))
        error = float(errors[0])
        upper = max(level * (1.0 + max(error, self.noise)), float(high.max()))
        return HinfNorm(self.value, self.frequency, upper, error)


def _vertices(places: Array, squares: Array) -> tuple[Array, Array]:
    """Return where parabolas (K,) through three values of 1/gain², (3, K), are least.

    And by how much gain² is higher there, relatively; where there is no such vertex near by, the
    middle frequency is returned.
    """
    left, at, right = places
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        before, _, after = squares[1] / squares
        rise, fall = (after - 1.0) / (right - at), (1.0 - before) / (at - left)
        bend = (rise - fall) / (right - left)
        vertex = 0.5 * (left + at - fall / bend)
        # a little beside them, if the middle value is not the largest
        inside = (bend > 0.0) & (np.abs(vertex - at) <= 2.0 * (right - left))
        risen = np.where(inside, bend * (vertex - at) ** 2, 0.0)
    return np.where(inside, vertex, at), risen


def _exact_gains(system: LtiSystem, omega: Array) -> Array:
    """Return the gains (K,) of a system in continuous time, as its response has them."""
    away = (1j * omega)[:, None, None] * np.eye(system.order) - system.a
    try:
        there = np.linalg.solve(away, system.b.astype(np.complex128))
        return largest_gains(np.asarray(system.d + system.c @ there, dtype=np.complex128))
    except np.linalg.LinAlgError:  # the response says what is wrong
        return largest_gains(system.response(omega))


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
    n = system.order
    unit, below, above = _triangles(n)
    away = s[:, None, None] * unit - system.a
    factors, inverse = np.empty_like(away), np.empty_like(away)
    order = []
    for i, one in enumerate(away):
        factors[i], swaps, singular = zgetrf(one)
        if singular:
            inverse[i] = np.nan
        else:
            inverse[i], _ = zgetri(factors[i], swaps)
        row = list(range(n))
        for k, other in reversed(list(enumerate(swaps.tolist()))):
            row[k], row[other] = row[other], row[k]
        order.append(row)
    size = np.abs(factors)
    with np.errstate(all="ignore"):
        # |L| |U| of the backward error bound, rows in their original order
        changed = (size * below + unit) @ (size * above)
        changed = changed[np.arange(omega.size)[:, None], order] * (n * _EPS)
        if system.dt_s is not None:  # exp(jω dt) is rounded itself
            changed += _EPS * unit
        part = np.abs(inverse) @ changed
        norm = part.sum(axis=1).max(axis=1)
    # the Neumann series of (I − R E)⁻¹, |E| no larger than `changed`, must converge, else rounding
    # may make the matrix singular
    sure = norm < 0.5
    for i in np.flatnonzero(~sure & np.isfinite(norm)).tolist():
        sure[i] = np.abs(np.linalg.eigvals(part[i])).max() < 0.5
    high, error = np.full((2, omega.size), np.inf)
    if not sure.all():
        inverse, changed, part = inverse[sure], changed[sure], part[sure]
    into, out = inverse @ system.b, system.c @ inverse
    # (I − R E)⁻¹ R B
    moved = np.abs(out) @ changed @ np.linalg.solve(unit - part, np.abs(into))
    away_by = np.sqrt(np.sum(moved * moved, axis=(1, 2)))
    gains = largest_gains((out @ system.b + system.d).astype(complex))
    high[sure] = gains + away_by
    error[sure] = away_by / np.where(gains > 0.0, gains, np.inf)
    return high, error


@lru_cache(maxsize=32)
def _triangles(n: int) -> tuple[Array, Array, Array]:
    """Return the unit matrix, and ones below the diagonal, and on and above it."""
    below = np.tri(n, k=-1)
    return np.eye(n), below, 1.0 - below


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

    Raises
    ------
    np.linalg.LinAlgError
        If their iteration does not converge.
    """
    made = _hamiltonians(system.a, system.b, system.c, system.d, np.array(level))
    real, imaginary, _, _, failed = dgeev(made, compute_vl=0, compute_vr=0)
    if failed:
        raise np.linalg.LinAlgError("the eigenvalues of a Hamiltonian matrix did not converge")
    return np.asarray(real + 1j * imaginary)


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
    return np.asarray(np.linalg.eigvals(_hamiltonians(a, b, c, d, level)), dtype=complex)


def _hamiltonians(a: Array, b: Array, c: Array, d: Array, level: Array) -> Array:
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
    return made


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
