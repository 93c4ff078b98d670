"""Store of the searches that have ended, so that a resumed run does not repeat them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError, StageError
from hillsphere.products.product_codec import canonical, load_product, save_product
from hillsphere_controllers.structured.records import SearchResult, Start

__all__ = ["SearchStore"]


class SearchStore:
    """A directory with a file for every search that has ended by itself.

    Parameters
    ----------
    directory : Path
        Directory of this problem alone; it is created if it does not exist.
    note : callable
        Called with a sentence about each file that cannot be used.
    """

    def __init__(self, directory: Path, note: Callable[[str], None]) -> None:
        self._directory, self._note = directory, note
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _write_error(directory, error) from error

    def read(self, start: Start) -> SearchResult | None:
        """Return the result of the search from a start, None if it is not stored.

        Raises
        ------
        StageError
            If there is a file that cannot be read just now.
        """
        path = self._path(start)
        if not path.exists():
            return None
        try:
            result = load_product(path)
        except InputError as error:
            self._note(f"{error}; this search is repeated")
            return None
        if isinstance(result, SearchResult) and _is_same_start(result.start, start):
            return result
        self._note(f"{path.name} belongs to another search; this one is repeated")
        return None

    def keep(self, result: SearchResult) -> SearchResult:
        """Store the result of a search, unless it was interrupted: then it will be repeated.

        Returns
        -------
        SearchResult
            The result as the file gives it back.

        Raises
        ------
        StageError
            If the file cannot be written.
        """
        result = canonical(result)
        if result.interrupted:
            return result
        path = self._path(result.start)
        try:
            save_product(path, result)
        except OSError as error:
            raise _write_error(path, error) from error
        return result

    def _path(self, start: Start) -> Path:
        return self._directory / f"search-{start.number:05d}.npz"


def _is_same_start(one: Start, other: Start) -> bool:
    if one.theta is None or other.theta is None:
        if one.theta is not other.theta:
            return False
    elif not np.array_equal(one.theta, other.theta):
        return False
    return replace(one, theta=None) == replace(other, theta=None)


def _write_error(path: Path, error: OSError) -> StageError:
    return StageError(
        f"{path} cannot be written: {error.strerror or error}; the results of earlier "
        "searches are stored: free the path and resume the run"
    )
