"""The stage ``equilibria``: libration points and the linear motion about them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from hillsphere.engine.surroundings import Surroundings
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Metric, Presentation
from hillsphere.products.fields import Label, Shape
from hillsphere.show.tables import FieldColumns, column, tabulate
from hillsphere_plants.equilibria.libration_points import (
    check_orbit,
    libration_points,
    rest_eigenvalues,
)
from hillsphere_plants.equilibria.specs import EquilibriaSpec

__all__ = ["Equilibria", "EquilibriaStage"]

_TURN = 2.0 * np.pi
_REAL = 1e-9
"""Part of an eigenvalue below which its real or imaginary part is rounding."""


@dataclass(frozen=True)
class Equilibria:
    """Points of rest and the linear motion about them.

    With a true anomaly the points are those where a particle at rest is not accelerated for that
    moment, and the eigenvalues those of the equations with the true anomaly held.
    """

    frame: str
    """Frame of the positions."""
    names: Annotated[tuple[str, ...], Shape("points"), Label("point")]
    """``"L1"`` …"""
    true_anomaly_rad: Annotated[Array, Shape("points"), Label("true anomaly", 5, "deg")]
    """True anomaly at which the point is one of rest; NaN if it is always one."""
    position_m: Annotated[Array, Shape(3, "points")]
    """Positions of the points."""
    eigenvalues_1_s: Annotated[
        np.ndarray[tuple[int, ...], np.dtype[np.complex128]], Shape(6, "points")
    ]
    """Eigenvalues of the linear motion about them, the largest real part first."""
    height_m: Annotated[Array, Shape("points"), Label("above the surface along the radius", 6)]
    """Height above the surface along the radius; NaN without a surface."""


class EquilibriaStage:
    """Libration points of a plant.

    Parameters
    ----------
    spec : EquilibriaSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant has no such points, or no true anomaly.
    """

    def __init__(self, spec: EquilibriaSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self._anomalies = tuple(a % _TURN for a in spec.true_anomalies_rad)
        check_orbit(self.plant, *self._anomalies[:1])

    def run(self, ctx: Context) -> Equilibria:
        """Find them.

        Parameters
        ----------
        ctx : Context
            Progress.

        Returns
        -------
        Equilibria
            For each true anomaly in turn.

        Raises
        ------
        ConvergenceError
            If a search fails.
        """
        anomalies: tuple[float | None, ...] = self._anomalies or (None,)
        advance = ctx.track("equilibria", len(anomalies))
        names: list[str] = []
        where: list[Array] = []
        values: list[np.ndarray[tuple[int, ...], np.dtype[np.complex128]]] = []
        at: list[float] = []
        for anomaly in anomalies:
            by_name = libration_points(self.plant, anomaly)
            points = np.array(list(by_name.values())).T
            names += by_name
            where.append(points)
            values.append(rest_eigenvalues(self.plant, points, anomaly))
            at += [np.nan if anomaly is None else anomaly] * len(by_name)
            advance(1)
        position = np.concatenate(where, axis=1)
        return Equilibria(
            frame=self.plant.frame,
            names=tuple(names),
            true_anomaly_rad=np.array(at),
            position_m=position,
            eigenvalues_1_s=np.concatenate(values, axis=1),
            height_m=self._heights(position),
        )

    def present(self, product: Equilibria) -> Presentation:
        """Show positions, heights, growth and periods."""
        of = FieldColumns(product, "points")
        motions = [_growth_and_periods(values) for values in product.eigenvalues_1_s.T]
        distances = [float(np.linalg.norm(r)) for r in product.position_m.T]
        words = ("period of the slowest oscillation", "of the next", "of the fastest of three")
        columns = [
            of("names", "point"),
            of("true_anomaly_rad"),
            *(column(f"{axis}_m", r, axis, 10)
              for axis, r in zip("xyz", product.position_m, strict=True)),
            column("distance_m", distances, "distance from the centre", 10),
            of("height_m"),
            column("growth_s", [growth for growth, _ in motions], "time of growth by e", 5),
            *(column(f"period_{k + 1}_s",
                     [periods[k] if k < len(periods) else None for _, periods in motions],
                     text, 6, unit="s")
              for k, text in enumerate(words)),
        ]  # fmt: skip
        notes = [f"In the frame {product.frame}, in the body's gravity, which moves them off axes."]
        if self.spec.true_anomalies_rad:
            notes.append(
                "At each true anomaly the points where a particle at rest is not accelerated for "
                "that moment; growth and periods are those of the equations held there."
            )
        lengths = np.linalg.norm(product.position_m, axis=0)
        # Of several true anomalies each has metrics of its own, by its place among them.
        places = [product.names[:i].count(name) for i, name in enumerate(product.names)]
        many = max(places) > 0
        metrics = {
            f"{name.lower()}_distance{f'_{place + 1}' if many else ''}": Metric(float(d), "m")
            for name, place, d in zip(product.names, places, lengths, strict=True)
        }
        table = tabulate("Equilibrium points", columns, notes)
        return Presentation(metrics, {"equilibrium_points": table}, {})

    def _heights(self, r: Array) -> Array:
        axes = Surroundings.of(self.plant).semi_axes_m
        if axes is None:
            return np.full(r.shape[1], np.nan)
        level = np.sqrt(np.sum((r / np.asarray(axes)[:, None]) ** 2, axis=0))
        return np.asarray(np.linalg.norm(r, axis=0) * (1.0 - 1.0 / level))


def _growth_and_periods(
    values: np.ndarray[tuple[int, ...], np.dtype[np.complex128]],
) -> tuple[float | None, list[float]]:
    """Return the time of growth by e, None if stable, and the periods, the longest first.

    Real and imaginary parts that are rounding beside the eigenvalue count as zero.
    """
    growth = float(values.real.max())
    turning = values.imag[values.imag > _REAL * np.abs(values)]
    periods: list[float] = np.sort(2.0 * np.pi / turning)[::-1].tolist()
    unstable = growth > _REAL * float(np.abs(values).max())
    return (1.0 / growth if unstable else None), periods
