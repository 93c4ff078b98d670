"""Checks of the options of ``hillsphere track`` before it begins."""

from __future__ import annotations

import tempfile
from math import inf, radians
from pathlib import Path

from hillsphere.base.atomic import output_place
from hillsphere.errors import InputError
from hillsphere_tracking.live.atmosphere import Air
from hillsphere_tracking.memory import RandomWalk

__all__ = ["air_of", "check_apart", "check_positive", "check_writable", "random_walk_of"]


def check_positive(**numbers: float) -> None:
    """Refuse values of options (by name) that are not positive and finite."""
    for name, value in numbers.items():
        if not 0.0 < value < inf:
            raise InputError(f"--{name.replace('_', '-')} must be > 0, got {value:g}")


def check_apart(log: Path | None, source: str) -> None:
    """Refuse a log that would take the place of the measurements while they are read."""
    if log is None or source == "-" or not (log.exists() and Path(source).exists()):
        return
    if log.samefile(source):
        raise InputError(f"--log: {log} is the file of the measurements; name another one")


def check_writable(option: str, path: Path | None) -> None:
    """Refuse a file that could not be written at the end of the pass.

    Parameters
    ----------
    option : str
        Name of the option.
    path : Path or None
        The file, or None if the option is not given.

    Raises
    ------
    InputError
        If the path is not a regular file (but a directory, a device or a FIFO), or its directory is
        not writable. The target of a link is checked, since the target is written.
    """
    if path is None:
        return
    try:
        folder = output_place(path).parent
    except IsADirectoryError:
        raise InputError(f"{option}: {path} is a directory; name a file in it") from None
    except OSError as error:
        raise InputError(
            f"{option}: {path} cannot be written: {error.strerror}; name a file"
        ) from error
    if not folder.is_dir():
        raise InputError(f"{option}: the directory {folder} does not exist")
    try:
        # files are written to a temporary file in the same directory, which is then renamed
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{option}: nothing can be written in {folder}: {error.strerror or error}"
        ) from error


def air_of(refraction: bool, pressure: float | None, temperature: float | None) -> Air | None:
    """Return the air for the refraction, or None without --refraction."""
    if refraction:
        return Air(
            1010.0 if pressure is None else pressure, 10.0 if temperature is None else temperature
        )
    if pressure is not None or temperature is not None:
        raise InputError("--pressure and --temperature need --refraction")
    return None


def random_walk_of(walk: tuple[float, float]) -> RandomWalk:
    """Return the random walk of biases (degrees in a day) and time offset (s in a day)."""
    if not all(0.0 <= size < inf for size in walk):
        raise InputError(
            "--forget must be two numbers ≥ 0 and finite, degrees and s, got "
            f"{walk[0]:g} and {walk[1]:g}"
        )
    return RandomWalk(radians(walk[0]), walk[1])
