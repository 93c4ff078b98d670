"""The stage ``equilibria``: libration points and the linear motion about them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.engine.surroundings import Surroundings
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Cell, Column, Metric, Presentation, Table
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
_COLUMNS = (
    Column("point", "", "point"),
    Column("true_anomaly_deg", "deg", "true anomaly", 5),
    Column("x_m", "m", "x", 10),
    Column("y_m", "m", "y", 10),
    Column("z_m", "m", "z", 10),
    Column("distance_m", "m", "distance from the centre", 10),
    Column("height_m", "m", "above the surface along the radius", 6),
    Column("growth_s", "s", "time of growth by e", 5),
    Column("period_1_s", "s", "period of the slowest oscillation", 6),
    Column("period_2_s", "s", "of the next", 6),
    Column("period_3_s", "s", "of the fastest of three", 6),
)


@dataclass(frozen=True)
class Equilibria:
    """Points of rest and the linear motion about them.

    Parameters
    ----------
    frame : str
        Of the positions.
    names : tuple of str, length N
        ``"L1"`` …
    true_anomaly_rad : ndarray, shape (N,)
        Where the body was held; NaN for points of rest for good.
    position_m : ndarray, shape (3, N)
        Where they are.
    eigenvalues_1_s : ndarray of complex, shape (6, N)
        Of the linear motion, the largest real part first; for a moment's points those of the
        equations with the true anomaly held.
    height_m : ndarray, shape (N,)
        Above the surface along the radius; NaN without a surface.
    """

    frame: str
    names: tuple[str, ...]
    true_anomaly_rad: Array
    position_m: Array
    eigenvalues_1_s: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    height_m: Array


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
            found = libration_points(self.plant, anomaly)
            points = np.array(list(found.values())).T
            names += found
            where.append(points)
            values.append(rest_eigenvalues(self.plant, points, anomaly))
            at += [np.nan if anomaly is None else anomaly] * len(found)
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
        rows: list[dict[str, Cell]] = []
        for i, name in enumerate(product.names):
            values = product.eigenvalues_1_s[:, i]
            growth = float(values.real.max())
            turning = values.imag[values.imag > _REAL * np.abs(values)]
            periods = np.sort(2.0 * np.pi / turning)[::-1].tolist()
            r = product.position_m[:, i]
            unstable = growth > _REAL * float(np.abs(values).max())
            rows.append(
                {
                    "point": name,
                    "true_anomaly_deg": _number(np.degrees(product.true_anomaly_rad[i])),
                    "x_m": float(r[0]),
                    "y_m": float(r[1]),
                    "z_m": float(r[2]),
                    "distance_m": float(np.linalg.norm(r)),
                    "height_m": _number(product.height_m[i]),
                    "growth_s": 1.0 / growth if unstable else None,
                    "period_1_s": periods[0] if periods else None,
                    "period_2_s": periods[1] if len(periods) > 1 else None,
                    "period_3_s": periods[2] if len(periods) > 2 else None,
                }
            )
        notes = [f"In the frame {product.frame}, in the body's gravity, which moves them off axes."]
        if self.spec.true_anomalies_rad:
            notes.append(
                "At each true anomaly the points where a particle at rest is not accelerated for "
                "that moment; growth and periods are those of the equations held there."
            )
        distances = np.linalg.norm(product.position_m, axis=0)
        # Of several true anomalies each has metrics of its own, by its place among them.
        places = [product.names[:i].count(name) for i, name in enumerate(product.names)]
        many = max(places) > 0
        metrics = {
            f"{name.lower()}_distance{f'_{place + 1}' if many else ''}": Metric(float(d), "m")
            for name, place, d in zip(product.names, places, distances, strict=True)
        }
        table = Table("Equilibrium points", _COLUMNS, rows, notes)
        return Presentation(metrics, {"equilibrium_points": table}, {})

    def _heights(self, r: Array) -> Array:
        axes = Surroundings.of(self.plant).semi_axes_m
        if axes is None:
            return np.full(r.shape[1], np.nan)
        level = np.sqrt(np.sum((r / np.asarray(axes)[:, None]) ** 2, axis=0))
        return np.asarray(np.linalg.norm(r, axis=0) * (1.0 - 1.0 / level))


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
