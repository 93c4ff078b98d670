"""Gravity on arrays of points: compiled expressions beside vectorised numpy and SciPy.

Both sides compute the same accelerations (compared here before anything is timed). Polyhedra are
compared with the package polyhedral-gravity, harmonic series with pyshtools, where these are
installed; neither is needed. Those times are CPU times, taken in seven pairs, and the median is a
figure.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib.metadata import version
from importlib.util import find_spec
from itertools import count
from math import factorial, sqrt
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import elliprd

from hillsphere.gravity import GravityField
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.sphere import icosphere
from hillsphere_gravity.ellipsoid import CODATA_2018_G, Ellipsoid
from hillsphere_gravity.harmonics import Harmonics
from hillsphere_gravity.polyhedron_sums import PolyhedronSums
from hillsphere_gravity.polyhedron_tree import PolyhedronTree
from hillsphere_gravity.specs import EllipsoidSpec, HarmonicsSpec

Array = NDArray[np.float64]
POINTS = 100_000
GM = 7.0875e5
AXES = (13030.0, 11400.0, 9140.0)
RADIUS = 11100.0
_CALLS = count(1)


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


def rough_mesh(subdivisions: int) -> Mesh:
    """Return an ellipsoid of 13 × 11 × 9 km with waves of 4 % and roughness of 0.4 %."""
    directions, faces = icosphere(subdivisions)
    rng = np.random.default_rng(1)
    radii = 1.0 + 0.004 * rng.normal(size=len(directions))
    for _ in range(12):
        wave = rng.normal(size=3) * rng.uniform(1.0, 6.0)
        radii += 0.04 * np.sin(directions @ wave + rng.uniform(0.0, 6.0))
    return Mesh(radii[:, None] * directions * [13e3, 11e3, 9e3], faces)


def surroundings(mesh: Mesh, count: int, seed: int = 0) -> Array:
    """Return points (3, count) from 1.1 to 3 times the radius of the surface below them."""
    rng = np.random.default_rng(seed)
    below = mesh.vertices[rng.integers(0, len(mesh.vertices), count)].T
    return np.ascontiguousarray(below * rng.uniform(1.1, 3.0, count))


def fresh(r: Array) -> Array:
    """Return points that no model remembers from an earlier call, a nanometre away."""
    return np.asarray(r * (1.0 + 1e-13 * next(_CALLS)))


def series_of(rows: list[dict[str, Any]]) -> Harmonics:
    """Return the series of a table of coefficients."""
    return Harmonics(
        HarmonicsSpec.model_validate(
            {
                "gm_m3_s2": GM,
                "reference_radius_m": RADIUS,
                "normalisation": "full",
                "tide_system": "none",
                "coefficients": rows,
            }
        )
    )


def random_rows(degree: int) -> list[dict[str, Any]]:
    """Return coefficients that fall with the square of the degree."""
    rng = np.random.default_rng(0)
    rows: list[dict[str, Any]] = [{"n": 0, "m": 0, "c": 1.0, "s": 0.0}]
    for n in range(2, degree + 1):
        for m in range(n + 1):
            c, s = rng.normal(scale=0.05 / n**2, size=2)
            rows.append({"n": n, "m": m, "c": float(c), "s": float(s) if m else 0.0})
    return rows


def paired(
    ours: Callable[[], object], theirs: Callable[[], object], units: tuple[int, int]
) -> tuple[float, float, float]:
    """Return CPU times for each unit of work of both, ns, and the ratio: medians of seven pairs."""
    rows = []
    for _ in range(7):
        marks = [process_time()]
        for function in (ours, theirs):
            function()
            marks.append(process_time())
        rows.append(np.diff(marks) / units * 1e9)
    own, other = np.array(rows).T
    ratios = other / own
    print(f"    ratios of seven pairs: {ratios.min():.3g} to {ratios.max():.3g}")
    return float(np.median(own)), float(np.median(other)), float(np.median(ratios))


def in_clusters() -> dict[str, float]:
    """Time of the clusters for 10 000 points beside that of all faces, for each point."""
    mesh, found = rough_mesh(5), {}
    direct, few, many = PolyhedronSums(mesh), surroundings(mesh, 128, 1), surroundings(mesh, 10_000)
    exact = direct(few).acceleration()
    scale = mesh.volume_m3 / np.maximum(np.linalg.norm(few, axis=0), mesh.largest_radius_m) ** 2
    turned = many[:, ::-1].copy()
    for error in (1e-6, 1e-12):
        name = f"polyhedron_20480_clusters_{error:.0e}".replace("e-0", "e-")
        begin = process_time()
        tree = PolyhedronTree(mesh, error)
        tree(many).acceleration()
        first = process_time() - begin
        off = np.linalg.norm(tree(few).acceleration() - exact, axis=0) / scale
        if not off.max() <= error + 1e-12:
            raise ArithmeticError(f"{name}: errs by {off.max():g}")
        own, _, ratio = paired(
            lambda tree=tree: tree(fresh(turned)).acceleration(),  # type: ignore[misc]
            lambda: direct(fresh(few)).acceleration(),
            (many.shape[1], few.shape[1]),
        )
        found |= {
            f"{name}_us_per_point": own * 1e-3,
            f"{name}_faster_than_all_faces": ratio,
            f"{name}_set_up_s": first - own * many.shape[1] * 1e-9,
            f"{name}_error": float(off.max()),
        }
    return found


def polyhedra() -> dict[str, float]:
    """Sum over all faces beside polyhedral-gravity, which returns all three quantities too."""
    peer: Any = None
    if find_spec("polyhedral_gravity") is None:
        print("  polyhedral-gravity is not installed: no comparison with it")
    else:
        import polyhedral_gravity as peer

        print(f"  polyhedral-gravity {version('polyhedral-gravity')}, one thread")
    found: dict[str, float] = {}
    for subdivisions, points, few in ((2, 64, 64), (2, 1024, 64), (5, 64, 4), (5, 1024, 4)):
        mesh = rough_mesh(subdivisions)
        faces = len(mesh.faces)
        r = surroundings(mesh, points)
        direct = PolyhedronSums(mesh)
        name = f"polyhedron_{faces}_faces_{points}_points"

        calls = max(1, 2**18 // points // faces)

        def ours(direct: Any = direct, r: Array = r, calls: int = calls) -> None:
            for _ in range(calls):
                sums = direct(fresh(r))
                sums.potential(), sums.acceleration(), sums.gradient()

        if peer is None:
            begin = process_time()
            ours()
            found[f"{name}_ns_per_face"] = (process_time() - begin) / calls / points / faces * 1e9
            continue
        body = peer.GravityEvaluable(
            peer.Polyhedron(
                (mesh.vertices, mesh.faces), 1.0,
                integrity_check=peer.PolyhedronIntegrity.DISABLE,
            )
        )  # fmt: skip
        places = r[:, :few].T.tolist()
        theirs = np.array([row[1] for row in body(places, parallel=False)]).T
        exact = CODATA_2018_G * direct(r[:, :few]).acceleration()
        # its constant of gravitation is compared too, and its sign is that of the acceleration
        if not np.abs(theirs - exact).max() <= 1e-9 * np.abs(exact).max():
            raise ArithmeticError(f"{name}: polyhedral-gravity differs")
        own, other, ratio = paired(
            ours,
            lambda body=body, places=places: body(places, parallel=False),  # type: ignore[misc]
            (calls * points * faces, few * faces),
        )
        found |= {
            f"{name}_ns_per_face": own,
            f"{name}_polyhedral_gravity_ns_per_face": other,
            f"{name}_faster_than_polyhedral_gravity": ratio,
        }
    return found


def pyshtools_series() -> dict[str, float]:
    """Harmonic series at scattered points beside MakeGravGridPoint, in Fortran, point by point."""
    if find_spec("pyshtools") is None:
        print("  pyshtools is not installed: no comparison with it")
        return {}
    import pyshtools

    print(f"  pyshtools {pyshtools.__version__}")
    found: dict[str, float] = {}
    rng = np.random.default_rng(4)
    r = rng.normal(size=(3, 2000))
    r *= 1.6e4 / np.linalg.norm(r, axis=0)
    latitude = np.degrees(np.arcsin(r[2] / 1.6e4))
    longitude = np.degrees(np.arctan2(r[1], r[0]))
    polar, east = np.radians(90.0 - latitude), np.radians(longitude)
    axes = np.array(
        [
            [np.sin(polar) * np.cos(east), np.sin(polar) * np.sin(east), np.cos(polar)],
            [np.cos(polar) * np.cos(east), np.cos(polar) * np.sin(east), -np.sin(polar)],
            [-np.sin(east), np.cos(east), np.zeros(east.size)],
        ]
    )
    for degree in (4, 20, 50) if os.environ.get("HILLSPHERE_BENCHMARK_LONG") else (4, 20):
        rows = random_rows(degree)
        table = np.zeros((2, degree + 1, degree + 1))
        for row in rows:
            table[:, row["n"], row["m"]] = row["c"], row["s"]
        field = GravityField(series_of(rows))

        def theirs(table: Array = table, degree: int = degree) -> Array:
            values = [
                pyshtools.gravmag.MakeGravGridPoint(table, GM, RADIUS, 1.6e4, a, b, lmax=degree)
                for a, b in zip(latitude[:200], longitude[:200], strict=True)
            ]
            return np.asarray(np.einsum("kN,kiN->iN", np.array(values).T, axes[:, :, :200]))

        ours, peers = field.acceleration(r), theirs()
        off = np.abs(ours[:, :200] - peers).max() / np.abs(peers).max()
        if not off <= 1e-12:
            raise ArithmeticError(f"degree {degree}: pyshtools differs by {off:g}")
        repeats = max(1, 400 // degree)
        own, other, ratio = paired(
            lambda field=field, k=repeats: [field.acceleration(r) for _ in range(k)],  # type: ignore[misc]
            theirs,
            (repeats * r.shape[1], 200),
        )
        found |= {
            f"harmonics_{degree}_scattered_ns_per_point": own,
            f"harmonics_{degree}_pyshtools_ns_per_point": other,
            f"harmonics_{degree}_faster_than_pyshtools": ratio,
            f"harmonics_{degree}_difference_from_pyshtools": float(off),
        }
    return found


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
    rows = [{"n": n, "m": m, "c": c, "s": s} for (n, m), (c, s) in triangle.items()]
    series = GravityField(series_of(rows))
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
    return found | polyhedra() | in_clusters() | pyshtools_series()


if __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:<45} {value:10.2f}")
