"""The examples of the README, and of the pages on missions and campaigns, do what they say."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hillsphere.base.paths import missions_directory
from hillsphere.gravity import GravityField
from hillsphere.mission import load_mission
from hillsphere.plugins import Registry, validate

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str, page: str = "README.md") -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def test_library_example_runs(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (example,) = (block for block in blocks("python") if "hs.run" in block)
    names: dict[str, Any] = {}
    exec(example, names)
    assert capsys.readouterr().out == "met\n"
    assert len(names["frame"]) == 2
    assert len(names["path"]) == 200
    # The flow of Hamilton's equations keeps the volume.
    assert np.linalg.det(names["phi"]) == pytest.approx(1.0, abs=1e-9)
    # The orbit closes in the plant of its mission. Measured: 2e-10 m;
    # with the CODATA value of G, 1.4 m.
    missed_m = np.linalg.norm((names["end"] - names["path"][0])[:3])
    assert missed_m < 1e-8


def test_mission_example_is_short_and_valid(tmp_path: Path) -> None:
    example, *_ = blocks("toml")
    assert len(example.splitlines()) <= 35
    path = tmp_path / "deimos.toml"
    path.write_text(example, encoding="utf-8")
    mission = load_mission(str(path))
    assert mission.order() == ["family"]
    assert list(mission.specs["requirement"]) == ["closed"]


def tables_of(mission: str, begins: tuple[str, ...]) -> str:
    """Return the head of a packaged mission and those of its tables that begin so."""
    text = (missions_directory() / f"{mission}.toml").read_text(encoding="utf-8")
    head, *tables = re.split(r"^(?=\[)", text, flags=re.MULTILINE)
    return head + "".join(table for table in tables if table.startswith(begins))


def test_example_of_named_elements(tmp_path: Path) -> None:
    elements = blocks("toml", "docs/missions.md")[1]
    begins = ("[body", "[gravity.phobos]", "[plant.descent]", "[guidance.energy]")
    head = tables_of("phobos-landing", begins)
    head = re.sub(r"^drop = .*\n", "", head, flags=re.MULTILINE)
    path = tmp_path / "landing.toml"
    path.write_text(head + elements, encoding="utf-8")
    mission = load_mission(
        str(path), sets=["stage.references.descents.rt1.duration_s=7200"], allow_path=True
    )
    descents = mission.resolved()["stage"]["references"]["descents"]
    assert [descent["name"] for descent in descents] == ["rt1", "rt2"]
    assert [descent["duration_s"] for descent in descents] == [7200, 7200]
    longitudes = [descent["site"]["longitude_rad"] for descent in descents]
    assert longitudes == [pytest.approx(np.radians(25)), pytest.approx(np.radians(15))]
    sets = ["stage.references.descents.rt2=false"]
    mission = load_mission(str(path), sets=sets, allow_path=True)
    assert len(mission.resolved()["stage"]["references"]["descents"]) == 1


def test_example_of_tables_that_stand_for_several(tmp_path: Path) -> None:
    example, _, several, *_ = blocks("toml", "docs/missions.md")
    path = tmp_path / "deimos.toml"
    path.write_text(example + several, encoding="utf-8")
    stages = load_mission(str(path), sets=["stage.orbit.curve_members=50"]).specs["stage"]
    assert list(stages) == ["family", "orbit_30", "orbit_45", "orbit_60"]
    figures = [stage.model_dump()["figures"] for stage in stages.values()]
    assert figures == [True, True, True, False]
    assert load_mission(str(path), profile="fast").order() == ["family", "orbit_60"]


def test_requirement_example_is_about_the_mission(tmp_path: Path) -> None:
    example, _, _, requirement = blocks("toml", "docs/missions.md")
    path = tmp_path / "deimos.toml"
    path.write_text(example + requirement, encoding="utf-8")
    assert list(load_mission(str(path)).specs["requirement"]) == ["closed"]


def test_campaign_example_repeats_the_stage_of_the_packaged_mission(tmp_path: Path) -> None:
    (campaign,) = blocks("toml", "docs/campaigns.md")
    begins = ("[body", "[gravity", "[plant", "[compensator.integral]", "[stage.hover]")
    path = tmp_path / "hover.toml"
    path.write_text(tables_of("phobos-hover", begins) + campaign, encoding="utf-8")
    assert load_mission(str(path), allow_path=True).order() == ["hover", "verify"]


def test_plugin_example_is_a_plugin(monkeypatch: pytest.MonkeyPatch) -> None:
    sources = {
        match.group(1): block
        for block in blocks("python")
        if (match := re.match(r"# (my_gravity/\w+\.py)", block))
    }
    assert len(sources) == 3
    package = ModuleType("my_gravity")
    package.__path__ = []
    monkeypatch.setitem(sys.modules, "my_gravity", package)
    for name in ("specs", "soft"):
        module = ModuleType(f"my_gravity.{name}")
        monkeypatch.setitem(sys.modules, f"my_gravity.{name}", module)
        exec(sources[f"my_gravity/{name}.py"], module.__dict__)
    exec(sources["my_gravity/__init__.py"], package.__dict__)

    registry = Registry(strict=True)
    registry.add_plugin("my_gravity", package)
    record = registry.get("gravity", "soft")
    spec_class = record.load_spec()
    spec = validate(spec_class, spec_class.examples[0], where="gravity 'soft'")
    field = GravityField(record.load_target()(spec))
    r = np.array([[4e3], [0.0], [3e3]])
    distance2 = 25e6 + 25e6
    np.testing.assert_allclose(field.potential(r), 7e5 / np.sqrt(distance2), rtol=1e-14)
    np.testing.assert_allclose(field.acceleration(r), -7e5 * r / distance2**1.5, rtol=1e-14)


def test_nothing_is_left_to_be_filled_in() -> None:
    assert not re.search(r"[A-Z]+_PLACEHOLDER|TODO|TBD", README)
