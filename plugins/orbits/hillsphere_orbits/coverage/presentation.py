"""Tables, figures and sentences about the coverage of the surface."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Presentation
from hillsphere.show.tables import FieldColumns, FilledColumn, column, tabulate, text_column
from hillsphere_orbits.coverage.figures import coverage_chart, track_chart
from hillsphere_orbits.coverage.products import Coverage
from hillsphere_orbits.qso.presentation import label_identifier

__all__ = ["present_coverage"]

_RANGE = {"min": "least", "mean": "mean", "max": "largest"}


def present_coverage(product: Coverage, label: str) -> Presentation:
    """Show coverage, altitudes, eclipses and light.

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
        "coverage": tabulate("Coverage", _coverage(product), notes),
        "latitude_bands": tabulate("Time over each latitude", _bands(product)),
        "seasons": tabulate("Light in the course of the year", _seasons(product), notes),
    }
    own = label_identifier("coverage", label)
    figures = {"coverage": coverage_chart(product, own), "ground_tracks": track_chart(product, own)}
    return Presentation(
        tables={label_identifier(name, label): table for name, table in tables.items()},
        figures={label_identifier(name, label): figure for name, figure in figures.items()},
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
        f"{np.degrees(product.min_sun_elevation_rad):.3g}° high outside the shadow of the primary."
    )
    return notes


def _coverage(product: Coverage) -> list[FilledColumn]:
    of = FieldColumns(product, "orbits")
    known = np.isfinite(product.primary_shadow).all() or np.isfinite(product.body_shadow).all()
    primary = [values.mean() for values in product.primary_shadow.T]
    body = [values.mean() for values in product.body_shadow.T]
    return [
        of("labels", "orbit"),
        *of.split("latitude_rad", min="least", max="largest"),
        of("surface_part"),
        of("cells_part"),
        *of.split("altitude_m", **_RANGE),
        *of.split("distance_m", **_RANGE),
        *of.split("speed_m_s", **_RANGE),
        *_year("eclipse", "eclipsed", product.shadow if known else product.shadow * np.nan),
        column("mean_primary_eclipse", primary, "by the primary, mean", 4),
        column("mean_body_eclipse", body, "by the moon, mean", 4),
        *_year("lit", "ground lit", product.lit_ground),
    ]


def _year(stem: str, label: str, values: Array) -> list[FilledColumn]:
    spread = values.min(axis=0), values.mean(axis=0), values.max(axis=0)
    return [
        column(f"{key}_{stem}", part, f"{label}, {word} of the year", 4)
        for (key, word), part in zip(_RANGE.items(), spread, strict=True)
    ]


def _bands(product: Coverage) -> list[FilledColumn]:
    orbit, band = np.nonzero(product.band_time.T)
    return [
        text_column("orbit", np.array(product.labels)[orbit], "orbit"),
        column("latitude_from_deg", product.band_rad[band], "from", 5),
        column("latitude_to_deg", product.band_rad[band + 1], "to", 5),
        column("time_part", product.band_time[band, orbit], "part of the time", 4),
    ]


def _seasons(product: Coverage) -> list[FilledColumn]:
    of = FieldColumns(product, "orbits", "seasons")
    return [
        of("labels", "orbit"),
        of("declination_rad", "sun_declination_deg"),
        of("shadow", "eclipse"),
        of("primary_shadow", "primary_eclipse"),
        of("body_shadow", "body_eclipse"),
        of("lit_ground", "lit"),
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
