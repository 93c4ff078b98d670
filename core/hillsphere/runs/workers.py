"""Parallel work of one stage, in independent pieces, on the workers of the run's executor.

Compiled code releases the interpreter's lock, but Python code between short calls does not:
processes are then faster than threads. The result of a piece must depend only on the piece and on
the data common to all, so that it has the same bits for any number of workers.
"""

from __future__ import annotations

import os
import pickle
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import islice
from time import monotonic
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

from hillsphere.base.errors import HillsphereError, StageError
from hillsphere.base.stray_processes import end_child_of
from hillsphere.cases.executors.sending import Unsendable
from hillsphere.cases.executors.worker import format_error
from hillsphere.interfaces.stages import Context
from hillsphere.interfaces.tasks import Crew, Failed, Finished, Job, Lost

__all__ = ["Divisible", "Workers"]

TRIES = 3
"""Attempts at a piece whose worker is lost; the cause may be another piece or another user."""

HERE_S = 1.0
"""Time that the run's own process works before it starts workers, s. Their start takes about as
long, so that shorter work gains nothing from them."""

T = TypeVar("T")
R = TypeVar("R")
T_contra = TypeVar("T_contra", contravariant=True)
R_co = TypeVar("R_co", covariant=True)

_Result: TypeAlias = tuple[Any, Exception | None]
"""Result of a piece, and the error that it raised, if any."""


class Divisible(Protocol[T_contra, R_co]):
    """Data common to all pieces; picklable, so that it can be sent to a worker once."""

    def prepare(self) -> Callable[[T_contra], R_co]:
        """Return the function that does a piece; called once in each worker, may take long."""
        ...


class Workers(Generic[T, R]):
    """Workers for the pieces of one work; a context manager, whose exit stops all of them.

    The workers of the run's executor are started only after `HERE_S`; until then this process does
    pieces itself, the last ones first. It does all pieces if there is no other worker (the serial
    executor, one processor), or if the work cannot be pickled, such as with a plant that was
    defined at a prompt.

    Parameters
    ----------
    ctx : Context
        Gives the executor, and the log for a note that the work cannot be sent.
    work : Divisible
        The work.

    Examples
    --------
    >>> with Workers(ctx, Searches(plant)) as workers:  # doctest: +SKIP
    ...     for found in workers.map(orbits):
    ...         advance(1)
    """

    def __init__(self, ctx: Context, work: Divisible[T, R]) -> None:
        self._ctx, self._work = ctx, work
        self._stack = ExitStack()
        self._crew: Crew | None = None
        self._alone = False
        self._do: Callable[[T], R] | None = None
        self._begun = 0
        self._process = os.getpid()

    def __enter__(self) -> Workers[T, R]:
        return self

    def __exit__(self, *exc: object) -> None:
        self._crew = None
        self._stack.close()

    def map(self, items: Sequence[T]) -> Generator[R, None, None]:
        """Yield the results of the work's function for all items, in order.

        Exhaust the iterator before another call; to stop early, leave the context.

        Parameters
        ----------
        items : sequence
            Picklable. They are begun in order, so that the longest ones should come first.

        Yields
        ------
        object
            Results. An error of the function is raised in place of its result; an error in another
            process has the traceback in its notes.

        Raises
        ------
        StageError
            If the work cannot be prepared, or a piece lost its worker `TRIES` times.
        """
        done: dict[int, _Result] = {}
        following = 0
        for number, result in self._results(items):
            done[number] = result
            while following in done:
                value, error = done.pop(following)
                if error is not None:
                    raise error
                yield value
                end_child_of(self._process)
                following += 1

    def ended(self, items: Sequence[T]) -> Generator[R, None, None]:
        """Yield the results of the work's function in the order in which they are completed.

        The results must identify their items. An error of the function is raised at once;
        otherwise as `map`.
        """
        for _, (value, error) in self._results(items):
            if error is not None:
                raise error
            yield value
            end_child_of(self._process)

    def _results(self, items: Sequence[T]) -> Iterator[tuple[int, _Result]]:
        """Yield number and result of every piece, as they end."""
        left, until = len(items), monotonic() + HERE_S
        while left and not self._alone and self._crew is None:
            if monotonic() < until:
                left -= 1
                yield left, self._here(items[left])
            else:
                self._hire()
        if self._crew is not None:
            yield from self._there(self._crew, items[:left])
        else:
            for number in range(left):
                yield number, self._here(items[number])

    def _here(self, item: T) -> _Result:
        """Do a piece in this process."""
        if self._do is None:
            self._do = self._work.prepare()
        try:
            return self._do(item), None
        except Exception as error:  # raised at its place
            return None, error

    def _hire(self) -> None:
        """Start the executor's workers, if it has others than this process."""
        with ExitStack() as stack:
            try:
                crew = stack.enter_context(self._ctx.executor.crew(_Pieces(self._work)))
            except Unsendable as error:
                self._ctx.info(f"done in the process of the run: {error}")
            else:
                if crew.slots > 1:
                    self._crew, self._stack = crew, stack.pop_all()
        self._alone = self._crew is None

    def _there(self, crew: Crew, items: Sequence[T]) -> Iterator[tuple[int, _Result]]:
        """Yield number and result of the pieces that workers do, as they end."""
        first, self._begun = self._begun, self._begun + len(items)
        fresh = iter(range(len(items)))
        lost: Counter[int] = Counter()
        under_way = 0
        ended: tuple[int, _Result] | None = None
        while True:
            # New pieces are submitted before a result is yielded, so that workers stay busy.
            for number in islice(fresh, crew.slots - under_way):
                crew.submit(Piece(first + number, items[number]))
                under_way += 1
            if ended is not None:
                yield ended
            if not under_way:
                return
            ended = None
            match crew.outcome():
                case Finished(piece, result):
                    under_way -= 1
                    ended = piece.number - first, result
                case Failed(_, message, trace):
                    raise _with_trace(StageError(message), trace)
                case Lost(piece, _, how):
                    lost[piece.number] += 1
                    if lost[piece.number] == TRIES:
                        raise StageError(
                            f"{TRIES} workers ended one after the other at the same work ({how})"
                        )
                    crew.submit(piece)


@dataclass(frozen=True)
class Piece(Job):
    """One item for the work's function; see also `Job`.

    Parameters
    ----------
    item : object
        The item.
    """

    item: Any


@dataclass(frozen=True)
class _Pieces:
    """Work on pieces as `hillsphere.interfaces.tasks.Work`."""

    work: Divisible[Any, Any]

    def prepare(self) -> Callable[[Piece], _Result]:
        try:
            return _Doing(self.work.prepare())
        except HillsphereError as error:  # any other may pass, and is tried again
            return _Refusing(_sendable(error))


@dataclass(frozen=True)
class _Doing:
    """Does pieces; returns result and error, so that an error reaches the run as what it is."""

    do: Callable[[Any], Any]

    def __call__(self, piece: Piece) -> _Result:
        try:
            return self.do(piece.item), None
        except Exception as error:  # the border of what a plugin computes
            return None, _sendable(error)


@dataclass(frozen=True)
class _Refusing:
    """Returns for every piece the error by which the work could not be prepared."""

    error: Exception

    def __call__(self, piece: Piece) -> _Result:
        return None, self.error


def _sendable(error: Exception) -> Exception:
    """Return an error with its traceback as a note; as a `StageError` if it cannot be pickled."""
    message, trace = format_error(error)
    try:
        return _with_trace(pickle.loads(pickle.dumps(error)), trace)
    except Exception:  # whatever the error's class makes of it
        return _with_trace(StageError(message), trace)


def _with_trace(error: Exception, trace: str) -> Exception:
    if trace:
        error.add_note(trace)
    return error
