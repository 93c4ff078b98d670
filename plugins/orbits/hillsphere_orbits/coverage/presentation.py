"""Tables, figures and sentences about what orbits see."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Cell, Column, Figure, Presentation, Table
from hillsphere_orbits.coverage.figures import draw_coverage, draw_tracks
from hillsphere_orbits.coverage.products import Coverage
from hillsphere_orbits.qso.presentation import named

__all__ = ["present_coverage"]

_ORBIT = Column("orbit", "", "orbit")
_RANGE = (("min", "least"), ("mean", "mean"), ("max", "largest"))
_COLUMNS = (
    _ORBIT,
    Column("latitude_min_deg", "deg", "least latitude", 5),
    Column("latitude_max_deg", "deg", "largest latitude", 5),
    Column("surface_part", "-", "surface between", 4),
    Column("cells_part", "-", "surface in cells met", 4),
    *(Column(f"altitude_{key}_km", "km", f"{word} altitude", 5) for key, word in _RANGE),
    *(Column(f"distance_{key}_km", "km", f"{word} distance", 5) for key, word in _RANGE),
    *(Column(f"speed_{key}_m_s", "m/s", f"{word} speed", 4) for key, word in _RANGE),
    *(Column(f"eclipse_{key}", "-", f"eclipsed, {word} of the year", 4) for key, word in _RANGE),
    Column("primary_eclipse_mean", "-", "by the primary, mean", 4),
    Column("body_eclipse_mean", "-", "by the moon, mean", 4),
    *(Column(f"lit_{key}", "-", f"ground lit, {word} of the year", 4) for key, word in _RANGE),
)
_BANDS = (
    _ORBIT,
    Column("latitude_from_deg", "deg", "from", 5),
    Column("latitude_to_deg", "deg", "to", 5),
    Column("time_part", "-", "part of the time", 4),
)
_SEASONS = (
    _ORBIT,
    Column("sun_declination_deg", "deg", "elevation of the Sun over the orbit plane", 4),
    Column("eclipse", "-", "eclipsed", 4),
    Column("primary_eclipse", "-", "by the primary", 4),
    Column("body_eclipse", "-", "by the moon", 4),
    Column("lit", "-", "ground lit", 4),
)


def present_coverage(product: Coverage, label: str) -> Presentation:
    """Show what the orbits see.

    Parameters
    ----------
    product : Coverage
        What is shown.
    label : str
        Appended to all identifiers.

    Returns
    -------
    Presentation
        Tables ``coverage``, ``latitude_bands`` and ``seasons``, figures ``coverage`` and
        ``ground_tracks``.
    """
    notes = _notes(product)
    tables = {
        "coverage": Table("Coverage", _COLUMNS, _rows(product), notes),
        "latitude_bands": Table("Time over each latitude", _BANDS, _bands(product)),
        "seasons": Table("Light in the course of the year", _SEASONS, _seasons(product), notes),
    }
    about = f" of {product.body.capitalize()}" if product.body not in ("", "body") else ""
    rows = max(4, len(product.labels))
    figures = {
        "coverage": Figure(
            f"Latitudes{about} and altitudes",
            lambda figure: draw_coverage(figure, product),
            "Left: part of the time over each band of latitude. Right: altitude, from the least "
            "to the largest, with its mean.",
            size_in=(9.0, 1.8 + 0.3 * rows),
        ),
        "ground_tracks": Figure(
            f"Ground tracks on the surface{about}",
            lambda figure: draw_tracks(figure, product),
            "The point of the surface nearest to the spacecraft, along one period of the orbits "
            "that reach least far, half as far and farthest in latitude.",
            size_in=(8.0, 4.6),
        ),
    }
    return Presentation(
        tables={named(name, label): table for name, table in tables.items()},
        figures={named(name, label): figure for name, figure in figures.items()},
        verdict=_verdict(product),
    )


def _notes(product: Coverage) -> list[str]:
    notes = [
        "The ground point is that of the surface nearest to the spacecraft; its latitude is "
        "planetocentric. It repeats after every period, as the moon is locked; cells are "
        f"{180.0 / (product.band_rad.size - 1):.3g}° wide. The speed is relative to the surface.",
        "What depends on the Sun is averaged over the orbit and, independently, over "
        f"{product.sun_longitudes} directions of the Sun about the orbit's normal, for "
        f"{product.declination_rad.size} places of the year with the Sun up to "
        f"{np.degrees(np.max(np.abs(product.declination_rad))):.3g}° off the orbit plane.",
    ]
    if np.isfinite(product.primary_shadow).all():
        cone = (
            "a cylinder, the Sun infinitely far"
            if product.sun_distance_m is None
            else f"a cone, the Sun {product.sun_distance_m / 1.495978707e11:.6g} au away; the part "
            "of its disc that is hidden counts"
        )
        notes.append(f"The shadow of the primary is {cone}; that of the moon a cylinder.")
    else:
        notes.append("The shadow of the primary is left out: no radius of it is given.")
    notes.append(
        "Ground counts as lit where the Sun stands at least "
        f"{np.degrees(product.sun_elevation_min_rad):.3g}° high outside the shadow of the primary."
    )
    return notes


def _number(value: float, factor: float = 1.0) -> float | None:
    return float(value * factor) if np.isfinite(value) else None


def _spread(values: Array, stem: str, suffix: str = "", factor: float = 1.0) -> dict[str, Cell]:
    return {
        f"{stem}_{key}{suffix}": _number(value, factor)
        for (key, _), value in zip(_RANGE, values, strict=True)
    }


def _year(values: Array) -> Array:
    return np.array([values.min(axis=0), values.mean(axis=0), values.max(axis=0)])


def _rows(product: Coverage) -> list[dict[str, Cell]]:
    shadow, lit = _year(product.shadow), _year(product.lit_ground)
    if not (np.isfinite(product.primary_shadow).all() or np.isfinite(product.body_shadow).all()):
        shadow = np.full_like(shadow, np.nan)  # nothing is known of any shadow
    return [
        {
            "orbit": name,
            "latitude_min_deg": float(np.degrees(product.latitude_rad[0, i])),
            "latitude_max_deg": float(np.degrees(product.latitude_rad[1, i])),
            "surface_part": float(product.surface_part[i]),
            "cells_part": float(product.cells_part[i]),
            **_spread(product.altitude_m[:, i], "altitude", "_km", 1e-3),
            **_spread(product.distance_m[:, i], "distance", "_km", 1e-3),
            **_spread(product.speed_m_s[:, i], "speed", "_m_s"),
            **_spread(shadow[:, i], "eclipse"),
            "primary_eclipse_mean": _number(product.primary_shadow[:, i].mean()),
            "body_eclipse_mean": _number(product.body_shadow[:, i].mean()),
            **_spread(lit[:, i], "lit"),
        }
        for i, name in enumerate(product.labels)
    ]


def _bands(product: Coverage) -> list[dict[str, Cell]]:
    edges = np.degrees(product.band_rad)
    return [
        {
            "orbit": name,
            "latitude_from_deg": float(edges[k]),
            "latitude_to_deg": float(edges[k + 1]),
            "time_part": float(product.band_time[k, i]),
        }
        for i, name in enumerate(product.labels)
        for k in np.flatnonzero(product.band_time[:, i])
    ]


def _seasons(product: Coverage) -> list[dict[str, Cell]]:
    return [
        {
            "orbit": name,
            "sun_declination_deg": float(np.degrees(tilt)),
            "eclipse": _number(product.shadow[s, i]),
            "primary_eclipse": _number(product.primary_shadow[s, i]),
            "body_eclipse": _number(product.body_shadow[s, i]),
            "lit": _number(product.lit_ground[s, i]),
        }
        for i, name in enumerate(product.labels)
        for s, tilt in enumerate(product.declination_rad)
    ]


def _verdict(product: Coverage) -> list[str]:
    far = int(np.argmax(product.surface_part))
    low, high = np.degrees(product.latitude_rad[:, far])
    widest = f"The widest coverage is that of {product.labels[far]}: latitudes {low:.3g}° to "
    widest += f"{high:.3g}°, {100 * product.surface_part[far]:.3g} % of the surface"
    if np.isfinite(product.altitude_m).all():
        near = product.altitude_m[:, far] / 1e3
        widest += f", from altitudes of {near[0]:.3g} to {near[2]:.3g} km"
    return [widest + "."]
