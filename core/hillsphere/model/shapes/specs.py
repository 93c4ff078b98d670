"""Specs of shapes, the keys of a table ``[shape.NAME]``."""

from __future__ import annotations

from pathlib import PurePath
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec.base import DataPath, Spec, Vector3, data_path, option, quantity, rule

__all__ = [
    "DSK_SUFFIXES",
    "METRES",
    "EllipsoidShapeSpec",
    "GridShapeSpec",
    "HarmonicShapeSpec",
    "LengthUnit",
    "PolyhedronShapeSpec",
]

LengthUnit = Literal["m", "km"]
METRES = {"m": 1.0, "km": 1000.0}
DSK_SUFFIXES = (".bds", ".dsk")
"""Suffixes of shape files of SPICE."""


def _one_source(file: str | None, given: bool, key: str) -> None:
    """Require exactly one source of a shape: a file, or values in the table."""
    if given == (file is not None):
        text = f"{key} and file both give the shape; keep one" if given else f"give {key} or file"
        raise rule(key, text)


class EllipsoidShapeSpec(Spec):
    """A tri-axial ellipsoid about the centre."""

    examples = ({"axes_km": [13.03, 11.40, 9.14]},)

    axes_m: Vector3 = quantity("length", "semi-axes along the body's x, y, z", gt=0, le=1e9)


class HarmonicShapeSpec(Spec):
    """The radius as a series of spherical harmonics, 4π-normalised."""

    examples = (
        {"coefficients": [[0, 0, 7.3, 0], [2, 0, -1.1, 0], [2, 2, 2.1, -0.9]], "length_unit": "km"},
    )

    length_unit: LengthUnit = option("unit of the coefficients")
    coefficients: tuple[tuple[int, int, float, float], ...] = option(
        "rows [degree, order, C, S], 4π-normalised without the Condon–Shortley phase, longitude "
        "counted to the east; the row of degree 0 is the mean radius",
        default=(),
    )
    file: DataPath | None = data_path("table of such rows, instead", default=None)
    max_degree: int | None = option("use degrees up to this", default=None, ge=0)

    @model_validator(mode="after")
    def _source(self) -> Self:
        _one_source(self.file, bool(self.coefficients), "coefficients")
        return self


class GridShapeSpec(Spec):
    """The radius on a regular grid of planetocentric latitude and east longitude."""

    examples = (
        {
            "length_unit": "km",
            "radii": [
                [9.1, 9.1, 9.1, 9.1],
                [11.0, 10.1, 11.1, 10.0],
                [13.0, 11.4, 13.0, 11.4],
                [11.0, 10.1, 11.1, 10.0],
                [9.1, 9.1, 9.1, 9.1],
            ],
        },
    )

    length_unit: LengthUnit = option("unit of the radii")
    radii: tuple[tuple[float, ...], ...] = option(
        "one row for each latitude, from the south pole to the north pole in equal steps; in each "
        "the radii at longitudes from 0 eastward in equal steps, 360° left out; all of a pole's "
        "row are its one radius",
        default=(),
    )
    file: DataPath | None = data_path(
        "instead of radii: file with their rows, separated by blanks or commas; # begins a comment",
        default=None,
    )

    @model_validator(mode="after")
    def _source(self) -> Self:
        _one_source(self.file, bool(self.radii), "radii")
        return self


class PolyhedronShapeSpec(Spec):
    """A closed mesh of triangles."""

    examples = (
        {
            "length_unit": "km",
            "vertices": [[10, 0, 0], [-9, 0, 0], [0, 9, 0], [0, -9, 0], [0, 0, 8], [0, 0, -8]],
            "faces": [
                [1, 3, 5], [3, 2, 5], [2, 4, 5], [4, 1, 5],
                [3, 1, 6], [2, 3, 6], [4, 2, 6], [1, 4, 6],
            ],
        },
    )  # fmt: skip

    length_unit: LengthUnit | None = option(
        "unit of the vertices; required, as no format but SPICE's DSK (always km) states it",
        default=None,
    )
    vertices: tuple[Vector3, ...] = option("corners, in the body-fixed frame", default=())
    faces: tuple[tuple[int, int, int], ...] = option(
        "triangles: numbers of three vertices, counted from 1, anticlockwise as seen from outside",
        default=(),
    )
    file: DataPath | None = data_path(
        "instead of vertices and faces: file with both, Wavefront OBJ (rows v and f), a plate "
        "model (counts, vertices, plates), .stl or .ply (extra 'mesh'), SPICE's .bds or .dsk "
        "(extra 'spice')",
        default=None,
    )
    segment: int | None = option(
        "which segment of a DSK file that has several, counted from 1", default=None, ge=1
    )
    merge_vertices: bool = option(
        "whether vertices at the same place are made one; required for .stl, which lists the "
        "corners of each face anew",
        default=False,
    )
    merge_tolerance_m: float = quantity(
        "length", "largest distance of two vertices that are made one; 0: equal ones", default=0.0,
        ge=0, le=1e6,
    )  # fmt: skip
    vertices_file: DataPath | None = data_path(
        "instead of file: table of the vertices alone, beside plates_file", default=None
    )
    plates_file: DataPath | None = data_path(
        "table of the plates, of which each names three rows of vertices_file", default=None
    )

    @model_validator(mode="after")
    def _unit(self) -> Self:
        suffix = PurePath(self.file).suffix.lower() if self.file else ""
        if suffix in DSK_SUFFIXES:
            if self.length_unit not in (None, "km"):
                raise rule("length_unit", "the vertices of a DSK file are in km; leave it out")
        elif self.length_unit is None:
            raise rule("length_unit", "give the unit of the vertices, m or km")
        if self.segment is not None and suffix not in DSK_SUFFIXES:
            raise rule("segment", "goes with a DSK file (.bds, .dsk); remove it")
        if self.merge_tolerance_m > 0.0 and not self.merge_vertices:
            raise rule("merge_tolerance_m", "goes with merge_vertices = true")
        return self

    @model_validator(mode="after")
    def _source(self) -> Self:
        pair = (self.vertices_file, self.plates_file)
        if pair == (None, None):
            _one_source(self.file, bool(self.vertices or self.faces), "vertices")
        elif None in pair:
            missing = "plates_file" if self.plates_file is None else "vertices_file"
            raise rule(missing, "vertices_file and plates_file belong together; give both")
        elif self.file is not None or self.vertices or self.faces:
            raise rule(
                "vertices_file", "two sources of the shape; keep either file, vertices and faces, "
                "or vertices_file and plates_file"
            )  # fmt: skip
        return self
