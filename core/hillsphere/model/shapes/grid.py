"""A shape given by its radius on a grid of latitude and longitude."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.formats.coefficients import LineReader
from hillsphere.model.shapes.specs import METRES, GridShapeSpec
from hillsphere.model.shapes.sphere import unit_vectors

__all__ = ["GridShape"]

_SAME = 1e-9
"""Relative difference of equal radii at a pole: above the rounding of a unit's conversion, below
the last digit of any published table."""


class GridShape:
    """A radius that is interpolated bilinearly in latitude and longitude on a grid.

    The surface is continuous, with creases along the lines of the grid.

    Parameters
    ----------
    spec : GridShapeSpec
        The radii of the grid.

    Raises
    ------
    InputError
        If the rows have different lengths, are fewer than three, hold a radius that is not
        positive, or differ along a pole.
    """

    def __init__(self, spec: GridShapeSpec) -> None:
        rows = _read(spec.file) if spec.file is not None else [list(row) for row in spec.radii]
        where = spec.file or "radii"
        if len(rows) < 3 or len({*map(len, rows)}) != 1 or len(rows[0]) < 3:
            raise InputError(
                f"{where}: expected at least three rows of the same three or more radii, got rows "
                f"of {sorted({*map(len, rows)})}"
            )
        with np.errstate(over="ignore"):  # refused below
            radii = METRES[spec.length_unit] * np.array(rows)
        if not (np.isfinite(radii).all() and (radii > 0.0).all()):
            raise InputError(f"{where}: radii must be positive")
        for pole in (0, -1):
            if np.ptp(radii[pole]) > _SAME * radii[pole, 0]:
                raise InputError(
                    f"{where}: the first and the last row are the poles, where all longitudes "
                    f"meet: their radii must be the same, got {radii[pole].min():g} to "
                    f"{radii[pole].max():g} m"
                )
        self._radii = radii
        # Between its points the surface bulges: a cell is no plane.
        way = unit_vectors(np.linspace(-90, 90, 361), np.linspace(0, 359.5, 720))
        x, y, z = np.abs(way * self.radius_array(way)).max(axis=1).tolist()
        self._extent = (x, y, z)

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the half-lengths of a box about the centre along x, y, z, m, from a ½° grid."""
        return self._extent

    @property
    def largest_radius_m(self) -> float:
        """Largest radius, m: that of a point of the grid."""
        return float(self._radii.max())

    @cached_property
    def steepest_per_m(self) -> float:
        r"""Lipschitz constant of the surface function, 1/m.

        The gradient of \|r\|/R is 1/R along the ray and R′/R² across it, with the gradient R′ of
        the radius on the unit sphere. In a cell R is bilinear in latitude and longitude, so that
        its derivatives are largest on the sides of the cell. The derivative by longitude is divided
        by the cosine of the latitude. In a cell at a pole, at the angle δ from it, the difference
        along a row grows as δ and the cosine as sin δ; their ratio is largest on the row opposite
        the pole.
        """
        rows, columns = self._radii.shape
        per_row, per_column = np.pi / (rows - 1), 2.0 * np.pi / columns
        north = np.abs(np.diff(self._radii, axis=0)) / per_row
        east = np.abs(np.roll(self._radii, -1, axis=1) - self._radii) / per_column
        cosines = np.cos(np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows))
        cosines[0], cosines[-1] = cosines[1], cosines[-2]
        east = np.maximum(east[1:], east[:-1]) / np.minimum(cosines[1:], cosines[:-1])[:, None]
        north = np.maximum(north, np.roll(north, -1, axis=1))
        slope, least = float(np.max(np.hypot(north, east))), float(self._radii.min())
        return float(np.hypot(1.0 / least, slope / least**2))

    def radius_array(self, directions: Array) -> Array:
        """Return the distance of the surface (N,), m, along directions (3, N) of any length."""
        return self._interpolated(directions)[0]

    def surface_array(self, r: Array) -> Array:
        """Return |r|/R − 1, (N,), at r (3, N), m."""
        return np.asarray(np.linalg.norm(r, axis=0) / self.radius_array(r) - 1.0)

    def normal_array(self, r: Array) -> Array:
        """Return the unit outward normals (3, N) where the rays through r meet the surface."""
        # The normal is along ∇(|r| − R) = r̂ − (R_φ/R) north − (R_λ/(R cos φ)) east, at |r| = R.
        radius, by_latitude, by_longitude = self._interpolated(r)
        x, y, z = r
        # On the polar axis, where east is not defined, `flat` must not be zero.
        flat = np.maximum(np.hypot(x, y), 1e-12 * np.abs(z))
        distance = np.hypot(flat, z)
        north = np.array([-x * z / flat, -y * z / flat, flat]) / distance
        east = np.array([-y, x, np.zeros_like(x)]) / flat
        slope = (by_latitude / radius) * north + (by_longitude / radius * distance / flat) * east
        normal = r / distance - slope
        return np.asarray(normal / np.linalg.norm(normal, axis=0))

    def _interpolated(self, directions: Array) -> tuple[Array, Array, Array]:
        """Return the radius and its derivatives by latitude and longitude, m and m/rad."""
        x, y, z = directions
        rows, columns = self._radii.shape
        per_row, per_column = np.pi / (rows - 1), 2.0 * np.pi / columns
        up = (np.arctan2(z, np.hypot(x, y)) + 0.5 * np.pi) / per_row
        around = np.mod(np.arctan2(y, x) / per_column, columns)
        # A lane that has become non-finite stays so, whatever its cell.
        i = np.clip(np.nan_to_num(up).astype(np.int64), 0, rows - 2)
        j = np.clip(np.nan_to_num(around).astype(np.int64), 0, columns - 1)
        # Bilinear interpolation between the four corners, with s to the north and t to the east.
        s, t, k = up - i, around - j, (j + 1) % columns
        sw, se = self._radii[i, j], self._radii[i, k]
        nw, ne = self._radii[i + 1, j], self._radii[i + 1, k]
        south, north = sw + t * (se - sw), nw + t * (ne - nw)
        across = (1.0 - s) * (se - sw) + s * (ne - nw)
        return (
            np.asarray(south + s * (north - south)),
            np.asarray((north - south) / per_row),
            np.asarray(across / per_column),
        )


def _read(path: str) -> list[list[float]]:
    lines = LineReader(Path(path))
    texts = (line.partition("#")[0].replace(",", " ").split() for line in lines)
    return [[lines.positive(word, "radius") for word in words] for words in texts if words]
