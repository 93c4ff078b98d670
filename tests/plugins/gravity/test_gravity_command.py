"""`hillsphere gravity`: a file's field at given places, as the models compute it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run
from hillsphere.gravity import GravityField

FIELD = missions_directory() / "data" / "phobos-gravity-degree4.gfc"
CUBE = """v 1 1 1
v 1 1 -1
v 1 -1 1
v 1 -1 -1
v -1 1 1
v -1 1 -1
v -1 -1 1
v -1 -1 -1
f 1 3 4
f 1 4 2
f 5 6 8
f 5 8 7
f 1 2 6
f 1 6 5
f 3 7 8
f 3 8 4
f 1 5 7
f 1 7 3
f 2 4 8
f 2 8 6
"""


def test_field_of_a_file_is_that_of_the_model(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["gravity", str(FIELD), "--at", "0,0,20", "--at", "-10,90,15", "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    field = GravityField(create("gravity", "harmonics", file=str(FIELD)))
    lat = np.radians(-10.0)
    r = np.array([[20e3, 0, 0], [0.0, 15e3 * np.cos(lat), 15e3 * np.sin(lat)]]).T
    assert [p["potential_m2_s2"] for p in shown["points"]] == pytest.approx(field.potential(r))
    pull = np.array([p["acceleration_m_s2"] for p in shown["points"]]).T
    assert pull == pytest.approx(field.acceleration(r), rel=1e-9, abs=1e-15)
    # far away it is that of a point mass
    assert run(["gravity", str(FIELD), "--at", "30,40,1e6", "--json"]) == 0
    far = json.loads(capsys.readouterr().out)
    assert far["points"][0]["potential_m2_s2"] == pytest.approx(far["gm_m3_s2"] / 1e9)


def test_a_table_with_a_unit_of_length_is_a_mesh(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []
    for name in ("cube.tab", "cube.obj"):
        path = tmp_path / name
        path.write_text(CUBE)
        options = ["--length-unit", "km", "--density-g-cm3", "2", "--json"]
        assert run(["gravity", str(path), *options]) == 0
        shown.append(json.loads(capsys.readouterr().out))
        shown[-1].pop("file")
    assert shown[0] == shown[1]
    assert shown[0]["volume_m3"] == pytest.approx(8e9)


def test_table_names_units_and_the_reference_sphere(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["gravity", str(FIELD), "--at", "0,0,5", "--at", "0,0,50", "--max-degree", "2"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith(f"{FIELD}: GM = 0.000708")
    assert "U (m²/s²)" in out
    assert err.startswith("1 of 2 places lie inside the reference sphere")


def test_field_of_a_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = tmp_path / "cube.obj"
    mesh.write_text(CUBE)
    words = ["gravity", str(mesh), "--at", "0,0,1e3", "--density-g-cm3", "2", "--json"]
    assert run(words) == 2  # a unit is never chosen in silence
    assert "give --length-unit m or km" in capsys.readouterr().err
    assert run([*words, "--length-unit", "km"]) == 0
    shown = json.loads(capsys.readouterr().out)
    # a cube of 2 km with 2 g/cm³
    assert shown["gm_m3_s2"] == pytest.approx(6.67430e-11 * 2000.0 * 8e9)
    pull = shown["points"][0]["acceleration_m_s2"]
    assert pull[0] == pytest.approx(-shown["gm_m3_s2"] / 1e12, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--at", "1,2"], "expected LAT,LON,RADIUS_KM"),
        (["--at", "1,2,x"], "expected LAT,LON,RADIUS_KM"),
        (["--at", "91,0,20"], "the latitude must lie within ±90°"),
        (["--at", "nan,0,20"], "the latitude must lie within"),
        (["--at", "0,0,0"], "the radius must be positive"),
        (["--at", "0,0,20", "--max-degree", "9"], "max_degree must be ≤ 4"),
        (["--at", "0,0,20", "--gm-km3-s2", "1"], "--gm-km3-s2 is for meshes"),
    ],
)
def test_bad_input_is_one_message(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["gravity", str(FIELD), *arguments]) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert message in err


def test_files_that_cannot_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    for name in ("absent.gfc", "cube.obj", "field.unknown"):
        assert run(["gravity", str(tmp_path / name), "--at", "0,0,20"]) == 2
        assert name in capsys.readouterr().err


def test_extent_volume_and_density_of_a_mesh(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A cube of 2 km: a wrong unit shows in the volume, or with GM in the density."""
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    words = ["gravity", str(path), "--at", "0,0,20", "--density-g-cm3", "2", "--length-unit", "km"]
    assert run([*words, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["faces"] == 12
    assert shown["extent_m"] == [2000.0, 2000.0, 2000.0]
    assert shown["volume_m3"] == pytest.approx(8e9, rel=1e-14)
    assert shown["density_kg_m3"] == pytest.approx(2000.0, rel=1e-14)
    assert run(words) == 0
    assert "12 triangles, extent 2 × 2 × 2 km, volume 8 km³, density 2000 kg/m³" in (
        capsys.readouterr().out
    )


def test_field_at_an_epoch(capsys: pytest.CaptureFixture[str]) -> None:
    path = Path(__file__).parents[2] / "data" / "gravity" / "time-1.gfc"
    words = ["gravity", str(path), "--at", "0,0,7000"]
    assert run(words) == 2
    assert "give the key epoch" in capsys.readouterr().err
    assert run([*words, "--epoch", "2014-01-01"]) == 0
    assert f"{path}: GM = 400000 km³/s²" in capsys.readouterr().out


def test_places_on_the_axes_are_shown_without_any_and_stl_names_its_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """1.5 times the reference radius of the field, or the half diagonal √3 km of the cube."""
    assert run(["gravity", str(FIELD), "--json"]) == 0
    field: Any = create("gravity", "harmonics", file=str(FIELD))
    radius_m = float(field.reference_radius_m)
    points = json.loads(capsys.readouterr().out)["points"]
    places = [(p["latitude_deg"], p["longitude_deg"]) for p in points]
    assert places == [(0.0, 0.0), (0.0, 90.0), (90.0, 0.0)]
    assert [p["radius_m"] for p in points] == pytest.approx([1.5 * radius_m] * 3)
    (tmp_path / "cube.obj").write_text(CUBE)
    mesh = ["--length-unit", "km", "--density-g-cm3", "2"]
    assert run(["gravity", str(tmp_path / "cube.obj"), *mesh, "--json"]) == 0
    points = json.loads(capsys.readouterr().out)["points"]
    assert [p["radius_m"] for p in points] == pytest.approx([1500.0 * 3.0**0.5] * 3)
    (tmp_path / "cube.stl").write_text("solid\nendsolid\n")
    assert run(["gravity", str(tmp_path / "cube.stl"), *mesh]) == 2
    assert capsys.readouterr().err.rstrip().endswith("give --merge-vertices")
