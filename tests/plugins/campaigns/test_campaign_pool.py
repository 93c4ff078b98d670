"""Worker processes that compute, die, hang and are killed, for real."""

from __future__ import annotations

import errno
import os
import random
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.core.cases.toy_cases import ROOT, StageWork, Toy, ToyPlan, Unprepared, same
from tests.core.cases.toy_loop import Loop

from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors import pool as executors_pool
from hillsphere.cases.executors.pool import Pool, PoolCrew
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import PoolSpec, SerialSpec
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces.tasks import Failed, Finished, Lost, Outcome, Task, Work
from hillsphere_campaigns.engine import run_campaign

PLAN = ToyPlan(330)
SERIAL = Serial(SerialSpec())
LOOP = StageWork([Loop])


@pytest.fixture(autouse=True)
def _importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers find modules where the process that starts them does."""
    monkeypatch.syspath_prepend(str(ROOT))


@pytest.fixture(autouse=True)
def _no_process_stays() -> Iterator[None]:
    before = children(os.getpid())
    yield
    assert children(os.getpid()) - before == set()


def children(pid: int) -> set[int]:
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()
    return {int(child) for child in listed}


def pool(workers: int) -> Pool:
    return Pool(PoolSpec(workers=workers))


def run(executor: Any, work: Work, plan: ToyPlan = PLAN, **options: Any) -> list[Any]:
    return run_campaign(plan, work, executor=executor, **options)[0]


@pytest.fixture(scope="module")
def flown() -> list[Any]:
    return run(SERIAL, LOOP)


@pytest.mark.parametrize(("workers", "group_blocks"), [(1, 7), (3, None)])
def test_workers_and_grouping_change_no_bit(
    workers: int, group_blocks: int | None, flown: list[Any]
) -> None:
    assert same(run(pool(workers), LOOP, group_blocks=group_blocks), flown)
    assert {len(set(o.values[0].tolist())) for o in flown} == {64, 10}


def test_cases_that_cost_their_workers(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    sound = run(SERIAL, StageWork([Toy()]))
    faults = {5: "print", 70: "kill", 130: "exit", 200: "kill once", 329: "raise"}
    work = StageWork([Toy(faults, str(tmp_path))])
    found = run(pool(2), work, tries=2)
    captured = capfd.readouterr()
    assert captured.out == ""
    assert "printed by a stage" in captured.err
    assert "written by a stage" in captured.err
    told = {n: m for o in found for n, m in zip(o.message_case.tolist(), o.messages, strict=True)}
    assert told == {
        70: "its worker ended: signal 9 (SIGKILL)",
        130: "its worker ended: exit code 3",
        329: "ZeroDivisionError: case 329 cannot be computed",
    }
    status = np.concatenate([o.status for o in found])
    assert {n: status[n] for n in told} == {
        70: "killed",
        130: "killed",
        329: "error",
    }
    innocent = ~np.isin(np.arange(330), list(told))
    values, expected = (np.concatenate([o.values for o in b], axis=1) for b in (found, sound))
    assert values[:, innocent].tobytes() == expected[:, innocent].tobytes()
    assert np.isnan(values[:, ~innocent]).all()


def test_a_case_that_does_not_end() -> None:
    plan = ToyPlan(100)
    found = run(pool(2), StageWork([Toy({20: "loop"})]), plan, limit_s=0.5, tries=1)
    sound = run(SERIAL, StageWork([Toy()]), plan)
    assert found[0].status[20] == "time_limit"
    assert found[0].messages == ("its worker was stopped after 0.5 s",)
    assert not found[0].failed[20]
    kept = np.arange(64) != 20
    assert found[0].values[:, kept].tobytes() == sound[0].values[:, kept].tobytes()
    assert same(found[1:], sound[1:])


def test_workers_killed_from_outside_at_any_moment(tmp_path: Path, flown: list[Any]) -> None:
    """Kills fall on workers that start, prepare, compute and send."""
    killed, over = 0, threading.Event()

    def kill() -> None:
        nonlocal killed
        chance = random.Random(4)
        # Five deaths in a row before any worker is ready would rightly be taken for a fault.
        while killed < 4 and not over.wait(chance.uniform(0.0, 0.5)):
            for child in sorted(children(os.getpid()))[:1]:
                os.kill(child, signal.SIGKILL)
                killed += 1

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        checkpoints = Checkpoints(tmp_path, "f")
        found = run(pool(2), LOOP, group_blocks=1, tries=5, checkpoints=checkpoints)
    finally:
        over.set()
        killer.join()
    assert killed >= 1
    assert same(found, flown)


def outcome_of(work: Work, task: Task | None = None) -> Outcome:
    with PoolCrew(work, 1) as crew:
        crew.submit(task or Task(0, (PLAN.block(0)[0],)))
        return crew.outcome()


def test_work_that_cannot_be_prepared() -> None:
    failed = outcome_of(Unprepared("raise"))
    assert isinstance(failed, Failed)
    assert failed.error == (
        "RuntimeError: there is no field (in 5 worker processes one after another)"
    )
    assert "in prepare" in failed.detail
    died = outcome_of(Unprepared("exit"))
    assert isinstance(died, Failed)
    assert died.error.startswith(
        "worker processes end before they are ready, the last with exit code 5;"
    )


@pytest.mark.parametrize("when", ["prepare", "ready"])
@pytest.mark.parametrize("workers", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_passing_fault_while_a_worker_prepares(tmp_path: Path, when: str, workers: int) -> None:
    def outcome(error: Exception, times: int) -> tuple[Outcome, int]:
        place = tmp_path / f"{type(error).__name__}-{times}"
        place.mkdir()
        work = Faulty(str(place), when, error, times)
        with PoolCrew(work, 1) if workers else SERIAL.crew(work) as crew:
            crew.submit(Task(7, ()))
            return crew.outcome(), len(list(place.iterdir()))

    busy = OSError(errno.EMFILE, "Too many open files")
    ended, tries = outcome(busy, 2)
    assert ended == Finished(Task(7, ()), 7)
    assert tries == 3
    failed, tries = outcome(MemoryError("no room"), 99)
    assert isinstance(failed, Failed)
    assert failed.error.startswith("MemoryError: no room")
    assert tries == 5
    failed, tries = outcome(InputError("no such body"), 99)
    assert (isinstance(failed, Failed) and failed.error, tries) == ("no such body", 1)
    failed, tries = outcome(ModuleNotFoundError("no such module"), 99)
    assert isinstance(failed, Failed)
    assert tries == 1


@dataclass(frozen=True)
class Faulty:
    """Work that can be prepared only after some tries, which leave files."""

    place: str
    when: str
    error: Exception
    times: int

    def prepare(self) -> Any:
        if self.when == "prepare":
            self.go_wrong()
        return FaultyTask(self)

    def go_wrong(self) -> None:
        tries = len(list(Path(self.place).iterdir()))
        Path(self.place, str(tries)).touch()
        if tries < self.times:
            raise self.error


@dataclass(frozen=True)
class FaultyTask:
    work: Faulty

    def ready(self, task: Task) -> None:
        if self.work.when == "ready":
            self.work.go_wrong()

    def __call__(self, task: Task) -> int:
        return task.number


@pytest.mark.parametrize(("limit_s", "how"), [(None, "killed"), (0.5, "time_limit")])
def test_half_an_answer_does_not_hold_up_the_run(limit_s: float | None, how: str) -> None:
    """The channel stays open, as a process that the stage started holds it."""
    begun = time.monotonic()
    lost = outcome_of(Half(), Task(0, (), limit_s=limit_s))
    assert time.monotonic() - begun < 15.0
    assert isinstance(lost, Lost)
    assert lost.how == how


class Half:
    def prepare(self) -> Any:
        return half


def half(task: Task) -> None:
    channel = int(sys.argv[1])
    run_by = os.getpid()
    if os.fork() == 0:
        end = time.monotonic() + 20.0
        while time.monotonic() < end and os.getppid() == run_by:
            time.sleep(0.1)
        time.sleep(4.0)
        os._exit(0)
    os.write(channel, (10_000).to_bytes(8, "big") + b"half of it")
    if task.limit_s is None:
        os.kill(run_by, signal.SIGKILL)
    time.sleep(60.0)


def test_no_more_workers_than_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    started = 0
    start = executors_pool._start_worker

    def counted() -> Any:
        nonlocal started
        started += 1
        return start()

    monkeypatch.setattr(executors_pool, "_start_worker", counted)
    plan = ToyPlan(130)
    assert same(run(pool(99), StageWork([Toy()]), plan), run(SERIAL, StageWork([Toy()]), plan))
    assert 1 <= started <= 3


def test_work_that_cannot_be_sent() -> None:
    with pytest.raises(StageError, match=r"the work cannot be sent to other processes .*lambda"):
        run(pool(1), StageWork([lambda: Toy()]))


def test_no_process_can_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    told = r"no worker process can be started: No such file or directory \(/nowhere/python\)"
    with pytest.raises(StageError, match=told):
        outcome_of(StageWork([Toy()]))


@pytest.mark.parametrize(
    ("number", "told"), [(signal.SIGSEGV, "signal 11 (SIGSEGV)"), (40, "signal 40")]
)
def test_a_worker_says_how_it_ended(number: int, told: str) -> None:
    lost = outcome_of(Signalled(number))
    assert isinstance(lost, Lost)
    assert (lost.how, lost.detail) == ("killed", told)


@dataclass(frozen=True)
class Signalled:
    number: int

    def prepare(self) -> Any:
        return self

    def __call__(self, task: Task) -> None:
        os.kill(os.getpid(), self.number)


def test_an_answer_that_cannot_be_sent() -> None:
    failed = outcome_of(Unsendable())
    assert isinstance(failed, Failed)
    assert "lambda" in failed.error


class Unsendable:
    def prepare(self) -> Any:
        return lambda task: lambda: task


def test_a_worker_that_died_idle_costs_no_task() -> None:
    with PoolCrew(StageWork([Toy()]), 1) as crew:
        for number in range(2):
            crew.submit(Task(number, (PLAN.block(number)[0],)))
            assert isinstance(crew.outcome(), Finished)
            (worker,) = crew._workers
            os.kill(worker.process.pid, signal.SIGKILL)
            worker.process.wait()


def test_time_to_prepare_does_not_count() -> None:
    task = Task(0, (PLAN.block(0)[0],), limit_s=0.3)
    assert isinstance(outcome_of(Slow(), task), Finished)
    lost = outcome_of(StageWork([Toy({3: "loop"})]), task)
    assert isinstance(lost, Lost)
    assert (lost.how, lost.detail) == ("time_limit", "stopped after 0.3 s")


def test_time_to_prepare_has_a_limit_of_its_own() -> None:
    failed = outcome_of(Slow(), Task(0, (), limit_s=0.1, ready_limit_s=0.2))
    assert isinstance(failed, Failed)
    assert failed.error.startswith("preparing the stage did not end within 0.2 s")
    assert isinstance(outcome_of(Slow(), Task(0, (), limit_s=5, ready_limit_s=20)), Finished)


class Slow:
    """Takes its time before each of its tasks, for what can be done beforehand."""

    def prepare(self) -> Any:
        time.sleep(0.5)
        return SlowTask()


class SlowTask:
    def ready(self, task: Task) -> None:
        time.sleep(0.5)

    def __call__(self, task: Task) -> int:
        return task.number


def test_no_more_tasks_than_workers() -> None:
    task = Task(0, (PLAN.block(0)[0],))
    with PoolCrew(StageWork([Toy()]), 1) as crew:
        with pytest.raises(RuntimeError, match="no task is under way"):
            crew.outcome()
        crew.submit(task)
        with pytest.raises(RuntimeError, match="1 tasks are under way already"):
            crew.submit(task)


def test_signals_of_the_terminal_and_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")  # not what a worker may take over
    with PoolCrew(Surroundings(), 1) as crew:
        crew.submit(Task(0, ()))
        outcome = crew.outcome()
        assert isinstance(outcome, Finished)
        assert outcome.value == (True, True, "1")
        # A worker that is asked to end with the run ends by itself.
        (worker,) = crew._workers
    assert worker.process.returncode == 0


class Surroundings:
    def prepare(self) -> Any:
        return surroundings


def surroundings(task: Task) -> tuple[bool, bool, str]:
    os.kill(os.getpid(), signal.SIGINT)
    return (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN,
        os.getpgrp() != os.getpgid(os.getppid()),
        os.environ["OPENBLAS_NUM_THREADS"],
    )


SCRIPT = """
import sys
sys.path.insert(0, {root!r})
from tests.core.cases.toy_cases import StageWork, Toy, ToyPlan
from hillsphere_campaigns.engine import run_campaign
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.specs import PoolSpec
{work}
def tell(count):
    print(count, flush=True)
executor = Pool(PoolSpec(workers=2))
found, _ = run_campaign(ToyPlan(130), work, executor=executor, advance=tell)
print(len(found), "blocks")
"""


def script(directory: Path, work: str) -> list[str]:
    path = directory / "script.py"
    path.write_text(SCRIPT.format(root=str(ROOT), work=work), "utf-8")
    return [sys.executable, str(path)]


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    command = script(tmp_path, "work = StageWork([Toy()])")
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.endswith("3 blocks\n")


def test_a_run_without_standard_error(tmp_path: Path) -> None:
    """What a worker prints goes nowhere then, and does not end up among the results."""
    command = ["sh", "-c", '"$@" 2>&-', "sh"]
    command += script(tmp_path, 'work = StageWork([Toy({5: "print"})])')
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0
    assert "by a stage" not in done.stdout
    assert done.stdout.endswith("3 blocks\n")


def test_what_a_script_defines_cannot_be_sent(tmp_path: Path) -> None:
    command = script(tmp_path, "class Own(Toy):\n    pass\nwork = StageWork([Own()])")
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 1
    assert (
        "the work cannot be sent to other processes (Own is defined in the program "
        "that was started, not in a module); define its classes at the top level of modules"
    ) in done.stderr


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_workers_do_not_outlive_their_run(tmp_path: Path, number: signal.Signals) -> None:
    """One computes without end, one waits for its next task; both leave with the run."""
    command = script(tmp_path, 'work = StageWork([Toy({100: "loop"})])')
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        # Which blocks are done by now, and whether the other ones are sent together, may differ.
        # Blocks that were sent together are told of together, and never if one of them is endless.
        while select.select([process.stdout], [], [], 20)[0]:
            if int(process.stdout.readline()) > 0:
                break
        workers = children(process.pid)
        assert 1 <= len(workers) <= 2
        # As a terminal does: to the process and all that are in its group.
        os.killpg(process.pid, number)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == -number
    assert errors.count("Traceback") == (number is signal.SIGINT)
    end = time.monotonic() + 20.0
    while any(alive(pid) for pid in workers):
        assert time.monotonic() < end
        time.sleep(0.02)


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"
