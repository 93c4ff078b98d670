"""Reading and validation of mission files, from TOML text to linked Specs.

The public names are those of `hillsphere.mission.load`, which is imported when one of them is used,
so that other modules of this package load without it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hillsphere.mission.load import (
        FORMAT,
        Mission,
        MissionError,
        load_mission,
        packaged_missions,
    )

__all__ = [
    "FORMAT",
    "Mission",
    "MissionError",
    "load_mission",
    "packaged_missions",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("hillsphere.mission.load"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
