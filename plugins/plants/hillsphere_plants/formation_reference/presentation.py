"""Table and figure of the reference trajectory of a formation."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import PALETTE, Figure, Metric, Presentation
from hillsphere.products import Trajectories
from hillsphere.show.tables import column, tabulate, text_column

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["present_formation"]

_COLOURS = ("blue", "vermillion", "green", "purple", "orange", "sky", "black")


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
        figures={
            "formation_reference": Figure(
                "Reference trajectories of the formation",
                lambda figure: _draw(figure, places, spacecraft, semi_axes_m),
                "In the Hill frame of the asteroid: x away from the Sun, z its orbit normal. "
                "Circles: the start; grey: what the asteroid sweeps as it turns.",
                size_in=(8.0, 4.8),
            )
        },
    )


def _draw(
    figure: MatplotlibFigure,
    places: list[Array],
    spacecraft: tuple[str, ...],
    semi_axes_m: Array | None,
) -> None:
    from matplotlib.patches import Ellipse

    across, along = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    for axes, (name, row) in ((across, ("z", 2)), (along, ("x", 0))):
        if semi_axes_m is not None:
            # what the body sweeps as it turns about z
            wide = 2e-3 * float(max(semi_axes_m[:2]))
            high = 2e-3 * float(semi_axes_m[2]) if name == "z" else wide
            axes.add_patch(Ellipse((0.0, 0.0), wide, high, color="#999999", label="asteroid"))
        for i, (craft, r) in enumerate(zip(spacecraft, places, strict=True)):
            colour = PALETTE[_COLOURS[i % len(_COLOURS)]]
            axes.plot(r[1] / 1e3, r[row] / 1e3, color=colour, label=craft)
            axes.plot(r[1, :1] / 1e3, r[row, :1] / 1e3, "o", color=colour, markerfacecolor="white")
        axes.set_ylabel(f"{name} [km]")
        axes.set_aspect("equal", adjustable="box")
    along.set_xlabel("y [km]")
    across.legend(loc="best")
