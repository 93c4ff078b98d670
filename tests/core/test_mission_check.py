"""What a mission is refused for before its first stage: the same by ``validate`` and ``run``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import pytest

from hillsphere import create, load_mission
from hillsphere.base.ranges import LARGEST
from hillsphere.cli.endings import run
from hillsphere.errors import InputError, PluginError
from hillsphere.interfaces import Context
from hillsphere.plugins import Component, Registry, default_registry, hookimpl
from hillsphere.presentation import Presentation
from hillsphere.runs.mission_check import check_mission
from hillsphere.spec import Spec, StageSpec
from hillsphere.spec.units import UNITS

HERE = __name__

SOUND = """format = 1
name = "small"
title = "Small"
seed = 5
[body.moon]
type = "moon"
name = "phobos"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
[gravity.rock]
type = "ellipsoid"
axes_km = [13.03, 11.40, 9.14]
density_g_cm3 = 1.86
[gravity.lumps]
type = "harmonics"
gm_km3_s2 = 7.0875e-4
reference_radius_km = 11.1
normalisation = "full"
tide_system = "none"
coefficients = [{ n = 0, m = 0, c = 0.0 }, { n = 2, m = 0, c = -4.698e-2 }]
[gravity.void]
type = "sum"
parts = [{ model = "rock" }, { model = "rock", name = "hole", scale = -1.0 }]
[gravity.both]
type = "sum"
parts = [{ model = "rock" }, { model = "lumps" }]
[plant.hill]
type = "hill"
body = "moon"
gravity = "both"
[dispersions.spare]
type = "normal"
of = "gravity.rock"
parameters = ["axis_*"]
unit = "km"
sigma = [0.1, 0.2, 0.3]
[stage.family]
type = "qso_family"
plant = "hill"
x_amplitudes_km = [60]
"""


BAD = [
    ('plant.hill.gravity="lumps"', "plant.hill.gravity: the model as a whole has GM = 0 "),
    ('plant.hill.gravity="void"', "plant.hill.gravity: the model as a whole has GM = 0 "),
    ("gravity.rock.density_g_cm3=1470", "must be ≤ 30 g/cm³, got 1470 g/cm³"),
    ("gravity.rock.density_kg_m3=0.9", "must be ≥ 1 kg/m³, got 0.9 kg/m³"),
    ('dispersions.spare.parameters=["Z9,9"]', "gravity.rock has no quantity 'Z9,9'"),
    ("dispersions.spare.sigma=[0.1, 0.2]", "sigma is given for 2 quantities, but parameters"),
    ("dispersions.spare.correlation=[[1.0, 0.1], [0.1, 1.0]]", "correlation is given for 2 quanti"),
    ('dispersions.spare.unit="deg"', "its numbers are in rad, but axis_x is in m"),
]  # fmt: skip


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SOUND, "utf-8")
    return path


def test_parts_of_a_sum_may_attract_nothing(small: Path) -> None:
    """The series without C00 is a part of the plant's gravity; the sum without mass of none."""
    assert check_mission(load_mission(small)).order == ("family",)


@pytest.mark.parametrize(("setting", "message"), BAD)
@pytest.mark.parametrize("command", ["validate", "run"])
def test_validate_and_run_refuse_the_same(
    command: str,
    setting: str,
    message: str,
    small: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    out = ["--out", str(tmp_path / "out")] if command == "run" else []
    assert run([command, str(small), "--set", setting, *out]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert "Traceback" not in told
    assert [line for line in told.splitlines() if line.startswith(("--set", str(small)))]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["small.toml"]


@pytest.mark.parametrize("command", ["validate", "run"])
@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ('dispersions.field.parameters=["C9,9"]', "no quantity 'C9,9'"),
        ("dispersions.field.correlation=[[1.0]]", "correlation is given for 1 quantities"),
    ],
)
def test_dispersions_of_a_campaign(
    command: str,
    setting: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run([command, "phobos-hover", "--set", setting]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@dataclass
class Thawed:
    value: float


class ThawedSpec(StageSpec):
    """Says that it yields what cannot be stored."""

    produces = f"{HERE}:Thawed"


class SilentSpec(StageSpec):
    """Does not say what it yields."""


class WordSpec(StageSpec):
    """Yields what is no class."""

    produces = f"{HERE}:HERE"


class Never:
    """Never runs."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> Any:
        raise AssertionError("the mission was to be refused before")

    def present(self, product: Any) -> Presentation:
        raise AssertionError


class Plugin:
    @hookimpl
    def hillsphere_components(self) -> Iterator[Component]:
        for name in ("Thawed", "Silent", "Word"):
            yield Component("stage", name.lower(), f"{HERE}:Never", f"{HERE}:{name}Spec", "")


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("thawed", "must be a frozen dataclass"),
        ("silent", "declares no product"),
        ("word", "is not a class"),
    ],
)
def test_a_stage_whose_product_cannot_be_stored(kind: str, message: str, tmp_path: Path) -> None:
    registry = Registry()
    registry.add_plugin("mine", Plugin())
    path = tmp_path / "m.toml"
    path.write_text(f'format = 1\nname = "m"\ntitle = "M"\nseed = 1\n[stage.a]\ntype = "{kind}"\n')
    mission = load_mission(path, registry=registry)
    with pytest.raises(PluginError, match=message):
        check_mission(mission)


# --- ranges ---------------------------------------------------------------------------------


def _specs(spec: type[Spec], seen: set[type[Spec]]) -> Iterator[type[Spec]]:
    if spec in seen:
        return
    seen.add(spec)
    yield spec
    waiting: list[Any] = [field.annotation for field in spec.model_fields.values()]
    while waiting:
        annotation = waiting.pop()
        if isinstance(annotation, type) and issubclass(annotation, Spec):
            yield from _specs(annotation, seen)
        waiting += get_args(annotation)


def test_every_quantity_of_every_component_has_bounds_on_both_sides() -> None:
    seen: set[type[Spec]] = set()
    checked = 0
    for record in default_registry():
        if record.component.kind == "command":
            continue
        for spec in _specs(record.load_spec(), seen):
            for name in spec.model_fields:
                extra = spec.schema_extra(name)
                if dimension := extra.get("x-dimension"):
                    bounds: Any = extra["x-bounds"]
                    upper = bounds.get("le", bounds.get("lt"))
                    lower = bounds.get("ge", bounds.get("gt"))
                    assert -LARGEST[dimension] <= lower < upper <= LARGEST[dimension], (spec, name)
                    checked += 1
    assert checked > 200
    assert set(LARGEST) == set(UNITS)


@pytest.mark.parametrize("density_kg_m3", [1.0, 1470.0, 22_600.0, 30_000.0])
def test_densities_of_matter(density_kg_m3: float) -> None:
    create("gravity", "ellipsoid", axes_km=[1, 1, 1], density_kg_m3=density_kg_m3)


@pytest.mark.parametrize(
    ("kind", "type_", "keys", "message"),
    [
        # g/cm³ and kg/m³ mixed up, either way
        ("gravity", "ellipsoid", {"axes_km": [1, 1, 1], "density_g_cm3": 1470}, "≤ 30 g/cm³"),
        ("gravity", "ellipsoid", {"axes_km": [1, 1, 1], "density_kg_m3": 0.5}, "≥ 1 kg/m³"),
        # the Sun's GM in km³/s² under a key in m³/s²
        ("body", "solar_orbit", {"semi_major_axis_au": 1, "epoch": "2026-01-01T00:00:00",
                                 "primary_gm_m3_s2": 1.32712440018e11}, "≥ 1e\\+18 m³/s²"),
        # the Earth's radius in km under a key in m
        ("body", "planet", {"equatorial_radius_m": 6378.137}, "≥ 100000 m"),
        ("body", "planet", {"gm_m3_s2": 398600.4418}, "≥ 1000000000 m³/s²"),
        # a turn in 0.1 s
        ("body", "asteroid", {"name": "a", "semi_major_axis_au": 1, "rotation_rate_rad_s": 63},
         "≤ 10 rad/s"),
        # degrees under a key in radians
        ("body", "asteroid", {"name": "a", "semi_major_axis_au": 1, "rotation_rate_deg_h": 10,
                              "node_rad": 348.7}, "≤ 100 rad"),
        # metres under a key in kilometres
        ("sensor", "antenna", {"station": "s", "latitude_deg": 0, "longitude_deg": 0,
                               "height_km": 39}, "≤ 9 km"),
    ],
)  # fmt: skip
def test_slips_of_units_are_refused(
    kind: str, type_: str, keys: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        create(kind, type_, **keys)
