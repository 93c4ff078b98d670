r"""H∞ synthesis of full order by two Riccati equations.

The plant

.. math::

    \dot x &= A x + B_1 w + B_2 u \\
    z &= C_1 x + D_{11} w + D_{12} u \\
    y &= C_2 x + D_{21} w + D_{22} u

is brought to D12 = [0; I], D21 = [0 I] by orthogonal maps of z and w and scaling of u and y, and
D22 is taken out. A controller that keeps the gain from w to z below γ exists just if both Riccati
equations have stabilising solutions X, Y ≥ 0 with ρ(XY) < γ² [1]_, [2]_. The least γ is found by
bisection; near it the controller's poles run away, so that the controller returned is that of a γ a
little larger.

References
----------
.. [1] K. Glover, J. C. Doyle (1988), State-space formulae for all stabilizing controllers that
   satisfy an H∞-norm bound and relations to risk sensitivity, Systems & Control Letters 11,
   167-172.
.. [2] K. Zhou, J. C. Doyle, K. Glover (1996), Robust and Optimal Control, Prentice Hall, sections
   17.1 and 17.2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import HinfNorm, hinf_norm
from hillsphere_controllers.errors import SingularProblemError, SynthesisFailedError
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.full_order.riccati import stabilising_solution
from hillsphere_controllers.full_order.scaling import Units
from hillsphere_controllers.systems.algebra import fed_back, lower_lft
from hillsphere_controllers.systems.balancing import balanced
from hillsphere_controllers.systems.bilinear import continuous, discrete

__all__ = ["HinfDesign", "hinf_synthesis"]

_RANK = 1e-9
"""Of D12 and D21, beside columns [B2; D12] and rows [C2 D21] of norm one."""
_ROUNDING = 1e-13
_HIGHEST = 1e12
_BACK_OFFS = (1.0, 1.5, 3.0, 10.0, 30.0)


@dataclass(frozen=True)
class HinfDesign:
    """A controller and what it does.

    Parameters
    ----------
    controller : LtiSystem
        From y to u, of the order of the plant.
    gamma : float
        The closed loop's norm, computed from the closed loop.
    closed_loop : LtiSystem
        From w to z.
    norm : HinfNorm
        Of it, with its peak's frequency.
    least : float
        The largest γ found for which the Riccati equations are not solvable: no controller of any
        order reaches it. The bisection's tolerance below the least one for which they are.
    """

    controller: LtiSystem
    gamma: float
    closed_loop: LtiSystem
    norm: HinfNorm
    least: float


def hinf_synthesis(
    plant: LtiSystem,
    controls: int,
    measurements: int,
    *,
    tolerance: float = 1e-4,
    back_off: float = 0.005,
    regularisation: float = 0.0,
) -> HinfDesign:
    """Return a controller that nearly minimises the gain from w to z.

    Parameters
    ----------
    plant : LtiSystem
        Its last inputs are the controls u, its last outputs the measurements y; in discrete time
        its bilinear image is used.
    controls, measurements : int
        Numbers of u and y.
    tolerance : float
        Relative width at which the bisection of γ ends.
    back_off : float
        By how much the γ of the controller is larger than the least one; it is enlarged where the
        controller does not pass the check of its closed loop.
    regularisation : float
        Weight that is put on every control, and size of the noise that is put on every measurement,
        for the synthesis only: makes problems solvable in which D12 or D21 lacks full rank, for a γ
        that is a little larger. The closed loop is that of the plant as given; `HinfDesign.least`
        then belongs to the problem with them.

    Returns
    -------
    HinfDesign
        The controller, checked.

    Raises
    ------
    InputError
        If the numbers do not fit.
    NotStabilisableError
        If u cannot stabilise the plant, or y does not show an unstable mode.
    SingularProblemError
        If a control has no weight (D12 without full column rank), a measurement no noise (D21
        without full row rank), or the plant from u to z or from w to y a zero on the imaginary
        axis.
    SynthesisFailedError
        If no controller found passes the check.
    """
    (p, m), (k, q) = plant.shape, (controls, measurements)
    if not (0 < k <= m and 0 < q <= p):
        raise InputError(f"{k} controls and {q} measurements do not fit a plant of {p} × {m}")
    if not regularisation >= 0.0:
        raise InputError(f"a regularisation must be ≥ 0, got {regularisation}")
    units = Units.of(plant, k, q)
    scaled = units.scaled(plant)
    if plant.dt_s is None:
        made = _continuous(scaled, units, tolerance, back_off, regularisation)
    else:
        made = _continuous(continuous(scaled), units, tolerance, back_off, regularisation)
        made = _checked(scaled, discrete(made.controller, plant.dt_s), made.least)
    return replace(made, controller=units.restored(made.controller))


def _continuous(
    plant: LtiSystem, units: Units, tolerance: float, back_off: float, regularisation: float
) -> HinfDesign:
    """Return the design for a plant in continuous time, its controls in these units."""
    posed = _regularised(plant, units, regularisation) if regularisation else plant
    problem = _Problem(balanced(posed)[0], units.controls.size, units.measurements.size)
    low, high = problem.bracket()
    while high > low * (1.0 + tolerance):
        middle = np.sqrt(low * high) if low > 0.0 else 0.1 * high
        if middle <= 1e-12 * problem.size:
            break
        if problem.solve(middle) is None:
            low = middle
        else:
            high = middle
    return _backed_off(plant, problem, (low, high), back_off)


def _backed_off(
    plant: LtiSystem, problem: _Problem, least: tuple[float, float], back_off: float
) -> HinfDesign:
    """Return the best controller whose closed loop is what it should be."""
    best: HinfDesign | None = None
    for factor in _BACK_OFFS:
        gamma = least[1] * (1.0 + back_off * factor)
        solved = problem.solve(gamma)
        controller = None if solved is None else problem.controller(gamma, *solved)
        if controller is None:
            continue
        try:
            design = _checked(plant, controller, least[0])
        except (SynthesisFailedError, InputError):
            continue
        if best is None or design.gamma < best.gamma:
            best = design
        if best.gamma <= gamma * (1.0 + 1e-6):
            return best
    if best is None:
        raise SynthesisFailedError(
            f"the Riccati equations are solvable for γ = {least[1]:.6g}, but no controller near it "
            "makes a stable closed loop in floating point; scale inputs and outputs to order one, "
            "or use a larger back_off"
        )
    return best


def _checked(plant: LtiSystem, controller: LtiSystem, least: float) -> HinfDesign:
    loop = lower_lft(plant, controller)
    if not loop.is_stable:
        raise SynthesisFailedError("the closed loop is not stable")
    norm = hinf_norm(loop)
    return HinfDesign(controller, norm.value, loop, norm, least)


class _Problem:
    """The plant with D12 = [0; I], D21 = [0 I], D22 = 0, and how to come back."""

    def __init__(self, plant: LtiSystem, k: int, q: int) -> None:
        p, m = plant.shape
        p1, m1 = p - q, m - k
        self._a = plant.a
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
                    f"not at all; add a small direct term ({remedy}), or give a regularisation"
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

    def bracket(self) -> tuple[float, float]:
        """Return a γ without and one with a solution."""
        k, q = self._k, self._q
        p1, m1 = self._d11.shape
        low = max(
            np.linalg.norm(self._d11[: p1 - k], 2) if p1 > k else 0.0,
            np.linalg.norm(self._d11[:, : m1 - q], 2) if m1 > q else 0.0,
        )
        high = max(2.0 * low, self.size)
        while self.solve(high) is None:
            low, high = high, 10.0 * high
            if high > _HIGHEST * self.size:
                raise SingularProblemError(
                    "the Riccati equations have no stabilising solution for any γ: a transfer from "
                    "u to z or from w to y has a zero on the imaginary axis (an integrator outside "
                    "of the loop, say), or the data are badly scaled; shift the weight's pole or "
                    "zero slightly off the axis"
                )
        return float(low), float(high)

    def solve(self, gamma: float) -> tuple[Array, Array] | None:
        """Return X and Y for a γ, None if it is too small."""
        g2 = gamma * gamma
        r, rt = self._weights(gamma)
        b = np.hstack([self._b1, self._b2])
        d1 = np.hstack([self._d11, self._d12])
        x = _solution(self._a, b, self._c1, d1, r)
        if x is None:
            return None
        c = np.vstack([self._c1, self._c2])
        d2 = np.vstack([self._d11, self._d21])
        y = _solution(self._a.T, c.T, self._b1.T, d2.T, rt)
        if y is None:
            return None
        largest = float(np.abs(np.linalg.eigvals(x @ y)).max(initial=0.0))
        return (x, y) if largest < g2 * (1.0 - 1e-12) else None

    def _weights(self, gamma: float) -> tuple[Array, Array]:
        p1, m1 = self._d11.shape
        d1 = np.hstack([self._d11, self._d12])
        d2 = np.vstack([self._d11, self._d21])
        r, rt = d1.T @ d1, d2 @ d2.T
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
        f = -np.linalg.solve(r, d1.T @ self._c1 + b.T @ x)
        h = -np.linalg.solve(rt, (self._b1 @ d2.T + y @ c.T).T).T
        f12, f2 = f[m1 - q : m1], f[m1:]
        h12, h2 = h[:, p1 - k : p1], h[:, p1:]
        d1111, d1112 = self._d11[: p1 - k, : m1 - q], self._d11[: p1 - k, m1 - q :]
        d1121, d1122 = self._d11[p1 - k :, : m1 - q], self._d11[p1 - k :, m1 - q :]
        left = g2 * np.eye(p1 - k) - d1111 @ d1111.T
        right = g2 * np.eye(m1 - q) - d1111.T @ d1111
        through = -d1121 @ d1111.T @ np.linalg.solve(left, d1112) - d1122
        try:
            d12 = np.linalg.cholesky(np.eye(k) - d1121 @ np.linalg.solve(right, d1121.T))
            d21 = np.linalg.cholesky(np.eye(q) - d1112.T @ np.linalg.solve(left, d1112)).T
        except np.linalg.LinAlgError:
            return None
        z = np.linalg.inv(np.eye(len(x)) - y @ x / g2)
        b2 = z @ (self._b2 + h12) @ d12
        c2 = -d21 @ (self._c2 + f12)
        b1 = -z @ h2 + b2 @ np.linalg.solve(d12, through)
        back = np.linalg.solve(d21, c2)
        c1 = f2 + through @ back
        a = self._a + b @ f + b1 @ back
        found = (a, b1 @ self._y, self._u @ c1, self._u @ through @ self._y)
        if not all(np.isfinite(matrix).all() for matrix in found):
            return None
        # y − D22 u is what the controller was made for
        return _behind(LtiSystem(*found), self._d22)


def _regularised(plant: LtiSystem, units: Units, size: float) -> LtiSystem:
    """Return the plant with the controls among z and noise on the measurements, of one size."""
    (p, m), n = plant.shape, plant.order
    k, q = units.controls.size, units.measurements.size
    b1, b2 = plant.b[:, : m - k], plant.b[:, m - k :]
    c1, c2 = plant.c[: p - q], plant.c[p - q :]
    d11, d12 = plant.d[: p - q, : m - k], plant.d[: p - q, m - k :]
    d21, d22 = plant.d[p - q :, : m - k], plant.d[p - q :, m - k :]
    weight, noise = np.diag(size / units.controls), np.diag(size / units.measurements)
    return LtiSystem(
        plant.a,
        np.hstack([b1, np.zeros((n, q)), b2]),
        np.vstack([c1, np.zeros((k, n)), c2]),
        np.block(
            [
                [d11, np.zeros((p - q, q)), d12],
                [np.zeros((k, m - k + q)), weight],
                [d21, noise, d22],
            ]
        ),
    )


def _behind(controller: LtiSystem, d22: Array) -> LtiSystem:
    """Return the controller for measurements that contain the controls, y = y₀ + D22 u."""
    if not d22.any():
        return controller
    k, q = controller.shape
    turned = fed_back(replace(controller, inputs=(), outputs=()), -d22)
    assert turned.shape == (k, q)
    return turned


def _solution(a: Array, b: Array, c: Array, d: Array, r: Array) -> Array | None:
    """Return X ≥ 0 of the equation with the weight R (indefinite) and the cross term Dᵀ C."""
    try:
        feed = np.linalg.solve(r, d.T @ c)
        back = np.linalg.solve(r, b.T)
    except np.linalg.LinAlgError:
        return None
    shifted = a - b @ feed
    s = -b @ back
    whole = c.T @ c
    q = whole - c.T @ d @ feed
    # what rounding leaves of a weight that cancels is none
    q[np.abs(q) <= _ROUNDING * np.abs(whole).max(initial=0.0)] = 0.0
    x = stabilising_solution(shifted, 0.5 * (s + s.T), 0.5 * (q + q.T))
    if x is None:
        return None
    least = float(np.linalg.eigvalsh(x)[0]) if len(x) else 0.0
    return x if least >= -1e-9 * max(float(np.abs(x).max(initial=0.0)), 1e-300) else None
