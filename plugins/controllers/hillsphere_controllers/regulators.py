"""Linear-quadratic laws (LQR, LQG) whose gains follow from a motion and weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.full_order.lqg import kalman, lqr
from hillsphere_controllers.full_order.sampled_data import sampled_cost, sampled_noise
from hillsphere_controllers.law_specs import LqgSpec, LqrSpec
from hillsphere_controllers.linearisation import linearise_plant
from hillsphere_controllers.specs import Matrix

__all__ = ["LinearQuadraticGaussian", "LinearQuadraticRegulator"]


class LinearQuadraticRegulator:
    r"""u = −K x − K_I s + u₀ on the deviation x of all states, u held.

    K minimises :math:`\int (x^\mathsf{T} Q x + u^\mathsf{T} R u) dt` among all commands that are
    held over each period [1]_: the motion is discretised exactly, and so is the cost. With integral
    action the sums :math:`s_{k+1} = s_k + h x_k` of the positions' deviations are further states,
    their squares weighed once a period.

    Parameters
    ----------
    spec : LqrSpec
        Motion and weights.

    Raises
    ------
    InputError
        If sizes do not fit.
    NotStabilisableError, SingularProblemError
        As `hillsphere_controllers.full_order.lqg.lqr` does.

    Attributes
    ----------
    gain : ndarray, shape (m, n + i)
        [K K_I].
    poles : ndarray, shape (n + i,)
        Of the closed loop, per period: all inside of the unit circle.

    References
    ----------
    .. [1] K. J. Åström, B. Wittenmark (1997), Computer-Controlled Systems, 3rd edition, Prentice
       Hall, chapter 11.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: LqrSpec) -> None:
        self.spec = spec
        self.period_s = h = spec.period_s
        motion = _Motion(spec)
        n, m = motion.b.shape
        count = len(spec.integral_sizes)
        if count > n:
            raise InputError(f"integral_sizes: {count} of {n} states")
        a, b, q, r, cross = sampled_cost(motion.a, motion.b, motion.q, motion.r, h)
        sums = np.hstack([h * np.eye(count, n), np.eye(count)])
        a = np.vstack([np.hstack([a, np.zeros((n, count))]), sums])
        b = np.vstack([b, np.zeros((count, m))])
        weight = np.zeros((n + count, n + count))
        weight[:n, :n] = q
        weight[n:, n:] = h * np.diag(1.0 / np.array(spec.integral_sizes) ** 2)
        cross = np.vstack([cross, np.zeros((count, m))])
        design = lqr(_system(a, b, np.eye(n + count), h), weight, r, cross)
        self.gain, self.poles = design.gain, design.poles
        self._n, self._trim = n, motion.trim[:, None]
        self._integrals = count

    def initial(self, n_cases: int) -> Array:
        """Return the sums (i, N), zero."""
        return np.zeros((self._integrals, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (m, N) and the sums (i, N)."""
        _check_seen(len(y), self._n)
        x = y - ref
        u = self._trim - self.gain @ np.concatenate([x, xc])
        return u, xc + self.period_s * x[: self._integrals]


class LinearQuadraticGaussian:
    r"""u = −K x̂ + u₀ with the estimate x̂ of a Kalman filter in steady state, u held.

    .. math::

        \hat x_k &= \bar x_k + M (y_k - C \bar x_k), \\
        \bar x_{k+1} &= A \hat x_k + B (u_k - u_0),

    with motion, cost and noise discretised exactly [1]_; y is the deviation of what is seen. The
    estimate begins with zero: on the reference.

    Parameters
    ----------
    spec : LqgSpec
        Motion, weights and noises.

    Raises
    ------
    InputError
        If sizes do not fit.
    NotStabilisableError, SingularProblemError
        As `hillsphere_controllers.full_order.lqg.lqr` and `kalman` do.

    Attributes
    ----------
    gain : ndarray, shape (m, n)
        K.
    update : ndarray, shape (n, p)
        M.
    poles : ndarray, shape (2 n,)
        Of the closed loop, per period: of the regulator, then of the filter.

    References
    ----------
    .. [1] K. J. Åström, B. Wittenmark (1997), Computer-Controlled Systems, 3rd edition, Prentice
       Hall, chapter 11.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: LqgSpec) -> None:
        self.spec = spec
        self.period_s = h = spec.period_s
        motion = _Motion(spec)
        n, m = motion.b.shape
        self._c = _matrix(spec.c, (len(spec.c), n), "c") if spec.c else np.eye(n)
        self._p = len(self._c)
        if len(spec.measurement_sizes) != self._p:
            raise InputError(
                f"measurement_sizes: {self._p} values are seen, got {len(spec.measurement_sizes)}"
            )
        if spec.w:
            density = _matrix(spec.w, (n, n), "w")
        else:
            entering = motion.b * _vector(spec.control_noise, m, "control_noise")
            density = entering @ entering.T
        a, b, q, r, cross = sampled_cost(motion.a, motion.b, motion.q, motion.r, h)
        regulator = lqr(_system(a, b, np.eye(n), h), q, r, cross)
        noise = sampled_noise(motion.a, density, h)
        estimator = kalman(
            _system(a, b, self._c, h), noise, np.diag(np.array(spec.measurement_sizes) ** 2)
        )
        self.gain, self.update = regulator.gain, estimator.update_gain
        self.poles = np.concatenate([regulator.poles, estimator.poles])
        self._a, self._b, self._trim = a, b, motion.trim[:, None]

    def initial(self, n_cases: int) -> Array:
        """Return the predictions x̄ (n, N), zero."""
        return np.zeros((len(self._a), n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return u (m, N) and the next predictions (n, N)."""
        _check_seen(len(y), self._p)
        x = xc + self.update @ (y - ref - self._c @ xc)
        u = -self.gain @ x
        return u + self._trim, self._a @ x + self._b @ u


class _Motion:
    """Motion A, B, weights Q, R and trim command u₀ of a Spec."""

    def __init__(self, spec: LqrSpec | LqgSpec) -> None:
        if spec.plant is not None and spec.point is not None:
            point = spec.point
            linear = linearise_plant(
                spec.plant.get(), point.position_m, point.velocity_m_s, point.others, point.time_s
            )
            self.a, self.b, drift = linear.a, linear.b, linear.drift
        else:
            n = len(spec.a)
            self.a, self.b = _matrix(spec.a, (n, n), "a"), np.array(spec.b, dtype=float)
            drift = np.zeros(n)
        n, m = self.b.shape
        self.q = _weight(spec.q, spec.state_sizes, n, "q", "state_sizes")
        self.r = _weight(spec.r, spec.control_sizes, m, "r", "control_sizes")
        self.trim: Array = np.zeros(m)
        if spec.trim:
            # velocities at the point change its position, whatever is commanded
            self.trim = np.asarray(-np.linalg.lstsq(self.b, drift, rcond=None)[0], dtype=float)


def _weight(matrix: Matrix, sizes: Sequence[float], n: int, key: str, name: str) -> Array:
    if matrix:
        return _matrix(matrix, (n, n), key)
    return np.diag(1.0 / _vector(sizes, n, name) ** 2)


def _matrix(given: Matrix, shape: tuple[int, int], key: str) -> Array:
    made = np.array(given, dtype=float)
    if made.shape != shape:
        raise InputError(f"{key} must be {shape[0]} × {shape[1]}, got {made.shape}")
    return made


def _vector(given: Sequence[float], n: int, key: str) -> Array:
    if len(given) != n:
        raise InputError(f"{key}: {n} numbers are needed, got {len(given)}")
    return np.array(given, dtype=float)


def _system(a: Array, b: Array, c: Array, h: float) -> LtiSystem:
    return LtiSystem(a, b, c, np.zeros((len(c), b.shape[1])), h)


def _check_seen(count: int, wanted: int) -> None:
    if count != wanted:
        raise InputError(
            f"the law was made for {wanted} values, it sees {count}; name those that it was made "
            "for (sees of the flight)"
        )
