"""The command ``hillsphere gravity``: the field of a file at given places, without a mission."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hillsphere.cli.output import number, write, write_json, write_table
from hillsphere.cli.streams import say
from hillsphere.errors import InputError

if TYPE_CHECKING:
    from hillsphere.interfaces import Array

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_MESHES = (".obj", ".plt", ".icq", ".stl", ".ply", ".bds", ".dsk")
_SUFFIXES = (".gfc", ".shadr", ".sha", ".tab", ".cof", *_MESHES)
_COLUMNS = ("latitude (°)", "longitude (°)", "radius (km)", "U (m²/s²)", "|g| (m/s²)",
            "g_x (m/s²)", "g_y (m/s²)", "g_z (m/s²)")  # fmt: skip

_OUTSIDE = 1.5
"""Radius of the places shown where none are given, in radii of the sphere about the body: the terms
of degree n have shrunk there by 1.5⁻ⁿ, and the field is still that of the body's shape."""


@app.command()
def gravity(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Field (.gfc, .shadr, .sha, .tab, .cof), or mesh of triangles (.obj, .stl, .ply, "
            "a plate model .plt, an .icq, SPICE's .bds or .dsk; a .tab with --length-unit).",
        ),
    ],
    at: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LAT,LON,RADIUS_KM",
            help="Place: planetocentric latitude and east longitude, degrees, and distance from "
            "the centre, km. May be given several times; left out: on the axes x, y and z, at "
            "1.5 times the radius of the sphere about the body (of reference, or of its vertices).",
        ),
    ] = None,
    max_degree: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Use degrees up to this (fields).")
    ] = None,
    tide_system: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Tide system, of a .gfc file that does not state it."),
    ] = None,
    normalisation: Annotated[
        str | None,
        typer.Option(metavar="full|none", help="Normalisation, of a file that does not state it."),
    ] = None,
    epoch: Annotated[
        str | None,
        typer.Option(metavar="DATE", help="Date at which a time-variable .gfc file is evaluated."),
    ] = None,
    gm_km3_s2: Annotated[
        float | None,
        typer.Option("--gm-km3-s2", metavar="GM", help="Gravitational parameter (meshes), km³/s²."),
    ] = None,
    density_g_cm3: Annotated[
        float | None,
        typer.Option(
            "--density-g-cm3", metavar="RHO", help="Density instead of GM (meshes), g/cm³."
        ),
    ] = None,
    length_unit: Annotated[
        str | None,
        typer.Option(
            metavar="m|km", help="Unit of the vertices (meshes), which only SPICE's files state."
        ),
    ] = None,
    segment: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Segment of a file of SPICE, from 1.")
    ] = None,
    merge_vertices: Annotated[
        bool,
        typer.Option("--merge-vertices", help="Make one of vertices at the same place (meshes)."),
    ] = False,
    merge_tolerance_m: Annotated[
        float, typer.Option(metavar="M", min=0.0, help="Distance of vertices that are merged, m.")
    ] = 0.0,
    json: Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")] = False,
) -> None:
    """Show potential and acceleration of a gravity file at given places.

    The potential is positive; the acceleration is its gradient in the body-fixed frame, without
    the centrifugal part of a turning body.
    """
    places = [_place(text) for text in at or ()]
    mesh = {"gm_km3_s2": gm_km3_s2, "density_g_cm3": density_g_cm3}
    if (suffix := file.suffix.lower()) not in _SUFFIXES:
        raise InputError(f"{file}: the suffix must be one of {', '.join(_SUFFIXES)}")
    # A table may hold either; only a mesh has a unit of its vertices.
    is_mesh = suffix in _MESHES or (suffix == ".tab" and length_unit is not None)
    told: tuple[str, ...] = ()
    keys: dict[str, Any]
    if is_mesh:
        keys = {"length_unit": length_unit, "segment": segment}
        keys |= {"merge_vertices": merge_vertices, "merge_tolerance_m": merge_tolerance_m}
        if suffix == ".stl" and not merge_vertices:
            raise InputError(
                f"{file}: an STL file lists the corners of each face anew, so that its faces have "
                "no edge in common; give --merge-vertices"
            )
        model, told = _mesh_model(file, keys, mesh)
    else:
        keys = {"max_degree": max_degree, "tide_system": tide_system,
                "normalisation": normalisation, "epoch": epoch}  # fmt: skip
        model = _series_model(file, keys, mesh)
    rows = _evaluate(model, places or _usual_places(model))
    body = _describe_body(model) if is_mesh else {}
    if json:
        write_json({"file": str(file), "gm_m3_s2": float(model.gm_m3_s2), **body, "points": rows})
        return
    write(f"{file}: GM = {number(float(model.gm_m3_s2) / 1e9)} km³/s²\n")
    if body:
        extent = " × ".join(number(axis / 1e3) for axis in body["extent_m"])
        write(
            f"{body['faces']} triangles, extent {extent} km, volume "
            f"{number(body['volume_m3'] / 1e9)} km³, density "
            f"{number(body['density_kg_m3'])} kg/m³\n"
        )
        for sentence in told[1:]:
            write(f"{sentence}\n")
    write_table([list(map(number, _cells(row))) for row in rows], header=_COLUMNS)
    radius_m = getattr(model, "reference_radius_m", None)
    inside = sum(radius_m is not None and row["radius_m"] < radius_m for row in rows)
    if radius_m is not None and inside:
        say(
            f"{inside} of {len(rows)} places lie inside the reference sphere of {radius_m / 1e3:g} "
            "km, where the series need not converge"
        )


def _place(text: str) -> tuple[float, float, float]:
    """Return latitude, longitude (degrees) and radius (km) of an option's text."""
    try:
        latitude, longitude, radius = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--at {text[:60]!r}: expected LAT,LON,RADIUS_KM, such as 10,-75.5,20"
        ) from None
    # written so that nan is refused, too
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 360.0 and 0.0 < radius < 1e12):
        raise InputError(
            f"--at {text[:60]!r}: the latitude must lie within ±90°, the longitude within ±360°, "
            "and the radius must be positive (km)"
        )
    return latitude, longitude, radius


def _usual_places(model: Any) -> list[tuple[float, float, float]]:
    """Return places on the three axes, safely outside the sphere about the body."""
    about = getattr(model, "reference_radius_m", None)
    radius_km = _OUTSIDE * (model.mesh.largest_radius_m if about is None else about) / 1e3
    return [(0.0, 0.0, radius_km), (0.0, 90.0, radius_km), (90.0, 0.0, radius_km)]


def _series_model(file: Path, given: dict[str, Any], mesh: dict[str, float | None]) -> Any:
    from hillsphere import create

    for key, value in mesh.items():
        if value is not None:
            raise InputError(f"--{key.replace('_', '-')} is for meshes (.obj); {file} has its own")
    keys: dict[str, Any] = {"file": str(file)}
    keys |= {key: value for key, value in given.items() if value is not None}
    if "tide_system" not in keys and file.suffix.lower() != ".gfc":
        keys["tide_system"] = "unknown"  # such a file states none, and the field is the same
    return create("gravity", "harmonics", **keys)


def _mesh_model(
    file: Path, keys: dict[str, Any], mesh: dict[str, float | None]
) -> tuple[Any, tuple[str, ...]]:
    from hillsphere import create

    given = {key: value for key, value in mesh.items() if value is not None}
    if len(given) != 1:
        raise InputError(f"{file}: a mesh needs either --gm-km3-s2 or --density-g-cm3")
    if keys["length_unit"] is None and file.suffix.lower() not in (".bds", ".dsk"):
        raise InputError(f"{file}: give --length-unit m or km; the file does not state its unit")
    stated = {key: value for key, value in keys.items() if value is not None}
    shape: Any = create("shape", "polyhedron", file=str(file), **stated)
    return create("gravity", "polyhedron", shape=shape, **given), shape.describe()


def _describe_body(model: Any) -> dict[str, Any]:
    """Return by what a wrong unit, or a mesh of another body, is noticed."""
    from hillsphere_gravity.ellipsoid import CODATA_2018_G

    low, high = model.mesh.vertices.min(axis=0), model.mesh.vertices.max(axis=0)
    volume = model.mesh.volume_m3
    return {
        "faces": len(model.mesh.faces),
        "extent_m": [float(length) for length in high - low],
        "volume_m3": volume,
        "density_kg_m3": float(model.gm_m3_s2) / (CODATA_2018_G * volume),
    }


def _evaluate(model: Any, places: list[tuple[float, float, float]]) -> list[dict[str, Any]]:
    import numpy as np

    from hillsphere.gravity import GravityField

    latitude, longitude, radius_km = np.array(places).T
    lat, lon, radius = np.radians(latitude), np.radians(longitude), radius_km * 1e3
    r: Array = radius * np.array(
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    )
    field = GravityField(model)
    u, g = field.potential(r), field.acceleration(r)
    return [
        {
            "latitude_deg": float(latitude[i]),
            "longitude_deg": float(longitude[i]),
            "radius_m": float(radius[i]),
            "potential_m2_s2": float(u[i]),
            "acceleration_m_s2": [float(component) for component in g[:, i]],
        }
        for i in range(len(places))
    ]


def _cells(row: dict[str, Any]) -> list[float]:
    x, y, z = row["acceleration_m_s2"]
    size = float((x * x + y * y + z * z) ** 0.5)
    return [row["latitude_deg"], row["longitude_deg"], row["radius_m"] / 1e3,
            row["potential_m2_s2"], size, x, y, z]  # fmt: skip
