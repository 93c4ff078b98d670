"""A large campaign in files: the results of a small one, the same bytes however it was computed."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from tests.core.uncertainty.toy_mission import Hover, toy_repeated

from hillsphere.base.arrays import Array
from hillsphere.cases import stored_blocks
from hillsphere.cases.block_outcome import BlockOutcome
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated, RepeatedWork
from hillsphere.cases.stored_blocks import BlockFiles, StoredBlocks
from hillsphere.errors import Interrupted, StageError
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.interfaces.tasks import Finished, Lost, Outcome, StoredTask, Work
from hillsphere.products import CaseTable, load_product, save_product
from hillsphere.products.columns import Columns
from hillsphere_campaigns import sensitivity
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.case_table import table_of
from hillsphere_campaigns.engine import run_campaign
from hillsphere_campaigns.export import export_csv
from hillsphere_campaigns.presentation import present_campaign
from hillsphere_campaigns.task_sizes import files_of_task

CASES = 1500
"""24 blocks, in files of 4: the last one has fewer."""

TABLES = """
[dispersions.start]
type = "normal"
of = "stage.hover"
parameters = ["state.x", "state.y"]
sigma = 100.0
"""


class Flight(Hover):
    """A toy that fails, raises, and yields what is no number."""

    def run_cases(self, batch: CaseBatch, history: bool = False) -> CaseResults:
        x, y = batch.value("state.x", 20e3), batch.value("state.y", 0.0)
        if (batch.numbers == 700).any():
            raise ValueError("case 700")
        values: Array = np.array([x, np.hypot(x - 20e3, y), x * y])
        values[2, batch.numbers % 97 == 3] = np.nan
        failed = values[1] > 200.0
        status = ["impact" if one else "completed" for one in failed]
        cause = ["ground" if one else "" for one in failed]
        units = ("m", "m", "m2")
        return CaseResults(("x", "r", "xy"), units, values, tuple(status), tuple(cause), failed)


@pytest.fixture(scope="module")
def repeated(tmp_path_factory: pytest.TempPathFactory) -> Repeated:
    return toy_repeated(tmp_path_factory.mktemp("toys"), TABLES)


@pytest.fixture(autouse=True)
def _small_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stored_blocks, "LEAST_BLOCKS", 4)
    for name in ("run_cases",):
        monkeypatch.setattr(Hover, name, getattr(Flight, name))


def planned(repeated: Repeated) -> Plan:
    return plan_of(repeated, ("start",), cases=CASES, stream="many")


class Shuffled:
    """Tasks end in any order, and some are lost; `elsewhere`: with storage of their own."""

    def __init__(self, slots: int, elsewhere: Path | None = None, chance: float = 0.2) -> None:
        self.slots, self.elsewhere, self.chance = slots, elsewhere, chance
        self.kinds: list[type] = []
        self._random = random.Random(slots)

    def crew(self, work: Work) -> Shuffled:
        if self.elsewhere is not None:
            assert isinstance(work, RepeatedWork)
            assert work.files is not None
            there = BlockFiles(self.elsewhere, work.files.fingerprint, work.files.plan)
            work = RepeatedWork(work.variants, work.bands, there)
        self._do = work.prepare()
        self._under_way: list[Any] = []
        return self

    def __enter__(self) -> Shuffled:
        return self

    def __exit__(self, *exc: object) -> None:
        pass

    def submit(self, task: Any) -> None:
        self.kinds.append(type(task))
        self._under_way.append(task)

    def outcome(self) -> Outcome:
        task = self._under_way.pop(self._random.randrange(len(self._under_way)))
        if self._random.random() < self.chance:
            return Lost(task, "killed", "signal 9 (SIGKILL)")
        return Finished(task, self._do(task))


def run(repeated: Repeated, directory: Path, executor: Any = None, **options: Any) -> CaseTable:
    plan = planned(repeated)
    files = BlockFiles(directory, "f", plan)
    outcomes, stopped = run_campaign(
        plan, RepeatedWork(plan.variants, (), files), executor=executor or Serial(SerialSpec()),
        checkpoints=Checkpoints(directory, "f"), stored=StoredBlocks(files), tries=20, **options,
    )  # fmt: skip
    return table_of(plan, outcomes, "hover", stopped)


def in_memory(repeated: Repeated, **options: Any) -> CaseTable:
    plan = planned(repeated)
    outcomes, stopped = run_campaign(
        plan, RepeatedWork(plan.variants), executor=Serial(SerialSpec()), **options
    )
    return table_of(plan, outcomes, "hover", stopped)


def digests(directory: Path) -> dict[str, str]:
    return {
        path.name: sha256(path.read_bytes()).hexdigest() for path in sorted(directory.iterdir())
    }


def assert_same(a: CaseTable, b: CaseTable) -> None:
    for field in fields(CaseTable):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if isinstance(x, np.ndarray):
            assert_array_equal(np.asarray(y), x, err_msg=field.name)
            assert np.asarray(y).dtype == x.dtype
        else:
            assert x == y, field.name


def test_the_table_and_all_that_is_shown_are_those_of_a_campaign_in_memory(
    repeated: Repeated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sensitivity, "ROOM_BYTES", 1)  # one input at a time
    known, table = in_memory(repeated), run(repeated, tmp_path / "work")
    assert isinstance(table.values, Columns)
    assert isinstance(table.input_values, Columns)
    assert_same(known, table)
    assert "ValueError: case 700" in table.messages
    path = tmp_path / "many.npz"
    save_product(path, table)
    loaded = load_product(path)
    assert_same(known, loaded)
    shown, expected = (present_campaign(t, show=("r", "x")) for t in (loaded, known))
    assert repr(shown.tables) == repr(expected.tables)
    assert shown.verdict == expected.verdict
    assert repr(shown.metrics) == repr(expected.metrics)
    assert repr(shown.figures) == repr(expected.figures)
    for t, name in ((loaded, "a.csv"), (known, "b.csv")):
        export_csv(t, tmp_path / name)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_any_number_of_workers_writes_the_same_bytes(repeated: Repeated, tmp_path: Path) -> None:
    run(repeated, tmp_path / "one")
    reference = digests(tmp_path / "one")
    assert sorted(reference) == [f"cases-{i:07d}.npy" for i in range(6)]
    for slots in (2, 3, 7):
        executor = Shuffled(slots)
        run(repeated, tmp_path / str(slots), executor)
        assert StoredTask in executor.kinds
        assert digests(tmp_path / str(slots)) == reference
    for blocks in (1, 3):  # outcomes by value, of which the run makes the files
        run(repeated, tmp_path / f"g{blocks}", Shuffled(3), group_blocks=blocks)
        assert digests(tmp_path / f"g{blocks}") == reference


@pytest.mark.parametrize("exists", [True, False])
def test_workers_with_other_storage_send_their_outcomes(
    repeated: Repeated, tmp_path: Path, exists: bool
) -> None:
    elsewhere = tmp_path / "elsewhere"
    if exists:
        elsewhere.mkdir()
    run(repeated, tmp_path / "one")
    executor = Shuffled(2, elsewhere, chance=0.0)
    run(repeated, tmp_path / "two", executor)
    assert digests(tmp_path / "two") == digests(tmp_path / "one")
    assert executor.kinds.count(StoredTask) <= 2  # then it is known


def interrupting(after: int) -> Callable[[int], None]:
    done = 0

    def advance(cases: int) -> None:
        nonlocal done
        done += cases
        if done >= after:
            raise Interrupted("enough")

    return advance


def test_an_interrupted_campaign_goes_on(repeated: Repeated, tmp_path: Path) -> None:
    run(repeated, tmp_path / "one")
    work = tmp_path / "work"
    for after in (100, 500, 600):
        with pytest.raises(Interrupted):
            run(repeated, work, Shuffled(2), advance=interrupting(after))
    kept = [p.name for p in work.glob("cases-*.npy")]
    assert kept
    (work / ".cases-0000005.npy.0123abcd.part").write_bytes(b"half")
    whole = (work / kept[0]).read_bytes()
    (work / kept[0]).write_bytes(whole[:-9])
    computed: list[int] = []
    run(repeated, work, advance=computed.append)
    assert (work / f"{kept[0]}.set-aside").read_bytes() == whole[:-9]
    (work / f"{kept[0]}.set-aside").unlink()
    assert digests(work) == digests(tmp_path / "one")
    assert sum(computed) == CASES  # told of all, those of files included
    again: list[int] = []
    run(repeated, work, Shuffled(1, chance=1.0), advance=again.append)  # nothing is left to do
    assert sum(again) == CASES


@pytest.mark.parametrize("blocks", [1, 4, 10])
def test_an_early_end_cuts_the_files(repeated: Repeated, tmp_path: Path, blocks: int) -> None:
    def stop(prefix: Any) -> str:
        assert isinstance(prefix[-1], BlockOutcome)
        return "enough" if len(prefix) == blocks else ""

    known = in_memory(repeated, stop=stop)
    assert known.case.size == 64 * blocks
    reference = {}
    for slots in (1, 5):
        work = tmp_path / str(slots)
        table = run(repeated, work, Shuffled(slots), stop=stop)
        assert_same(known, table)
        reference[slots] = {k: v for k, v in digests(work).items() if k.startswith("cases-")}
    assert reference[1] == reference[5]


def test_a_full_disk_is_told(
    repeated: Repeated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(stored_blocks, "write_columns", full)
    with pytest.raises(StageError, match=r"cases-0000000\.npy cannot be written: No space left"):
        run(repeated, tmp_path / "work")


def test_the_size_of_a_task_keeps_the_scheduler_free() -> None:
    """1000 workers with 10⁹ cases of half a millisecond: at most 200 tasks per second."""
    blocks = 10**9 // 64
    per_file = stored_blocks.BlockFiles(Path(), "", _Blocks(blocks)).blocks_per_file
    files = files_of_task(64 * 0.5e-3, per_file, blocks, slots=1000)
    assert files >= 1
    assert 1000 / (files * per_file * 64 * 0.5e-3) < 200
    # A cheap case, of which a file takes 20 ms: many files a task.
    files = files_of_task(64 * 20e-6, per_file, blocks, slots=1000)
    assert 1000 / (files * per_file * 64 * 20e-6) < 200
    # A file of an hour is no task.
    assert files_of_task(60.0, 64, 10**6, slots=8) == 0
    # At the end nobody is left alone with a file of two seconds.
    assert files_of_task(2.0 / 64, 64, 64 * 3, slots=2) == 0


class _Blocks:
    def __init__(self, blocks: int) -> None:
        self.blocks = blocks

    def __getattr__(self, name: str) -> Any:
        raise NotImplementedError
