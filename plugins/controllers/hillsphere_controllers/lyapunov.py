"""Sampled control by a quadratic Lyapunov function."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from hillsphere.dynamics import System, system
from hillsphere.engine.simulation.flow import thrust_vectors, velocity_rows
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.law_specs import LyapunovSpec
from hillsphere_controllers.systems.holding import zero_order_hold_matrices

__all__ = ["Lyapunov"]

_FALLS = 1e-12
"""P is scaled to ones on its diagonal, so V falls if the largest eigenvalue of its change is below
minus this rounding. A smaller value would accept a P for which V stays constant in some
direction."""


class Lyapunov:
    r"""The held acceleration that minimises V = xᵀ P x one period later.

    Each axis is a chain of two integrators, x = (position, velocity) minus the reference, once the
    plant's own acceleration is cancelled. Over a period h with u held, x goes to A x + B u exactly,
    A = [1 h; 0 1], B = [h²/2; h], so that

    .. math::

        u = -(B^\mathsf{T} P B)^{-1} B^\mathsf{T} P A x

    is the command after which V is least. From a time constant, P solves :math:`A_c^\mathsf{T} P
    A_c - P = -Q`, where A_c is the period's motion of the axis under
    :math:`\ddot e = -ω^2 e - 2 ζ ω \dot e`, brought about by a held command as near as one can, and
    Q weighs :math:`e^2 + \dot e^2/ω^2`. V then falls by xᵀ Q x or more in each period: that command
    is one of those among which u is the best [1]_.

    Parameters
    ----------
    spec : LyapunovSpec
        The function, and what is cancelled.

    Raises
    ------
    InputError
        If V does not fall in every period, or the plant does not fit.

    Attributes
    ----------
    p : ndarray, shape (2, 2) or (2 a, 2 a)
        P, of each axis or of all.
    gain : ndarray, shape (1, 2) or (a, 2 a)
        Of u = −K x.

    References
    ----------
    .. [1] R. E. Kalman, J. E. Bertram (1960), Control system analysis and design via the "second
       method" of Lyapunov, part II, discrete-time systems, Journal of Basic Engineering 82,
       394-400.
    """

    actuation: Literal["hold", "impulse"] = "hold"

    def __init__(self, spec: LyapunovSpec) -> None:
        self.spec = spec
        self.period_s = h = spec.period_s
        self.p = np.array(spec.p, dtype=float) if spec.p else _function(spec, h)
        n = len(self.p) // 2
        one = np.array([[1.0, h], [0.0, 1.0]])
        a = np.kron(one, np.eye(n))
        b = np.kron(np.array([[0.5 * h * h], [h]]), np.eye(n))
        if not np.allclose(self.p, self.p.T, rtol=1e-10, atol=0.0):
            raise InputError("p must be symmetric")
        # sizes of positions and velocities differ: compared in units in which P has ones
        if (
            np.diag(self.p).min() <= 0.0
            or np.linalg.eigvalsh(_normalise_by(self.p, self.p))[0] <= 0.0
        ):
            raise InputError("p must be positive definite")
        # minimum of V after one period over u
        self.gain = np.linalg.solve(b.T @ self.p @ b, b.T @ self.p @ a)
        closed = a - b @ self.gain
        change = _normalise_by(closed.T @ self.p @ closed - self.p, self.p)
        if np.linalg.eigvalsh(change)[-1] >= -_FALLS:
            raise InputError(
                "p gives no Lyapunov function: from some state V does not fall over a period of "
                f"{h:g} s whatever is commanded; give a time constant, or a P that couples "
                "positions and velocities"
            )
        self._axes = n if n > 1 else None
        self._drift = _Drift(spec) if spec.plant is not None else None

    def initial(self, n_cases: int) -> Array:
        """Return no states, (0, N)."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return the accelerations (a, N), m/s², and no states."""
        axes = len(y) // 2
        if len(y) != 2 * axes or axes != (self._axes or axes) or not axes:
            wanted = 2 * self._axes if self._axes else "an even number of"
            raise InputError(
                f"the law sees {len(y)} values, it needs {wanted}: positions, then as many "
                "velocities"
            )
        x = y - ref
        if self._axes:
            u = -self.gain @ x
        else:
            u = -(self.gain[0, 0] * x[:axes] + self.gain[0, 1] * x[axes:])
        if self._drift is not None:
            u = u - self._drift(y, t_s)
            if self.spec.cancel == "difference":
                u = u + self._drift(ref, t_s)
        if self.spec.maximum_m_s2 is not None:
            each = u.reshape(thrust_vectors(axes), -1, u.shape[1])
            size = np.sqrt(np.sum(each**2, axis=1, keepdims=True))
            most = self.spec.maximum_m_s2
            u = (each * np.minimum(1.0, most / np.where(size > 0.0, size, most))).reshape(u.shape)
        return u, xc


class _Drift:
    """Accelerations of a plant without command."""

    def __init__(self, spec: LyapunovSpec) -> None:
        assert spec.plant is not None
        plant = spec.plant.get()
        rows, n = velocity_rows(plant), len(plant.states)
        if rows != list(range(n // 2, n)):
            names = ", ".join(v.name for v in plant.states)
            raise InputError(
                "plant: its states must be positions, then as many velocities, so that the law "
                f"sees all that its acceleration depends on; they are {names}"
            )
        self._equations: System = system(plant)
        if self._equations.external is not None:
            raise InputError(
                "plant: its gravity is a function of arrays (a table, a polyhedron), which is not "
                "cancelled; take a harmonic or ellipsoid model of the body, or leave plant out"
            )
        self._rate = self._equations.function(*self._equations.rhs[n // 2 :])
        self._n = n

    def __call__(self, x: Array, t_s: Array) -> Array:
        if len(x) != self._n:
            raise InputError(f"plant: it has {self._n} states, the law sees {len(x)} values")
        p = self._equations.parameters(None, x.shape[1])
        rate: Array = self._rate(x, p, t_s)
        return rate


def _function(spec: LyapunovSpec, h: float) -> Array:
    """Return P of an axis whose motion has the time constant."""
    assert spec.time_constant_s is not None
    # times in time constants, so that the equation is well scaled
    tau = spec.time_constant_s
    free = np.array([[0.0, 1.0], [0.0, 0.0]])
    wanted = np.array([[0.0, 1.0], [-1.0, -2.0 * spec.damping]])
    a, b = zero_order_hold_matrices(free, np.array([[0.0], [1.0]]), h / tau)
    poles, _ = zero_order_hold_matrices(wanted, np.zeros((2, 0)), h / tau)
    # the held command that puts the poles where those of the wanted motion are after h
    closed = a - b @ _place_poles(a, b, np.trace(poles), float(np.linalg.det(poles)))
    p = solve_discrete_lyapunov(closed.T, np.eye(2))
    # back from time constants to seconds: velocity times τ is a length
    unit = np.array([1.0, tau])
    return np.asarray(p * np.outer(unit, unit))


def _place_poles(a: Array, b: Array, trace: float, determinant: float) -> Array:
    """Return K (1, 2) for which A − B K has this trace and determinant (Ackermann's formula)."""
    reach = np.hstack([b, a @ b])
    polynomial = a @ a - trace * a + determinant * np.eye(2)
    return np.asarray(np.linalg.solve(reach.T, np.array([0.0, 1.0]))[None] @ polynomial)


def _normalise_by(matrix: Array, p: Array) -> Array:
    """Return a matrix in units in which P has ones on its diagonal."""
    root = np.sqrt(np.diag(p))
    return np.asarray(matrix / np.outer(root, root))
