"""How the cost of gravity grows with the faces of a shape and the degree of a series.

    python benchmarks/growth_of_gravity.py                       # prints
    python benchmarks/growth_of_gravity.py docs/images/gravity-growth.svg

CPU times for each point of the acceleration, the shortest of three runs: of a polyhedron summed
over all faces and with clusters of faces as series (``relative_error = 1e-6``), and of a harmonic
series; what is done once for a shape or a series is shown beside. The exponents are the slopes of
straight lines through the logarithms, from 1280 faces and from degree 8 on.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from time import process_time

import numpy as np
from bench_gravity import fresh, random_rows, rough_mesh, series_of, surroundings

from hillsphere.gravity import GravityField
from hillsphere.model.shapes.mesh import Mesh
from hillsphere_gravity.polyhedron_sums import PolyhedronSums
from hillsphere_gravity.polyhedron_tree import PolyhedronTree

SUBDIVISIONS = (1, 2, 3, 4, 5, 6)
"""Of an icosahedron: 80 to 81 920 faces."""
DEGREES = (2, 4, 8, 12, 20, 32, 50)
PAIRS = 2**20
"""Of a face and a point that are summed for one time; 64 points at least."""
POINTS = 4000
"""Of which the series are evaluated."""
FITTED_FROM_FACES, FITTED_FROM_DEGREE = 1000, 8


def shortest(function: Callable[[], object]) -> float:
    """Return the CPU time of the fastest of three calls, s."""
    times = []
    for _ in range(3):
        begin = process_time()
        function()
        times.append(process_time() - begin)
    return min(times)


def measure_faces() -> dict[str, np.ndarray]:
    """Return faces, and times for each point, s, and for the set-up of the clusters, s."""
    rows = []
    for subdivisions in SUBDIVISIONS:
        mesh: Mesh = rough_mesh(subdivisions)
        faces = len(mesh.faces)
        count = max(64, PAIRS // faces)
        few, many = surroundings(mesh, count), surroundings(mesh, POINTS)
        direct = PolyhedronSums(mesh)
        direct(few[:, :64])
        summed = shortest(lambda direct=direct, few=few: direct(fresh(few))) / count  # type: ignore[misc]
        begin = process_time()
        tree = PolyhedronTree(mesh, 1e-6)
        tree(many).acceleration()
        first = process_time() - begin
        again = many[:, ::-1].copy()
        clustered = shortest(lambda tree=tree, q=again: tree(fresh(q)).acceleration())  # type: ignore[misc]
        rows.append((faces, summed, clustered / POINTS, max(first - clustered, 0.0)))
        print(
            f"{faces:>7} faces {summed * 1e6:10.2f} µs summed {clustered / POINTS * 1e6:10.2f} µs "
            f"in clusters, set up in {first - clustered:8.3f} s"
        )
    return dict(zip(("faces", "summed", "clustered", "first"), np.array(rows).T, strict=True))


def measure_degrees() -> dict[str, np.ndarray]:
    """Return degrees, times for each point, s, and of compiling, s."""
    rows = []
    for degree in DEGREES:
        field = GravityField(series_of(random_rows(degree)))
        r = 1.5e4 * np.random.default_rng(1).normal(size=(3, POINTS))
        r *= np.maximum(1.0, 1.3e4 / np.linalg.norm(r, axis=0))
        begin = process_time()
        field.acceleration(r)
        first = process_time() - begin
        time_s = shortest(lambda field=field, r=r: field.acceleration(r))  # type: ignore[misc]
        rows.append((degree, time_s / POINTS, max(first - time_s, 0.0)))
        print(f"{degree:>7} degree {time_s / POINTS * 1e9:9.1f} ns, compiled in {first:8.3f} s")
    return dict(zip(("degree", "time", "first"), np.array(rows).T, strict=True))


def fit(x: np.ndarray, y: np.ndarray, start: float) -> tuple[float, float]:
    """Return exponent and factor of a power law from a place on."""
    some = x >= start
    slope, offset = np.polyfit(np.log(x[some]), np.log(y[some]), 1)
    return float(slope), float(np.exp(offset))


def draw(path: str, faces: dict[str, np.ndarray], degrees: dict[str, np.ndarray]) -> None:
    """Draw times and fitted lines on logarithmic axes, faces left, degrees right."""
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = "gravity-growth"
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.0), layout="constrained")
    for axes, x, y, start, name, colour, marker in (
        (left, faces["faces"], faces["summed"], FITTED_FROM_FACES, "all faces", "#0072b2", "o"),
        (left, faces["faces"], faces["clustered"], FITTED_FROM_FACES, "clusters, 1e-6", "#d55e00",
         "s"),
        (right, degrees["degree"], degrees["time"], FITTED_FROM_DEGREE, "series", "#0072b2", "o"),
    ):  # fmt: skip
        exponent, factor = fit(x, y, start)
        line = x[x >= start]
        axes.loglog(x, 1e6 * y, marker, color=colour)
        axes.loglog(
            line, 1e6 * factor * line**exponent, "-", color=colour,
            label=f"{name}: power {exponent:.2f}",
        )  # fmt: skip
    left.set_xlabel("faces")
    left.set_title("Polyhedron, 1.1 to 3 radii")
    right.set_xlabel("degree")
    right.set_xticks(DEGREES, [str(degree) for degree in DEGREES])
    right.minorticks_off()
    right.set_title("Harmonic series")
    for axes in (left, right):
        axes.set_ylabel("CPU time for each point (µs)")
        axes.grid(alpha=0.3, which="both")
        axes.legend()
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    of_faces, of_degrees = measure_faces(), measure_degrees()
    for name in ("summed", "clustered", "first"):
        power = fit(of_faces["faces"], of_faces[name], FITTED_FROM_FACES)[0]
        print(f"{name}: faces to the power {power:.3f}")
    for name in ("time", "first"):
        power = fit(of_degrees["degree"], of_degrees[name], FITTED_FROM_DEGREE)[0]
        print(f"{name}: degree to the power {power:.3f}")
    if len(sys.argv) > 1:
        draw(sys.argv[1], of_faces, of_degrees)
