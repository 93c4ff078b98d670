"""State transition matrix of one quasi-satellite revolution: step map beside SciPy.

QSO-La of Phobos (30 km, tri-axial ellipsoid). Both sides integrate the 42 variational equations
by the same eighth-order formula to the same accuracy, measured against a Taylor propagation and
relative to the largest element of the matrix: the step map with the fewest steps that reach it,
SciPy's DOP853 with the loosest tolerance that does and a right-hand side in numpy.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import acos, cos, sqrt
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import elliprd

from hillsphere.dynamics import StepMap, Taylor, system
from hillsphere.interfaces import Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params
from hillsphere_gravity.ellipsoid import Ellipsoid
from hillsphere_gravity.specs import EllipsoidSpec

Array = NDArray[np.float64]
ACCURACY = 1e-11
# Parameters and orbit: Phobos QSO bifurcation paper, Table 1 (QSO-La), reproduced to 1e-14.
AXES = (13030.0, 11400.0, 9140.0)
GM = 7.059650784871513e5
MEAN_MOTION = 2.279134204706896e-4
LENGTH = (GM / MEAN_MOTION**2) ** (1.0 / 3.0)
PERIOD = 4.73057690305042
START = np.array([30e3 / LENGTH, 0.0, 0.0, 0.0, -2.81471632617670, 0.0])


class Hill:
    """Circular Hill problem about an ellipsoid."""

    frame = "hill:phobos"
    states = tuple(Variable(n, 1) for n in ("x", "y", "z")) + tuple(
        Variable(n, 1, -1) for n in ("vx", "vy", "vz")
    )
    controls: tuple[Variable, ...] = ()
    scales = Scales(LENGTH, 1.0 / MEAN_MOTION)
    _gravity = Ellipsoid(EllipsoidSpec(axes_m=AXES, gm_m3_s2=GM))

    def parameters(self) -> tuple[Parameter, ...]:
        """Return those of the ellipsoid."""
        return self._gravity.parameters()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI."""
        n = MEAN_MOTION
        g = self._gravity.acceleration((x[0], x[1], x[2]), p)
        return (
            *x[3:],
            2.0 * n * x[4] + 3.0 * n * n * x[0] + g[0],
            -2.0 * n * x[3] + g[1],
            -n * n * x[2] + g[2],
        )

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return no events."""
        return {}


SQUARES = (np.array(AXES) / LENGTH) ** 2


def numpy_rate(t: float, y: Array) -> Array:
    """Return the 42 derivatives of one lane: SciPy's R_D, gradient in closed form."""
    a, b, c = SQUARES.tolist()
    x, v = y[:3], y[3:6]
    xx, yy, zz = (x * x).tolist()
    p2 = a + b + c - xx - yy - zz
    p1 = a * b + b * c + c * a - xx * (b + c) - yy * (a + c) - zz * (a + b)
    p0 = a * b * c - xx * b * c - yy * a * c - zz * a * b
    q = p2 * p2 / 9.0 - p1 / 3.0
    s = (p1 * p2 - 3.0 * p0) / 6.0 - p2**3 / 27.0
    root = 2.0 * sqrt(q) * cos(acos(s / q**1.5) / 3.0) - p2 / 3.0
    for _ in range(2):
        root -= (((root + p2) * root + p1) * root + p0) / ((3.0 * root + 2.0 * p2) * root + p1)
    m = SQUARES + root
    rd = elliprd(m[[1, 2, 0]], m[[2, 0, 1]], m)
    d = x / m
    hessian = np.outer(d, d) * (3.0 / (sqrt(m.prod()) * (d @ d)))
    jacobian = np.zeros((6, 6))
    jacobian[:3, 3:] = np.eye(3)
    jacobian[3:, :3] = hessian - np.diag(rd) + np.diag([3.0, 0.0, -1.0])
    jacobian[3, 4], jacobian[4, 3] = 2.0, -2.0
    out = np.empty(42)
    out[:3] = v
    out[3:6] = -x * rd
    out[3] += 2.0 * v[1] + 3.0 * x[0]
    out[4] -= 2.0 * v[0]
    out[5] -= x[2]
    out[6:] = (jacobian @ y[6:].reshape(6, 6)).ravel()
    return out


def scipy_stm(start: Array, tolerance: float) -> Array:
    """Return the matrix (6, 6) after one revolution."""
    y0 = np.concatenate([start, np.eye(6).ravel()])
    solution = solve_ivp(
        numpy_rate, (0.0, PERIOD), y0, method="DOP853", rtol=tolerance, atol=tolerance
    )
    return np.asarray(solution.y[6:, -1].reshape(6, 6))


def best_time(function: Callable[[], object], repeats: int) -> float:
    """Shortest of some runs, s: the one least disturbed."""
    times = []
    for _ in range(repeats):
        begin = perf_counter()
        function()
        times.append(perf_counter() - begin)
    return min(times)


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    equations = system(Hill(), normalised=True)
    begin = perf_counter()
    step_map = StepMap(equations, stm=True)
    found = {"stm_map_compile_s": perf_counter() - begin}

    _, exact = Taylor(equations, stm=True).propagate(START, PERIOD)
    size = np.abs(exact).max()

    def error(phi: Array) -> float:
        return float(np.abs(phi - exact).max() / size)

    steps = next(
        n for n in range(20, 400) if error(step_map.propagate(START, PERIOD, n)[1]) < ACCURACY
    )
    tolerance = next(
        float(tol) for tol in np.logspace(-8, -13, 41) if error(scipy_stm(START, tol)) < ACCURACY
    )
    found["stm_map_steps"] = steps
    found["stm_map_error"] = error(step_map.propagate(START, PERIOD, steps)[1])
    found["scipy_tolerance"] = tolerance
    found["scipy_error"] = error(scipy_stm(START, tolerance))

    other = best_time(lambda: scipy_stm(START, tolerance), 5)
    found["scipy_ms_per_orbit"] = other * 1e3
    for lanes in (1, 16, 64, 256):
        # Neighbouring orbits, so that no lane does another's work.
        x = START[:, None] * np.linspace(1.0, 1.001, lanes)
        elapsed = best_time(lambda x=x: step_map.propagate(x, PERIOD, steps), 10) / lanes  # type: ignore[misc]
        name = "alone" if lanes == 1 else f"batch_{lanes}"
        found[f"stm_map_ms_per_orbit_{name}"] = elapsed * 1e3
        found[f"stm_speedup_{name}"] = other / elapsed
    return found


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
