"""Rules that end a campaign before all its cases are done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from hillsphere.base.arrays import Array
from hillsphere.base.problems import did_you_mean
from hillsphere.cases.case_classes import LEVEL, decided_failures, failure_ratio, is_undecided
from hillsphere.errors import StageError

__all__ = ["Block", "StopCriteria"]


class Block(Protocol):
    """The part of a finished block of n cases that a stopping rule reads."""

    @property
    def metrics(self) -> tuple[str, ...]:
        """Names of the m metrics; none if every case raised."""
        ...

    @property
    def values(self) -> Array:
        """Their values, shape (m, n)."""
        ...

    @property
    def status(self) -> NDArray[np.str_]:
        """How each case ended, shape (n,)."""
        ...

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which cases failed, shape (n,)."""
        ...


@dataclass(frozen=True)
class StopCriteria:
    """When a campaign is to end early.

    The intervals are looked at after every block, and the first that is narrow (or high) enough
    ends the campaign. To look so often makes them promise too much: a campaign ends at a moment at
    which chance made its interval narrow, or high.

    - `failures_above` is hurt most. With a failure ratio of 10 %, just that of the limit, a single
      look at 95 % takes it to be above with a probability of 2 %; looks after every block from
      256 to 2048 cases do so in 10 % of the campaigns.
    - `failure_half_width` is hurt little, as the Clopper–Pearson interval promises less than it
      keeps: with a failure ratio of 5 %, 97 % of the intervals of 95 % that end at a half-width
      of 0.02 hold the truth, about as many as at a fixed number of cases.
    - `mean_half_widths`: 94.5 % instead of 95 % with an exponential metric that ends after some
      1000 cases, nothing to be seen with a normal one.

    Where it matters, ask for a higher confidence, or more `least_cases`.

    Parameters
    ----------
    failure_half_width : float or None
        End when neither end of the failure ratio's Clopper–Pearson interval is farther from the
        ratio than this, whether or not the undecided cases had failed.
    mean_half_widths : mapping of str to float
        End when the Student intervals of the means of all these metrics are as narrow as this to
        either side. If `failure_half_width` is given too, both must be reached.
    failures_above : float or None
        End when the lower end of the failure ratio's interval is above this, even if none of the
        undecided cases had failed.
    least_cases : int
        Cases before which the campaign does not end.
    level : float
        Confidence level of the intervals.
    """

    failure_half_width: float | None = None
    mean_half_widths: Mapping[str, float] = field(default_factory=dict)
    failures_above: float | None = None
    least_cases: int = 256
    level: float = LEVEL

    def rule(self) -> Callable[[Sequence[Block]], str]:
        """Return a rule for one campaign.

        Returns
        -------
        callable
            Given the finished blocks from the first on, in order, it returns why the campaign ends
            there, or ``""``. Call it after each block: it remembers what it has seen, and looks at
            nothing but what was added.

        Raises
        ------
        StageError
            By the rule, if a metric is named that the stage does not have.
        """
        return _Rule(self)


@dataclass
class _Running:
    """Mean and sum of squares about it, block by block (Chan, Golub and LeVeque, 1983)."""

    count: int = 0
    mean: float = 0.0
    square: float = 0.0

    def add(self, values: Array) -> None:
        n = values.size
        if n == 0:
            return
        mean = float(np.mean(values))
        square = float(np.sum((values - mean) ** 2))
        total, apart = self.count + n, mean - self.mean
        self.square += square + apart**2 * self.count * n / total
        self.mean += apart * n / total
        self.count = total

    def half_width(self, level: float) -> float:
        if self.count < 2:
            return np.inf
        error = np.sqrt(self.square / (self.count - 1) / self.count)
        return float(stdtrit(self.count - 1, 0.5 * (1.0 + level)) * error)


class _Rule:
    def __init__(self, criteria: StopCriteria) -> None:
        self._criteria = criteria
        self._restart()

    def _restart(self) -> None:
        self._blocks = self._cases = self._failures = self._undecided = 0
        self._means = {name: _Running() for name in self._criteria.mean_half_widths}

    def __call__(self, prefix: Sequence[Block]) -> str:
        if len(prefix) < self._blocks:
            self._restart()
        while self._blocks < len(prefix):
            self._take(prefix[self._blocks])
        return self._reason() if self._cases >= self._criteria.least_cases else ""

    def _take(self, block: Block) -> None:
        self._blocks += 1
        self._cases += block.failed.size
        undecided = is_undecided(block.status)
        self._undecided += int(np.count_nonzero(undecided))
        self._failures += int(np.count_nonzero(decided_failures(block)))
        for name, running in self._means.items():
            if name in block.metrics:
                values = block.values[block.metrics.index(name)]
                sound = (~block.failed | (block.status == "requirement")) & ~undecided
                running.add(values[sound & np.isfinite(values)])
            elif block.metrics:
                hint = did_you_mean(name, list(block.metrics), otherwise="metrics")
                raise StageError(
                    f"the campaign is to end by the mean of {name!r}, but the stage has no such "
                    f"metric{hint}"
                )

    def _reason(self) -> str:
        criteria, cases = self._criteria, self._cases
        decided = cases - self._undecided
        found = failure_ratio(self._failures, decided, self._undecided, criteria.level)
        ratio, (low, high) = float(found.value), found.sure
        so_far = f"{self._failures} of {decided} cases failed"
        if self._undecided:
            so_far = f"{self._failures} of {decided} decided cases failed, {self._undecided} are "
            so_far += "undecided"
        percent = f"{100.0 * criteria.level:g} %"
        above = criteria.failures_above
        if above is not None and low > above:
            return (
                f"{so_far}: with {percent} confidence more than {low:.3g}, above the limit of "
                f"{above:g}"
            )
        narrow = []
        if (width := criteria.failure_half_width) is not None:
            reach = max(ratio - low, high - ratio)
            if not reach <= width:
                return ""
            narrow.append(f"failure ratio {ratio:.3g} to ±{reach:.2g} (asked ±{width:g})")
        for name, width in criteria.mean_half_widths.items():
            running = self._means[name]
            reach = running.half_width(criteria.level)
            if reach > width:
                return ""
            narrow.append(f"mean {name} {running.mean:.6g} to ±{reach:.2g} (asked ±{width:g})")
        return f"{so_far}; known at {percent}: {', '.join(narrow)}" if narrow else ""
