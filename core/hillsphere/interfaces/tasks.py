"""What an executor is given and gives back: jobs, such as tasks of blocks, and how each ended."""

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
    "Task",
    "Work",
    "unready",
]


class Work(Protocol):
    """What is done with a job; picklable, so that it can be sent to a worker once."""

    def prepare(self) -> Callable[[Any], Any]:
        """Make the function that does a job; called once in each worker, it may take long.

        The function takes jobs of the class that the crew is given. It may have a method
        ``ready(job)``, which is called before each job: what it makes ready, such as compiled
        code, counts against `Job.ready_limit_s`, not `limit_s`.
        """
        ...


@dataclass(frozen=True)
class Job:
    """What a worker is given at a time; subclasses say what it is to do.

    Parameters
    ----------
    number : int
        Unique among the jobs of a crew.
    limit_s : float or None
        Wall-clock time after which its worker is stopped.
    ready_limit_s : float or None
        The same for what is made ready before.
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
class Finished:
    """A job was done; `value` is what the work's function returned."""

    task: Job
    value: Any


@dataclass(frozen=True)
class Lost:
    """The worker of a job died (``"killed"``) or was stopped at its limit (``"time_limit"``)."""

    task: Job
    how: str
    detail: str


@dataclass(frozen=True)
class Failed:
    """The work could not be prepared, or its function raised, which it must not."""

    task: Job
    error: str
    detail: str


Outcome = Finished | Lost | Failed


def unready(task: Job) -> str:
    """Say that a worker was stopped while it made ready for a job."""
    return (
        f"preparing the stage did not end within {task.ready_limit_s:g} s (ten times the limit of "
        "a block, at least 300 s), and its worker was stopped; give a longer block_limit or none"
    )


class Crew(Protocol):
    """Workers that do one kind of work; a context manager, whose end stops them all at once."""

    @property
    def slots(self) -> int:
        """How many jobs can be under way."""
        ...

    def submit(self, task: Job) -> None:
        """Give a job to a free worker; no more than `slots` may be under way."""
        ...

    def outcome(self) -> Outcome:
        """Wait for a job to end. A worker that was lost is replaced before this returns."""
        ...

    def __enter__(self) -> Crew: ...

    def __exit__(self, *exc: object) -> None: ...


class Executor(Protocol):
    """Where jobs are done: in this process, in others, on other machines."""

    def crew(self, work: Work) -> Crew:
        """Return workers for this work."""
        ...
