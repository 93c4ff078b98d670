"""Gravity on arrays of points: compiled expressions beside vectorised numpy and SciPy.

Both sides compute the same accelerations (compared here before anything is timed).
"""

from __future__ import annotations

from collections.abc import Callable
from math import factorial, sqrt
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from scipy.special import elliprd

from hillsphere.gravity import GravityField
from hillsphere_gravity.ellipsoid import Ellipsoid
from hillsphere_gravity.harmonics import Harmonics
from hillsphere_gravity.specs import EllipsoidSpec, HarmonicsSpec

Array = NDArray[np.float64]
POINTS = 100_000
GM = 7.0875e5
AXES = (13030.0, 11400.0, 9140.0)
RADIUS = 11100.0


def best_time(function: Callable[[], object], repeats: int) -> float:
    """Shortest of some runs, s: the one least disturbed."""
    times = []
    for _ in range(repeats):
        start = perf_counter()
        function()
        times.append(perf_counter() - start)
    return min(times)


def numpy_ellipsoid(r: Array) -> Array:
    """Acceleration by the trigonometric root of the confocal cubic and SciPy's R_D."""
    squares = np.array(AXES) ** 2
    r2 = r * r
    a, b, c = squares
    x, y, z = r2
    p2 = squares.sum() - r2.sum(axis=0)
    p1 = a * b + b * c + c * a - x * (b + c) - y * (c + a) - z * (a + b)
    p0 = a * b * c - x * b * c - y * c * a - z * a * b
    q = p2 * p2 / 9.0 - p1 / 3.0
    cosine = ((p1 * p2 - 3.0 * p0) / 6.0 - p2**3 / 27.0) / (q * np.sqrt(q))
    root = 2.0 * np.sqrt(q) * np.cos(np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0) - p2 / 3.0
    m = squares[:, None] + root
    root += (np.sum(r2 / m, axis=0) - 1.0) / np.sum(r2 / (m * m), axis=0)
    u, v, w = squares[:, None] + np.where(np.sum(r2 / squares[:, None], axis=0) > 1.0, root, 0.0)
    rd = np.array([elliprd(v, w, u), elliprd(w, u, v), elliprd(u, v, w)])
    return np.asarray(-GM * r * rd)


def numpy_harmonics(r: Array, triangle: dict[tuple[int, int], tuple[float, float]]) -> Array:
    """Acceleration by Cunningham's recursion on arrays, Montenbruck and Gill (2000), eq. 3.33."""
    degree = max(n for n, _ in triangle)
    square = np.sum(r * r, axis=0)
    x, y, z = RADIUS * r / square
    ratio = RADIUS * RADIUS / square
    v: dict[tuple[int, int], Array] = {(0, 0): RADIUS / np.sqrt(square)}
    w: dict[tuple[int, int], Array] = {(0, 0): np.zeros_like(square)}
    for m in range(degree + 2):
        if m:
            f = 2 * m - 1
            v[m, m] = f * (x * v[m - 1, m - 1] - y * w[m - 1, m - 1])
            w[m, m] = f * (x * w[m - 1, m - 1] + y * v[m - 1, m - 1])
        for n in range(m + 1, degree + 2):
            for q in (v, w):
                q[n, m] = (2 * n - 1) * z * q[n - 1, m] / (n - m)
                if n - 2 >= m:
                    q[n, m] -= (n + m - 1) / (n - m) * ratio * q[n - 2, m]
    total = np.zeros_like(r)
    for (n, m), (c_bar, s_bar) in triangle.items():
        norm = sqrt((2 - (m == 0)) * (2 * n + 1) * factorial(n - m) / factorial(n + m))
        c, s = norm * c_bar, norm * s_bar
        if m == 0:
            total[0] -= c * v[n + 1, 1]
            total[1] -= c * w[n + 1, 1]
        else:
            f = (n - m + 2) * (n - m + 1)
            up, down = (n + 1, m + 1), (n + 1, m - 1)
            total[0] += 0.5 * (-c * v[up] - s * w[up] + f * (c * v[down] + s * w[down]))
            total[1] += 0.5 * (-c * w[up] + s * v[up] + f * (-c * w[down] + s * v[down]))
        total[2] -= (n - m + 1) * (c * v[n + 1, m] + s * w[n + 1, m])
    return np.asarray(GM / RADIUS**2 * total)


def compare(
    name: str, compiled: Callable[[Array], Array], plain: Callable[[Array], Array], r: Array
) -> dict[str, float]:
    """Time per point of both, ns, and their ratio; `ArithmeticError` if they disagree."""
    ours, theirs = compiled(r), plain(r)
    difference = float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs)))
    if not difference <= 1e-13:
        raise ArithmeticError(f"{name}: the two implementations differ by {difference:g}")
    fast = best_time(lambda: compiled(r), 15) / r.shape[1] * 1e9
    slow = best_time(lambda: plain(r), 4) / r.shape[1] * 1e9
    return {
        f"{name}_ns_per_point": fast,
        f"{name}_numpy_ns_per_point": slow,
        f"{name}_faster_than_numpy": slow / fast,
    }


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(3, POINTS))
    directions /= np.linalg.norm(directions, axis=0)
    r = directions * rng.uniform(5e3, 150e3, POINTS)  # a part of them inside
    ellipsoid = GravityField(Ellipsoid(EllipsoidSpec(axes_m=AXES, gm_m3_s2=GM)))
    found = compare("ellipsoid_acceleration", ellipsoid.acceleration, numpy_ellipsoid, r)

    triangle = {(0, 0): (1.0, 0.0)}
    for n in range(2, 5):
        for m in range(n + 1):
            c, s = rng.normal(scale=0.05 / n**2, size=2)
            triangle[n, m] = (float(c), float(s) if m else 0.0)
    series = GravityField(
        Harmonics(
            HarmonicsSpec.model_validate(
                {
                    "gm_m3_s2": GM,
                    "reference_radius_m": RADIUS,
                    "normalisation": "full",
                    "tide_system": "none",
                    "coefficients": [
                        {"n": n, "m": m, "c": c, "s": s} for (n, m), (c, s) in triangle.items()
                    ],
                }
            )
        )
    )
    outside = directions * rng.uniform(14e3, 150e3, POINTS)
    found |= compare(
        "harmonics_4_acceleration",
        series.acceleration,
        lambda points: numpy_harmonics(points, triangle),
        outside,
    )
    for name, field, points in (("ellipsoid", ellipsoid, r), ("harmonics_4", series, outside)):
        field.gradient(points)  # compiles
        elapsed = best_time(lambda field=field, points=points: field.gradient(points), 10)  # type: ignore[misc]
        found[f"{name}_gradient_ns_per_point"] = elapsed / POINTS * 1e9
    return found


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:<45} {value:10.2f}")
