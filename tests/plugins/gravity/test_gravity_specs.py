"""What a mission may not write, and what it is told."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.plugins import default_registry
from hillsphere.testing import example as made_example
from hillsphere_gravity import specs
from hillsphere_gravity.point_mass import PointMass
from hillsphere_gravity.specs import HarmonicsSpec, PointMassSpec

AXES = {"axes_km": [13.03, 11.40, 9.14]}
SERIES = {
    "gm_km3_s2": 7e-4,
    "reference_radius_km": 11.1,
    "normalisation": "full",
    "tide_system": "none",
}
ROW = {"n": 2, "m": 0, "c": -0.05}
POINT = PointMass(PointMassSpec(gm_m3_s2=1.0))


def series(*rows: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {**SERIES, "coefficients": list(rows), **more}


@pytest.mark.parametrize(
    ("type_", "keys", "messages"),
    [
        ("point_mass", {"gm_m3_s2": -1.0}, ["gm_m3_s2: must be > 0"]),
        ("point_mass", {"gm_m3_s2": 0}, ["gm_m3_s2: must be > 0"]),
        ("point_mass", {"gm_m3_s2": float("nan")}, ["gm_m3_s2: must be a finite number"]),
        ("point_mass", {}, ["gm_m3_s2: missing"]),
        ("ellipsoid", {**AXES}, ["the mass is missing; give density_kg_m3"]),
        (
            "ellipsoid",
            {**AXES, "gm_m3_s2": 7e5, "density_kg_m3": 1860.0},
            ["gm_m3_s2: density and gm both give the mass; keep one"],
        ),
        (
            "ellipsoid",
            {**AXES, "gm_m3_s2": 7e5, "gravitational_constant": 6.674e-11},
            ["gravitational_constant: goes with a density only"],
        ),
        ("ellipsoid", {"axes_km": [1, 1, -1], "gm_m3_s2": 1.0}, ["must be > 0"]),
        ("ellipsoid", {"axes_km": [1, 1], "gm_m3_s2": 1.0}, ["axes_km: expected three numbers"]),
        (
            "ellipsoid",
            {"axes_km": [1e200, 1e200, 1e200], "gm_m3_s2": 1.0},
            ["axes_km[0]: must be ≤ 1000000 km, got 1e+200 km"],
        ),
        (
            "ellipsoid",
            {"axes_m": [1.0, 1.0, 1e-320], "gm_m3_s2": 1.0},
            ["axes_m[2]: must be ≥ 0.001 m"],
        ),
        (
            "ellipsoid",
            {"axes_km": [1, 100.1, 1], "gm_m3_s2": 1.0},
            ["axes_km: the longest must be at most 100 times the shortest, got 100.1 times"],
        ),
        ("ellipsoid", {**AXES, "density_kg_m3": 1e19}, ["density_kg_m3: must be ≤ 30000 kg/m³"]),
        ("ellipsoid", {**AXES, "density_kg_m3": 1e-4}, ["density_kg_m3: must be ≥ 1 kg/m³"]),
        ("ellipsoid", {**AXES, "gm_m3_s2": 1e26}, ["gm_m3_s2: must be ≤ 1e+25 m³/s²"]),
        (
            "ellipsoid",
            {**AXES, "density_kg_m3": 1e3, "gravitational_constant": 1e300},
            ["gravitational_constant: must be ≤ 1"],
        ),
        ("point_mass", {"gm_m3_s2": 1e26}, ["gm_m3_s2: must be ≤ 1e+25 m³/s²"]),
        ("point_mass", {"gm_m3_s2": 1e-300}, ["gm_m3_s2: must be ≥ 1e-20 m³/s²"]),
        ("harmonics", series(ROW) | {"gm_km3_s2": 1e17}, ["gm_km3_s2: must be ≤ 1e+16 km³/s²"]),
        (
            "harmonics",
            series(ROW) | {"reference_radius_km": 1e7},
            ["reference_radius_km: must be ≤ 1000000 km"],
        ),
        ("harmonics", series({"n": 2, "m": 3, "c": 0.1}), ["order m must be ≤ degree n"]),
        (
            "harmonics",
            series({"n": 2, "m": 0, "c": 0.1, "s": 0.2}),
            ["coefficients[0].s: S of order 0 multiplies sin 0 and must be 0, got 0.2"],
        ),
        ("harmonics", series({"m": 0, "c": 0.1}), ["coefficients[0].n: missing: n: degree"]),
        ("harmonics", series({"n": -1, "m": 0, "c": 0.1}), ["coefficients[0].n: must be ≥ 0"]),
        ("harmonics", series({"n": 2, "m": 0, "c": float("inf")}), ["must be a finite number"]),
        (
            "harmonics",
            series(ROW, {"n": 2, "m": 2, "c": 0.1}, ROW),
            ["degree 2, order 0 stands in row 1 and again in row 3; keep one"],
        ),
        (
            "harmonics",
            series(ROW, max_degree=4),
            ["max_degree: must be ≤ 2, the table's degree, got 4"],
        ),
        (
            "harmonics",
            series(ROW, max_degree=1, max_order=2),
            ["max_order: must be ≤ 1, the degree, got 2"],
        ),
        (
            "harmonics",
            series(ROW, max_degree=1, max_tesseral_degree=2),
            ["max_tesseral_degree: must be ≤ 1, the degree, got 2"],
        ),
        (
            "harmonics",
            {"coefficients": [ROW], "gm_km3_s2": 7e-4},
            ["missing beside coefficients: reference_radius_m, normalisation, tide_system"],
        ),
        ("harmonics", SERIES, ["the series is missing; give coefficients or file"]),
        ("harmonics", series(ROW, file="a.gfc"), ["file: coefficients and file both give"]),
        ("harmonics", series(ROW, file_format="icgem"), ["file_format: says how to read a file"]),
        ("harmonics", {"file": "a.csv"}, ["cannot tell the format from the suffix '.csv'"]),
        (
            "harmonics",
            series(ROW, normalisation="Full"),
            ["normalisation: must be one of 'full', 'none', got"],
        ),
        ("sum", {"parts": []}, ["parts: must hold at least one part"]),
        (
            "sum",
            {"parts": [{"model": POINT, "name": "a"}, {"model": POINT, "name": "a"}]},
            ["parts: parts 1 and 2 are both called 'a'; give one a name"],
        ),
        (
            "sum",
            {"parts": [{"model": POINT, "name": "a b"}]},
            ["parts[0].name: 'a b' does not match the pattern"],
        ),
    ],
)
def test_refused(type_: str, keys: dict[str, Any], messages: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        create("gravity", type_, **keys)
    lines = str(caught.value).splitlines()
    assert len(lines) == len(messages)
    for line, message in zip(lines, messages, strict=True):
        assert message in line


def test_most_elongated_ellipsoid_is_accepted() -> None:
    axes = [1.0, 1.0, specs.MOST_ELONGATED]
    assert create("gravity", "ellipsoid", axes_km=axes, gm_m3_s2=1.0).gm_m3_s2 == 1.0


def test_every_type_is_made_from_python() -> None:
    for record in default_registry().of_kind("gravity"):
        if not record.plugin.startswith("hillsphere_gravity"):
            continue
        for example in record.load_spec().examples:
            keys = dict(example)
            if record.component.type == "sum":
                keys["parts"] = [{**part, "model": POINT, "name": part["model"]}
                                 for part in keys["parts"]]  # fmt: skip
            if "shape" in keys:
                keys["shape"] = made_example("shape", keys["shape"])
            assert create("gravity", record.component.type, **keys).gm_m3_s2 > 0.0


@pytest.mark.parametrize(
    ("name", "expected"),
    [("a.gfc", "icgem"), ("A.GFC", "icgem"), ("a.tab", "shadr"), ("a.shadr", "shadr")],
)
def test_format_by_suffix(name: str, expected: str) -> None:
    assert specs.file_format_of(HarmonicsSpec(file=name)) == expected
    assert specs.file_format_of(HarmonicsSpec(file="a.txt", file_format="shadr")) == "shadr"


def test_every_field_is_described_and_every_spec_has_an_example() -> None:
    for name in specs.__all__:
        spec = getattr(specs, name)
        if not name.endswith("Spec"):
            continue
        assert spec.examples, name
        assert all(field.description for field in spec.model_fields.values()), name


def test_specs_import_no_numerics() -> None:
    code = (
        "import sys, hillsphere_gravity, hillsphere_gravity.specs\n"
        "print([m for m in ('numpy', 'scipy', 'heyoka') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"
