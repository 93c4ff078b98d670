"""The stage ``coverage``: surface coverage, altitudes, eclipses and lighting."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.dynamics import StepMap, system
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import OrbitSet
from hillsphere_orbits.coverage.ellipsoid_geometry import (
    cell_areas,
    is_hidden,
    nearest_point,
    normals,
)
from hillsphere_orbits.coverage.presentation import present_coverage
from hillsphere_orbits.coverage.products import Coverage
from hillsphere_orbits.coverage.specs import CoverageSpec
from hillsphere_orbits.coverage.sunlight import declinations, obscuration, sun_directions
from hillsphere_orbits.nonlinear_stability.sampled_orbits import require_states, retrace
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.survey import LockedMoon

__all__ = ["CoverageStage"]

_PLACES = 300
"""Places on an orbit at which the Sun is looked at; the ground track has all of them."""

_OF_CELL = 0.15
"""Longest step of time, natural units, in cells: below an orbit outside its body the ground point
moves at no more than about 3 rad per unit."""


class CoverageStage:
    """Ground tracks, altitudes, eclipses and lit ground of periodic orbits.

    Parameters
    ----------
    spec : CoverageSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant is not about a moon that stands still in its frame.
    """

    def __init__(self, spec: CoverageSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        states = self.plant.states
        if not isinstance(self.plant, LockedMoon):
            raise InputError(
                "coverage needs a plant about a moon that is locked to its primary, such as "
                f"'hill'; got a {type(self.plant).__name__}"
            )
        self.moon: LockedMoon = self.plant
        require_states(states, "coverage")

    def run(
        self,
        ctx: Context,
        orbits: tuple[OrbitSet, ...],
    ) -> Coverage:
        """Describe the members of the families.

        Parameters
        ----------
        ctx : Context
            Progress.
        orbits : tuple of OrbitSet
            Whose members are described.

        Returns
        -------
        Coverage
            One row per member.

        Raises
        ------
        InputError
            If the plant has other states than position and velocity in space, or the primary
            reaches as far as the orbits.
        StageError
            If the orbits belong to other equations, or pass through the body.
        """
        spec, moon = self.spec, self.moon
        given = members_of(*orbits)
        equations = system(self.plant, normalised=True)
        # steps short enough that the ground track skips no cell
        around = retrace(StepMap(equations), given, _OF_CELL * spec.cell_rad)
        # the last state is the first one again
        way = around.way[:, :-1] * equations.unit[:, None, None]
        place, count = way[:3], len(given.labels)
        self._refuse_near_primary(place)
        axes = np.array(moon.semi_axes_m, dtype=float) if moon.semi_axes_m else None
        body = self._to_body(place)
        ground, altitude = _ground(body, axes, given.labels)
        longitude = np.arctan2(ground[1], ground[0])
        latitude = np.arctan2(ground[2], np.hypot(ground[0], ground[1]))
        # extremes by a parabola: samples alone miss them by a part of a step
        extent = np.array([_least(latitude), -_least(-latitude)])
        bands = _odd(np.pi / spec.cell_rad)
        edges = np.linspace(-0.5 * np.pi, 0.5 * np.pi, bands + 1)
        band = np.clip(np.searchsorted(edges, latitude, side="right") - 1, 0, bands - 1)
        shape = axes if axes is not None else np.ones(3)
        light = self._light(place, body, ground, axes, ctx.track("light", spec.seasons))
        return Coverage(
            labels=given.labels,
            latitude_rad=extent,
            surface_part=np.array([_between(low, high, shape) for low, high in extent.T]),
            cells_part=_cells(longitude, band, edges, shape),
            band_rad=edges,
            band_time=np.array(
                [np.bincount(band[:, i], minlength=bands) / band.shape[0] for i in range(count)]
            ).T,
            altitude_m=_spread(altitude),
            distance_m=_spread(np.linalg.norm(place, axis=0)),
            speed_m_s=_spread(np.linalg.norm(way[3:], axis=0)),
            declination_rad=declinations(spec.sun_declination_max_rad, spec.seasons),
            primary_shadow=light[0],
            body_shadow=light[1],
            shadow=light[2],
            lit_ground=light[3],
            track_rad=np.array([longitude, latitude]),
            track_altitude_m=altitude,
            cell_rad=spec.cell_rad,
            min_sun_elevation_rad=spec.sun_elevation_min_rad,
            sun_longitudes=spec.sun_longitudes,
            sun_distance_m=spec.sun_distance_m,
            body=moon.body_name,
        )

    def present(
        self,
        product: Coverage,
        orbits: tuple[OrbitSet, ...] = (),
    ) -> Presentation:
        """Show the table, the time over each latitude and the altitudes."""
        return present_coverage(product, self.spec.label)

    def _refuse_near_primary(self, place: Array) -> None:
        radius = self.spec.primary_radius_m
        if radius is None:
            return
        away = place + np.array([self.moon.primary_distance_m, 0.0, 0.0])[:, None, None]
        room = float(np.min(np.linalg.norm(away, axis=0)))
        if radius >= room:
            raise InputError(
                f"primary_radius_m: a primary of radius {radius / 1e3:g} km reaches as far as the "
                f"orbits, which come to {room / 1e3:.6g} km from its centre"
            )

    def _to_body(self, r: Array) -> Array:
        """Return the components along the axes of the body of vectors (3, …)."""
        c, s = np.cos(self.moon.prime_meridian_rad), np.sin(self.moon.prime_meridian_rad)
        return np.array([c * r[0] + s * r[1], c * r[1] - s * r[0], r[2]])

    def _light(
        self,
        place: Array,
        body: Array,
        ground: Array,
        axes: Array | None,
        advance: Callable[[int], None],
    ) -> Array:
        """Return means (4, S, M): shadow of the primary, of the moon, of both, lit ground."""
        spec = self.spec
        thin = slice(None, None, max(1, place.shape[1] // _PLACES))
        place, body, ground = place[:, thin], body[:, thin], ground[:, thin]
        distance = spec.sun_distance_m
        apparent = float(np.arcsin(spec.sun_radius_m / distance)) if distance else 0.0
        primary = np.array([-self.moon.primary_distance_m, 0.0, 0.0])[:, None]
        high = np.sin(spec.sun_elevation_min_rad)
        means = np.full((4, spec.seasons, place.shape[2]), np.nan)
        tilts = declinations(spec.sun_declination_max_rad, spec.seasons)
        for s, tilt in enumerate(tilts):
            sun = sun_directions(tilt, spec.sun_longitudes, place.shape[1])
            sun_of_body = self._to_body(sun)
            for i in range(place.shape[2]):
                dark = np.zeros((place.shape[1], spec.sun_longitudes))
                if spec.primary_radius_m is not None:
                    dark = obscuration(
                        primary - place[:, :, i], spec.primary_radius_m, sun, apparent
                    )
                    means[0, s, i] = dark.mean()
                if axes is not None:
                    behind = is_hidden(body[:, :, i], sun_of_body, axes)
                    means[1, s, i] = behind.mean()
                    up = normals(ground[:, :, i], axes)
                    lit = np.einsum("in,ink->nk", up, sun_of_body) >= high
                    # the ground is in the primary's shadow when the spacecraft above it is
                    means[3, s, i] = (lit * (1.0 - dark)).mean()
                    dark = np.where(behind, 1.0, dark)
                means[2, s, i] = dark.mean()
            advance(1)
        return means


def _ground(body: Array, axes: Array | None, labels: tuple[str, ...]) -> tuple[Array, Array]:
    """Return ground points (3, P, M) and altitudes (P, M)."""
    if axes is None:
        return body, np.full(body.shape[1:], np.nan)
    inside = np.min(np.sum((body / axes[:, None, None]) ** 2, axis=0), axis=0) < 1.0
    if inside.any():
        names = ", ".join(repr(labels[i]) for i in np.flatnonzero(inside)[:5])
        raise StageError(f"orbits that pass through the body have no coverage: {names}")
    ground = nearest_point(body.reshape(3, -1), axes).reshape(body.shape)
    return ground, np.linalg.norm(body - ground, axis=0)


def _odd(number: float) -> int:
    """Return the next odd number, so that the equator lies within a band."""
    whole = int(np.ceil(number * (1.0 - 1e-12)))
    return whole if whole % 2 else whole + 1


def _between(low: float, high: float, axes: Array) -> float:
    """Return the part of the surface between two latitudes."""
    turns = np.linspace(-np.pi, np.pi, 37)
    whole = cell_areas(np.linspace(-0.5 * np.pi, 0.5 * np.pi, 19), turns, axes).sum()
    return float(cell_areas(np.linspace(low, high, 19), turns, axes).sum() / whole)


def _cells(longitude: Array, band: Array, edges: Array, axes: Array) -> Array:
    """Return the part of the surface (M,) in cells that the ground points (P, M) meet."""
    count = 2 * (edges.size - 1)
    turns = np.linspace(-np.pi, np.pi, count + 1)
    column = np.clip(np.searchsorted(turns, longitude, side="right") - 1, 0, count - 1)
    area = cell_areas(edges, turns, axes)
    parts = []
    for row, place in zip(band.T, column.T, strict=True):
        met = np.zeros(area.shape, dtype=bool)
        met[row, place] = True
        parts.append(float(area[met].sum() / area.sum()))
    return np.array(parts)


def _spread(values: Array) -> Array:
    """Return least, mean and largest (3, M) of values (P, M) on a closed curve."""
    return np.array([_least(values), values.mean(axis=0), -_least(-values)])


def _least(values: Array) -> Array:
    """Return the least of each column (P, M) of samples on a closed curve, by a parabola."""
    places, lane = values.shape[0], np.arange(values.shape[1])
    i = np.argmin(values, axis=0)
    here = values[i, lane]
    before, after = values[i - 1, lane], values[(i + 1) % places, lane]
    bend = before - 2.0 * here + after
    safe = np.where(bend > 0.0, bend, 1.0)
    return np.asarray(here - np.where(bend > 0.0, 0.125 * (after - before) ** 2 / safe, 0.0))
