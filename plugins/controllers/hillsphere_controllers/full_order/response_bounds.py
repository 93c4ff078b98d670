"""Lower bounds of γ for all controllers, proved in spite of rounding."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem

__all__ = ["frequency_bound", "response_bound", "solution_error"]

_SAFETY = 10.0
"""Units of rounding per order that an entry of the Hamiltonian matrix may be wrong by: above the
usual error of sums of n products, so that a proved bound holds."""
_GRID = 30
"""Frequencies, even in their logarithm: a bound between two of them is hardly higher."""
_MARGIN = 1e-13
"""Relative rounding of the gain of a matrix."""
_EPS = float(np.finfo(float).eps)


def response_bound(plant: LtiSystem, controls: int, measurements: int, omega_rad_s: Array) -> float:
    """Return a lower bound of the gain from w to z, for all controllers, from responses.

    What the controls do not reach of z, and what the measurements do not show of w, stays as it is
    without a controller (the necessary half of Parrott's theorem).

    Parameters
    ----------
    plant : LtiSystem
        In continuous time.
    controls, measurements : int
        Numbers of its last inputs and outputs.
    omega_rad_s : ndarray, shape (K,)
        Frequencies, rad/s.

    Returns
    -------
    float
        The largest over the frequencies, less twice the difference that a rotation of the states
        makes; 0 where there is none.
    """
    n = plant.order
    # a random rotation of the states changes rounding alone: the difference measures its error
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(n, n)))[0]
    turned = LtiSystem(turn.T @ plant.a @ turn, turn.T @ plant.b, plant.c @ turn, plant.d)
    bound = 0.0
    for omega in omega_rad_s:
        try:
            one, other = (
                _residual_gain(system.response(np.array([omega]))[0], controls, measurements)
                for system in (plant, turned)
            )
        except InputError:  # a pole on the axis
            continue
        if np.isfinite(one + other):
            bound = max(bound, min(one, other) - 2.0 * abs(one - other))
    return bound


def frequency_bound(plant: LtiSystem, controls: int, measurements: int) -> float:
    """Return the largest `response_bound` over frequencies about the plant's poles, and infinity.

    It holds for singular problems too: nothing is inverted.

    Parameters
    ----------
    plant, controls, measurements
        As of `response_bound`.
    """
    p, m = plant.shape
    if p - measurements <= controls and m - controls <= measurements:
        return 0.0  # all of z is reached and all of w shown
    size = np.abs(plant.poles)
    size = size[size > 0.0]
    low, high = (size.min(), size.max()) if size.size else (1.0, 1.0)
    omega = np.concatenate([[0.0], size, np.geomspace(0.1 * low, 10.0 * high, _GRID)])
    direct = _residual_gain(plant.d.astype(complex), controls, measurements) * (1.0 - _MARGIN)
    return max(direct, response_bound(plant, controls, measurements, omega))


def _residual_gain(response: Array, k: int, q: int) -> float:
    """Return the gain of P11 orthogonal to the range of P12 and to the rows of P21."""
    p1, m1 = response.shape[0] - q, response.shape[1] - k
    direct, gains = response[:p1, :m1], [0.0]
    if p1 > k:
        # directions of z that the controls do not reach
        beside = np.linalg.svd(response[:p1, m1:])[0][:, k:]
        gains.append(float(np.linalg.norm(beside.conj().T @ direct, 2)))
    if m1 > q:
        # directions of w that the measurements do not show
        beside = np.linalg.svd(response[p1:, :m1])[2][q:].conj().T
        gains.append(float(np.linalg.norm(direct @ beside, 2)))
    return max(gains)


def solution_error(
    matrices: tuple[Array, Array, Array],
    rounding: tuple[Array, Array, Array],
    x: Array,
    floor: float,
) -> tuple[float, Array]:
    """Return a bound of the distance of X from the stabilising Riccati solution.

    From the residual and the inverse of the Lyapunov operator at X, from which Newton's method
    converges, in states in which X is the unit matrix but for signs (no unit decides).

    Parameters
    ----------
    matrices : tuple of ndarray, shape (n, n)
        A, S and Q of Aᵀ X + X A + X S X + Q = 0.
    rounding : tuple of ndarray, shape (n, n)
        How far their entries may be from what they stand for.
    x : ndarray, shape (n, n)
        The solution found.
    floor : float
        Below which its eigenvalues are taken for that, in units in which its diagonal is one.

    Returns
    -------
    error : float
        e with −e Z ≤ solution − X ≤ e Z; infinite where that cannot be told. An X that is not
        ≥ 0 stands for a solution that is not if e < 1.
    z : ndarray, shape (n, n)
        Z > 0, the absolute value of X in units in which its diagonal is one.
    """
    n = len(x)
    unit = np.sqrt(np.abs(np.diag(x)))
    unit[unit == 0.0] = 1.0
    values, vectors = np.linalg.eigh(x / unit[:, None] / unit)
    # coordinates in which |X| is the identity, eigenvalues below the floor raised to it
    root = np.sqrt(np.maximum(np.abs(values), floor))
    into, back = root[:, None] * vectors.T * unit, (vectors / root) / unit[:, None]
    z = into.T @ into
    a, s, q = into @ matrices[0] @ back, into @ matrices[1] @ into.T, back.T @ matrices[2] @ back
    wrong = [
        given + _SAFETY * n * _EPS * np.abs(one)
        for given, one in zip(rounding, matrices, strict=True)
    ]
    there, home = np.abs(into), np.abs(back)
    da, ds, dq = (
        float(np.linalg.norm(one))
        for one in (there @ wrong[0] @ home, there @ wrong[1] @ there.T, home.T @ wrong[2] @ home)
    )
    mine = back.T @ x @ back
    mine = 0.5 * (mine + mine.T)
    closed = a + s @ mine
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            inverse = solve_continuous_lyapunov(closed.T, -np.eye(n))
    except (np.linalg.LinAlgError, RuntimeWarning):  # its eigenvalues are on the axis, nearly
        return np.inf, z
    inverse = 0.5 * (inverse + inverse.T)
    if not np.isfinite(inverse).all() or np.linalg.eigvalsh(inverse)[0] <= 0.0:
        return np.inf, z
    # for a stable matrix the operator's inverse is largest on the unit matrix
    largest = float(np.linalg.norm(inverse, 2))
    rest = float(np.linalg.norm(closed.T @ mine + mine @ a + q, 2))
    size = float(np.linalg.norm(mine, 2))
    # first Newton step: inverse Lyapunov operator times residual and data errors
    moved = largest * (rest + 2.0 * da * size + ds * size**2 + dq)
    # Kantorovich's condition
    steep = 4.0 * largest * (float(np.linalg.norm(s, 2)) + ds) * moved
    return (2.0 * moved if steep < 1.0 else np.inf), z
