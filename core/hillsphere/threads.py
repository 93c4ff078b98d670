"""Several independent pieces of work at once, in threads of this process.

Compiled code runs outside the interpreter's lock, so that threads share the processors without
sending anything to other processes. Each piece must be independent and hold no `Taylor` integrator
of another; results come in the order of the items, whatever the order in which they are done, and
are the same bits for any number of threads.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

__all__ = ["in_threads", "processors"]

T = TypeVar("T")
R = TypeVar("R")


def processors() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(
    function: Callable[[T], R], items: Iterable[T], workers: int | None = None
) -> Generator[R, None, None]:
    """Yield ``function(item)`` for every item, in order.

    Parameters
    ----------
    function : callable
        Called in other threads; it must not touch what another call touches.
    items : iterable
        Taken up one by one, at most two per thread ahead of what has been yielded.
    workers : int, optional
        Threads; by default one per processor. With one, everything is done in the caller's.

    Yields
    ------
    object
        Results. What a call raises is raised here, at its place; calls that have not begun are
        then given up, as they are when the caller stops early.
    """
    count = workers if workers is not None else processors()
    if count <= 1:
        yield from map(function, items)
        return
    ahead: deque[Future[R]] = deque()
    pool = ThreadPoolExecutor(count, thread_name_prefix="hillsphere")
    try:
        for item in items:
            ahead.append(pool.submit(function, item))
            if len(ahead) >= 2 * count:
                yield ahead.popleft().result()
        while ahead:
            yield ahead.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
