"""Directories of the framework: its cache and the packaged missions."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_directory() -> Path:
    """Return the cache directory: HILLSPHERE_CACHE, or the platform's user cache."""
    if given := os.environ.get("HILLSPHERE_CACHE"):
        return Path(given)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "hillsphere"
    base = os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else None
    return Path(base or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hillsphere"


def missions_directory() -> Path:
    """Return the packaged missions: inside the wheel, or beside the core in a source tree."""
    here = Path(__file__).resolve().parent
    installed = here / "missions"
    return installed if installed.is_dir() else here.parents[1] / "missions"
