"""Campaigns on dask: a real scheduler and real workers on this machine, some of which die."""

from __future__ import annotations

import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import distributed
import pytest
from tests.core.cases.toy_cases import ROOT, StageWork, Toy, ToyPlan, Unprepared, same
from tests.core.cases.toy_loop import Loop

from hillsphere.base.algebra_threads import ONE_THREAD
from hillsphere.cases.block_outcome import BlockOutcome
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import PoolSpec, SerialSpec
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces.tasks import Task
from hillsphere_campaigns.engine import run_campaign
from hillsphere_dask import dask, dask_workers
from hillsphere_dask.dask import Dask
from hillsphere_dask.specs import DaskSpec

PATIENCE_S = 30.0


@dataclass
class Cluster:
    """A scheduler and the process that looks after the workers."""

    address: str
    scheduler: subprocess.Popen[bytes] | None
    nanny: subprocess.Popen[bytes]

    def executor(self) -> Dask:
        return Dask(DaskSpec(scheduler=self.address))

    def workers(self) -> list[int]:
        """Return the processes that compute."""
        return [
            pid
            for pid in children(self.nanny.pid)
            if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def alive(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state.rpartition(")")[2].split()[0] != "Z"


def started(module: str, *arguments: str, path: Sequence[str] = ()) -> subprocess.Popen[bytes]:
    """Start a program of dask's; it and all its children form a process group."""
    place = os.pathsep.join([*path, str(ROOT), *filter(None, sys.path)])
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{module}", "--host", "127.0.0.1",
         "--no-dashboard", *arguments],
        env={**os.environ, "PYTHONPATH": place, "DASK_LOGGING__DISTRIBUTED": "critical"},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def ended(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


@contextmanager
def cluster(directory: Path) -> Iterator[Cluster]:
    """Start a scheduler and two workers."""
    with ExitStack() as stack:
        file = directory / "scheduler.json"
        local = ("--local-directory", str(directory))
        both = ("--scheduler-file", str(file))
        scheduler = started(
            "dask_scheduler", "--port", "0", "--dashboard-address", "127.0.0.1:0", *both
        )
        stack.callback(ended, scheduler)
        two = ("--nworkers", "2", "--nthreads", "1")
        nanny = started("dask_worker", *both, *local, *two)
        stack.callback(ended, nanny)
        yield Cluster(_address(file), scheduler, nanny)


def _address(file: Path) -> str:
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        with suppress(OSError, json.JSONDecodeError):
            return str(json.loads(file.read_text())["address"])
        time.sleep(0.05)
    raise AssertionError("the scheduler does not come up")


@pytest.fixture(autouse=True)
def _toys_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with cluster(tmp_path_factory.mktemp("cluster")) as made:
        yield made


@pytest.fixture(scope="module")
def doomed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Start a cluster whose scheduler a test may kill."""
    with cluster(tmp_path_factory.mktemp("doomed")) as made:
        yield made


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Start a scheduler without workers."""
    start: Any = distributed.LocalCluster
    with start(n_workers=0, dashboard_address="127.0.0.1:0", silence_logs=logging.CRITICAL) as made:
        yield str(made.scheduler_address)


@contextmanager
def worker(address: str, *arguments: str, path: Sequence[str] = ()) -> Iterator[None]:
    """Start one worker."""
    process = started("dask_worker", address, *arguments, path=path)
    try:
        yield
    finally:
        ended(process)


def serially(plan: ToyPlan, work: StageWork) -> list[BlockOutcome]:
    return run_campaign(plan, work, executor=Serial(SerialSpec()))[0]


def once(act: Callable[[], None]) -> Callable[[int], None]:
    """Return what an engine tells of progress to: it acts when the first cases are done."""
    done: list[int] = []

    def advance(count: int) -> None:
        if count and not done:
            done.append(count)
            act()

    return advance


@pytest.mark.parametrize("group_blocks", [None, 1, 3])
def test_a_cluster_gives_the_bits_of_this_process(
    two_workers: Cluster, group_blocks: int | None
) -> None:
    plan, work = ToyPlan(130, variants=2), StageWork((Loop, Loop))
    there, _ = run_campaign(plan, work, executor=two_workers.executor(), group_blocks=group_blocks)
    assert same(there, serially(plan, work))


def test_a_worker_that_is_killed_costs_nothing(two_workers: Cluster) -> None:
    plan, work = ToyPlan(64 * 24), StageWork((Toy(rounds=2000),))
    killed: list[int] = []

    def kill() -> None:
        victim = two_workers.workers()[0]
        os.kill(victim, signal.SIGKILL)
        killed.append(victim)

    there, _ = run_campaign(
        plan, work, executor=two_workers.executor(), group_blocks=1, advance=once(kill)
    )
    assert len(killed) == 1
    assert same(there, serially(plan, work))


def test_a_case_that_kills_its_worker_is_a_row(two_workers: Cluster) -> None:
    plan = ToyPlan(66)
    there, _ = run_campaign(
        plan, StageWork((Toy({65: "kill"}),)), executor=two_workers.executor(), tries=1
    )
    sound = serially(plan, StageWork((Toy(),)))
    assert same(there[:1], sound[:1])
    assert there[1].status.tolist() == [sound[1].status[0], "killed"]
    assert there[1].values[:, 0].tobytes() == sound[1].values[:, 0].tobytes()
    assert there[1].messages[0].startswith("its worker ended")


def test_a_case_without_end_is_stopped(two_workers: Cluster) -> None:
    plan = ToyPlan(65)
    there, _ = run_campaign(
        plan, StageWork((Toy({64: "loop"}),)), executor=two_workers.executor(), tries=1, limit_s=1
    )
    assert same(there[:1], serially(plan, StageWork((Toy(),)))[:1])
    assert there[1].status.tolist() == ["time_limit"]
    assert "stopped after 1 s" in there[1].messages[0]


def test_work_that_cannot_be_prepared_fails_once(two_workers: Cluster) -> None:
    with pytest.raises(StageError, match="RuntimeError: there is no field") as caught:
        run_campaign(ToyPlan(640), Unprepared("raise"), executor=two_workers.executor())
    assert "in prepare" in "".join(caught.value.__notes__)


def test_work_that_kills_every_worker_ends(two_workers: Cluster) -> None:
    with pytest.raises(StageError, match="3 dask workers died one after the other while they prep"):
        run_campaign(ToyPlan(640), Unprepared("exit"), executor=two_workers.executor())


def test_a_scheduler_that_is_killed_leaves_what_is_finished(
    doomed: Cluster, tmp_path: Path
) -> None:
    plan, work = ToyPlan(64 * 24), StageWork((Toy(rounds=2000),))
    kept = Checkpoints(tmp_path / "work", "key")

    def kill() -> None:
        assert doomed.scheduler is not None
        doomed.scheduler.kill()

    begin = time.monotonic()
    with pytest.raises(StageError, match=r"gone.*finished group.*is kept.*`hillsphere resume`"):
        run_campaign(
            plan, work, executor=doomed.executor(), checkpoints=kept, group_blocks=1,
            advance=once(kill),
        )  # fmt: skip
    assert time.monotonic() - begin < dask_workers.ANSWER_S
    finished = len(kept.load())
    assert 1 <= finished < plan.blocks
    computed: list[int] = []
    after, _ = run_campaign(
        plan, work, executor=Pool(PoolSpec(workers=2)), checkpoints=kept, advance=computed.append
    )
    assert same(after, serially(plan, work))


def test_other_versions_are_refused(two_workers: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    here = dask_workers.surroundings() | {"numpy": "1.0", "sources of hillsphere_toy": "0"}
    monkeypatch.setattr(dask_workers, "surroundings", lambda: here)
    with (
        pytest.raises(StageError, match=r"cannot be used, tcp://.*: numpy is .* there, 1.0 here: "),
        two_workers.executor().crew(StageWork((Toy(),))),
    ):
        pass


def test_differences_are_named() -> None:
    here = {
        "python": "3.11.7",
        "CPU features": "AVX2",
        "sources of toy": "a",
        "threads of BLAS": "",
    }
    assert dask_workers.differences(here, here | {"threads of BLAS": "1"}) == []
    there = here | {"CPU features": "SSE2", "sources of toy": "b", "threads of BLAS": "4"}
    first, second, third = dask_workers.differences(here, there)
    assert first == "CPU features is SSE2 there, AVX2 here"
    assert second.startswith("sources of toy is b there, a here: start its workers from the same")
    assert third.startswith("its BLAS may use 4 threads: start it with a nanny, or with OMP_NUM_TH")
    del there["sources of toy"], there["python"]
    assert dask_workers.differences(here, there)[0] == "python is missing there, 3.11.7 here"


def test_a_worker_without_the_package_is_refused(scheduler: str, tmp_path: Path) -> None:
    (tmp_path / "hillsphere.py").write_text("raise ImportError('not installed')")
    one = ("--nthreads", "1", "--local-directory", str(tmp_path))
    with (
        worker(scheduler, *one, path=[str(tmp_path)]),
        pytest.raises(StageError, match=r"hillsphere cannot be used there \(ImportError: not inst"),
        Dask(DaskSpec(scheduler=scheduler)).crew(StageWork((Toy(),))),
    ):
        pass


def test_a_worker_of_several_threads_is_refused(scheduler: str, tmp_path: Path) -> None:
    place = ("--local-directory", str(tmp_path))
    connect: Any = distributed.Client
    with (
        worker(scheduler, "--nthreads", "2", *place),
        worker(scheduler, "--nthreads", "1", *place),
        connect(scheduler, set_as_default=False) as client,
    ):
        client.wait_for_workers(2, PATIENCE_S)
        with (
            pytest.raises(StageError, match="it has 2 threads: start it with --nthreads 1"),
            Dask(DaskSpec(scheduler=scheduler)).crew(StageWork((Toy(),))),
        ):
            pass


def test_a_limit_needs_a_nanny(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in ONE_THREAD.items():
        monkeypatch.setenv(name, value)
    arguments = ("--nthreads", "1", "--no-nanny", "--local-directory", str(tmp_path))
    with (
        worker(scheduler, *arguments),
        Dask(DaskSpec(scheduler=scheduler)).crew(StageWork((Toy(),))) as crew,
    ):
        batch, _ = ToyPlan(64).block(0)
        with pytest.raises(StageError, match="has no nanny that could stop it at the limit of 3 s"):
            crew.submit(Task(0, (batch,), limit_s=3.0))


def test_work_that_cannot_be_sent_is_an_error(scheduler: str) -> None:
    with (
        pytest.raises(StageError, match="the work cannot be sent to other processes"),
        Dask(DaskSpec(scheduler=scheduler)).crew(StageWork((lambda: Toy(),))),
    ):
        pass


def test_a_cluster_without_workers_is_no_endless_wait(
    scheduler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dask, "PATIENCE_S", 0.5)
    with (
        pytest.raises(StageError, match=f"no worker for .*`dask worker {scheduler} --nthreads 1`"),
        Dask(DaskSpec(scheduler=scheduler)).crew(StageWork((Toy(),))),
    ):
        pass


def test_no_scheduler_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask, "CONNECT_S", 1.0)
    with (
        pytest.raises(StageError, match=r"no dask scheduler answers at tcp://127\.0\.0\.1:9 "),
        Dask(DaskSpec(scheduler="tcp://127.0.0.1:9")).crew(StageWork((Toy(),))),
    ):
        pass


def test_without_dask_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'hillsphere\[dask\]'"):
        Dask(DaskSpec())


def test_dask_is_imported_only_when_used() -> None:
    code = (
        "import sys; from hillsphere_dask.dask import Dask; "
        "from hillsphere_dask.specs import DaskSpec; Dask(DaskSpec()); "
        "assert not {'dask', 'distributed', 'tornado'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


SCRIPT = """
from hillsphere_campaigns.engine import run_campaign
from hillsphere_dask.dask import Dask
from hillsphere_dask.specs import DaskSpec
from tests.core.cases.toy_cases import StageWork, Toy, ToyPlan

def advance(count):
    if count:
        print("begun", flush=True)

work = StageWork((Toy({7: "print", 70: "wait"}),))
run_campaign(ToyPlan(128), work, executor=Dask(DaskSpec(workers=2)), advance=advance)
"""


@pytest.mark.slow
def test_a_local_cluster_keeps_quiet_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    # No guard of the main part: workers do not read the script that started them.
    file = tmp_path / "script.py"
    file.write_text(SCRIPT)
    script = subprocess.Popen(
        [sys.executable, "-W", "error", str(file)], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    with script:
        assert script.stdout is not None
        assert script.stdout.readline() == "begun\n"
        helpers = children(script.pid)
        helpers += [pid for helper in helpers for pid in children(helper)]
        assert len(helpers) >= 3
        script.send_signal(signal.SIGINT)
        out, errors = script.communicate(timeout=PATIENCE_S)
    assert out == ""
    assert errors.startswith("printed by a stage\n") or errors.startswith("written by a stage\n")
    assert errors.rstrip().endswith("KeyboardInterrupt")
    assert errors.count("Traceback") == 1
    end = time.monotonic() + PATIENCE_S
    while any(map(alive, helpers)):
        assert time.monotonic() < end
        time.sleep(0.05)
