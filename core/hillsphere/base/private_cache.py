"""Check that no other user can write to the cache; otherwise a private cache is used.

The cache holds code that is executed: compiled functions are pickles and machine code, and the
compile layer loads its own database without a check of its owner. A directory is trusted only if
this user owns it and nobody else but the administrator can write to it, to the files in it, or to
any directory above it: write access to one of those allows replacing the whole cache.
"""

from __future__ import annotations

import atexit
import errno
import logging
import os
import shutil
import stat
import sys
import tempfile
from contextlib import suppress
from functools import partial
from pathlib import Path

from hillsphere.base.errors import InputError

__all__ = ["cache_fault", "is_private", "private_cache", "trusted_cache"]

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_MOST_LINKS = 40
"""Links followed in one path: the limit of Linux itself (path_resolution(7))."""

_PREFIX = "hillsphere-cache-"


def is_private(status: os.stat_result) -> bool:
    """Return whether a file with this status is this user's and only this user may write to it."""
    if sys.platform == "win32":  # the cache is in the user's own profile, whose access is Windows's
        return True
    return status.st_uid == os.geteuid() and not status.st_mode & _OTHERS_WRITE


def cache_fault(directory: Path) -> str:
    """Say why a directory cannot be trusted as a cache.

    Parameters
    ----------
    directory : Path
        The cache. Missing directories are made, with access for this user alone.

    Returns
    -------
    str
        ``""`` if it can be trusted; else a sentence without a full stop.

    Raises
    ------
    OSError
        If it does not exist and cannot be made, or is not a directory.

    Notes
    -----
    Each directory is checked before a name is looked up in it. If all of them pass, only this user
    and the administrator can redirect the path, so that the result still holds when the path is
    used. A directory that everybody may write to passes if its sticky bit is set and the next
    entry of the path belongs to this user or the administrator, as in ``/tmp``.
    """
    if sys.platform == "win32":
        directory.mkdir(parents=True, exist_ok=True)
        return ""
    here = Path("/")
    waiting = [*reversed(Path(os.path.abspath(directory)).parts[1:])]
    above = os.lstat(here)
    links = 0
    while True:
        if above.st_uid not in (0, os.geteuid()):
            return f"{here} belongs to another user"
        if not waiting:
            break
        if above.st_mode & _OTHERS_WRITE and not above.st_mode & stat.S_ISVTX:
            return f"others may write to {here}"
        name = waiting.pop()
        if name == "..":  # of a link's target; the directories above were checked before
            here = here.parent
            above = os.lstat(here)
            continue
        place = here / name
        try:
            status = os.lstat(place)
        except FileNotFoundError:
            with suppress(FileExistsError):  # made by another process meanwhile, checked below
                place.mkdir(mode=0o700)
            status = os.lstat(place)
        # In a sticky directory others could have made this name, but cannot replace ours.
        if status.st_uid not in (0, os.geteuid()):
            return f"{place} belongs to another user"
        if stat.S_ISLNK(status.st_mode):
            links += 1
            if links > _MOST_LINKS:
                return f"{place} is part of a loop of symbolic links"
            target = Path(os.readlink(place))
            if target.is_absolute():
                here, above = Path("/"), os.lstat("/")
            waiting += [part for part in reversed(target.parts) if part != "/"]
            continue
        if not stat.S_ISDIR(status.st_mode):
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(place))
        here, above = place, status
    if above.st_uid != os.geteuid():
        return f"{here} belongs to another user"
    if above.st_mode & _OTHERS_WRITE:
        return f"others may write to {here}"
    return _entry_fault(here)


def _entry_fault(directory: Path) -> str:
    """Say which entry of a cache, or of the compile layer's part of it, others may write to.

    Deeper entries are checked when they are opened.
    """
    for place in (directory, directory / "compiled"):
        if not place.is_dir():
            continue
        with os.scandir(place) as entries:
            for entry in entries:
                try:
                    status = entry.stat(follow_symlinks=False)
                except FileNotFoundError:  # another process removed it
                    continue
                if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
                    return f"{entry.path} is neither a file nor a directory"
                if not is_private(status):
                    return f"{entry.path} belongs to another user, or others may write to it"
    return ""


def trusted_cache(directory: Path) -> Path:
    """Return a cache directory, or a private one if others may write to it.

    Parameters
    ----------
    directory : Path
        The requested cache.

    Returns
    -------
    Path
        `directory` if it can be trusted. Also if it cannot be used at all: the code that writes to
        it reports that.
    """
    try:
        fault = cache_fault(directory)
    except (OSError, ValueError):
        return directory
    return private_cache(directory, fault) if fault else directory


def private_cache(directory: Path, fault: str) -> Path:
    """Return a fresh cache directory for this user alone, which is removed with this process.

    A warning is given once. Child processes learn of the directory by ``HILLSPHERE_CACHE``.

    Parameters
    ----------
    directory : Path
        The cache that cannot be trusted.
    fault : str
        Why.

    Raises
    ------
    InputError
        If others may write to every directory for temporary files.
    """
    place = _fresh_directory()
    atexit.register(partial(_remove, place, os.getpid()))
    os.environ["HILLSPHERE_CACHE"] = str(place)
    logging.getLogger("hillsphere").warning(
        "the cache %s is not used, as it may hold what others have written (%s); a private one is, "
        "which lasts for this run only: remove the cache, or set HILLSPHERE_CACHE to a directory "
        "that only you can write to",
        directory,
        fault,
    )
    return place


def _fresh_directory() -> Path:
    """Make a directory of mode 0700 at a path that no other user can redirect."""
    for base in (tempfile.gettempdir(), "/tmp", "/var/tmp", str(Path.home())):
        with suppress(OSError):
            place = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=base))
            if not cache_fault(place):
                return place
            place.rmdir()
    raise InputError(
        "there is no place for a private cache: others may write to the directories of temporary "
        "files and above them; set HILLSPHERE_CACHE to a directory that only you can write to"
    )


def _remove(place: Path, process: int) -> None:
    if os.getpid() == process:  # not in a fork of it
        shutil.rmtree(place, ignore_errors=True)
