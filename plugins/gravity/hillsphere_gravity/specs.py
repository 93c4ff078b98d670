"""What a mission may write for each gravity model."""

from __future__ import annotations

from pathlib import PurePath
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.base.ranges import BODY_RADIUS_M, DENSITY_KG_M3, GM_M3_S2
from hillsphere.spec import (
    DataPath,
    Ref,
    Spec,
    Vector3,
    data_path,
    option,
    quantity,
    reference,
    rule,
)

__all__ = [
    "CoefficientSpec",
    "EllipsoidSpec",
    "HarmonicsSpec",
    "PartSpec",
    "PointMassSpec",
    "PolyhedronSpec",
    "ShapeHarmonicsSpec",
    "SumSpec",
    "file_format_of",
]

Normalisation = Literal["full", "none"]
TideSystem = Literal["tide_free", "zero_tide", "mean_tide", "none", "unknown"]
FileFormat = Literal["icgem", "shadr", "cof", "table"]

_SUFFIXES: dict[str, FileFormat] = {
    ".gfc": "icgem",
    ".shadr": "shadr",
    ".sha": "shadr",
    ".tab": "shadr",
    ".cof": "cof",
}


MOST_ELONGATED = 100.0
"""Largest ratio of two semi-axes of an ellipsoid for which its integrals were verified."""


def _check_mass(
    density_kg_m3: float | None, gm_m3_s2: float | None, gravitational_constant: float | None
) -> None:
    """Refuse a mass that is given twice, or not at all."""
    if density_kg_m3 is not None and gm_m3_s2 is not None:
        raise rule("gm_m3_s2", "density and gm both give the mass; keep one")
    if density_kg_m3 is None and gm_m3_s2 is None:
        raise rule(
            "density_kg_m3",
            "the mass is missing; give density_kg_m3 (or density_g_cm3) or gm_m3_s2 (or gm_km3_s2)",
        )
    if gm_m3_s2 is not None and gravitational_constant is not None:
        raise rule("gravitational_constant", "goes with a density only; gm needs none, remove it")


class PointMassSpec(Spec):
    """A point mass at the origin."""

    examples = ({"gm_km3_s2": 7.0875e-4},)

    gm_m3_s2: float = quantity("gravitational_parameter", "gravitational parameter GM", **GM_M3_S2)


class EllipsoidSpec(Spec):
    """A homogeneous ellipsoid; its mass is given as a density or as GM, not both."""

    examples = (
        {"axes_km": [13.03, 11.40, 9.14], "density_g_cm3": 1.860},
        {"axes_km": [13.03, 11.40, 9.14], "gm_km3_s2": 7.0875e-4},
    )

    axes_m: Vector3 = quantity(
        "length",
        "semi-axes along the body's x, y, z, in any order of size; the longest at most 100 times "
        "the shortest",
        **BODY_RADIUS_M,
    )
    density_kg_m3: float | None = quantity("density", "density", default=None, **DENSITY_KG_M3)
    gm_m3_s2: float | None = quantity(
        "gravitational_parameter", "gravitational parameter GM", default=None, **GM_M3_S2
    )
    gravitational_constant: float | None = option(
        "constant of gravitation G that goes with the density, m³/(kg s²); left out: the CODATA "
        "2018 value 6.67430e-11",
        default=None,
        gt=0,
        ge=1e-12,
        le=1.0,
    )

    @model_validator(mode="after")
    def _not_too_elongated(self) -> Self:
        ratio = max(self.axes_m) / min(self.axes_m)
        if ratio > MOST_ELONGATED:
            raise rule(
                "axes_m",
                f"the longest must be at most {MOST_ELONGATED:g} times the shortest, got "
                f"{ratio:.4g} times; further out the integrals lose digits",
            )
        return self

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        _check_mass(self.density_kg_m3, self.gm_m3_s2, self.gravitational_constant)
        return self


class HomogeneousShapeSpec(Spec):
    """A homogeneous body of any shape; its mass is given as a density or as GM, not both."""

    shape: Ref = reference("shape", "the body's shape: a polyhedron, or one to be triangulated")
    subdivisions: int | None = option(
        "triangulate the shape: how often each face of an icosahedron is divided into four "
        "(4: 5120 faces); for a shape that is no polyhedron itself",
        default=None,
        ge=0,
        le=7,
    )
    density_kg_m3: float | None = quantity("density", "density", default=None, **DENSITY_KG_M3)
    gm_m3_s2: float | None = quantity(
        "gravitational_parameter", "gravitational parameter GM", default=None, **GM_M3_S2
    )
    gravitational_constant: float | None = option(
        "constant of gravitation G that goes with the density, m³/(kg s²); left out: the CODATA "
        "2018 value 6.67430e-11",
        default=None,
        gt=0,
        ge=1e-12,
        le=1.0,
    )

    @model_validator(mode="after")
    def _one_mass(self) -> Self:
        _check_mass(self.density_kg_m3, self.gm_m3_s2, self.gravitational_constant)
        return self


class PolyhedronSpec(HomogeneousShapeSpec):
    """A homogeneous body of any shape; its mass is given as a density or as GM, not both."""

    examples = (
        {"shape": "polyhedron", "density_g_cm3": 1.9},
        {"shape": "ellipsoid", "subdivisions": 2, "gm_km3_s2": 7.0875e-4},
        {"shape": "polyhedron", "density_g_cm3": 1.9, "relative_error": 1e-6},
    )

    relative_error: float | None = option(
        "bound of the error but for rounding, of GM/s, GM/s² and GM/s³ for potential, acceleration "
        "and gradient (s: distance from the origin, or of the farthest vertex if that is more), "
        "with which distant clusters of faces are replaced by series: 1e-6 for maps, 1e-12 for "
        "flights. For meshes of thousands of faces; left out: all faces are summed",
        default=None,
        ge=1e-12,
        le=1e-2,
    )


class ShapeHarmonicsSpec(HomogeneousShapeSpec):
    """The harmonic series of a homogeneous body of any shape, for orbits outside a sphere."""

    examples = (
        {"shape": "polyhedron", "density_g_cm3": 1.9},
        {"shape": "polyhedron", "gm_km3_s2": 1.2e-4, "series_from_km": 25.0, "tolerance": 1e-8},
    )

    series_from_m: float | None = quantity(
        "length",
        "distance from the origin from which the series must hold; families of orbits end there. "
        "Left out: 1.5 times that of the farthest vertex",
        default=None,
        **BODY_RADIUS_M,
    )
    tolerance: float = option(
        "error of the acceleration at that distance, as a part of GM/r², for which as many degrees "
        "are taken as it needs, up to max_degree. Farther out the error is smaller",
        default=1e-6,
        ge=1e-12,
        le=1e-2,
    )
    max_degree: int = option(
        "largest degree of the series; where the tolerance needs more, the error that is reached "
        "is told. The time of compiling grows fast with it",
        default=8,
        ge=0,
        le=120,
    )


class CoefficientSpec(Spec):
    """One row of a table of harmonic coefficients."""

    examples = ({"n": 2, "m": 0, "c": -4.698e-2}, {"n": 2, "m": 2, "c": 2.276e-2, "s": -2.02e-4})

    n: int = option("degree", ge=0)
    m: int = option("order", ge=0)
    c: float = option("coefficient of cos mλ")
    s: float = option("coefficient of sin mλ; must be 0 or left out where m = 0", default=0.0)

    @model_validator(mode="after")
    def _in_triangle(self) -> Self:
        if self.m > self.n:
            raise rule("m", f"order m must be ≤ degree n, got n = {self.n}, m = {self.m}")
        if self.m == 0 and self.s != 0.0:
            raise rule("s", f"S of order 0 multiplies sin 0 and must be 0, got {self.s}")
        return self


class HarmonicsSpec(Spec):
    """A spherical-harmonic series, from rows in the mission or from a file.

    With rows in the mission, `gm_m3_s2`, `reference_radius_m`, `normalisation` and `tide_system`
    are required. With a file they are taken from it; what the file does not state must be given
    here, and what both state must agree.
    """

    examples = (
        {
            "gm_km3_s2": 7.087546066894452e-4,
            "reference_radius_km": 11.1,
            "normalisation": "full",
            "tide_system": "none",
            "coefficients": [{"n": 2, "m": 0, "c": -4.698e-2}, {"n": 2, "m": 2, "c": 2.276e-2}],
        },
    )

    gm_m3_s2: float | None = quantity(
        "gravitational_parameter", "gravitational parameter GM", default=None, **GM_M3_S2
    )
    reference_radius_m: float | None = quantity(
        "length", "reference radius of the coefficients", default=None, **BODY_RADIUS_M
    )
    normalisation: Normalisation | None = option(
        "'full': 4π-normalised, 'none': conventional; neither with the Condon–Shortley phase",
        default=None,
    )
    tide_system: TideSystem | None = option(
        "what of the permanent tide the degree-2 zonal holds; 'none' for a body without one. "
        "Recorded, never converted",
        default=None,
    )
    coefficients: tuple[CoefficientSpec, ...] = option(
        "rows {n, m, c, s} in any order; a coefficient that is not listed is zero, C00 one",
        default=(),
    )
    file: DataPath | None = data_path(
        "ICGEM .gfc, PDS SHADR or GMAT .cof file, or a table of rows n m C S", default=None
    )
    file_format: FileFormat | None = option(
        "format of the file; left out: by its suffix (.gfc: 'icgem'; .shadr, .sha, .tab: 'shadr'; "
        ".cof: 'cof'). 'table': rows of degree, order, C, S and perhaps two standard deviations, "
        "without a head, as EGM2008's",
        default=None,
    )
    epoch: str | None = option(
        "date and time at which the time-variable terms of an ICGEM file are evaluated, such as "
        "'2020-01-01T00:00:00'; the field stays that of this epoch. For such files only",
        default=None,
        max_length=40,
    )
    max_degree: int | None = option("use degrees up to this", default=None, ge=0)
    max_order: int | None = option("use orders up to this", default=None, ge=0)
    max_tesseral_degree: int | None = option(
        "use orders above 0 in degrees up to this only, zonal terms up to max_degree; left out: "
        "in all",
        default=None,
        ge=0,
    )

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if self.coefficients and self.file is not None:
            raise rule("file", "coefficients and file both give the series; keep one")
        if self.epoch is not None and (self.file is None or file_format_of(self) != "icgem"):
            raise rule("epoch", "goes with an ICGEM file that changes with time; remove it")
        if self.file is not None:
            file_format_of(self)
        elif not self.coefficients:
            raise rule("coefficients", "the series is missing; give coefficients or file")
        elif self.file_format is not None:
            raise rule("file_format", "says how to read a file, and none is given; remove it")
        else:
            self._check_table()
        return self

    def _check_table(self) -> None:
        required = ("gm_m3_s2", "reference_radius_m", "normalisation", "tide_system")
        if missing := [key for key in required if getattr(self, key) is None]:
            raise rule(missing[0], f"missing beside coefficients: {', '.join(missing)}")
        first: dict[tuple[int, int], int] = {}
        for index, row in enumerate(self.coefficients):
            earlier = first.setdefault((row.n, row.m), index)
            if earlier != index:
                raise rule(
                    "coefficients",
                    f"degree {row.n}, order {row.m} stands in row {earlier + 1} and again in row "
                    f"{index + 1}; keep one",
                )
        highest = max(row.n for row in self.coefficients)
        if self.max_degree is not None and self.max_degree > highest:
            raise rule(
                "max_degree", f"must be ≤ {highest}, the table's degree, got {self.max_degree}"
            )
        degree = highest if self.max_degree is None else self.max_degree
        if self.max_order is not None and self.max_order > degree:
            raise rule("max_order", f"must be ≤ {degree}, the degree, got {self.max_order}")
        if self.max_tesseral_degree is not None and self.max_tesseral_degree > degree:
            raise rule(
                "max_tesseral_degree",
                f"must be ≤ {degree}, the degree, got {self.max_tesseral_degree}",
            )


def file_format_of(spec: HarmonicsSpec) -> FileFormat:
    """Format of a coefficient file, as given or by its suffix.

    Parameters
    ----------
    spec : HarmonicsSpec
        With `file` set.

    Returns
    -------
    str
        ``"icgem"``, ``"shadr"``, ``"cof"`` or ``"table"``.

    Raises
    ------
    PydanticCustomError
        If the suffix says nothing and `file_format` is not given.
    """
    if spec.file_format is not None:
        return spec.file_format
    suffix = PurePath(spec.file or "").suffix.lower()
    if suffix not in _SUFFIXES:
        raise rule(
            "file", f"cannot tell the format from the suffix {suffix!r}; give file_format "
            "= 'icgem', 'shadr', 'cof' or 'table'"
        )  # fmt: skip
    return _SUFFIXES[suffix]


class PartSpec(Spec):
    """One model of a sum, turned and placed in the frame of the sum."""

    examples = ({"model": "phobos", "name": "core", "position_km": [0.5, 0.0, 0.0]},)

    model: Ref = reference("gravity", "the model")
    name: str | None = option(
        "prefix of its run-time parameters ('core.gm'); left out: the name of the model's table",
        default=None,
        min_length=1,
        pattern=r"^[A-Za-z][A-Za-z0-9_-]*$",
    )
    position_m: Vector3 = quantity(
        "length", "origin of the part in the frame of the sum", default=(0.0, 0.0, 0.0)
    )
    rotation_zxz_rad: Vector3 = quantity(
        "angle",
        "3-1-3 Euler angles (α, β, γ): the part's axes are those of the sum turned about z by α, "
        "then about the new x by β, then about the new z by γ (as pole and prime meridian of a "
        "body: α = 90° + right ascension, β = 90° − declination, γ = W)",
        default=(0.0, 0.0, 0.0),
    )
    scale: float = option(
        "factor on the part's attraction; negative for a void to be taken out", default=1.0
    )


class SumSpec(Spec):
    """Gravity of several models together, e.g. a body with a dense core or a void."""

    examples = (
        {
            "parts": [
                {"model": "shell"},
                {"model": "core", "position_km": [0.5, 0.0, 0.0], "rotation_zxz_deg": [90, 0, 0]},
            ]
        },
    )

    parts: tuple[PartSpec, ...] = option("the models, at least one")

    @model_validator(mode="after")
    def _distinct_names(self) -> Self:
        if not self.parts:
            raise rule("parts", "must hold at least one part, got none")
        names = self.part_names()
        for index, name in enumerate(names):
            if name in names[:index]:
                raise rule(
                    "parts",
                    f"parts {names.index(name) + 1} and {index + 1} are both called {name!r}; "
                    "give one a name",
                )
        return self

    def part_names(self) -> tuple[str, ...]:
        """Return the parts' names: as given, else that of the model's table, else ``part<i>``."""
        return tuple(
            part.name or (f"part{i}" if part.model.name == "(given)" else part.model.name)
            for i, part in enumerate(self.parts, start=1)
        )
