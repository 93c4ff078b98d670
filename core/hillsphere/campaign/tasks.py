"""What an executor is given and gives back: tasks of blocks, and how each ended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from hillsphere.campaign.cases import CaseBatch

__all__ = ["Crew", "Executor", "Failed", "Finished", "Lost", "Outcome", "Task", "Work", "unready"]


class Work(Protocol):
    """What is done with a task; picklable, so that it can be sent to a worker once."""

    def prepare(self) -> Callable[[Task], Any]:
        """Make the function that does a task; called once in each worker, it may take long.

        The function may have a method ``ready(task)``, which is called before each task: what it
        makes ready, such as compiled code, counts against `Task.ready_limit_s`, not `limit_s`.
        """
        ...


@dataclass(frozen=True)
class Task:
    """Blocks that a worker computes one after the other.

    Parameters
    ----------
    number : int
        Unique among the tasks of a campaign.
    blocks : tuple of CaseBatch
        The blocks.
    variant : int
        Which variant of the mission they belong to.
    history : bool
        Whether histories are wanted.
    limit_s : float or None
        Wall-clock time after which its worker is stopped.
    ready_limit_s : float or None
        The same for what is made ready before.
    """

    number: int
    blocks: tuple[CaseBatch, ...]
    variant: int = 0
    history: bool = False
    limit_s: float | None = None
    ready_limit_s: float | None = None


@dataclass(frozen=True)
class Finished:
    """A task was done; `value` is what the work's function returned."""

    task: Task
    value: Any


@dataclass(frozen=True)
class Lost:
    """The worker of a task died (``"killed"``) or was stopped at its limit (``"time_limit"``)."""

    task: Task
    how: str
    detail: str


@dataclass(frozen=True)
class Failed:
    """The work could not be prepared, or its function raised, which it must not."""

    task: Task
    error: str
    detail: str


Outcome = Finished | Lost | Failed


def unready(task: Task) -> str:
    """Say that a worker was stopped while it made ready for a task."""
    return (
        f"preparing the stage did not end within {task.ready_limit_s:g} s (ten times the limit of "
        "a block, at least 300 s), and its worker was stopped; give a longer block_limit or none"
    )


class Crew(Protocol):
    """Workers that do one kind of work; a context manager, whose end stops them all at once."""

    @property
    def slots(self) -> int:
        """How many tasks can be under way."""
        ...

    def submit(self, task: Task) -> None:
        """Give a task to a free worker; no more than `slots` may be under way."""
        ...

    def outcome(self) -> Outcome:
        """Wait for a task to end. A worker that was lost is replaced before this returns."""
        ...

    def __enter__(self) -> Crew: ...

    def __exit__(self, *exc: object) -> None: ...


class Executor(Protocol):
    """Where tasks are done: in this process, in others, on other machines."""

    def crew(self, work: Work) -> Crew:
        """Return workers for this work."""
        ...
