"""Whatever is lost, divided, delayed or interrupted: the list of outcomes is the same."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.core.cases.toy_cases import Misshapen, StageWork, Toy, ToyPlan, same

from hillsphere.cases.block_outcome import BlockOutcome
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.cases.repeated import RepeatedWork
from hillsphere.errors import Interrupted, StageError
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.interfaces.tasks import Finished, Job, Lost, Outcome, Task, Work
from hillsphere_campaigns.engine import run_campaign

PLAN = ToyPlan(1000)
WORK = StageWork([Toy()])
SERIAL = Serial(SerialSpec())
KILLERS = (3, 100, 101, 999)


@dataclass
class Scripted:
    """Tasks under way end in any order; those that hold a killer, or by chance, are lost."""

    slots: int = 1
    seed: int = 0
    killers: Sequence[int] = ()
    chance: float = 0.0
    how: str = "killed"
    tasks: list[Task] = field(default_factory=list)

    def crew(self, work: Work) -> Scripted:
        self._do = work.prepare()
        self._random = random.Random(self.seed)
        self._under_way: list[Task] = []
        return self

    def __enter__(self) -> Scripted:
        return self

    def __exit__(self, *exc: object) -> None:
        self._under_way = []

    def submit(self, task: Job) -> None:
        assert isinstance(task, Task)
        assert len(self._under_way) < self.slots
        self._under_way.append(task)
        self.tasks.append(task)

    def outcome(self) -> Outcome:
        task = self._under_way.pop(self._random.randrange(len(self._under_way)))
        numbers = np.concatenate([batch.numbers for batch in task.blocks])
        if np.isin(self.killers, numbers).any() or self._random.random() < self.chance:
            return Lost(task, self.how, "signal 9 (SIGKILL)")
        return Finished(task, self._do(task))


def run(executor: Any = SERIAL, work: Work = WORK, **options: Any) -> list[BlockOutcome]:
    return run_campaign(PLAN, work, executor=executor, **options)[0]


REFERENCE = run()


def test_outcomes_are_those_of_the_blocks() -> None:
    assert [len(o.numbers) for o in REFERENCE] == [64] * 15 + [40]
    assert np.concatenate([o.numbers for o in REFERENCE]).tolist() == list(range(1000))
    direct = Toy().run_cases(PLAN.block(15)[0])
    assert REFERENCE[15].values.tobytes() == direct.values[:, :40].tobytes()


@pytest.mark.parametrize("group_blocks", [1, 3, 5, 7, 100])
@pytest.mark.parametrize("slots", [1, 2, 4])
def test_order_and_grouping_change_nothing(slots: int, group_blocks: int) -> None:
    executor = Scripted(slots, seed=slots + group_blocks)
    assert same(run(executor, group_blocks=group_blocks), REFERENCE)
    assert {len(task.blocks) for task in executor.tasks[:-1]} <= {group_blocks}
    assert len({task.number for task in executor.tasks}) == len(executor.tasks)


@settings(max_examples=25, deadline=None)
@given(
    slots=st.integers(1, 5),
    group_blocks=st.one_of(st.none(), st.integers(1, 9)),
    seed=st.integers(0, 2**32),
    chance=st.floats(0.0, 0.3),
)
def test_killers_are_found_and_nobody_else_is_hurt(
    slots: int, group_blocks: int | None, seed: int, chance: float
) -> None:
    executor = Scripted(slots, seed, KILLERS, chance)
    found = run(executor, group_blocks=group_blocks, tries=12)
    whole = {n: (i, j) for i, o in enumerate(found) for j, n in enumerate(o.numbers.tolist())}
    assert list(whole) == list(range(1000))
    for number, (i, j) in whole.items():
        if number in KILLERS:
            assert (found[i].status[j], found[i].cause[j]) == ("killed", "")
            assert np.isnan(found[i].values[:, j]).all()
            told = dict(zip(found[i].message_case.tolist(), found[i].messages, strict=True))
            assert told[number] == "its worker ended: signal 9 (SIGKILL)"
        else:
            assert found[i].values[:, j].tobytes() == REFERENCE[i].values[:, j].tobytes()
            assert found[i].status[j] == REFERENCE[i].status[j]
            assert found[i].failed[j] == REFERENCE[i].failed[j]


def test_how_often_what_is_tried() -> None:
    executor = Scripted(killers=[100], how="time_limit")
    found = run(executor, group_blocks=4, limit_s=2.5)
    assert {task.ready_limit_s for task in executor.tasks} == {300.0}
    assert (found[1].status[36], found[1].failed[36]) == ("time_limit", False)
    assert found[1].messages == ("its worker was signal 9 (SIGKILL)",)
    tried = [
        (len(task.blocks), int((~task.blocks[0].filler).sum()), task.limit_s)
        for task in executor.tasks
        if any(100 in batch.numbers for batch in task.blocks)
    ]
    # The group three times, its block, eight of its cases, and the case itself three times.
    assert tried == [(4, 64, 10.0)] * 3 + [(1, 64, 2.5)] + [(1, 8, 2.5)] + [(1, 1, 2.5)] * 3


def test_a_group_waits_for_one_block_without_end_not_for_many() -> None:
    executor = Scripted()
    run(executor, group_blocks=4, limit_s=1000.0)
    assert {task.ready_limit_s for task in executor.tasks} == {10_000.0}
    first, *others = (task.limit_s for task in executor.tasks)
    assert first == 4000.0
    assert all(limit is not None and 1000.0 < limit < 1100.0 for limit in others)


def test_a_task_that_is_lost_by_accident_is_done_again() -> None:
    class Once(Scripted):
        def outcome(self) -> Outcome:
            self.killers = [100] if len(self.tasks) < 5 else []
            return super().outcome()

    assert same(run(Once(), group_blocks=2), REFERENCE)


def test_every_case_kills() -> None:
    plan = ToyPlan(70)
    executor = Scripted(2, killers=range(70))
    found, _ = run_campaign(plan, WORK, executor=executor, tries=1)
    assert [o.metrics for o in found] == [(), ()]
    assert all((o.status == "killed").all() for o in found)
    assert np.concatenate([o.numbers for o in found]).tolist() == list(range(70))


def test_every_case_raises_in_one_block_or_in_all() -> None:
    some = run(work=StageWork([Toy(dict.fromkeys(range(64), "raise"))]))
    assert some[0].metrics == ("x", "y")
    assert np.isnan(some[0].values).all()
    assert same(some[1:], REFERENCE[1:])
    every = run(work=StageWork([Toy(dict.fromkeys(range(1000), "raise"))]))
    assert {o.metrics for o in every} == {()}
    assert all((o.status == "error").all() and not o.failed.any() for o in every)


def test_a_task_never_mixes_variants() -> None:
    plan = ToyPlan(150, variants=3)
    stages = [Toy(), Toy(rounds=2), Toy(rounds=3)]
    executor = Scripted(2, seed=5)
    found, _ = run_campaign(plan, StageWork(stages), executor=executor, group_blocks=5)
    assert [(task.variant, len(task.blocks)) for task in executor.tasks] == [(0, 3), (1, 3), (2, 3)]
    alone, _ = run_campaign(plan, StageWork(stages), executor=SERIAL, group_blocks=1)
    assert same(found, alone)


def few_failures(prefix: Sequence[BlockOutcome]) -> str:
    failed = sum(int(o.failed.sum()) for o in prefix)
    return f"{failed} failed" if failed > 100 else ""


@pytest.mark.parametrize("slots", [1, 3, 8])
@pytest.mark.parametrize("group_blocks", [None, 1, 3, 16])
def test_the_end_does_not_depend_on_the_order(slots: int, group_blocks: int | None) -> None:
    seen: list[int] = []

    def stop(prefix: Sequence[BlockOutcome]) -> str:
        seen.append(len(prefix))
        return few_failures(prefix)

    ends = next(n for n in range(1, 17) if few_failures(REFERENCE[:n]))
    assert 1 < ends < 16
    found, why = run_campaign(
        PLAN, WORK, executor=Scripted(slots, seed=slots), group_blocks=group_blocks, stop=stop
    )
    assert seen == list(range(1, ends + 1))
    assert why == few_failures(REFERENCE[:ends])
    assert same(found, REFERENCE[:ends])


def test_an_end_that_was_reached_before_needs_no_crew(tmp_path: Path) -> None:
    def checkpoints() -> Checkpoints:
        return Checkpoints(tmp_path, "f")

    whole = run(Scripted(4), checkpoints=checkpoints(), group_blocks=2)

    class Nobody:
        def crew(self, work: Work) -> Any:
            raise AssertionError("nothing is left to do")

    assert same(run(Nobody(), checkpoints=checkpoints()), whole)
    found, why = run_campaign(
        PLAN, WORK, executor=Nobody(), checkpoints=checkpoints(), stop=few_failures
    )
    assert why
    assert same(found, REFERENCE[: len(found)])


def test_what_is_told_on_the_way(tmp_path: Path) -> None:
    done: list[int] = []
    failures: list[int] = []
    options: dict[str, Any] = {"advance": done.append, "on_failures": failures.append}
    found = run(Scripted(3), checkpoints=Checkpoints(tmp_path, "f"), **options)
    assert sum(done) == 1000
    assert failures == sorted(set(failures))
    assert failures[-1] == sum(int(o.failed.sum()) for o in found)
    # What was kept counts as done.
    again: list[int] = []
    run(checkpoints=Checkpoints(tmp_path, "f"), advance=again.append)
    assert sum(again) == 1000


@pytest.mark.parametrize("error", [Interrupted, KeyboardInterrupt])
def test_an_interrupted_campaign_keeps_what_is_finished(
    tmp_path: Path, error: type[BaseException]
) -> None:
    done = 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        if done > 300:
            raise error

    with pytest.raises(error):
        run(advance=advance, checkpoints=Checkpoints(tmp_path, "f"), group_blocks=1)
    assert sorted(Checkpoints(tmp_path, "f").load()) == [0, 1, 2, 3, 4]
    assert same(run(checkpoints=Checkpoints(tmp_path, "f")), REFERENCE)


def test_blocks_are_made_when_they_are_needed() -> None:
    made: list[int] = []

    class Watched(ToyPlan):
        def block(self, number: int) -> tuple[CaseBatch, int]:
            made.append(number)
            return super().block(number)

    ahead: list[int] = []
    run_campaign(
        Watched(6400), WORK, executor=SERIAL, group_blocks=3,
        stop=lambda prefix: ahead.append(max(made) - len(prefix)) or "",  # type: ignore[func-returns-value]
    )  # fmt: skip
    assert made == list(range(100))
    # The rest of the task that is finished, the next of three blocks, and one looked at.
    assert max(ahead) <= 2 + 3 + 1


def test_groups_grow_to_about_a_second_and_shrink_towards_the_end() -> None:
    class Timed(Scripted):
        def outcome(self) -> Outcome:
            outcome = super().outcome()
            assert isinstance(outcome, Finished)
            for one in outcome.value:
                object.__setattr__(one, "seconds", 0.1)
            return outcome

    executor = Timed(2)
    run_campaign(ToyPlan(6400), WORK, executor=executor)
    sizes = [len(task.blocks) for task in executor.tasks]
    assert sum(sizes) == 100
    assert sizes[:2] == [1, 1]
    assert max(sizes) == 10
    # From the first outcome on a second's work, ten, but at most half of each of two workers' share
    # of what is left.
    left, expected = 98, [1, 1]
    while left:
        expected.append(max(1, min(10, left // 4)))
        left -= expected[-1]
    assert sizes == expected
    assert sizes[-4:] == [1, 1, 1, 1]


def test_an_error_of_the_stage_ends_the_campaign() -> None:
    with pytest.raises(StageError, match=r"Misshapen.run_cases .*values .*got \(2, 3\)") as caught:
        run(work=StageWork([Misshapen()]))
    assert "Traceback" in caught.value.__notes__[0]


def test_metrics_that_change_end_the_campaign() -> None:
    class Fickle(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            results = super().run_cases(batch)
            names = ("x", "y") if batch.numbers[0] < 200 else ("x", "z")
            return CaseResults(
                names, results.units, results.values, results.status, results.cause, results.failed
            )

    with pytest.raises(StageError, match=r"metrics x .*, z .* for cases 256 to 319, but x .*, y"):
        run(work=StageWork([Fickle()]))


def test_stages_are_built_and_compiled_before_the_clock_runs() -> None:
    told: list[str] = []

    class Compiled(Toy):
        def prepare_cases(self, names: tuple[str, ...], **inputs: Any) -> None:
            told.append(f"compiled for {names}")

    @dataclass
    class Variant:
        number: int
        inputs: dict[str, Any] = field(default_factory=dict)

        def build(self) -> Any:
            told.append(f"built {self.number}")
            return Compiled()

    variants: Any = (Variant(0), Variant(1))
    do: Any = RepeatedWork(variants).prepare()
    batch, _ = PLAN.block(0)
    do.ready(Task(0, (batch,)))
    assert told == ["built 0", "compiled for ('a', 'b')"]
    assert same(do(Task(0, (batch,))), REFERENCE[:1])
    # A task may hold blocks of several designs.
    other, _ = PLAN.block(1)
    do.ready(Task(0, (batch, replace(batch, names=("b", "a")), other)))
    assert told[2:] == ["compiled for ('a', 'b')", "compiled for ('b', 'a')"]
    del told[2:]
    # Blocks of a variant follow each other: only the stage of the last one is kept.
    do(Task(1, (batch,), variant=1))
    do(Task(2, (batch,), variant=1))
    do(Task(3, (batch,), variant=0))
    assert told[2:] == ["built 1", "built 0"]


def test_work_that_cannot_be_prepared() -> None:
    class Hopeless:
        def prepare(self) -> Callable[[Task], Any]:
            raise ValueError("no\nfield")

    with pytest.raises(StageError, match=r"^ValueError: no field\n"):
        run(work=Hopeless())


def test_a_crew_of_this_process_takes_one_task_at_a_time() -> None:
    task = Task(0, (PLAN.block(0)[0],))
    with SERIAL.crew(WORK) as crew:
        with pytest.raises(RuntimeError, match="no task is under way"):
            crew.outcome()
        crew.submit(task)
        with pytest.raises(RuntimeError, match="task 0 is still under way"):
            crew.submit(task)
        assert isinstance(crew.outcome(), Finished)
