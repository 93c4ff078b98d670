"""Tasks done in the process of the run, one after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.cases.executors.worker import MOST_FAULTS, format_error, is_passing
from hillsphere.interfaces.tasks import Failed, Finished, Job, Outcome, Work

__all__ = ["Serial", "SerialCrew"]


class Serial:
    """Executor that runs all tasks in the calling process.

    Nothing protects the run here: a case that kills its process ends the run, and no task is
    stopped at its limit (`Job.limit_s` is ignored). Results have the bits of every other executor
    as long as the linear algebra of this process works in one thread, as that of workers and
    of the command ``hillsphere`` does, or on arrays too small to be shared among several. In a
    program of one's own set ``OMP_NUM_THREADS=1`` before numpy is imported.

    Parameters
    ----------
    spec : SerialSpec
        Parameters; there are none.
    """

    def __init__(self, spec: SerialSpec) -> None:
        self.spec = spec

    def crew(self, work: Work) -> SerialCrew:
        """Return this process as the one worker."""
        return SerialCrew(work)


class SerialCrew:
    """One task at a time, done when its outcome is asked for; see `Crew`."""

    slots = 1

    def __init__(self, work: Work) -> None:
        self._work = work
        self._do: Callable[[Any], Any] | None = None
        self._task: Job | None = None

    def __enter__(self) -> SerialCrew:
        return self

    def __exit__(self, *exc: object) -> None:
        self._do = self._task = None

    def submit(self, task: Job) -> None:
        """Keep the task until its outcome is asked for."""
        if self._task is not None:
            raise RuntimeError(f"task {self._task.number} is still under way")
        self._task = task

    def outcome(self) -> Outcome:
        """Do the task."""
        task, self._task = self._task, None
        if task is None:
            raise RuntimeError("no task is under way")
        try:
            do = self._prepared(task)
            return Finished(task, do(task))
        except Exception as error:
            return Failed(task, *format_error(error))

    def _prepared(self, task: Job) -> Callable[[Any], Any]:
        """Make ready for a task, again if a fault may be a passing one."""
        left = MOST_FAULTS
        while True:
            try:
                if self._do is None:
                    self._do = self._work.prepare()
                if hasattr(self._do, "ready"):
                    self._do.ready(task)
                return self._do
            except Exception as error:
                left -= 1
                if not left or not is_passing(error):
                    raise
                self._do = None
