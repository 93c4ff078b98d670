"""Interface of executors: jobs, such as tasks of blocks, and how each of them ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from hillsphere.interfaces.cases import CaseBatch

__all__ = [
    "Crew",
    "Executor",
    "Failed",
    "Finished",
    "Job",
    "Lost",
    "Outcome",
    "StoredTask",
    "Task",
    "Work",
    "unready",
]


class Work(Protocol):
    """The work done on jobs; picklable, so that it can be sent to a worker once."""

    def prepare(self) -> Callable[[Any], Any]:
        """Return the function that does a job; called once in each worker, may take long.

        An optional method ``ready(job)`` of the function is called before each job; its time, for
        instance of compilation, counts against `Job.ready_limit_s`, not `limit_s`.
        """
        ...


@dataclass(frozen=True)
class Job:
    """A unit of work for one worker; subclasses hold its data.

    Parameters
    ----------
    number : int
        Unique among the jobs of a crew.
    limit_s : float or None
        Wall-clock time after which its worker is stopped.
    ready_limit_s : float or None
        The same for its preparation by ``ready``.
    """

    number: int
    limit_s: float | None = field(default=None, kw_only=True)
    ready_limit_s: float | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Task(Job):
    """Blocks that a worker computes one after the other; see also `Job`.

    Parameters
    ----------
    blocks : tuple of CaseBatch
        The blocks.
    variant : int
        Which variant of the mission they belong to.
    history : bool
        Whether histories are wanted.
    """

    blocks: tuple[CaseBatch, ...]
    variant: int = 0
    history: bool = False


@dataclass(frozen=True)
class StoredTask(Job):
    """Whole files of a large campaign, which a worker plans, computes and writes; see also `Job`.

    Parameters
    ----------
    files : range
        Their numbers (`hillsphere.cases.stored_blocks`).
    variant : int
        Which variant of the mission their cases belong to.
    """

    files: range
    variant: int = 0


@dataclass(frozen=True)
class Finished:
    """A job that was done; `value` is the result of the work's function."""

    task: Job
    value: Any


@dataclass(frozen=True)
class Lost:
    """A job whose worker died (``"killed"``) or reached the time limit (``"time_limit"``)."""

    task: Job
    how: str
    detail: str


@dataclass(frozen=True)
class Failed:
    """A job whose preparation failed, or whose function raised an error against the contract."""

    task: Job
    error: str
    detail: str


Outcome = Finished | Lost | Failed


def unready(task: Job) -> str:
    """Return the message that a worker was stopped during the preparation of a job."""
    return (
        f"preparing the stage did not end within {task.ready_limit_s:g} s (ten times the limit of "
        "a block, at least 300 s), and its worker was stopped; give a longer block_limit or none"
    )


class Crew(Protocol):
    """Workers for one kind of work; a context manager, whose exit stops all of them."""

    @property
    def slots(self) -> int:
        """Largest number of jobs that can run at the same time."""
        ...

    def submit(self, task: Job) -> None:
        """Give a job to a free worker; at most `slots` jobs may run at the same time."""
        ...

    def outcome(self) -> Outcome:
        """Wait for a job to end and return its outcome; a lost worker is replaced first."""
        ...

    def __enter__(self) -> Crew: ...

    def __exit__(self, *exc: object) -> None: ...


class Executor(Protocol):
    """Runs jobs in this process, in other processes, or on other machines."""

    def crew(self, work: Work) -> Crew:
        """Return workers for this work."""
        ...
