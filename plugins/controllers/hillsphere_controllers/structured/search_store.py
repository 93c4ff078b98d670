"""Searches that have ended, in files, so that a run that is resumed does not repeat them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError, StageError
from hillsphere.products.product_codec import canonical, load_product, save_product
from hillsphere_controllers.structured.search import Found, Start

__all__ = ["SearchStore"]


class SearchStore:
    """A directory with a file for every search that has ended by itself.

    Parameters
    ----------
    directory : Path
        Where; of this problem alone. Made if it is not there.
    note : callable
        Told in a sentence what cannot be used.
    """

    def __init__(self, directory: Path, note: Callable[[str], None]) -> None:
        self._directory, self._note = directory, note
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unusable(directory, error) from error

    def found(self, start: Start) -> Found | None:
        """Return what the search from a start found, None if that is not known.

        Raises
        ------
        StageError
            If there is a file that cannot be read just now.
        """
        path = self._path(start)
        if not path.exists():
            return None
        try:
            found = load_product(path)
        except InputError as error:
            self._note(f"{error}; this search is done once more")
            return None
        if isinstance(found, Found) and _same(found.start, start):
            return found
        self._note(f"{path.name} is of another search, which is done once more")
        return None

    def keep(self, found: Found) -> Found:
        """Keep what a search found, unless it was stopped: then it is to be done once more.

        Returns
        -------
        Found
            What the file gives back.

        Raises
        ------
        StageError
            If the file cannot be written.
        """
        found = canonical(found)
        if found.interrupted:
            return found
        path = self._path(found.start)
        try:
            save_product(path, found)
        except OSError as error:
            raise _unusable(path, error) from error
        return found

    def _path(self, start: Start) -> Path:
        return self._directory / f"search-{start.number:05d}.npz"


def _same(one: Start, other: Start) -> bool:
    if one.theta is None or other.theta is None:
        if one.theta is not other.theta:
            return False
    elif not np.array_equal(one.theta, other.theta):
        return False
    return (one.number, one.seed, one.perturbation) == (
        other.number, other.seed, other.perturbation,
    )  # fmt: skip


def _unusable(path: Path, error: OSError) -> StageError:
    return StageError(
        f"{path} cannot be written: {error.strerror or error}; the searches that ended before are "
        "kept: mend that and resume the run"
    )
