"""Directories of the framework: its cache and the packaged missions."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path


def cache_directory() -> Path:
    """Return the cache directory: HILLSPHERE_CACHE, or the platform's user cache.

    The cache holds code that is executed. If another user could have written to it, a fresh private
    directory is used instead, with a warning (`hillsphere.base.private_cache`).
    """
    from hillsphere.base.private_cache import trusted_cache

    return trusted_cache(_wanted_cache())


def compiled_code_directory() -> Path:
    """Return the directory of compiled machine code: HEYOKA_CACHE_DIR, or a part of the cache.

    No other user can have written to it: see `cache_directory`.
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
    """Return the directory of the packaged missions, in the wheel or in the source tree."""
    here = Path(__file__).resolve().parents[1]
    installed = here / "missions"
    return installed if installed.is_dir() else here.parents[1] / "missions"
