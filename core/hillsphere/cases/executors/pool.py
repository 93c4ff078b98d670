"""Tasks done in processes of their own, each on a channel, so that one that dies costs one task.

The pool of the standard library does not say which task killed a process, and all its tasks are
lost with one; here the run knows what each process is doing, can stop it, and replaces it.
"""

from __future__ import annotations

import json
import os
import pickle
import signal
import socket
import subprocess
import sys
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from fcntl import F_DUPFD_CLOEXEC, fcntl
from multiprocessing.connection import wait
from time import monotonic
from typing import Any

from hillsphere.base.algebra_threads import ONE_THREAD
from hillsphere.base.errors import StageError
from hillsphere.base.processors import processors
from hillsphere.base.signals import child_groups
from hillsphere.cases.executors.channel import Channel
from hillsphere.cases.executors.sending import pickle_work
from hillsphere.cases.executors.specs import PoolSpec
from hillsphere.cases.executors.worker import MOST_FAULTS
from hillsphere.interfaces.tasks import Failed, Finished, Job, Lost, Outcome, Work, unready
from hillsphere.plugins.plugin_files import plugin_files

__all__ = ["Pool", "PoolCrew"]

MOST_FAILED_STARTS = 5
"""Workers in a row that may die before they are ready."""

LOOK_S = 1.0
"""How often to look whether a worker still lives whose channel is open: processes that a stage
started may hold it open."""

FAREWELL_S = 2.0
"""Time that idle workers have to end by themselves."""

_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[2]); "
    "from hillsphere.cases.executors.worker import main; "
    "main(int(sys.argv[1]))"
)


class Pool:
    """Executor of processes on this machine.

    Workers are started afresh, not forked, and do not read the program that started them: it needs
    no ``if __name__ == "__main__"``. But everything that is sent to them must stand in modules that
    can be imported.

    Parameters
    ----------
    spec : PoolSpec
        How many.
    """

    def __init__(self, spec: PoolSpec) -> None:
        self.spec = spec

    def crew(self, work: Work) -> PoolCrew:
        """Return processes for this work; see `PoolCrew`."""
        return PoolCrew(work, self.spec.workers or processors())


@dataclass(eq=False)
class _Worker:
    process: subprocess.Popen[bytes]
    channel: Channel
    ready: bool = False
    task: Job | None = None
    begun: bool = False
    deadline: float | None = None


class PoolCrew:
    """Processes that do one kind of work; see `Crew`.

    Parameters
    ----------
    work : Work
        Sent to each process once.
    workers : int
        Most processes at a time; each is started when there is a task for it.

    Raises
    ------
    StageError
        If the work cannot be sent.
    """

    def __init__(self, work: Work, workers: int) -> None:
        self.slots = workers
        self._work = pickle_work(work)
        self._workers: list[_Worker] = []
        self._waiting: deque[Job] = deque()
        self._ended: deque[Outcome] = deque()
        self._failed_starts = 0
        self._faults = 0

    def __enter__(self) -> PoolCrew:
        return self

    def __exit__(self, *exc: object) -> None:
        try:
            idle = [w for w in self._workers if w.ready and w.task is None]
            for worker in self._workers:
                if worker in idle:
                    with suppress(OSError):
                        worker.channel.send(None)
                else:
                    _kill(worker.process)
            end = monotonic() + FAREWELL_S
            for worker in idle:
                with suppress(subprocess.TimeoutExpired):
                    worker.process.wait(max(0.0, end - monotonic()))
        finally:
            while self._workers:
                self._remove(self._workers[-1])

    def submit(self, task: Job) -> None:
        """Give a task to a worker that is free, or to the first that will be."""
        under_way = len(self._waiting) + sum(w.task is not None for w in self._workers)
        if under_way + len(self._ended) >= self.slots:
            raise RuntimeError(f"{self.slots} tasks are under way already")
        self._waiting.append(task)
        self._hand_out()

    def outcome(self) -> Outcome:
        """Wait for a task to end; a worker that is lost is replaced."""
        if not (self._waiting or self._ended or any(w.task for w in self._workers)):
            raise RuntimeError("no task is under way")
        while not self._ended:
            self._hand_out()
            now = monotonic()
            limits = [w.deadline - now for w in self._workers if w.deadline is not None]
            awake = wait(
                [w.channel.fileno() for w in self._workers], max(0.0, min([LOOK_S, *limits]))
            )
            for worker in list(self._workers):
                ended = worker.process.poll() is not None
                # A worker may have sent its result before it ended: that is read first.
                if ended or worker.channel.fileno() in awake:
                    self._hear(worker)
                if worker not in self._workers:
                    continue
                if ended:
                    self._bury(worker)
                elif worker.deadline is not None and worker.deadline <= monotonic():
                    self._stop(worker)
        return self._ended.popleft()

    def _hand_out(self) -> None:
        """Give waiting tasks to idle workers, and start workers for those that are left."""
        for worker in list(self._workers):
            if self._waiting and worker.ready and worker.task is None:
                task = worker.task = self._waiting.popleft()
                worker.begun = False
                if task.ready_limit_s is not None:
                    worker.deadline = monotonic() + task.ready_limit_s
                try:
                    worker.channel.send(task)
                except OSError:
                    # It died while it was idle, for which the task is not to blame.
                    self._waiting.appendleft(task)
                    self._remove(worker)
        starting = sum(not w.ready for w in self._workers)
        while starting < len(self._waiting) and len(self._workers) < self.slots:
            self._workers.append(_start_worker())
            starting += 1

    def _hear(self, worker: _Worker) -> None:
        """Process the complete messages of a worker; the rest of a message is read later."""
        try:
            while worker in self._workers and (message := worker.channel.arrived()) is not None:
                self._take(worker, *pickle.loads(message))
        except EOFError:
            self._bury(worker)

    def _take(self, worker: _Worker, what: str, *content: Any) -> None:
        if what == "hello":
            with suppress(OSError):  # if it is gone, its channel will tell
                worker.channel.send(plugin_files())
                worker.channel.send_bytes(self._work)
        elif what == "ready":
            worker.ready, self._failed_starts = True, 0
        elif what == "begun":
            assert worker.task is not None
            worker.begun, self._faults = True, 0
            limit_s = worker.task.limit_s
            worker.deadline = None if limit_s is None else monotonic() + limit_s
        elif what == "unprepared":
            self._unprepared(worker, *content)
        else:
            task, worker.task, worker.deadline = worker.task, None, None
            assert task is not None
            self._ended.append(
                Finished(task, *content) if what == "done" else Failed(task, *content)
            )

    def _unprepared(self, worker: _Worker, passing: bool, error: str, detail: str) -> None:
        """Try with another worker, for a while; the task is not to blame."""
        if worker.task is not None:
            self._waiting.appendleft(worker.task)
        self._remove(worker)
        self._faults += 1
        if not passing:
            self._give_up(error, detail)
        elif self._faults >= MOST_FAULTS:
            self._give_up(f"{error} (in {self._faults} worker processes one after another)", detail)

    def _stop(self, worker: _Worker) -> None:
        """Kill a worker that overran its task's limit."""
        task = worker.task
        assert task is not None
        self._remove(worker)
        if not worker.begun:
            self._ended.append(Failed(task, unready(task), ""))
            return
        self._ended.append(Lost(task, "time_limit", f"stopped after {task.limit_s:g} s"))

    def _bury(self, worker: _Worker) -> None:
        """Report the task of a worker that ended by itself as lost."""
        # Its channel closes a moment before it has ended.
        with suppress(subprocess.TimeoutExpired):
            worker.process.wait(FAREWELL_S)
        self._remove(worker)
        how = _ending(worker.process.returncode)
        if worker.task is not None:
            self._ended.append(Lost(worker.task, "killed", how))
        elif not worker.ready:
            self._failed_starts += 1
            if self._failed_starts >= MOST_FAILED_STARTS:
                self._give_up(
                    f"worker processes end before they are ready, the last with {how}; what they "
                    "wrote stands on the standard error stream",
                    "",
                )

    def _give_up(self, error: str, detail: str) -> None:
        under_way = [*self._waiting, *(w.task for w in self._workers if w.task is not None)]
        self._waiting.clear()
        if under_way:
            self._ended.append(Failed(under_way[0], error, detail))

    def _remove(self, worker: _Worker) -> None:
        _kill(worker.process)
        worker.process.wait()
        child_groups.discard(worker.process.pid)
        worker.channel.close()
        self._workers.remove(worker)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a worker and all that plugins have started in it, which would outlive the run.

    Processes that one has started stay in its group, whose number is not given to another process
    while they live, also after the worker itself has ended.
    """
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


def _start_worker() -> _Worker:
    """Start a worker process; it sends ``("hello",)`` when it is ready."""
    ours, theirs = socket.socketpair()
    # The standard streams' numbers may be free if they were closed: there it would be lost.
    descriptor = fcntl(theirs.fileno(), F_DUPFD_CLOEXEC, 3)
    theirs.close()
    errors = subprocess.DEVNULL if sys.__stderr__ is None else 2
    try:
        process = subprocess.Popen(
            # -P: nothing from the working directory, which may hold a stranger's json.py.
            [
                sys.executable,
                "-P",
                "-c",
                _START,
                str(descriptor),
                json.dumps(sys.path),
            ],
            pass_fds=(descriptor,),
            env={**os.environ, **ONE_THREAD},
            stdin=subprocess.DEVNULL,
            # What a worker prints must not come between the results of the run.
            stdout=errors,
            stderr=errors,
            # The signals of a terminal are for the run alone.
            process_group=0,
        )
    except OSError as error:
        ours.close()
        raise StageError(
            f"no worker process can be started: {error.strerror or error} ({sys.executable})"
        ) from error
    finally:
        os.close(descriptor)
    child_groups.add(process.pid)
    return _Worker(process, Channel(ours))


def _ending(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {-code} ({signal.Signals(-code).name})"
    except ValueError:
        return f"signal {-code}"
