"""Results of a large campaign in files: what it is resumed from, and its product, in one.

A file holds the cases of neighbouring blocks, as many as the number of blocks alone determines, so
that the files of a campaign are the same for any number of workers. A worker that can reach the
directory writes the files itself: a few numbers are then all that travels to the run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.atomic import PART_SUFFIX
from hillsphere.base.errors import InputError, StageError
from hillsphere.cases.block_outcome import (
    BlockOutcome,
    complete_metrics,
    divide_outcome,
    join_outcomes,
)
from hillsphere.cases.case_classes import decided_failures
from hillsphere.cases.checkpoints import SET_ASIDE
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.products.columns import ColumnFile, ColumnFiles, write_columns

__all__ = ["MOST_IN_MEMORY", "BlockFiles", "FileReceipt", "StoredBlocks", "texts_of"]

MOST_IN_MEMORY = 65_536
"""Cases of a campaign whose table is held in memory and stored in one file; of a hundred columns
they take 50 MB."""

LEAST_BLOCKS = 64
"""Blocks in a file: 4096 cases, a megabyte with thirty columns. A column of a million cases is read
from 245 files in about 0.1 s."""

MOST_FILES = 65_536
"""Files of a campaign; larger ones have more blocks in each, so that a directory can be listed."""

FORMAT = 1
"""Version of the files; those of another version are computed again."""


class PlannedBlocks(Protocol):
    """What is needed of a plan, see `hillsphere.cases.plan.Plan`."""

    @property
    def blocks(self) -> int: ...
    def block(self, number: int) -> tuple[CaseBatch, int]: ...
    def cases_of(self, blocks: range) -> int: ...
    def variant_of(self, block: int) -> int: ...
    def input_values(self, cases: Integers) -> Array: ...


@dataclass(frozen=True)
class FileReceipt:
    """What the run is told of a file that was written."""

    number: int
    """Number of the file."""
    cases: int
    """Cases in it."""
    failures: int
    """Decided cases that failed."""
    metrics: tuple[str, ...]
    """Names of the metrics; none if no case has any."""
    units: tuple[str, ...]
    """Their units."""
    seconds: float = 0.0
    """Wall-clock time that its blocks took; 0 for a file of an earlier run."""


@dataclass(frozen=True)
class BlockFiles:
    """Where the files of a campaign are, and how its blocks are divided among them.

    Parameters
    ----------
    directory : Path
        The directory.
    fingerprint : str
        What the results depend on; files that carry another are not taken.
    plan : PlannedBlocks
        The cases.
    """

    directory: Path
    fingerprint: str
    plan: PlannedBlocks

    @property
    def blocks_per_file(self) -> int:
        """Blocks in each file but the last, determined by the number of blocks alone."""
        return LEAST_BLOCKS * -(-self.plan.blocks // (LEAST_BLOCKS * MOST_FILES))

    def blocks(self, number: int) -> range:
        """Return the numbers of the blocks in a file."""
        first = number * self.blocks_per_file
        return range(first, min(first + self.blocks_per_file, self.plan.blocks))

    def blocks_beside(self, block: int) -> range:
        """Return the numbers of the blocks in the file of a block."""
        return self.blocks(block // self.blocks_per_file)

    def path(self, number: int) -> Path:
        """Return the path of a file."""
        return self.directory / ColumnFiles.name(number)

    def write(self, number: int, outcomes: Sequence[BlockOutcome]) -> FileReceipt:
        """Write the first blocks of a file, as a rule all of them.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        cases = join_outcomes([replace(one, histories=None) for one in outcomes])
        inputs = self.plan.input_values(cases.numbers)
        words, status = np.unique(cases.status, return_inverse=True)
        causes, cause = np.unique(cases.cause, return_inverse=True)
        errors, count = cases.step_error, len(cases.numbers)
        columns: dict[str, NDArray[Any]] = {
            "values": cases.values,
            "inputs": inputs,
            "step_error": np.empty((0, count)) if errors is None else errors[None],
            "case": cases.numbers,
            "status": status.astype(np.uint16),
            "cause": cause.astype(np.uint16),
            "failed": cases.failed,
        }
        facts = {
            "format": FORMAT,
            "fingerprint": self.fingerprint,
            "first": self.blocks(number)[0],
            "counts": [len(one.numbers) for one in outcomes],
            "metrics": cases.metrics,
            "units": cases.units,
            "status": words.tolist(),
            "cause": causes.tolist(),
            "message_case": cases.message_case.tolist(),
            "messages": cases.messages,
            "step_error": errors is not None,
            "failures": int(np.count_nonzero(decided_failures(cases))),
        }
        write_columns(self.path(number), columns, facts)
        return _receipt(number, facts, sum(one.seconds for one in outcomes))

    def read(self, number: int) -> list[BlockOutcome]:
        """Return the blocks of a file.

        Raises
        ------
        InputError
            If it is damaged, or belongs to another campaign.
        OSError
            If it cannot be read.
        """
        with ColumnFile(self.path(number)) as file:
            facts = self._facts(file, number)
            outcome = BlockOutcome(
                numbers=file.read("case").astype(np.int64),
                metrics=tuple(facts["metrics"]),
                units=tuple(facts["units"]),
                values=file.read("values"),
                status=np.array(facts["status"], dtype=np.str_)[file.read("status")],
                cause=np.array(facts["cause"], dtype=np.str_)[file.read("cause")],
                failed=file.read("failed"),
                message_case=np.array(facts["message_case"], dtype=np.int64),
                messages=tuple(facts["messages"]),
                step_error=file.read("step_error", 0) if facts["step_error"] else None,
            )
        return divide_outcome(outcome, facts["counts"], [0.0] * len(facts["counts"]))

    def block(self, number: int) -> BlockOutcome:
        """Return a block from its file; raises as `read` does."""
        of, place = divmod(number, self.blocks_per_file)
        return self.read(of)[place]

    def receipt(self, number: int) -> FileReceipt:
        """Return what is to be told of a file that is there; raises as `read` does."""
        with ColumnFile(self.path(number)) as file:
            return _receipt(number, self._facts(file, number))

    def _facts(self, file: ColumnFile, number: int) -> dict[str, Any]:
        facts, blocks = file.facts, self.blocks(number)
        name = self.path(number).name
        if facts.get("format") != FORMAT:
            raise InputError(f"{name}: written in another format")
        if facts["fingerprint"] != self.fingerprint or facts["first"] != blocks[0]:
            raise InputError(f"{name}: belongs to a campaign of other inputs")
        if len(facts["counts"]) > len(blocks) or sum(facts["counts"]) != file.cases:
            raise InputError(f"{name}: holds other cases")
        return facts


def _receipt(number: int, facts: dict[str, Any], seconds: float = 0.0) -> FileReceipt:
    return FileReceipt(
        number,
        sum(facts["counts"]),
        int(facts["failures"]),
        tuple(facts["metrics"]),
        tuple(facts["units"]),
        seconds,
    )


class StoredBlocks(Sequence[BlockOutcome]):
    """The finished blocks of a large campaign, read from their files when they are asked for.

    As a sequence these are the blocks from the first on, up to the first that is not there, with
    the same metrics each.

    Parameters
    ----------
    files : BlockFiles
        Where.
    note : callable, optional
        Told in a sentence what could not be used.
    by_workers : bool
        Whether workers may write the files themselves; not if histories are wanted, of which the
        files have none.
    """

    def __init__(
        self,
        files: BlockFiles,
        note: Callable[[str], None] | None = None,
        *,
        by_workers: bool = True,
    ) -> None:
        self.files, self.by_workers = files, by_workers
        self._note = note or (lambda message: None)
        self._length = 0
        self._held: dict[int, BlockOutcome] = {}
        self._written: set[int] = set()
        self._read: tuple[int, list[BlockOutcome]] = (-1, [])
        self._known: BlockOutcome | None = None

    def load(self) -> Iterator[FileReceipt]:
        """Yield receipts of the files that an interrupted run has written.

        What a crash left half written is removed. A file that is damaged, not complete or of
        another campaign is set aside under another name, with a note.

        Raises
        ------
        StageError
            If the directory cannot be used.
        """
        try:
            self.files.directory.mkdir(parents=True, exist_ok=True)
            for part in self.files.directory.glob(f".*{PART_SUFFIX}"):
                part.unlink(missing_ok=True)
            for path in sorted(self.files.directory.glob("cases-*.npy")):
                name = path.stem.partition("-")[2]
                number = int(name) if name.isdecimal() else -1
                try:
                    if number < 0 or not self.files.blocks(number):
                        raise InputError(f"{path.name}: the campaign has no such file")
                    receipt = self.files.receipt(number)
                    if receipt.cases != self._planned(number):
                        raise InputError(f"{path.name}: is not complete")
                    self.files.read(number)  # every check of its columns
                except InputError as error:
                    path.replace(path.with_name(path.name + SET_ASIDE))
                    self._note(f"{error}; it was set aside and its blocks are computed again")
                else:
                    self._written.add(number)
                    yield receipt
        except OSError as error:
            raise StageError(
                f"files in {self.files.directory} cannot be used: {error.strerror or error}"
            ) from error

    def _planned(self, number: int) -> int:
        """Return the number of cases of a complete file."""
        return self.files.plan.cases_of(self.files.blocks(number))

    def accept(self, receipt: FileReceipt) -> bool:
        """Take a file that a worker has written; False if it cannot be seen from here."""
        try:
            there = self.files.receipt(receipt.number)
        except (InputError, StageError, OSError):
            return False
        if there.cases != receipt.cases:
            return False
        self._written.add(receipt.number)
        return True

    def hold(self, number: int, outcome: BlockOutcome) -> None:
        """Take a block; write its file once all blocks of the file are there.

        Raises
        ------
        StageError
            If the file cannot be written.
        """
        self._held[number] = replace(outcome, histories=None)
        of = number // self.files.blocks_per_file
        blocks = self.files.blocks(of)
        if all(one in self._held for one in blocks):
            self._write(of, [self._held[one] for one in blocks])
            for one in blocks:
                del self._held[one]

    def _write(self, number: int, outcomes: Sequence[BlockOutcome]) -> None:
        try:
            self.files.write(number, outcomes)
        except OSError as error:
            raise StageError(
                f"{self.files.path(number)} cannot be written: {error.strerror or error}; the "
                f"{len(self._written)} files written before are kept: mend that and resume the run"
            ) from error
        self._written.add(number)
        if self._read[0] == number:
            self._read = (-1, [])

    def is_written(self, number: int) -> bool:
        """Return whether the file of a block is there."""
        return number // self.files.blocks_per_file in self._written

    def lengthen(self, length: int) -> None:
        """Set how many blocks, from the first on, are there."""
        self._length = length

    def finish(self) -> tuple[ColumnFiles, list[dict[str, Any]]]:
        """Write what is not in a file yet, and remove what lies beyond the end.

        Returns
        -------
        tuple of ColumnFiles and list of dict
            The files, and the facts that each holds beside its columns (`BlockFiles.write`).

        Raises
        ------
        StageError
            If a file cannot be written or removed.
        """
        whole, rest = divmod(self._length, self.files.blocks_per_file)
        if (rest and self._length < self.files.plan.blocks) or (
            whole not in self._written and rest
        ):
            first = whole * self.files.blocks_per_file
            self._write(whole, [self._block(one) for one in range(first, self._length)])
        count = -(-self._length // self.files.blocks_per_file)
        sizes, facts = np.zeros((count, 3), dtype=np.int64), []
        for number in range(count):
            with ColumnFile(path := self.files.path(number)) as file:
                sizes[number] = file.cases, path.lstat().st_size, file.check
                facts.append(file.facts)
        with suppress(OSError):
            for number in self._written - set(range(count)):
                self.files.path(number).unlink(missing_ok=True)
        self._written &= set(range(count))
        return ColumnFiles(self.files.directory, *np.ascontiguousarray(sizes.T)), facts

    def __len__(self) -> int:
        """Return the number of blocks from the first on without a gap."""
        return self._length

    @overload
    def __getitem__(self, key: int) -> BlockOutcome: ...
    @overload
    def __getitem__(self, key: slice) -> list[BlockOutcome]: ...
    def __getitem__(self, key: int | slice) -> BlockOutcome | list[BlockOutcome]:
        """Return a block, or some of them."""
        places = range(self._length)[key]
        return self._block(places) if isinstance(places, int) else [self._block(p) for p in places]

    def _block(self, number: int) -> BlockOutcome:
        outcome = self._held.get(number)
        if outcome is None:
            of, place = divmod(number, self.files.blocks_per_file)
            if self._read[0] != of:
                self._read = of, self.files.read(of)
            outcome = self._read[1][place]
        if self._known is None and outcome.metrics:
            self._known = replace(outcome, messages=(), message_case=outcome.message_case[:0])
        return outcome if self._known is None else complete_metrics([self._known, outcome])[1]


def texts_of(files: ColumnFiles, name: str, facts: Sequence[dict[str, Any]]) -> NDArray[np.str_]:
    """Return the texts (N,) of a field of numbers of words, which each file has of its own.

    Parameters
    ----------
    files : ColumnFiles
        The files.
    name : str
        ``"status"`` or ``"cause"``.
    facts : sequence of dict
        Facts of the files; see `StoredBlocks.finish`.
    """
    words = sorted({word for one in facts for word in one[name]})
    places: Integers = files.read(name).astype(np.int64)
    ends = np.cumsum(files.counts)
    for one, last, count in zip(facts, ends.tolist(), files.counts.tolist(), strict=True):
        table = np.array([words.index(word) for word in one[name]], dtype=np.int64)
        places[last - count : last] = table[places[last - count : last]]
    return np.array(words, dtype=np.str_)[places]
