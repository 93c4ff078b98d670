"""Missions and runs from Python: settings as values, results as frames, arrays and plots."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.core.wave_missions import WAVES, waves_mission

import hillsphere as hs
from hillsphere.errors import InputError
from hillsphere.mission import MissionError
from hillsphere.plugins import default_registry

DEIMOS: dict[str, Any] = {
    "title": "Orbits around Deimos",
    "seed": 1,
    "body": {
        "deimos": {
            "type": "moon", "name": "deimos", "primary_gm_km3_s2": 42828.37,
            "semi_major_axis_km": 23463,
        }
    },
    "gravity": {
        "deimos": {"type": "ellipsoid", "axes_km": (8.04, 5.89, 5.11), "density_g_cm3": 1.47}
    },
    "plant": {"hill": {"type": "hill", "body": "deimos", "gravity": "deimos"}},
    "stage": {
        "family": {"type": "qso_family", "plant": "hill", "x_amplitudes_km": np.array([60, 30])}
    },
}  # fmt: skip


@pytest.fixture
def waves(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> hs.Mission:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(str(WAVES))
    default_registry.cache_clear()
    monkeypatch.chdir(tmp_path)
    Path("waves.toml").write_text(waves_mission(10), "utf-8")
    return hs.Mission.load("waves.toml")


def test_settings_are_values() -> None:
    mission = hs.Mission.load(
        "phobos-qso", set={"stage.family.x_amplitudes_km": np.array([90.0, 60.0]), "seed": 3}
    )
    assert mission.sets == ("stage.family.x_amplitudes_km=[90.0, 60.0]", "seed=3")
    assert mission.seed == 3
    again = mission.with_(set={"seed": 4, "title": 'a "b"\n'}, profile=None)
    assert (again.seed, again.title, len(again.sets)) == (4, 'a "b"\n', 4)
    assert "seed=3" in repr(mission)


def test_a_mission_is_made_of_tables() -> None:
    mission = hs.Mission.from_dict(DEIMOS)
    assert (mission.name, list(mission.specs["stage"])) == ("mission", ["family"])
    wrong = {**DEIMOS, "stage": {"family": {**DEIMOS["stage"]["family"], "plnt": 2}}}
    with pytest.raises(MissionError, match=r":\d+: stage.family.plnt: unknown key .* 'plant'"):
        hs.Mission.from_dict(wrong)
    with pytest.raises(InputError, match=r"stage.family: expected a number.*, got None"):
        hs.Mission.from_dict({**DEIMOS, "stage": {"family": None}})


def test_results_are_shown_and_opened_again(waves: hs.Mission) -> None:
    tables = tomllib.loads(Path("waves.toml").read_text("utf-8"))
    tables["stage"]["few"] = {
        "type": "sweep", "repeat": "wave", "over": {"stage.wave.height": np.array([0, 1])},
    }  # fmt: skip
    mission = hs.Mission.from_dict(tables)
    result = hs.run(mission, set={"stage.few.over.'stage.wave.height'": [0, 2]}, out="out")
    assert result.ok
    assert repr(result).startswith("<RunResult 'out': ")
    name, table = next(iter(result.tables.items()))
    frame = table.to_pandas()
    assert frame.shape == (len(table.rows), len(table.columns))
    assert list(frame.attrs["units"]) == list(frame.columns)
    assert table.title in table._repr_html_()
    assert name in result._repr_html_()
    opened = hs.load_run("out", mission=mission)
    assert opened.metrics == result.metrics
    assert opened.judgements == result.judgements
    assert {key: list(t.rows) for key, t in opened.tables.items()} == {
        key: list(t.rows) for key, t in result.tables.items()
    }
    assert list(opened.figures) == list(result.figures)
    stage = next(iter(opened.products))
    assert len(opened.to_xarray(stage).variables) > 0
    figure = next(iter(opened.figures))
    assert type(opened.plot(figure, "matplotlib")).__module__.startswith("matplotlib")
    with pytest.raises(InputError, match="no figure"):
        opened.plot("nothing")
    with pytest.raises(InputError, match="renderer must be"):
        opened.plot(figure, "pencil")  # type: ignore[arg-type]


def test_a_run_names_no_file_that_is_read(waves: hs.Mission) -> None:
    hs.run(waves, out="out")
    with pytest.raises(InputError, match="not a packaged one: give it as mission="):
        hs.load_run("out")
    with pytest.raises(InputError, match="has no stage"):
        hs.load_run("out", mission="phobos-qso")


def test_the_package_lists_what_it_offers() -> None:
    assert dir(hs) == sorted(hs.__all__)
    assert all(hasattr(hs, name) for name in dir(hs))


def test_components_of_a_mission_are_built_by_the_name_of_their_table() -> None:
    mission = hs.Mission.from_dict(DEIMOS)
    hill = hs.build(mission, "plant", "hill")
    assert hs.Motion(hill).states == ("x", "y", "z", "vx", "vy", "vz")
    with pytest.raises(InputError, match=r"no table \[plant\.hil\]; did you mean 'hill'\?"):
        hs.build(mission, "plant", "hil")
    with pytest.raises(InputError, match=r"no table \[plnt\.hill\]; did you mean 'plant'\?"):
        hs.build(mission, "plnt", "hill")


def test_components_of_a_run_have_its_settings(waves: hs.Mission, tmp_path: Path) -> None:
    result = hs.run(waves, out=tmp_path / "run")
    (kind, name) = next((k, n) for k, names in waves.specs.items() for n in names if k != "stage")
    made = result.build(kind, name)
    assert result.build(kind, name) is made
    again = hs.load_run(tmp_path / "run", mission=tmp_path / "waves.toml")
    assert type(again.build(kind, name)) is type(made)
    with pytest.raises(InputError, match="no table"):
        result.build("plant", "nothing")
