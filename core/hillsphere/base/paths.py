"""Directories of the framework: its cache and the packaged missions."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path


def cache_directory() -> Path:
    """Return the cache directory: HILLSPHERE_CACHE, or the platform's user cache.

    What is kept there is run. If anybody else may have written to it, a private and fresh directory
    takes its place, with a warning: see `hillsphere.base.private_cache`.
    """
    from hillsphere.base.private_cache import trusted_cache

    return trusted_cache(_wanted_cache())


def compiled_code_directory() -> Path:
    """Return where the compile layer keeps machine code: HEYOKA_CACHE_DIR, or in our cache.

    Nobody else can have written what is there: see `cache_directory`.
    """
    from hillsphere.base.private_cache import trusted_cache

    if given := os.environ.get("HEYOKA_CACHE_DIR"):
        return trusted_cache(Path(os.path.abspath(given)))
    directory = cache_directory() / "compiled"
    with suppress(OSError):  # who uses it says what is wrong with it
        directory.mkdir(mode=0o700, exist_ok=True)
    return directory


def _wanted_cache() -> Path:
    if given := os.environ.get("HILLSPHERE_CACHE"):
        return Path(given)
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "hillsphere"
    base = os.environ.get("LOCALAPPDATA") if sys.platform == "win32" else None
    return Path(base or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hillsphere"


def missions_directory() -> Path:
    """Return the packaged missions: inside the wheel, or beside the core in a source tree."""
    here = Path(__file__).resolve().parents[1]
    installed = here / "missions"
    return installed if installed.is_dir() else here.parents[1] / "missions"
