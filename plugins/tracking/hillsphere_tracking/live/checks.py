"""What is wrong with numbers and files that ``hillsphere track`` is given, before it begins."""

from __future__ import annotations

import tempfile
from math import inf, radians
from pathlib import Path

from hillsphere.base.atomic import output_place
from hillsphere.errors import InputError
from hillsphere_tracking.live.atmosphere import Air
from hillsphere_tracking.memory import RandomWalk

__all__ = ["air_of", "check_positive", "check_writable", "random_walk_of"]


def check_positive(**numbers: float) -> None:
    """Refuse values of options, by their names, that are not > 0 and finite."""
    for name, value in numbers.items():
        if not 0.0 < value < inf:
            raise InputError(f"--{name.replace('_', '-')} must be > 0, got {value:g}")


def check_writable(option: str, path: Path | None) -> None:
    """Refuse a file that could not be written when the pass is over.

    Parameters
    ----------
    option : str
        That gave it.
    path : Path or None
        The file, if there is to be one.

    Raises
    ------
    InputError
        If it is no regular file (a directory, a device, a FIFO), or nothing can be written beside
        it. Of a link, what it leads to is judged: that is what is written.
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
        # files are written beside their place and moved there whole
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(
            f"{option}: nothing can be written in {folder}: {error.strerror or error}"
        ) from error


def air_of(refraction: bool, pressure: float | None, temperature: float | None) -> Air | None:
    """Return the air that lifts the satellite, if there is any."""
    if refraction:
        return Air(
            1010.0 if pressure is None else pressure, 10.0 if temperature is None else temperature
        )
    if pressure is not None or temperature is not None:
        raise InputError("--pressure and --temperature are for --refraction")
    return None


def random_walk_of(walk: tuple[float, float]) -> RandomWalk:
    """Return how biases, degrees, and time offset, s, wander in a day."""
    if not all(0.0 <= size < inf for size in walk):
        raise InputError(
            "--forget must be two numbers ≥ 0 and finite, degrees and s, got "
            f"{walk[0]:g} and {walk[1]:g}"
        )
    return RandomWalk(radians(walk[0]), walk[1])
