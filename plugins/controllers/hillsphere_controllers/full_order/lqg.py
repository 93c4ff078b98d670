r"""Linear-quadratic regulator (LQR), stationary Kalman filter, and their combination (LQG).

In continuous time the regulator minimises :math:`\int (x^\mathsf{T} Q x + 2 x^\mathsf{T} N u +
u^\mathsf{T} R u) dt`, in discrete time the sum of the same, so that :math:`u = -K x` with

.. math::

    K = R^{-1} (B^\mathsf{T} X + N^\mathsf{T}) \quad\text{or}\quad
    K = (R + B^\mathsf{T} X B)^{-1} (B^\mathsf{T} X A + N^\mathsf{T}).

The filter is the same problem for the transposed matrices [1]_.

References
----------
.. [1] B. D. O. Anderson, J. B. Moore (1990), Optimal Control: Linear Quadratic Methods, Prentice
   Hall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem, real_matrix
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.h2 import optimal_cost
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["KalmanFilter", "Lqg", "Regulator", "kalman", "lqg", "lqr"]

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Regulator:
    """The state feedback u = −K x.

    Parameters
    ----------
    gain : ndarray, shape (m, n)
        K.
    cost : ndarray, shape (n, n)
        X: the cost from a state x is xᵀ X x.
    poles : ndarray, shape (n,)
        Of A − B K.
    """

    gain: Array
    cost: Array
    poles: Complex


@dataclass(frozen=True)
class KalmanFilter:
    """The stationary Kalman filter.

    Parameters
    ----------
    gain : ndarray, shape (n, p)
        L of x̂' = A x̂ + B u + L (y − C x̂ − D u); in discrete time x̂' is the next prediction.
    covariance : ndarray, shape (n, n)
        Of the error of x̂; in discrete time, of the prediction.
    update_gain : ndarray, shape (n, p)
        M of the estimate x̂ + M (y − C x̂ − D u) that has the measurement of the moment, in discrete
        time; zero in continuous time.
    poles : ndarray, shape (n,)
        Of A − L C.
    """

    gain: Array
    covariance: Array
    update_gain: Array
    poles: Complex


@dataclass(frozen=True)
class Lqg:
    """Regulator and filter together.

    Parameters
    ----------
    controller : LtiSystem
        From y to u, to be closed with positive sign (`lower_lft`): u = −K x̂.
    regulator : Regulator
        K.
    filter : KalmanFilter
        L.
    """

    controller: LtiSystem
    regulator: Regulator
    filter: KalmanFilter


def lqr(
    plant: LtiSystem,
    state_weight: Array,
    control_weight: Array,
    cross_weight: Array | None = None,
) -> Regulator:
    """Return the linear-quadratic regulator.

    Parameters
    ----------
    plant : LtiSystem
        In continuous or discrete time; only A and B matter.
    state_weight, control_weight : ndarray, shape (n, n), (m, m)
        Q and R, symmetric; R > 0.
    cross_weight : ndarray, shape (n, m), optional
        N; [[Q, N], [Nᵀ, R]] must be positive semidefinite.

    Returns
    -------
    Regulator
        The feedback.

    Raises
    ------
    InputError
        If a weight has the wrong shape, or is not as definite as it should be.
    NotStabilisableError
        If the controls do not reach a mode that is not stable.
    SingularProblemError
        If Q does not see a mode on the stability boundary.
    """
    n, m = plant.b.shape
    discrete = plant.dt_s is not None
    c, d = _square_root(state_weight, control_weight, cross_weight, n, m, "weight of the controls")
    made, scale = balance_states(LtiSystem(plant.a, plant.b, c, d))
    check_modes(made.a, made.b, np.zeros((0, n)), discrete=discrete)
    x, f = optimal_cost(made.a, made.b, made.c, d, discrete=discrete)
    # back from the balanced states x/scale
    x, f = x / np.outer(scale, scale), f / scale
    return Regulator(-f, x, np.linalg.eigvals(plant.a + plant.b @ f).astype(complex))


def kalman(
    plant: LtiSystem,
    process_noise: Array,
    measurement_noise: Array,
    *,
    through: Array | None = None,
    cross_noise: Array | None = None,
) -> KalmanFilter:
    """Return the Kalman filter in steady state.

    Parameters
    ----------
    plant : LtiSystem
        In continuous or discrete time; its outputs are the measurements.
    process_noise, measurement_noise : ndarray, shape (w, w), (p, p)
        Spectral densities of the white noises w and v, or covariances in discrete time; that of v
        positive definite.
    through : ndarray, shape (n, w), optional
        G of ẋ = A x + B u + G w; left out, w acts on each state.
    cross_noise : ndarray, shape (w, p), optional
        Between w and v.

    Returns
    -------
    KalmanFilter
        The estimator.

    Raises
    ------
    InputError
        If a matrix has the wrong shape, or is not as definite as it should be.
    NotStabilisableError
        If the measurements do not show a mode that is not stable.
    SingularProblemError
        If the noise does not excite a mode on the stability boundary.
    """
    p, n = plant.c.shape
    discrete = plant.dt_s is not None
    g = np.eye(n) if through is None else real_matrix(through, "through")
    if len(g) != n:
        raise InputError(f"the noise must enter through a matrix of {n} rows, got {g.shape}")
    c, d = _square_root(
        process_noise, measurement_noise, cross_noise, g.shape[1], p, "noise of the measurements"
    )
    # the regulator of the transposed matrices
    made, scale = balance_states(LtiSystem(plant.a.T, plant.c.T, c @ g.T, d))
    check_modes(made.a.T, np.zeros((n, 0)), made.b.T, discrete=discrete)
    y, f = optimal_cost(made.a, made.b, made.c, d, discrete=discrete)
    y, f = y / np.outer(scale, scale), f / scale
    update = np.zeros((n, p))
    if discrete:
        noise = plant.c @ y @ plant.c.T + d.T @ d
        # M = Y Cᵀ (C Y Cᵀ + R)⁻¹
        update = np.asarray(np.linalg.solve(noise, plant.c @ y).T, dtype=float)
    poles = np.linalg.eigvals(plant.a + f.T @ plant.c).astype(complex)
    return KalmanFilter(-f.T, y, update, poles)


def lqg(
    plant: LtiSystem,
    state_weight: Array,
    control_weight: Array,
    process_noise: Array,
    measurement_noise: Array,
    *,
    through: Array | None = None,
) -> Lqg:
    """Return the LQG controller: the regulator acting on the filter's estimate.

    Parameters
    ----------
    plant : LtiSystem
        From u to y, in continuous or discrete time.
    state_weight, control_weight : ndarray, shape (n, n), (m, m)
        Of the regulator, see `lqr`.
    process_noise, measurement_noise, through : ndarray, shape (w, w), (p, p), (n, w)
        Of the filter, see `kalman`.

    Returns
    -------
    Lqg
        The controller. In discrete time it acts on the prediction, so that a whole period is left
        to compute; `hillsphere_controllers.full_order.h2.h2_synthesis` gives the one that uses the
        measurement of the moment.

    Raises
    ------
    InputError, NotStabilisableError, SingularProblemError
        As `lqr` and `kalman` do.
    SynthesisFailedError
        If the closed loop is not stable in floating point.
    """
    regulator = lqr(plant, state_weight, control_weight)
    estimator = kalman(plant, process_noise, measurement_noise, through=through)
    k, gain = regulator.gain, estimator.gain
    a = plant.a - plant.b @ k - gain @ plant.c + gain @ plant.d @ k
    controller = LtiSystem(
        a, gain, -k, np.zeros((len(k), len(plant.c))), plant.dt_s, plant.outputs, plant.inputs
    )
    # states of the plant and of the controller together
    whole = np.block([[plant.a, -plant.b @ k], [gain @ plant.c, a - gain @ plant.d @ k]])
    none = np.zeros((len(whole), 0))
    if not LtiSystem(whole, none, none.T, np.zeros((0, 0)), plant.dt_s).is_stable:
        raise SynthesisFailedError(
            "the closed loop is not stable in floating point; scale inputs, outputs and time to "
            "order one"
        )
    return Lqg(controller, regulator, estimator)


def _square_root(
    first: Array, second: Array, cross: Array | None, n: int, m: int, name: str
) -> tuple[Array, Array]:
    """Return C, D with [C D]ᵀ [C D] = [[first, cross], [crossᵀ, second]]."""
    if not (n and m):
        raise InputError("states, and controls or measurements, are needed; there are none")
    q, r = (real_matrix(given, "a weight or covariance") for given in (first, second))
    s = np.zeros((n, m)) if cross is None else real_matrix(cross, "a cross term")
    for matrix, shape in ((q, (n, n)), (r, (m, m)), (s, (n, m))):
        if matrix.shape != shape:
            raise InputError(f"a matrix of {shape} finite numbers is needed, got {matrix.shape}")
    whole = np.block([[q, s], [s.T, r]])
    if np.abs(whole - whole.T).max(initial=0.0) > 1e-10 * np.abs(whole).max(initial=0.0):
        raise InputError("weights and covariances must be symmetric")
    if np.linalg.eigvalsh(r)[0] <= 0.0:
        raise InputError(f"the {name} must be positive definite")
    # q is taken apart by itself, so that a large r does not swamp it
    root_r = np.linalg.cholesky(r).T
    left = np.linalg.solve(root_r.T, s.T)
    values, vectors = np.linalg.eigh(q - left.T @ left)
    if values[0] < -1e-10 * max(np.abs(q).max(), 1e-300):
        raise InputError(
            f"[[Q, N], [Nᵀ, R]] must be positive semidefinite; an eigenvalue of Q − N R⁻¹ Nᵀ is "
            f"{values[0]:.6g}"
        )
    root_q = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    return np.vstack([root_q, left]), np.vstack([np.zeros((n, m)), root_r])
