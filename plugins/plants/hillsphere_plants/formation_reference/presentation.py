"""Table and figure of the reference trajectory of a formation."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Axis,
    Chart,
    Cloud,
    Metric,
    Path,
    Presentation,
    Solid,
    Space,
    Surface,
)
from hillsphere.products import Trajectories
from hillsphere.show.bodies import ellipsoid_points
from hillsphere.show.charts import even_indices
from hillsphere.show.history import time_unit
from hillsphere.show.spaces import with_room
from hillsphere.show.tables import column, tabulate, text_column

__all__ = ["present_formation"]


def present_formation(
    flights: Trajectories, spacecraft: tuple[str, ...], semi_axes_m: Array | None
) -> Presentation:
    """Show distances and paths.

    Parameters
    ----------
    flights : Trajectories
        One flight, whose states are those of all spacecraft.
    spacecraft : tuple of str
        Their names.
    semi_axes_m : ndarray, shape (3,), or None
        Semi-axes of the asteroid.

    Returns
    -------
    Presentation
        A table of distances, the paths, and the least distance of all as metric.
    """
    places = [flights.x[6 * i : 6 * i + 3, :, 0] for i in range(len(spacecraft))]
    apart = {
        f"asteroid – {name}": np.linalg.norm(r, axis=0)
        for name, r in zip(spacecraft, places, strict=True)
    }
    for i, j in combinations(range(len(spacecraft)), 2):
        apart[f"{spacecraft[i]} – {spacecraft[j]}"] = np.linalg.norm(places[i] - places[j], axis=0)
    columns = [
        text_column("between", apart, "from … to …"),
        column("least_km", [distance.min() for distance in apart.values()], "least distance", 6),
        column("greatest_km", [distance.max() for distance in apart.values()],
               "greatest distance", 6),
    ]  # fmt: skip
    least = min(float(distance.min()) for distance in apart.values())
    return Presentation(
        metrics={"least_distance": Metric(least, "m")},
        tables={"formation_distances": tabulate("Distances in the formation", columns)},
        figures={"formation_reference": _chart(places, flights.t_s[:, 0], spacecraft, semi_axes_m)},
    )


def _chart(
    places: list[Array], t_s: Array, spacecraft: tuple[str, ...], semi_axes_m: Array | None
) -> Chart:
    """Return the paths about the asteroid; a row is a spacecraft's distance from it."""
    unit, scale = time_unit(float(t_s[-1]))
    at = even_indices(t_s.size)
    solids: list[Solid] = []
    if semi_axes_m is not None:
        a, b, c = semi_axes_m / 1e3
        body = ellipsoid_points(max(a, b), max(a, b), c)  # it turns about z
        solids.append(Surface(body, "asteroid"))
    for i, (craft, r) in enumerate(zip(spacecraft, places, strict=True)):
        colour = LINE_COLOURS[i % len(LINE_COLOURS)]
        solids += [
            Path(r[:, at] / 1e3, craft, colour, times=t_s[at] / scale, rows=i),
            Cloud(r[:, :1] / 1e3, "", colour, rows=i),
        ]
    return Chart(
        "Reference trajectories of the formation",
        [with_room(Space(solids, time=Axis("time", unit)))],
        "In the Hill frame of the asteroid: x away from the Sun, z its orbit normal. Circles: the "
        "start; grey: what the asteroid sweeps as it turns.",
        shared_legend=True,
        table="formation_distances",
    )
