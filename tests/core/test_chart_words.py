"""Figures of campaigns show words on axes and in legends, not keys of the mission."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.core.wave_missions import WAVES, waves_mission
from tests.missions.pages import check_words, identifiers_in

from hillsphere.mission import load_mission
from hillsphere.plugins import default_registry
from hillsphere.runs.pipeline import run_mission

MISSION = (
    waves_mission(10)
    + """
[stage.map]
type = "sweep"
repeat = "wave"
dispersions = ["start"]
repetitions = 20
over = { "stage.wave.height" = [0, 1], "stage.wave.steps" = [1, 2, 3] }

[stage.line]
type = "sweep"
repeat = "wave"
lines = ["height"]
over = { "stage.wave.raises_at" = [-1, 40, 50], "stage.wave.height" = [0, 1] }
"""
)


@pytest.fixture(scope="module")
def charts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Directory of a run of sweeps over a quantity of the cases, and over keys."""
    place = tmp_path_factory.mktemp("words")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HILLSPHERE_CACHE", str(place / "cache"))
        patch.syspath_prepend(str(WAVES))
        default_registry.cache_clear()
        (place / "waves.toml").write_text(MISSION, "utf-8")
        assert run_mission(load_mission(place / "waves.toml"), out=place / "out").ok
        yield place / "out"
    default_registry.cache_clear()


def plot(charts: Path, name: str) -> Any:
    return json.loads((charts / f"figures/{name}.json").read_text("utf-8"))


def test_all_charts_show_words(charts: Path) -> None:
    assert len(list((charts / "figures").glob("*.json"))) >= 6
    check_words(charts)


def test_axes_bear_the_description_of_the_swept_key(charts: Path) -> None:
    """A description is the label of a key; a quantity of the cases has the words of its name."""
    layout = plot(charts, "sweep_failures")["layout"]
    assert layout["xaxis"]["title"]["text"] == "wave height (m)"
    assert layout["yaxis"]["title"]["text"] == "how often it is folded"
    assert layout["yaxis"]["ticktext"] == ["1", "2", "3"]
    titles = {part["title"]["text"] for name, part in plot(charts, "sweep_metrics_line")[
        "layout"].items() if name.startswith("xaxis")}  # fmt: skip
    assert titles == {"number of a case that raises"}


@pytest.mark.parametrize(
    "planted",
    [
        {"layout": {"xaxis": {"title": {"text": "stage.hover.period (s)"}}}},
        {"layout": {"yaxis2": {"ticktext": ["pid", "strict_ka3"]}}},
        {"layout": {"annotations": [{"text": "verify_unfiltered"}]}},
        {"layout": {"coloraxis": {"colorbar": {"title": {"text": "final_speed (m/s)"}}}}},
        {"layout": {}, "data": [{"showlegend": True, "name": "dispersions.flown"}]},
    ],
)
def test_an_identifier_is_seen(planted: dict[str, Any]) -> None:
    assert len(identifiers_in({"data": [], **planted})) == 1


@pytest.mark.parametrize("text", ["phobos C3,1", "Δv (m/s)", "x₀ = 0.5 m", "5 % to 95 %", "1:17"])
def test_words_and_numbers_are_none(text: str) -> None:
    assert identifiers_in({"data": [], "layout": {"xaxis": {"title": {"text": text}}}}) == []
