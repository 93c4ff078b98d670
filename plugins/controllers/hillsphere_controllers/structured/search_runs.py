"""Runs of searches in this process or in workers, with progress, storage and interruption."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from hillsphere.errors import Interrupted
from hillsphere.interfaces import Context
from hillsphere.runs.workers import Workers
from hillsphere_controllers.structured.records import Problem, SearchResult, Start
from hillsphere_controllers.structured.routes import RouteSearch
from hillsphere_controllers.structured.search_store import SearchStore

__all__ = ["Progress", "SearchRun"]


@dataclass(frozen=True)
class Progress:
    """Progress of a synthesis, reported when a search has ended or has found a lower γ.

    Parameters
    ----------
    done, total : int
        Searches that have ended, and all that are planned so far.
    latest : SearchResult or None
        What the last one found; None while one goes on.
    gamma : float
        The smallest γ so far; infinite if there is none.
    current : float
        The smallest γ so far of the search that goes on, or that has ended.
    """

    done: int
    total: int
    latest: SearchResult | None
    gamma: float
    current: float


class SearchRun:
    """Runs searches in this process or in workers, until they have ended or the user stops them."""

    def __init__(
        self,
        problem: Problem,
        progress: Callable[[Progress], None] | None,
        ctx: Context | None,
        name: str,
    ) -> None:
        self._problem = problem
        self._progress, self._ctx = progress, ctx
        self.interrupted = False
        self._done, self._total, self._gamma = 0, 0, np.inf
        self._kept: SearchStore | None = None
        if ctx is not None:
            directory = ctx.workspace() / f"searches-{ctx.fingerprint[:16]}{name}"
            self._kept = SearchStore(directory, ctx.info)

    def all(self, starts: Sequence[Start]) -> list[SearchResult]:
        """Return the results of all searches, or of the finished ones after an interruption."""
        self._total += len(starts)
        by_start: dict[int, SearchResult] = {}
        try:
            with closing(self._iterate_results(starts)) as results:
                for one in results:
                    by_start[one.start.number] = one
                    self._report_result(one)
                    if self.interrupted:
                        break
        except (KeyboardInterrupt, Interrupted):
            self.interrupted = True
            if not np.isfinite(self._gamma):
                raise
        return [by_start[number] for number in sorted(by_start)]

    def _iterate_results(self, starts: Sequence[Start]) -> Generator[SearchResult, None, None]:
        """Yield the results of searches as they end, stored ones first."""
        if self._ctx is None or self._kept is None:
            yield from map(RouteSearch(self._problem, self._report_progress), starts)
            return
        left = []
        for start in starts:
            known = self._kept.read(start)
            if known is None:
                left.append(start)
            else:
                yield known
        with Workers(self._ctx, _Searches(self._problem, self._report_progress)) as workers:
            for one in workers.ended(left):
                yield self._kept.keep(one)

    def _report_result(self, result: SearchResult) -> None:
        self._done += 1
        self.interrupted = result.interrupted
        if result.allowed:
            self._gamma = min(self._gamma, result.gamma)
        if self._progress is not None:
            self._progress(Progress(self._done, self._total, result, self._gamma, result.gamma))

    def _report_progress(self, gamma: float) -> None:
        if self._progress is not None:
            least = min(self._gamma, gamma)
            self._progress(Progress(self._done, self._total, None, least, gamma))


@dataclass(frozen=True)
class _Searches:
    """Searches for `hillsphere.runs.workers.Workers`; progress is reported in this process."""

    problem: Problem
    tell: Callable[[float], None] | None

    def prepare(self) -> Callable[[Start], SearchResult]:
        """Return the search."""
        return RouteSearch(self.problem, self.tell)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Searches, (self.problem, None)
