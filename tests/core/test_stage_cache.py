"""Keys of stages: what of a plugin's distribution they depend on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hillsphere.mission import load_mission
from hillsphere.plugins import Registry
from hillsphere.runs.stage_cache import StageKeys


@pytest.fixture
def key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, toys: Registry, sound_mission: str
) -> Callable[..., str | None]:
    """Key of a stage whose gravity comes from a package ``toy_bricks``, with a changed record."""
    (tmp_path / "toy_bricks").mkdir()
    (tmp_path / "toy_bricks" / "__init__.py").write_text("")
    (tmp_path / "toy_bricks" / "table.csv").write_text("1,2\n")
    (tmp_path / "toy_products.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    path = tmp_path / "m.toml"
    path.write_text(sound_mission)
    mission = load_mission(path, registry=toys)

    def of(**changes: Any) -> str | None:
        gravity = mission.components["gravity"]
        brick = gravity["brick"]
        component = replace(brick.component, target="toy_bricks:Brick")
        brick = replace(brick, component=component, **changes)
        parts = {**mission.components, "gravity": {**gravity, "brick": brick}}
        return StageKeys(replace(mission, components=parts)).of("family")

    return of


def test_key_depends_on_every_file_of_the_package(
    key: Callable[..., str | None], tmp_path: Path
) -> None:
    keys = [key()]
    assert key() == keys[0] is not None
    (tmp_path / "toy_bricks" / "table.csv").write_text("1,3\n")
    keys.append(key())
    (tmp_path / "toy_bricks" / "data").mkdir()
    (tmp_path / "toy_bricks" / "data" / "more.bin").write_bytes(b"\0")
    keys.append(key())
    (tmp_path / "toy_bricks" / "table.csv").rename(tmp_path / "toy_bricks" / "other.csv")
    keys.append(key())
    assert len(set(keys)) == 4


def test_key_depends_on_the_distribution(key: Callable[..., str | None]) -> None:
    assert key(distribution="toys 1.0") == key(distribution="toys 1.0")
    assert key(distribution="toys 1.0") != key(distribution="toys 1.1")
