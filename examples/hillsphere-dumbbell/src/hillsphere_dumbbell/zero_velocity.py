"""Zero-velocity curves and equilibrium points, for any plant with an integral of motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from hillsphere.dynamics import System, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, ConservedQuantity, Context, Plant
from hillsphere.presentation import PALETTE, Figure, Metric, Presentation
from hillsphere.products.fields import Shape
from hillsphere.show.tables import FieldColumns, column, tabulate, text_column
from hillsphere.symbolic import jacobian

from hillsphere_dumbbell.specs import ZeroVelocitySpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = ["ZeroVelocity", "ZeroVelocityStage", "equilibria"]

_SEEDS = 41
_ITERATIONS = 60
_RESIDUAL = 1e-11
_MERGE = 1e-6


@dataclass(frozen=True)
class ZeroVelocity:
    """Integral of motion of resting particles on a grid, and where they stay at rest."""

    frame: str
    """Frame of the positions."""
    x_m: Annotated[Array, Shape("columns")]
    """Grid in the plane z = 0."""
    y_m: Annotated[Array, Shape("rows")]
    """Grid in the plane z = 0."""
    integral_m2_s2: Annotated[Array, Shape("rows", "columns")]
    """Integral of motion at rest."""
    equilibria_m: Annotated[Array, Shape(2, "equilibria")]
    """Positions x, y of the equilibrium points, from −x to +x."""
    equilibrium_integral_m2_s2: Annotated[Array, Shape("equilibria")]
    """Integral of motion there: the zero-velocity curve through the point opens at this value."""
    growth_rate_1_s: Annotated[Array, Shape("equilibria")]
    """Largest real part of the eigenvalues of the linearised motion; zero for a stable point."""


class ZeroVelocityStage:
    """Compute the map and the equilibrium points.

    Parameters
    ----------
    spec : ZeroVelocitySpec
        With its plant bound.

    Raises
    ------
    InputError
        If the plant has no integral of motion, or its states are not position and velocity.
    """

    def __init__(self, spec: ZeroVelocitySpec) -> None:
        self.spec = spec
        self.plant: Any = spec.plant.get()
        if not isinstance(self.plant, ConservedQuantity):
            raise InputError(f"plant {spec.plant.name!r} has no integral of motion")
        plant: Plant = spec.plant.get()
        dimensions = [(v.length, v.time) for v in plant.states]
        if dimensions != [(1, 0)] * 3 + [(1, -1)] * 3:
            raise InputError(f"plant {spec.plant.name!r}: states must be x, y, z, vx, vy, vz")

    def run(self, ctx: Context) -> ZeroVelocity:
        """Return the map and the equilibrium points.

        Raises
        ------
        InputError
            If the integral of motion is a finite number nowhere on the map.
        """
        flow = system(self.plant, normalised=True)
        assert flow.integral is not None
        unit = float(flow.unit[0])
        size = float(self.plant.scales.of([self.plant.integral_variable])[0])
        integral = flow.function(flow.integral)

        axis = np.linspace(-self.spec.half_width_m, self.spec.half_width_m, self.spec.points)
        grid = np.stack(np.meshgrid(axis, axis)).reshape(2, -1) / unit
        values = size * integral(_at_rest(grid))[0].reshape(axis.size, axis.size)
        if not np.isfinite(values).any():
            raise InputError(
                "half_width: the integral of motion is a finite number nowhere on a map of half "
                f"the width {self.spec.half_width_m:.3g} m; give a map as large as the body's "
                "surroundings"
            )

        places, growth = equilibria(flow, self.spec.half_width_m / unit)
        kept = np.hypot(*places) * unit >= self.spec.inner_radius_m
        places, growth = places[:, kept], growth[kept]
        ctx.info(f"{places.shape[1]} equilibrium points")
        return ZeroVelocity(
            frame=flow.frame,
            x_m=axis,
            y_m=axis.copy(),
            integral_m2_s2=values,
            equilibria_m=places * unit,
            equilibrium_integral_m2_s2=size * integral(_at_rest(places))[0],
            growth_rate_1_s=growth / flow.time_unit_s,
        )

    def present(self, product: ZeroVelocity) -> Presentation:
        """Return the table of equilibrium points and the map."""
        names = [f"E{i + 1}" for i in range(product.equilibria_m.shape[1])]
        x, y = product.equilibria_m
        of = FieldColumns(product, "equilibria")
        columns = [
            text_column("name", names),
            column("x_km", x),
            column("y_km", y),
            column("integral_m2_s2", product.equilibrium_integral_m2_s2),
            of("growth_rate_1_s", "growth_rate_1_h"),
        ]
        unstable = int(np.count_nonzero(product.growth_rate_1_s > 0))
        return Presentation(
            metrics={
                "equilibria": Metric(len(names)),
                "unstable_equilibria": Metric(unstable),
            },
            tables={"equilibria": tabulate("Equilibrium points", columns)},
            figures={
                "zero_velocity": Figure(
                    "Zero-velocity curves",
                    partial(_draw, product=product, names=names),
                    "A particle at rest on a curve cannot cross it outwards. The curves through "
                    "the equilibrium points are drawn in colour.",
                    size_in=(6.5, 5.5),
                )
            },
            verdict=[f"{len(names)} equilibrium points, {unstable} of them unstable."],
        )


def equilibria(flow: System, half_width: float) -> tuple[Array, Array]:
    """Find the equilibrium points in the plane z = 0, by Newton's method from a grid of seeds.

    Parameters
    ----------
    flow : System
        Normalised equations with states x, y, z, vx, vy, vz.
    half_width : float
        Half the width of the square that is searched.

    Returns
    -------
    points : ndarray, shape (2, K)
        Positions x, y, from −x to +x.
    growth : ndarray, shape (K,)
        Largest real part of the eigenvalues of the linearised motion; zero within its accuracy.
    """
    rhs = flow.function(*flow.rhs)
    slopes = flow.function(*(s for row in jacobian(flow.rhs, flow.x) for s in row))
    seeds = np.linspace(-half_width, half_width, _SEEDS + 1)
    points = np.stack(np.meshgrid(seeds, seeds)).reshape(2, -1)
    longest = 0.1 * half_width
    for _ in range(_ITERATIONS):
        state = _at_rest(points)
        pull = rhs(state)[3:5]
        (a, b), (c, d) = slopes(state).reshape(6, 6, -1)[3:5, 0:2]
        with np.errstate(all="ignore"):  # a seed may run into a singularity; it is dropped below
            determinant = a * d - b * c
            step = np.stack([d * pull[0] - b * pull[1], a * pull[1] - c * pull[0]]) / determinant
            step *= np.minimum(1.0, longest / np.hypot(*step))
            points = points - step
    points[np.abs(points) < _RESIDUAL] = 0.0
    with np.errstate(all="ignore"):
        left = np.abs(rhs(_at_rest(points))[3:6]).max(axis=0)
        good = (left < _RESIDUAL) & (np.abs(points).max(axis=0) <= half_width)
    distinct: list[Array] = []
    for point in points[:, good].T:
        if all(np.hypot(*(point - other)) > _MERGE for other in distinct):
            distinct.append(point)
    distinct.sort(key=lambda point: (round(float(point[0]), 9), float(point[1])))
    positions = np.array(distinct).reshape(-1, 2).T
    matrices = slopes(_at_rest(positions)).reshape(6, 6, -1).transpose(2, 0, 1)
    growth = np.linalg.eigvals(matrices).real.max(axis=1, initial=0.0)
    return positions, np.where(growth > 1e-7, growth, 0.0)


def _at_rest(points: Array) -> Array:
    return np.concatenate([points, np.zeros((4, points.shape[1]))])


def _draw(figure: MatplotlibFigure, *, product: ZeroVelocity, names: list[str]) -> None:
    axes = figure.add_subplot(aspect="equal")
    x, y = product.x_m / 1e3, product.y_m / 1e3
    values = product.integral_m2_s2
    low, high = np.nanpercentile(values[np.isfinite(values)], (2.0, 97.0))
    values = np.where(np.isfinite(values), values, 2.0 * high)  # the grid may meet a singularity
    # One value all over the map, but for rounding: contours need levels that rise.
    if high - low <= 1e-12 * abs(high):
        high = low + max(abs(low), 1.0)
    levels = np.linspace(low, high, 14)
    filled = axes.contourf(x, y, values, levels=levels, cmap="Greys", extend="both", alpha=0.7)
    opening = np.unique(np.round(product.equilibrium_integral_m2_s2, 9))
    if opening.size:
        axes.contour(x, y, values, levels=opening, colors=PALETTE["vermillion"], linewidths=1.2)
    axes.plot(*(product.equilibria_m / 1e3), "o", color=PALETTE["blue"], markersize=5)
    for name, px, py in zip(names, *(product.equilibria_m / 1e3), strict=True):
        axes.annotate(name, (px, py), xytext=(5, 5), textcoords="offset points")
    axes.set_xlabel("x / km")
    axes.set_ylabel("y / km")
    axes.set_title(product.frame)
    bar = figure.colorbar(filled, ax=axes)
    bar.set_label("integral of motion at rest / (m²/s²)")
