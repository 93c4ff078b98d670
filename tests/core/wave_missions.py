"""A small mission of the test plugin in `waves`: a stage, and a campaign that repeats it."""

from __future__ import annotations

from pathlib import Path

WAVES = Path(__file__).parent / "waves"
"""Directory of the plugin, to be put on the path."""

_MISSION = """format = 1
name = "waves"
title = "Waves"
seed = 4

[stage.wave]
type = "wave"

[dispersions.start]
type = "normal"
of = "stage.wave"
parameters = ["height"]
sigma = 0.2

[stage.many]
type = "many"
repeat = "wave"
dispersions = ["start"]
"""


def waves_mission(cases: int) -> str:
    """Return the mission as TOML, with a campaign of so many cases."""
    return f"{_MISSION}cases = {cases}\n"
