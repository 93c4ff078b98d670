"""The two Riccati equations of H∞ synthesis at a given γ, and the central controller."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.errors import SingularProblemError
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.full_order.response_bounds import response_bound, solution_error
from hillsphere_controllers.full_order.riccati import (
    axis_frequencies,
    solution_by_pencil,
    stabilising_solution,
)
from hillsphere_controllers.systems.algebra import close_with_gain

__all__ = ["GammaProblem"]

_RANK = 1e-9
"""Of D12 and D21, beside columns [B2; D12] and rows [C2 D21] of norm one."""
_ROUNDING = 1e-13
"""Relative rounding of computed norms and weights: proofs are made with this margin, and entries
that cancel to less count as zero."""
_HIGHEST = 1e12
"""Largest γ tried, relative to the size of the problem. From γ² above the inverse of rounding
(1e16) on w has no effect on the equations; the rest is room for a poor estimate of the size."""
_ZERO = 1e-13
"""Smallest singular value of the equilibrated pencil at which it has a zero there: rounding, since
rows and columns have norm one."""
_FLOORS = (1e-15, 1e-10, 1e-6, 1e-2)
"""Floors of the eigenvalues of X in the error bound: a low floor is sharp for a well conditioned X,
a high one alone proves anything for a nearly singular X. Each proof that succeeds is valid."""
_EPS = float(np.finfo(float).eps)
_EQUAL = 1e-12
"""ρ(X Y) that is nearer to γ², relatively, counts as equal: rounding of its eigenvalues."""

_Matrices = tuple[Array, Array, Array]
_Side = tuple[Array, Array, Array, Array, Array]


class GammaProblem:
    """H∞ problem with D12 = [0; I], D21 = [0 I], D22 = 0, and the transformation back."""

    def __init__(self, plant: LtiSystem, k: int, q: int) -> None:
        p, m = plant.shape
        p1, m1 = p - q, m - k
        self.plant, self.channels, self._a = plant, (k, q), plant.a
        """The plant, and its numbers of controls and measurements."""
        self.by_pencil = False
        """Whether the Riccati equations are solved by their pencil, in vain without."""
        self.proved = 0.0
        """The largest γ of which is proved that no controller reaches it."""
        b1, b2 = plant.b[:, :m1], plant.b[:, m1:]
        c1, c2 = plant.c[:p1], plant.c[p1:]
        d11, d12 = plant.d[:p1, :m1], plant.d[:p1, m1:]
        d21, self._d22 = plant.d[p1:, :m1], plant.d[p1:, m1:]
        check_modes(plant.a, b2, c2)
        if k > p1 or q > m1:
            raise SingularProblemError(
                f"{k} controls need as many weighted outputs (there are {p1}), {q} measurements as "
                f"many disturbances ({m1}); add weights on the controls and noise on the "
                "measurements, or give a regularisation"
            )
        u1, s1, v1 = np.linalg.svd(d12)
        u2, s2, v2 = np.linalg.svd(d21)
        for what, values in (("control", s1), ("measurement", s2)):
            if values[-1] <= _RANK:
                name = "D12" if what == "control" else "D21"
                remedy = "a weight on it" if what == "control" else "noise on it"
                raise SingularProblemError(
                    f"{name} lacks full rank: some combination of the {what}s enters z or shows w "
                    f"not at all, or too little to be told from rounding; add a small direct "
                    f"term ({remedy}), or give a regularisation"
                )
        # z → Uᵀz with the k weighted rows last, u → R u; w → V w with the q noises last, y → S y
        rotate_z = np.vstack([u1[:, k:].T, u1[:, :k].T])
        rotate_w = np.vstack([v2[q:], v2[:q]])
        self._u = v1.T / s1
        self._y = (u2 / s2).T
        self._k, self._q = k, q
        self._b1, self._b2 = b1 @ rotate_w.T, b2 @ self._u
        self._c1, self._c2 = rotate_z @ c1, self._y @ c2
        self._d11 = rotate_z @ d11 @ rotate_w.T
        self._d12 = np.vstack([np.zeros((p1 - k, k)), np.eye(k)])
        self._d21 = np.hstack([np.zeros((q, m1 - q)), np.eye(q)])
        self.size = max(np.abs(plant.c).max(initial=0.0), np.abs(plant.d).max(initial=0.0), 1e-300)

    def bracket(self) -> tuple[float, float | None]:
        """Return a γ without and a γ with a solution; None for the latter if none was found."""
        k, q = self._k, self._q
        p1, m1 = self._d11.shape
        # Parrott: no controller changes the parts of D11 that u does not reach or y does not show
        low = max(
            np.linalg.norm(self._d11[: p1 - k], 2) if p1 > k else 0.0,
            np.linalg.norm(self._d11[:, : m1 - q], 2) if m1 > q else 0.0,
        )
        self.proved = max(self.proved, float(low) * (1.0 - _ROUNDING))
        for self.by_pencil in (False, True):
            below, high = low, max(2.0 * low, self.size)
            while high <= _HIGHEST * self.size:
                if self.solve(high) is not None:
                    return float(below), float(high)
                below, high = high, 10.0 * high
        return float(below), None

    def singular(self) -> SingularProblemError | None:
        """Return the error of a zero on the imaginary axis, None if none is found."""
        for what, b, c, d in (
            ("u to z", self._b2, self._c1, self._d12), ("w to y", self._b1, self._c2, self._d21),
        ):  # fmt: skip
            at = _find_axis_zero(self._a, b, c, d)
            if at is not None:
                return SingularProblemError(
                    f"the transfer from {what} has a zero on the imaginary axis at {at:.6g} rad/s "
                    "(an integrator outside of the loop, say); shift the weight's pole or zero "
                    "slightly off the axis"
                )
        return None

    def solve(self, gamma: float, *, checked: bool = True) -> tuple[Array, Array] | None:
        """Return X and Y for a γ; None if γ is too small or rounding hides the solutions.

        If γ is too small by more than the errors of X and Y, `proved` is raised. Without checks X
        and Y are returned as found; the closed loop of their controller must then be checked.
        """
        solutions = []
        for side in self._sides(gamma):
            posed = _equation(*side)
            if posed is None:
                return None
            matrices, rounding = posed
            x = self._side_solution(side, matrices, checked=checked)
            if x is None:
                if checked and gamma > self.proved:
                    at = axis_frequencies(*matrices)
                    bound = response_bound(self.plant, self._k, self._q, at)
                    self.proved = max(self.proved, bound)
                return None
            if checked and _is_negative(x):
                if gamma > self.proved and any(
                    solution_error(matrices, rounding, x, floor)[0] < 1.0 for floor in _FLOORS
                ):
                    self.proved = gamma
                return None
            solutions.append((matrices, rounding, x))
        x, y = solutions[0][2], solutions[1][2]
        if not checked:
            return x, y
        g2 = gamma * gamma
        # ρ(X Y) < γ² is the third
        largest = _radius(x, y)
        if largest < g2 * (1.0 - _EQUAL):
            return x, y
        if gamma > self.proved:
            errors = [[solution_error(*one, floor) for floor in _FLOORS] for one in solutions]
            for (ex, zx), (ey, zy) in product(*errors):
                if max(ex, ey) < 1.0:
                    # of the eigenvalues of √Y X √Y, with X − e Zx and Y − e Zy for X and Y
                    lost = ex * _radius(zx, y) + ey * _radius(x, zy) + ex * ey * _radius(zx, zy)
                    if largest * (1.0 - _ROUNDING) - lost > g2:
                        self.proved = gamma
                        break
        return None

    def slack(self, gamma: float) -> float | None:
        """Return γ²/ρ(X Y) − 1, positive just if γ is solvable; None without X ≥ 0 and Y ≥ 0.

        It rises with γ: X and Y fall. Nothing is proved by it.
        """
        solutions = []
        for side in self._sides(gamma):
            posed = _equation(*side)
            x = None if posed is None else self._side_solution(side, posed[0], checked=True)
            if x is None or _is_negative(x):
                return None
            solutions.append(x)
        largest = _radius(*solutions)
        return gamma * gamma * (1.0 - _EQUAL) / largest - 1.0 if largest > 0.0 else np.inf

    def _sides(self, gamma: float) -> tuple[_Side, _Side]:
        """Return A, B, C, D and R of the equations of X and of Y."""
        r, rt = self._weights(gamma)
        return (
            (self._a, np.hstack([self._b1, self._b2]), self._c1,
             np.hstack([self._d11, self._d12]), r),
            (self._a.T, np.vstack([self._c1, self._c2]).T, self._b1.T,
             np.vstack([self._d11, self._d21]).T, rt),
        )  # fmt: skip

    def _side_solution(self, side: _Side, matrices: _Matrices, *, checked: bool) -> Array | None:
        if self.by_pencil:
            return solution_by_pencil(_normalise_inputs(*side), matrices, checked=checked)
        return stabilising_solution(*matrices, checked=checked)

    def _weights(self, gamma: float) -> tuple[Array, Array]:
        p1, m1 = self._d11.shape
        d1 = np.hstack([self._d11, self._d12])
        d2 = np.vstack([self._d11, self._d21])
        r, rt = d1.T @ d1, d2 @ d2.T
        # R = D1ᵀ D1 − diag(γ² I, 0) and its dual (Zhou et al. 1996, section 17.1)
        r[:m1, :m1] -= gamma**2 * np.eye(m1)
        rt[:p1, :p1] -= gamma**2 * np.eye(p1)
        return r, rt

    def controller(self, gamma: float, x: Array, y: Array) -> LtiSystem | None:
        """Return the central controller, None if a factor is singular."""
        (p1, m1), k, q, g2 = self._d11.shape, self._k, self._q, gamma * gamma
        r, rt = self._weights(gamma)
        b = np.hstack([self._b1, self._b2])
        c = np.vstack([self._c1, self._c2])
        d1 = np.hstack([self._d11, self._d12])
        d2 = np.vstack([self._d11, self._d21])
        # gains F and H of state feedback and output injection, in the partition of w and z
        f = -np.linalg.solve(r, d1.T @ self._c1 + b.T @ x)
        h = -np.linalg.solve(rt, (self._b1 @ d2.T + y @ c.T).T).T
        f12, f2 = f[m1 - q : m1], f[m1:]
        h12, h2 = h[:, p1 - k : p1], h[:, p1:]
        d1111, d1112 = self._d11[: p1 - k, : m1 - q], self._d11[: p1 - k, m1 - q :]
        d1121, d1122 = self._d11[p1 - k :, : m1 - q], self._d11[p1 - k :, m1 - q :]
        left = g2 * np.eye(p1 - k) - d1111 @ d1111.T
        right = g2 * np.eye(m1 - q) - d1111.T @ d1111
        # direct term and factors of the central controller (Zhou et al. 1996, theorem 17.1)
        through = -d1121 @ d1111.T @ np.linalg.solve(left, d1112) - d1122
        try:
            d12 = np.linalg.cholesky(np.eye(k) - d1121 @ np.linalg.solve(right, d1121.T))
            d21 = np.linalg.cholesky(np.eye(q) - d1112.T @ np.linalg.solve(left, d1112)).T
        except np.linalg.LinAlgError:
            return None
        # Z = (I − Y X/γ²)⁻¹ couples the estimate to the worst disturbance
        z = np.linalg.inv(np.eye(len(x)) - y @ x / g2)
        b2 = z @ (self._b2 + h12) @ d12
        c2 = -d21 @ (self._c2 + f12)
        b1 = -z @ h2 + b2 @ np.linalg.solve(d12, through)
        back = np.linalg.solve(d21, c2)
        c1 = f2 + through @ back
        a = self._a + b @ f + b1 @ back
        matrices = (a, b1 @ self._y, self._u @ c1, self._u @ through @ self._y)
        if not all(np.isfinite(matrix).all() for matrix in matrices):
            return None
        # y − D22 u is what the controller was made for
        return _shift_direct_term(LtiSystem(*matrices), self._d22)


def _shift_direct_term(controller: LtiSystem, d22: Array) -> LtiSystem:
    """Return the controller for measurements y = y₀ + D22 u, given the one for y₀."""
    if not d22.any():
        return controller
    k, q = controller.shape
    turned = close_with_gain(replace(controller, inputs=(), outputs=()), -d22)
    assert turned.shape == (k, q)
    return turned


def _find_axis_zero(a: Array, b: Array, c: Array, d: Array) -> float | None:
    """Return the frequency at which a system with a zero on the axis loses rank, None without."""
    n, back = len(a), np.linalg.pinv(d)
    # zeros of the part that d inverts are among these, all if d is square
    for value in np.concatenate([np.linalg.eigvals(a - b @ back @ c), np.linalg.eigvals(a)]):
        if abs(value.real) > 1e-6 * abs(value):
            continue
        omega = abs(value.imag)
        pencil = np.block([[a - 1j * omega * np.eye(n), b + 0j], [c + 0j, d + 0j]])
        for _ in range(3):  # rows and columns of norm one: no unit decides
            pencil = pencil / np.maximum(np.linalg.norm(pencil, axis=1, keepdims=True), 1e-300)
            pencil = pencil / np.maximum(np.linalg.norm(pencil, axis=0, keepdims=True), 1e-300)
        if np.linalg.svd(pencil, compute_uv=False)[-1] <= _ZERO:
            return float(omega)
    return None


def _radius(one: Array, other: Array) -> float:
    return float(np.abs(np.linalg.eigvals(one @ other)).max(initial=0.0))


def _is_negative(x: Array) -> bool:
    """Return whether X ≥ 0, the second condition of Glover and Doyle (1988), is violated."""
    least = float(np.linalg.eigvalsh(x)[0]) if len(x) else 0.0
    return least < -1e-9 * max(float(np.abs(x).max(initial=0.0)), 1e-300)


def _normalise_inputs(
    a: Array, b: Array, c: Array, d: Array, r: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return A, B, Cᵀ C, R and Cᵀ D for w and u in units in which R has a diagonal of size one."""
    unit = np.sqrt(np.abs(np.diag(r)))  # γ may be far from one
    unit[unit == 0.0] = 1.0
    return a, b / unit, c.T @ c, r / unit[:, None] / unit, c.T @ (d / unit)


def _equation(
    a: Array, b: Array, c: Array, d: Array, r: Array
) -> tuple[_Matrices, _Matrices] | None:
    """Return A, S, Q for the weight R (indefinite) and the cross term Dᵀ C, and their errors."""
    _, b, whole, r, cross = _normalise_inputs(a, b, c, d, r)
    cross = cross.T
    try:
        feed = np.linalg.solve(r, cross)
        back = np.linalg.solve(r, b.T)
    except np.linalg.LinAlgError:
        return None
    s = -b @ back
    q = whole - cross.T @ feed
    # what rounding leaves of a weight that cancels is none
    rest = np.abs(q)
    rest[rest > _ROUNDING * np.abs(whole).max(initial=0.0)] = 0.0
    q[rest > 0.0] = 0.0
    # first-order error of the solution with R, by its condition number
    small = _EPS * len(r) * float(np.linalg.cond(r))
    size = [np.abs(one) for one in (b, feed, back, cross, c, a)]
    rounding = (
        small * (size[0] @ size[1]) + _EPS * size[5],
        small * (size[0] @ size[2]),
        small * (size[4].T @ size[4] + size[3].T @ size[1]) + rest,
    )
    return (a - b @ feed, 0.5 * (s + s.T), 0.5 * (q + q.T)), rounding
