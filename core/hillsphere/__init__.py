"""Hillsphere: plugin-based mission analysis for small bodies and satellite tracking.

The package's own namespace is light: it imports nothing numerical. The functions named here are
loaded from their modules on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hillsphere.base import stray_processes

if TYPE_CHECKING:
    from hillsphere.engine.motion import Motion
    from hillsphere.mission.load import Mission, load_mission
    from hillsphere.plugins.registry import create
    from hillsphere.runs.assembly import build
    from hillsphere.runs.pipeline import resume_run, run_mission
    from hillsphere.runs.run_calls import load_run, run
    from hillsphere.runs.run_result import RunResult

__all__ = [
    "Mission",
    "Motion",
    "RunResult",
    "__version__",
    "build",
    "create",
    "load_mission",
    "load_run",
    "resume_run",
    "run",
    "run_mission",
]
__version__ = "0.1.0"

_LAZY = {
    "Mission": "hillsphere.mission",
    "Motion": "hillsphere.engine.motion",
    "RunResult": "hillsphere.runs.run_result",
    "build": "hillsphere.runs.assembly",
    "create": "hillsphere.plugins",
    "load_mission": "hillsphere.mission",
    "load_run": "hillsphere.runs.run_calls",
    "resume_run": "hillsphere.runs.pipeline",
    "run": "hillsphere.runs.run_calls",
    "run_mission": "hillsphere.runs.pipeline",
}


stray_processes.install()


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module 'hillsphere' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
