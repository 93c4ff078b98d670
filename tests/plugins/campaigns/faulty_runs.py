"""A program that runs the command line again and again, and lets something go wrong on request.

Its argument is a mission, whose components it imports. Each line on its standard input is a table
in JSON: ``{"arguments": [...], "fault": {...}}``. The command line is called in a forked process,
which saves the imports and is otherwise a process like any other; a line on the standard output
then says how it ended.

A fault strikes at the n-th of a kind of events: ``compute`` (a task is handed out), ``open``,
``write``, ``fsync`` and ``replace`` (of files that are written beside their place), ``merge`` (what
is kept of a campaign is read, put together or cleared away). ``after_s`` strikes at a time instead.
"""

from __future__ import annotations

import errno
import json
import os
import pathlib
import random
import select
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, NoReturn

import scipy.stats  # noqa: F401  # used by what presents campaigns

import hillsphere.base.atomic
import hillsphere.cli.running
import hillsphere.runs.pipeline
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.pool import PoolCrew, _Worker
from hillsphere.cases.executors.serial import SerialCrew
from hillsphere.cli import main
from hillsphere.mission import load_mission
from hillsphere.runs.assembly import Assembly
from hillsphere.runs.store import RunDirectory
from hillsphere.show.drawing import Drawing
from hillsphere_campaigns.engine import _Campaign

PATIENCE_S = 120.0


class Faults:
    """What goes wrong in this process, and what it was doing then."""

    def __init__(self, fault: dict[str, Any], report: int) -> None:
        self.fault = fault
        self.report = report
        self.counts: Counter[str] = Counter()
        self.phase = "outside"
        self.random = random.Random(fault.get("seed", 0))
        if "after_s" in fault:
            self.later(fault["after_s"], self.kill)

    def event(self, name: str, halfway: Callable[[], object] = lambda: None) -> None:
        """Count an event, and let happen what is to happen at it; `halfway` does half of it."""
        self.counts[name] += 1
        if name != self.fault.get("event") or self.counts[name] != self.fault["at"]:
            return
        match self.fault["act"]:
            case "kill":
                if delay := self.fault.get("delay_s"):
                    self.later(delay, self.kill)
                else:
                    self.kill()
            case "kill halfway":
                halfway()
                self.kill()
            case "short":
                halfway()
                self.tell(struck=True)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            case "ENOSPC" | "EIO" as name:
                self.tell(struck=True)
                number = getattr(errno, name)
                raise OSError(number, os.strerror(number))

    def later(self, delay_s: float, act: Callable[[], object]) -> None:
        timer = threading.Timer(delay_s, act)
        timer.daemon = True
        timer.start()

    def kill(self) -> None:
        """Kill this process as ``kill -9`` does."""
        self.tell(phase=self.phase)
        os.kill(os.getpid(), signal.SIGKILL)

    def tell(self, **facts: Any) -> None:
        os.write(self.report, (json.dumps(facts) + "\n").encode())

    def kill_workers(self, crew: PoolCrew) -> None:
        """Kill so many of the pool's processes one by one, seldom one that is starting."""
        while self.counts["killed"] < self.fault["workers"]:
            time.sleep(self.random.uniform(0.02, 0.3))
            alive = [worker for worker in list(crew._workers) if worker.process.poll() is None]
            if not alive:
                continue
            victim = self.random.choice(alive)
            what = _doing(victim)
            if what == "starting" and self.counts[what] > self.counts["killed"] // 4:
                continue
            victim.process.kill()
            self.counts[what] += 1
            self.counts["killed"] += 1

    def install(self) -> None:
        """Watch the events."""
        self._watch_files()
        self._watch_campaigns()

    def _watch_files(self) -> None:
        fsync, replace, unlink, path_open = os.fsync, os.replace, os.unlink, pathlib.Path.open

        class System:
            """What `hillsphere.base.atomic` knows of the operating system."""

            path = os.path
            lstat = staticmethod(os.lstat)
            fchmod = staticmethod(os.fchmod)

            @staticmethod
            def fsync(descriptor: int) -> None:
                self.event("fsync")
                fsync(descriptor)

            @staticmethod
            def replace(source: object, target: object) -> None:
                before, self.phase = self.phase, "rename"
                self.event("replace", lambda: replace(source, target))  # type: ignore[arg-type]
                replace(source, target)  # type: ignore[arg-type]
                self.phase = before

        vars(hillsphere.base.atomic)["os"] = System

        def opened(path: pathlib.Path, mode: str = "r", *arguments: Any, **more: Any) -> Any:
            if mode != "xb":
                return path_open(path, mode, *arguments, **more)
            self.event("open")
            return Part(path_open(path, mode), self)

        def unlinked(*arguments: Any, **more: Any) -> None:
            if self.phase == "merge":
                self.event("merge")
            unlink(*arguments, **more)

        pathlib.Path.open = opened  # type: ignore[assignment, method-assign]
        os.unlink = unlinked

    def _watch_campaigns(self) -> None:
        def phase(cls: Any, method: str, during: str, after: str, event: bool) -> None:
            usual = getattr(cls, method)

            def watched(*arguments: Any) -> Any:
                self.phase = during
                if event:
                    self.event(during)
                try:
                    return usual(*arguments)
                finally:
                    self.phase = after

            setattr(cls, method, watched)

        phase(_Campaign, "run", "compute", "merge", False)
        phase(_Campaign, "resume", "merge", "merge", False)
        phase(_Campaign, "outcomes", "merge", "merge", True)
        phase(Checkpoints, "_read", "merge", "merge", True)
        phase(RunDirectory, "clear_workspace", "merge", "outside", False)
        for crew in (PoolCrew, SerialCrew):
            self._watch_tasks(crew)

    def _watch_tasks(self, crew: Any) -> None:
        submit = crew.submit

        def submitted(this: Any, task: Any) -> None:
            submit(this, task)
            self.event("compute")
            if "workers" in self.fault and self.counts["compute"] == 1:
                self.later(0.0, lambda: self.kill_workers(this))

        crew.submit = submitted


class Part:
    """A file that is being written beside its place."""

    def __init__(self, stream: Any, faults: Faults) -> None:
        self._stream, self._faults = stream, faults
        self._before = faults.phase
        faults.phase = "write"

    def write(self, data: Any) -> int:
        part = bytes(data)[: len(data) // 2]
        self._faults.event("write", lambda: (self._stream.write(part), self._stream.flush()))
        return int(self._stream.write(data))

    def __enter__(self) -> Part:
        return self

    def __exit__(self, *exc: object) -> None:
        self._stream.close()
        self._faults.phase = self._before

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _doing(worker: _Worker) -> str:
    if not worker.ready:
        return "starting"
    return "idle" if worker.task is None else "computing"


def _run(request: dict[str, Any], report: int) -> NoReturn:
    """Call the command line, in a process of its own."""
    log = os.open(request["log"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, 1)
    os.dup2(log, 2)
    sys.argv = ["hillsphere", *request["arguments"]]
    # Drawing takes ten times as long as the campaign.
    vars(hillsphere.runs.pipeline)["draw"] = lambda figure, *, png: Drawing(svg=b"")
    faults = Faults(request.get("fault") or {}, report)
    faults.install()
    code: Any = 3
    try:
        main()
    except SystemExit as end:
        code = end.code
    finally:
        faults.tell(counts=faults.counts)
        os._exit(int(code))


def _serve(request: dict[str, Any]) -> dict[str, Any]:
    ours, theirs = os.pipe()
    pid = os.fork()
    if not pid:
        os.close(ours)
        _run(request, theirs)
    os.close(theirs)
    found: dict[str, Any] = {}
    text = b""
    while select.select([ours], [], [], PATIENCE_S)[0] and (data := os.read(ours, 1 << 16)):
        text += data
    os.close(ours)
    for line in text.splitlines():
        found |= json.loads(line)
    if not text:
        os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    return found | {"code": os.waitstatus_to_exitcode(status)}


if __name__ == "__main__":
    mission = load_mission(sys.argv[1])
    assembly = Assembly(mission)
    stages = [assembly.get("stage", name) for name in mission.order()]
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_serve(json.loads(line))) + "\n")
        sys.stdout.flush()
