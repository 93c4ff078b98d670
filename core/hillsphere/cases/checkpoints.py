"""Finished blocks of a campaign, kept in files until the campaign is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.atomic import PART_SUFFIX
from hillsphere.base.errors import InputError, StageError
from hillsphere.cases.block_outcome import BlockOutcome, divide_outcome, join_outcomes
from hillsphere.interfaces.cases import Histories
from hillsphere.products.fields import Shape
from hillsphere.products.product_codec import load_product, save_product

__all__ = ["Checkpoint", "Checkpoints"]

SET_ASIDE = ".set-aside"
"""Ending of a file that could not be used."""


@dataclass(frozen=True)
class Checkpoint:
    """Neighbouring blocks that were finished together."""

    fingerprint: str
    """What the campaign's results depend on."""
    first: int
    """Number of the first block."""
    counts: Annotated[Integers, Shape("blocks")]
    """Cases in each block."""
    seconds: Annotated[Array, Shape("blocks")]
    """Wall-clock time that each took."""
    cases: BlockOutcome
    """All their cases."""


class Checkpoints:
    """A directory with a file for every group of blocks that was finished.

    Each file appears complete or not at all, is never changed, and names its blocks; campaigns
    that were interrupted and went on in other groups may leave files that overlap.

    Parameters
    ----------
    directory : Path
        Where; made if it is not there.
    fingerprint : str
        What the results depend on: files that carry another are not taken.
    note : callable, optional
        Told in a sentence what could not be used.
    """

    def __init__(
        self, directory: Path, fingerprint: str, note: Callable[[str], None] | None = None
    ) -> None:
        self.directory, self.fingerprint = directory, fingerprint
        self._note = note or (lambda message: None)
        self._kept = 0
        self._with_histories: set[Path] = set()

    def load(self) -> dict[int, BlockOutcome]:
        """Return what was kept, by number of the block, but for `histories`.

        What a crash left half written is removed. A file that is damaged, or belongs to another
        campaign, is set aside under another name, with a note: its blocks are to be computed again.

        Raises
        ------
        StageError
            If the directory cannot be used, or a file cannot be read just now, which is none of
            its damages: it stays.
        """
        found: dict[int, BlockOutcome] = {}
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            for part in self.directory.glob(f".*{PART_SUFFIX}"):
                part.unlink(missing_ok=True)
            for path in sorted(self.directory.glob("blocks-*.npz")):
                try:
                    blocks = self._read(path)
                except InputError as error:
                    path.replace(path.with_name(path.name + SET_ASIDE))
                    self._note(f"{error}; it was set aside and its blocks are computed again")
                else:
                    # Blocks that two files hold are the same in both.
                    found = blocks | found
        except OSError as error:
            raise StageError(
                f"checkpoints in {self.directory} cannot be used: {error.strerror or error}"
            ) from error
        self._kept = len(found)
        return found

    def save(self, first: int, outcomes: Sequence[BlockOutcome]) -> None:
        """Keep neighbouring blocks.

        Parameters
        ----------
        first : int
            Number of the first.
        outcomes : sequence of BlockOutcome
            What came of them.

        Raises
        ------
        StageError
            If the file cannot be written; what was kept before stands.
        """
        last = first + len(outcomes) - 1
        checkpoint = Checkpoint(
            fingerprint=self.fingerprint,
            first=first,
            counts=np.array([len(o.numbers) for o in outcomes], dtype=np.int64),
            seconds=np.array([o.seconds for o in outcomes]),
            cases=join_outcomes(outcomes),
        )
        path = self.directory / f"blocks-{first:07d}-{last:07d}.npz"
        if checkpoint.cases.histories is not None:
            self._with_histories.add(path)
        try:
            save_product(path, checkpoint)
        except OSError as error:
            raise StageError(
                f"{path} cannot be written: {error.strerror or error}; the {self._kept} blocks "
                "finished before are kept: mend that and resume the run"
            ) from error
        self._kept += len(outcomes)

    def drop(self, blocks: range) -> None:
        """Remove the files of blocks that are kept elsewhere, but for those with histories.

        Parameters
        ----------
        blocks : range
            A file is removed if all its blocks are among these.
        """
        for path in self.directory.glob("blocks-*.npz"):
            first, last = map(int, path.stem.split("-")[1:])
            if first in blocks and last in blocks and path not in self._with_histories:
                path.unlink(missing_ok=True)

    def histories(self) -> Iterator[tuple[Integers, Histories]]:
        """Yield the histories that were kept: numbers of cases (n,), and what they were like.

        One file is in memory at a time. Files may overlap.

        Raises
        ------
        StageError
            If a file that was written or read before cannot be read.
        """
        for path in sorted(self.directory.glob("blocks-*.npz")):
            try:
                cases = self._checkpoint(path).cases
            except InputError as error:
                raise StageError(
                    f"{error}; it was whole before: resume the run, which computes what it held "
                    "once more"
                ) from error
            if cases.histories is not None:
                yield cases.numbers, cases.histories

    def _read(self, path: Path) -> dict[int, BlockOutcome]:
        checkpoint = self._checkpoint(path)
        if checkpoint.cases.histories is not None:
            self._with_histories.add(path)
        parts = divide_outcome(
            checkpoint.cases, checkpoint.counts.tolist(), checkpoint.seconds.tolist()
        )
        return dict(enumerate(parts, checkpoint.first))

    def _checkpoint(self, path: Path) -> Checkpoint:
        checkpoint = load_product(path)
        if not isinstance(checkpoint, Checkpoint):
            raise InputError(f"{path.name}: holds a {type(checkpoint).__name__}")
        if checkpoint.fingerprint != self.fingerprint:
            raise InputError(f"{path.name}: belongs to a campaign of other inputs")
        return checkpoint
