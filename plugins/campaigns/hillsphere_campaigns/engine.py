"""The run of a campaign: tasks of blocks, with outcomes that do not depend on their order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from statistics import median
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.errors import StageError
from hillsphere.cases.block_outcome import BlockOutcome, complete_metrics, join_outcomes, lost_rows
from hillsphere.cases.case_classes import decided_failures
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.isolation import only
from hillsphere.cases.stored_blocks import FileReceipt, StoredBlocks
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.interfaces.tasks import (
    Crew,
    Executor,
    Failed,
    Finished,
    Lost,
    Outcome,
    StoredTask,
    Task,
    Work,
)
from hillsphere_campaigns.task_sizes import blocks_of_task, files_of_task

__all__ = ["CampaignPlan", "StopRule", "run_campaign"]

READY_LIMITS = 10.0
"""Limits of a block that preparing the stage may take: it compiles, once for many blocks …"""

LEAST_READY_S = 300.0
"""… and this long in any case."""

PARTS = 8
"""Parts of a block that cost its worker: 64 cases, 8, 1. Each level costs a worker and the time to
its limit, so that two of them are better than the six of halves."""

StopRule = Callable[[Sequence[BlockOutcome]], str]
"""Asked after each block, in their order, with the outcomes of all blocks up to it (a list that
grows); returns why to stop after it, or ``""``."""


class CampaignPlan(Protocol):
    """The cases of a campaign in their blocks."""

    @property
    def cases(self) -> int:
        """How many cases."""
        ...

    @property
    def blocks(self) -> int:
        """How many blocks."""
        ...

    def block(self, number: int) -> tuple[CaseBatch, int]:
        """Return a block and the variant that it belongs to."""
        ...


def run_campaign(
    plan: CampaignPlan,
    work: Work,
    *,
    executor: Executor,
    checkpoints: Checkpoints | None = None,
    stored: StoredBlocks | None = None,
    limit_s: float | None = None,
    tries: int = 3,
    group_blocks: int | None = None,
    stop: StopRule | None = None,
    advance: Callable[[int], None] | None = None,
    on_failures: Callable[[int], None] | None = None,
    on_metrics: Callable[[Sequence[str]], None] | None = None,
) -> tuple[list[BlockOutcome], str]:
    """Compute the blocks of a plan.

    Parameters
    ----------
    plan : CampaignPlan
        The cases.
    work : Work
        Computes a task: returns one `BlockOutcome` for each of its blocks.
    executor : Executor
        Where.
    checkpoints : Checkpoints, optional
        Where finished blocks are kept, and taken from.
    stored : StoredBlocks, optional
        Files of a large campaign, whose blocks are not held in memory. Workers that can reach them
        write them; `checkpoints`, which are needed too, keep what is no whole file yet.
    limit_s : float, optional
        Wall-clock time for a block; a worker that takes longer is stopped.
    tries : int
        How often a task may lose its worker before it is divided, down to the case that does it.
    group_blocks : int, optional
        Blocks of a task; by default as many as take about a second.
    stop : callable, optional
        See `StopRule`. What was computed beyond the end is dropped, so that the end does not depend
        on the order of the work.
    advance : callable, optional
        Told the number of cases done, now and then with 0; what it raises ends the campaign.
    on_failures : callable, optional
        Told how many cases have failed, whenever that changes.
    on_metrics : callable, optional
        Told the names of the metrics, once, as soon as a block has any; what it raises ends the
        campaign.

    Returns
    -------
    outcomes : sequence of BlockOutcome
        `stored` if it is given, otherwise a list: one per block, from the first, in their order,
        all with the same metrics. Executor, grouping and interruptions change no bit of them but
        `BlockOutcome.seconds`. With checkpoints their histories are left there
        (`Checkpoints.histories`), as they would fill the memory.
    stopped : str
        Why `stop` ended it; ``""`` if all blocks were computed.

    Raises
    ------
    StageError
        If the work cannot be prepared, it raises, or a checkpoint cannot be written.
    """
    campaign = _Campaign(plan, checkpoints, stored, limit_s, tries, group_blocks, stop)
    campaign.tell, campaign.tell_failures = advance, on_failures
    campaign.tell_metrics = on_metrics
    campaign.resume()
    if not campaign.over:
        with executor.crew(work) as crew:
            campaign.run(crew)
    # Files are as good as a list for whoever reads blocks one by one.
    return cast("list[BlockOutcome]", campaign.outcomes()), campaign.stopped


_Blocks = list[tuple[int, Sequence[BlockOutcome]]]
"""Finished blocks that go into one file: number of the first, and what came of each."""

_Stored = list[FileReceipt]
"""Files that a worker has written."""


@dataclass(frozen=True)
class _Piece:
    """What a task computes: neighbouring blocks, or a part of one that lost its worker before."""

    first: int
    batches: tuple[CaseBatch, ...]
    variant: int
    attempts: int
    part_of: int = 0
    """Cases of the whole block, if this is a part of it."""
    files: range = range(0)
    """Whole files of a large campaign, whose worker plans the batches itself."""
    count: int = 0
    """Blocks in these files."""


@dataclass
class _Campaign:
    plan: CampaignPlan
    checkpoints: Checkpoints | None
    stored: StoredBlocks | None
    limit_s: float | None
    tries: int
    group_blocks: int | None
    stop: StopRule | None
    tell: Callable[[int], None] | None = None
    tell_failures: Callable[[int], None] | None = None
    tell_metrics: Callable[[Sequence[str]], None] | None = None
    stopped: str = ""
    _held: dict[int, BlockOutcome] = field(default_factory=dict)
    _prefix: list[BlockOutcome] = field(default_factory=list)
    _length: int = 0
    _by_value: bool = field(init=False)
    _done: NDArray[np.bool_] = field(init=False)
    _parts: dict[int, dict[int, BlockOutcome]] = field(default_factory=dict)
    _again: deque[_Piece] = field(default_factory=deque)
    _under_way: dict[int, _Piece] = field(default_factory=dict)
    _known: BlockOutcome | None = None
    _seconds: deque[float] = field(default_factory=lambda: deque(maxlen=32))
    _block_bytes: int = 1
    _tasks: int = 0
    _failures: int = 0
    _left: int = 0

    def __post_init__(self) -> None:
        self._done = np.zeros(self.plan.blocks, dtype=np.bool_)
        self._by_value = self.stored is None or not self.stored.by_workers

    @property
    def over(self) -> bool:
        return bool(self.stopped) or self._length == self.plan.blocks

    def outcomes(self) -> Sequence[BlockOutcome]:
        return complete_metrics(self._prefix) if self.stored is None else self.stored

    def resume(self) -> None:
        """Read the blocks that an interrupted run has finished."""
        for receipt in () if self.stored is None else self.stored.load():
            self._book_file(receipt)
        kept = self.checkpoints.load() if self.checkpoints else {}
        for number in sorted(kept):
            if number < self.plan.blocks and not self._done[number]:
                self._book(number, kept[number])
        self._left = self.plan.blocks - int(np.count_nonzero(self._done))
        self._go_on()

    def run(self, crew: Crew) -> None:
        fresh = self._groups(crew.slots)
        while not self.over:
            self._refill(crew, fresh)
            outcome = crew.outcome()
            finished = self._take(outcome)
            # The worker goes on while this process writes.
            self._refill(crew, fresh)
            for part in finished:
                if isinstance(part, FileReceipt):
                    self._book_file(part)
                    continue
                first, outcomes = part
                if self.checkpoints and not self._is_file(first, outcomes):
                    self.checkpoints.save(first, outcomes)
                    outcomes = [replace(one, histories=None) for one in outcomes]
                for number, one in enumerate(outcomes, first):
                    self._book(number, one)
            self._go_on()

    def _is_file(self, first: int, outcomes: Sequence[BlockOutcome]) -> bool:
        """Return whether blocks fill a file of their own, and need no checkpoint."""
        if self.stored is None or any(one.histories is not None for one in outcomes):
            return False
        of = first // self.stored.files.blocks_per_file
        return self.stored.files.blocks(of) == range(first, first + len(outcomes))

    def _refill(self, crew: Crew, fresh: Iterator[_Piece]) -> None:
        while len(self._under_way) < crew.slots:
            piece = self._again.popleft() if self._again else next(fresh, None)
            if piece is None:
                return
            limit_s = self._limit(piece.count or len(piece.batches))
            ready_limit_s = None
            if self.limit_s is not None:
                ready_limit_s = max(LEAST_READY_S, READY_LIMITS * self.limit_s)
            limits: dict[str, Any] = {"limit_s": limit_s, "ready_limit_s": ready_limit_s}
            task: Task | StoredTask
            if piece.files:
                task = StoredTask(self._tasks, piece.files, piece.variant, **limits)
            else:
                task = Task(self._tasks, piece.batches, piece.variant, **limits)
            self._tasks += 1
            self._under_way[task.number] = piece
            crew.submit(task)

    def _limit(self, blocks: int) -> float | None:
        """Return the limit of a task: that of a block, and what the others take at most as a rule.

        A task of several blocks that takes longer, as it may, is divided, and each block then has
        the whole limit; so that a block without end does not hold up a worker for many limits.
        """
        if self.limit_s is None:
            return None
        usual = 4.0 * median(self._seconds) if self._seconds else self.limit_s
        return self.limit_s + (blocks - 1) * min(self.limit_s, usual)

    def _groups(self, slots: int) -> Iterator[_Piece]:
        """Yield neighbouring blocks of one variant that are not done."""
        group: list[CaseBatch] = []
        first, variant, size, end = 0, 0, 1, 0
        for number in range(self.plan.blocks):
            if number < end or self._done[number]:
                continue
            begins = self.stored is not None and number % self.stored.files.blocks_per_file == 0
            if begins and group:
                yield _Piece(first, tuple(group), variant, self.tries)
                group = []
            if begins and (files := self._whole_files(number, slots)) is not None:
                end = number + files.count
                self._left -= files.count
                yield files
                continue
            batch, of = self.plan.block(number)
            if group and (of != variant or number != first + len(group) or len(group) >= size):
                yield _Piece(first, tuple(group), variant, self.tries)
                group = []
            if not group:
                first, variant, size = number, of, self._size(slots)
            group.append(batch)
            self._left -= 1
        if group:
            yield _Piece(first, tuple(group), variant, self.tries)

    def _whole_files(self, number: int, slots: int) -> _Piece | None:
        """Return the files that begin with a block as one task, if they are quick enough."""
        if self.stored is None or self._by_value or self.group_blocks or not self._seconds:
            return None
        of = self.stored.files
        first = number // of.blocks_per_file
        most = files_of_task(median(self._seconds), of.blocks_per_file, self._left, slots)
        variant, count, last = of.plan.variant_of(number), 0, first
        while last < first + most and (blocks := of.blocks(last)):
            is_new = not self._done[blocks.start : blocks.stop].any()
            if not is_new or of.plan.variant_of(blocks[-1]) != variant:
                break
            last, count = last + 1, count + len(blocks)
        if not count:
            return None
        return _Piece(number, (), variant, self.tries, files=range(first, last), count=count)

    def _size(self, slots: int) -> int:
        if self.group_blocks is not None:
            return self.group_blocks
        if not self._seconds:
            return 1
        return blocks_of_task(median(self._seconds), self._block_bytes, self._left, slots)

    def _take(self, outcome: Outcome) -> _Blocks | _Stored:
        """Return the blocks or files that this outcome completes."""
        piece = self._under_way.pop(outcome.task.number)
        match outcome:
            case Finished() if piece.files:
                return self._take_files(piece, outcome.value)
            case Finished():
                self._seconds.extend(o.seconds for o in outcome.value)
                for one in outcome.value:
                    if one.histories is not None:
                        self._block_bytes = max(self._block_bytes, one.histories.values.nbytes)
                if not piece.part_of:
                    return [(piece.first, outcome.value)]
                return self._with_part(piece, piece.part_of, outcome.value[0])
            case Lost():
                return self._lost(piece, outcome)
            case Failed():
                error = StageError(outcome.error)
                if outcome.detail:
                    error.add_note(outcome.detail)
                raise error

    def _take_files(
        self, piece: _Piece, value: Sequence[FileReceipt | BlockOutcome]
    ) -> _Blocks | _Stored:
        """Return what came of whole files; those that cannot be seen here are computed again."""
        assert self.stored is not None
        receipts = [one for one in value if isinstance(one, FileReceipt)]
        outcomes = [one for one in value if isinstance(one, BlockOutcome)]
        accepted = [one for one in receipts if self.stored.accept(one)]
        seconds = sum(one.seconds for one in value) / piece.count
        self._seconds.append(seconds)
        if len(accepted) == len(receipts) and not outcomes:
            return accepted
        # Workers with other storage: from now on blocks come as they are.
        self._by_value = True
        if not receipts:
            blocks: _Blocks = [(piece.first, outcomes)]
            return blocks
        written = {one.number for one in accepted}
        missing = [number for number in piece.files if number not in written]
        for number in (block for of in missing for block in self.stored.files.blocks(of)):
            self._again.append(self._single(number, piece.attempts))
        return accepted

    def _single(self, number: int, attempts: int) -> _Piece:
        """Return a block as a task of its own."""
        batch, variant = self.plan.block(number)
        return _Piece(number, (batch,), variant, attempts)

    def _lost(self, piece: _Piece, lost: Lost) -> _Blocks:
        """Repeat or divide a lost task; a single case that is lost is undecided."""
        if piece.attempts > 1:
            self._again.append(replace(piece, attempts=piece.attempts - 1))
            return []
        if piece.files:
            for number in range(piece.first, piece.first + piece.count):
                self._again.append(self._single(number, attempts=1))
            return []
        if len(piece.batches) > 1:
            for number, batch in enumerate(piece.batches, piece.first):
                self._again.append(_Piece(number, (batch,), piece.variant, attempts=1))
            return []
        (batch,) = piece.batches
        lanes = np.flatnonzero(~batch.filler)
        cases = piece.part_of or len(lanes)
        if len(lanes) == 1:
            what = "its worker was" if lost.how == "time_limit" else "its worker ended:"
            row = lost_rows(batch.numbers[lanes], lost.how, "", f"{what} {lost.detail}")
            return self._with_part(piece, cases, row)
        for some in np.array_split(lanes, min(PARTS, len(lanes))):
            # A case is lost for good only if it was tried as often as its block.
            attempts = self.tries if len(some) == 1 else 1
            self._again.append(
                _Piece(piece.first, (only(batch, some),), piece.variant, attempts, cases)
            )
        return []

    def _with_part(self, piece: _Piece, cases: int, outcome: BlockOutcome) -> _Blocks:
        """Put a part of a block to the others."""
        parts = self._parts.setdefault(piece.first, {})
        parts[int(np.flatnonzero(~piece.batches[0].filler)[0])] = outcome
        if sum(len(o.numbers) for o in parts.values()) < cases:
            return []
        del self._parts[piece.first]
        return [(piece.first, [join_outcomes([parts[lane] for lane in sorted(parts)])])]

    def _book(self, number: int, outcome: BlockOutcome) -> None:
        """Enter a finished block into the list of outcomes."""
        self._check_metrics(outcome)
        self._done[number] = True
        if self.stored is None:
            self._held[number] = outcome
        else:
            self.stored.hold(number, outcome)
            if self.checkpoints and self.stored.is_written(number):
                self.checkpoints.drop(self.stored.files.blocks_beside(number))
        self._tell(len(outcome.numbers), int(np.count_nonzero(decided_failures(outcome))))

    def _book_file(self, receipt: FileReceipt) -> None:
        """Enter a file that is written into the list of outcomes."""
        assert self.stored is not None
        empty = lost_rows(np.zeros(0, dtype=np.int64), "", "", "")
        names: dict[str, Any] = {"metrics": receipt.metrics, "units": receipt.units}
        self._check_metrics(replace(empty, **names, values=np.zeros((len(receipt.metrics), 0))))
        blocks = self.stored.files.blocks(receipt.number)
        self._done[blocks.start : blocks.stop] = True
        self._tell(receipt.cases, receipt.failures)

    def _check_metrics(self, outcome: BlockOutcome) -> None:
        """Raise unless an outcome has the metrics of the earlier ones."""
        if self._known is None:
            self._known = outcome if outcome.metrics else None
            if self._known and self.tell_metrics:
                self.tell_metrics(outcome.metrics)
        else:
            complete_metrics([self._known, outcome])

    def _tell(self, cases: int, failures: int) -> None:
        if failures:
            self._failures += failures
            if self.tell_failures:
                self.tell_failures(self._failures)
        if self.tell:
            self.tell(cases)

    def _go_on(self) -> None:
        """Lengthen the part of the list without gaps, and ask after each block whether to stop."""
        while not self.over and self._done[self._length]:
            self._length += 1
            if self.stored is None:
                self._prefix.append(self._held.pop(self._length - 1))
            else:
                self.stored.lengthen(self._length)
            if self.stop:
                self.stopped = self.stop(self._prefix if self.stored is None else self.stored)
        if self.tell:
            self.tell(0)
