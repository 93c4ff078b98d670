"""Tasks in the workers of a dask cluster: one of this machine, or one that is already there."""

from __future__ import annotations

import asyncio
import concurrent.futures
import logging
import os
import queue
import signal
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from time import monotonic
from typing import TYPE_CHECKING, Any

from hillsphere.base.algebra_threads import ONE_THREAD
from hillsphere.base.processors import processors
from hillsphere.base.signals import child_groups
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces.tasks import Job, Lost, Outcome, Work
from hillsphere_dask.dask_workers import (
    Answered,
    Broken,
    Gone,
    Hired,
    Member,
    News,
    Refused,
    Registry,
    WorkerCount,
)

if TYPE_CHECKING:
    from hillsphere_dask.specs import DaskSpec

__all__ = ["Dask", "DaskCrew"]

CONNECT_S = 10.0
"""A scheduler that does not accept a connection for so long is not there."""

PATIENCE_S = 60.0
"""Without a worker for so long, a campaign gives up."""

STRAGGLERS_S = 5.0
"""Once a worker is ready, the others that were there at first are waited for at most so long."""

STILLBORN = 3
"""Workers that may die while they prepare the work, without one that succeeds."""

_KEPT = (
    "every finished group of cases is kept; once a scheduler is there again, `hillsphere resume` "
    "with this run's directory continues (--executor or --scheduler choose another executor)"
)


class Dask:
    """Tasks in workers of dask.distributed, see `hillsphere.interfaces.tasks.Executor`.

    Parameters
    ----------
    spec : DaskSpec
        Its parameters.

    Raises
    ------
    InputError
        If dask.distributed is not installed.
    """

    def __init__(self, spec: DaskSpec) -> None:
        if find_spec("distributed") is None:
            raise InputError(
                "the executor dask needs dask.distributed, which is not installed: "
                "pip install 'hillsphere[dask]'"
            )
        self.spec = spec

    def crew(self, work: Work) -> DaskCrew:
        """Return workers for this work; connected when the context is entered."""
        return DaskCrew(work, self.spec.scheduler, self.spec.workers)


class DaskCrew:
    """Workers of one cluster that do one kind of work, see `hillsphere.interfaces.tasks.Crew`.

    Parameters
    ----------
    work : Work
        What is done; pickled, sent to every worker once and prepared there.
    scheduler : str
        Address of a scheduler; ``""`` starts a cluster on this machine.
    workers : int or None
        How many workers at most; by default all, on this machine one per processor.

    Notes
    -----
    A worker that is there at first and cannot be used ends the campaign before it begins. Workers
    that appear later are hired too, unless they cannot be used; one that died is replaced if its
    nanny or whatever runs the cluster starts another. At the end of the context a cluster of this
    machine is killed; workers of another are let go, and finish the task that they are at.
    """

    def __init__(self, work: Work, scheduler: str, workers: int | None) -> None:
        self._work = work
        self._scheduler = scheduler
        self._workers = workers
        self._news: queue.SimpleQueue[News] = queue.SimpleQueue()
        self._free: list[Member] = []
        self._busy: dict[Member, Job] = {}
        self._outcomes: deque[Outcome] = deque()
        self._refused: dict[str, str] = {}
        self._stillborn = 0
        self._expected = 1
        self._stack = ExitStack()
        self._local: subprocess.Popen[bytes] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def slots(self) -> int:
        """How many tasks can be under way: one per worker that there is now, or one that waits."""
        while not self._news.empty():
            self._hear(0.0)
        return max(1, len(self._free) + len(self._busy))

    def submit(self, task: Job) -> None:
        """Give a task to a free worker, waiting for one if its last one died.

        Raises
        ------
        StageError
            If there is no worker, the scheduler is gone, or the task has a limit and the worker
            has no nanny that could stop it.
        """
        self._await_worker(free=True)
        member = self._free.pop(0)
        if task.limit_s is not None and member.nanny is None:
            raise StageError(
                f"the worker {member.address} has no nanny that could stop it at the limit of "
                f"{task.limit_s:g} s: start it without --no-nanny, or leave out the limit"
            )
        self._busy[member] = task
        assert self._loop is not None
        self._loop.call_soon_threadsafe(member.todo.put_nowait, task)

    def outcome(self) -> Outcome:
        """Wait for a task to end.

        Raises
        ------
        StageError
            If the scheduler is gone, or the last worker without another for a minute.
        """
        while not self._outcomes:
            if not self._busy:
                raise RuntimeError("no task is under way")
            self._hear(PATIENCE_S)
        outcome = self._outcomes.popleft()
        if isinstance(outcome, Lost):
            self._await_worker(free=False)
        return outcome

    def __enter__(self) -> DaskCrew:
        try:
            self._open()
        except BaseException:
            self._stack.close()
            raise
        return self

    def __exit__(self, *exc: object) -> None:
        self._stack.close()

    def _open(self) -> None:
        import dask
        from distributed import Client
        from distributed.utils import silence_logging_cmgr

        self._stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
        # A dead scheduler is told of soon, and work of many megabytes is meant.
        self._stack.enter_context(
            dask.config.set(
                {
                    "distributed.comm.timeouts.connect": f"{CONNECT_S:.0f}s",
                    "distributed.admin.large-graph-warning-threshold": "1TB",
                }
            )
        )
        address = self._scheduler or self._stack.enter_context(self._local_cluster())
        try:
            connect: Any = Client
            client = connect(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise StageError(
                f"no dask scheduler answers at {address} ({error}): start one with `dask "
                "scheduler` and give its address"
            ) from error
        self._stack.callback(client.close, timeout=2.0)
        self._loop = client.loop.asyncio_loop
        registry = Registry(client, self._work, self._workers, self._news)
        watching = asyncio.run_coroutine_threadsafe(registry.watch(), self._loop)
        self._stack.callback(_end, watching)
        self._expected = 1 if self._scheduler else self._workers or processors()
        self._await_first()

    def _await_first(self) -> None:
        """Wait until the first workers are ready; one of them that is refused ends it."""
        deadline = monotonic() + PATIENCE_S
        while not self._free and not self._refused:
            self._await_news(deadline)
        deadline = monotonic() + STRAGGLERS_S
        while len(self._free) < self._expected and not self._refused and monotonic() < deadline:
            self._hear(0.1)
        if self._refused:
            raise self._nobody()

    def _hear(self, timeout_s: float) -> None:
        """Take up one thing that happened; nothing if nothing did for so long."""
        try:
            news = self._news.get(timeout=timeout_s)
        except queue.Empty:
            return
        match news:
            case WorkerCount(count):
                self._expected = max(self._expected, count)
            case Hired(member):
                self._stillborn = 0
                self._free.append(member)
            case Answered(member, outcome):
                if self._busy.pop(member, None) is not None:
                    self._outcomes.append(outcome)
                    self._free.append(member)
            case Gone(member, detail):
                self._miss(member, detail)
            case Refused(member, why):
                self._refused[member.address] = why
            case Broken(detail):
                raise StageError(
                    f"{self._where} is gone{f' ({detail})' if detail else ''}; {_KEPT}"
                )

    def _miss(self, member: Member, detail: str) -> None:
        if member in self._busy:
            task = self._busy.pop(member)
            how = "time_limit" if member.overran else "killed"
            if member.overran:
                detail = f"stopped after {task.limit_s:g} s"
            self._outcomes.append(Lost(task, how, detail))
        elif member in self._free:
            self._free.remove(member)
        else:
            self._stillborn += 1
            if self._stillborn >= STILLBORN:
                raise StageError(
                    f"{self._stillborn} dask workers died one after the other while they prepared "
                    f"the work (the last was {member.address}: {detail}): see their logs"
                )

    def _await_worker(self, *, free: bool) -> None:
        """Wait until there is a worker, a free one if `free`."""
        deadline = monotonic() + PATIENCE_S
        while not self._free and (free or not self._busy):
            if self._busy:
                deadline = monotonic() + PATIENCE_S
            self._await_news(deadline)

    def _await_news(self, deadline: float) -> None:
        if self._local is not None and self._local.poll() is not None:
            raise StageError(
                f"the dask workers of this machine ended with code {self._local.returncode}; "
                "see the standard error stream"
            )
        left = deadline - monotonic()
        if left <= 0:
            raise self._nobody()
        self._hear(min(left, 1.0))

    @property
    def _where(self) -> str:
        return (
            f"the dask scheduler {f'at {self._scheduler}' if self._scheduler else 'started here'}"
        )

    def _nobody(self) -> StageError:
        if self._refused:
            address, why = next(iter(self._refused.items()))
            return StageError(f"{self._where} has a worker that cannot be used, {address}: {why}")
        remedy = (
            f"start some with `dask worker {self._scheduler} --nthreads 1`"
            if self._scheduler
            else "the machine may be too busy, or out of memory"
        )
        return StageError(
            f"{self._where} has had no worker for {PATIENCE_S:.0f} s: {remedy}; {_KEPT}"
        )

    @contextmanager
    def _local_cluster(self) -> Iterator[str]:
        """Start a scheduler in this process and workers in others; yield its address.

        The workers are programs of their own, not forks or spawned copies of the caller's, so that
        a script needs no guard of its main part. They end when the scheduler does, also if this
        process is killed.
        """
        from distributed import LocalCluster

        start: Any = LocalCluster
        with (
            tempfile.TemporaryDirectory(prefix="hillsphere-dask-") as scratch,
            start(
                n_workers=0,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            ) as cluster,
        ):
            address = str(cluster.scheduler_address)
            command = [sys.executable, "-P", "-m", "distributed.cli.dask_worker", address]
            command += ["--nworkers", str(self._workers or processors()), "--nthreads", "1"]
            command += ["--host", "127.0.0.1", "--no-dashboard", "--memory-limit", "0"]
            command += ["--death-timeout", "5", "--local-directory", scratch]
            path = os.pathsep.join(place or os.getcwd() for place in sys.path)
            environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": path}
            environment["DASK_LOGGING__DISTRIBUTED"] = "critical"
            # In a session of its own: Ctrl-C is for this process, which then ends the workers.
            # What is printed there must not mix with results on the standard output.
            self._local = subprocess.Popen(
                command, env=environment, stdin=subprocess.DEVNULL, stdout=2, start_new_session=True
            )
            child_groups.add(self._local.pid)
            try:
                yield address
            finally:
                os.killpg(self._local.pid, signal.SIGKILL)
                self._local.wait()
                child_groups.discard(self._local.pid)


def _end(watching: concurrent.futures.Future[None]) -> None:
    """Stop the workers' coroutines before the client closes, so that none of them complains."""
    watching.cancel()
