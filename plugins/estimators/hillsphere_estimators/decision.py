"""The answer of a verdict and its reason, from the tests of one case or of all together."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from hillsphere_estimators.checks import OF_FILTER, OF_FIT, OF_SIGMA
from hillsphere_estimators.chi_square_tests import Check

__all__ = ["Answer", "Circumstances", "Decision", "decide"]

Answer: TypeAlias = Literal[
    "consistent", "overconfident", "underconfident", "not linear enough here", "undecided"
]
"""What a verdict says of a run. "not linear enough here" is an overconfident filter whose model is
right but curved; "overconfident" one whose model does not explain the measurements, or whose
covariance is too small for another reason."""
_NEES = ("final_nees", "mean_nees")
_MEASURES = ("curvature", "path", "posterior_curvature", "motion", "coloured_nees")
"""Checks that say where theory holds, or what would be if; they are no tests of the filter."""
_SLOW = ("slow_nis", "fit_slow_nis", "sigma_slow_nis")
"""Tests that errors of measurements fail that are correlated in time, whatever the filter's own
errors are."""
_TWICE = 4.0
"""Mean NIS per row of a filter whose innovations are twice as large as it states. A run whose limit
is above that, of less than seven rows at the default level, is too short to be called
consistent."""


@dataclass(frozen=True)
class Decision:
    """An answer with its reason.

    Parameters
    ----------
    answer : str
        See `Answer`.
    reason : str
        Why, in a sentence: the tests that have led to the answer, and others that have failed.
    """

    answer: Answer
    reason: str


@dataclass(frozen=True)
class Circumstances:
    """What a decision depends on besides the tests.

    Parameters
    ----------
    curved : bool
        Whether the motion or an update is curved.
    explained : bool
        Whether the model explains most cases, see `is_explained`.
    poorly_fitted : bool
        Whether the NIS about the fit is that of a wrong solution.
    asked : bool
        Whether a fit was asked for.
    place : str
        The first curved motion or update, in words.
    lost : int
        Number of cases without finite beliefs.
    """

    curved: bool
    explained: bool
    poorly_fitted: bool = False
    asked: bool = True
    place: str = ""
    lost: int = 0


def decide(checks: dict[str, Check], case: int | None, at: Circumstances) -> Decision:
    """Return the answer from the tests of one case, or of all together, with its reason.

    Innovations show whether the model is right. They are taken about three linearisations, the
    filter's, that about the fit, and by sigma points; if the tests of any of them pass the model is
    not wrong. The expected NEES then shows whether the filter's beliefs are.

    Parameters
    ----------
    checks : dict of str to Check
        Tests by name.
    case : int or None
        The case; None for all together.
    at : Circumstances
        What else counts.

    Returns
    -------
    Decision
        "consistent" only where the expected NEES was tested, or no fit was asked for.
    """
    seen = _Seen(checks, case)
    gone = f"; the beliefs of {at.lost} cases are not finite" if at.lost else ""
    found = _weigh(seen, at)
    if at.lost and found.answer in ("consistent", "underconfident"):
        if at.place:
            return Decision("not linear enough here", f"{at.place}{gone}")
        return Decision("undecided", f"not all cases can be judged{gone}")
    return Decision(found.answer, found.reason + gone)


class _Seen:
    """Which tests of a case, or of all cases together, are above or below their limits."""

    def __init__(self, checks: dict[str, Check], case: int | None) -> None:
        self.checks = checks

        def names(pooled: str, each: str) -> frozenset[str]:
            return frozenset(
                name for name, check in checks.items()
                if (getattr(check, pooled) if case is None else getattr(check, each)[case])
            )  # fmt: skip

        self.high = names("above", "each_above")
        self.low = names("below", "each_below")
        self.there = frozenset(
            name for name, check in checks.items()
            if np.isfinite(check.value if case is None else check.each[case])
        )  # fmt: skip
        nis = checks["nis"]
        self.nis_limit = float(nis.high if case is None else nis.each_high[case])

    def say(self, names: Iterable[str]) -> str:
        """Return those of the tests that have failed, in words."""
        chosen = set(names) & (self.high | self.low)
        return "; ".join(str(check) for name, check in self.checks.items() if name in chosen)


def _weigh(seen: _Seen, at: Circumstances) -> Decision:
    """Return the decision for cases with finite beliefs."""
    if "nis" not in seen.there:
        return Decision("undecided", f"no innovation can be tested: {seen.checks['nis']}")
    high, low = seen.high, seen.low
    fitted = "final_nees" in seen.there
    # the power of the innovations, about whatever linearisation: one that passes clears the model
    powers = [
        bool(high & set(names[:3]))
        for names in (OF_FILTER, OF_FIT, OF_SIGMA)
        if names[0] in seen.there
    ]
    wrong = all(powers)
    no_fit = str(seen.checks["final_nees"])
    if fitted and high & set(OF_FIT[:3]) and at.poorly_fitted and not (wrong or at.explained):
        fitted, no_fit = False, f"the fit is no solution: {seen.say(OF_FIT[:3])}"
    names = OF_FIT if fitted else OF_FILTER
    if not (fitted and high & set(OF_FIT[:3])):
        wrong = wrong or names[3] in high
    optimistic = fitted and bool(high & set(_NEES))
    contradiction = f"the tests contradict each other: {seen.say((*OF_FILTER, *OF_FIT))}"
    # innovations smaller than stated, and a fit that is worse than the model
    if (
        at.curved and at.poorly_fitted and "nis" in low
        and not at.explained and not optimistic
    ):  # fmt: skip
        return Decision("undecided", contradiction)
    failed = seen.say(set(high) - set(_MEASURES))
    if optimistic and at.curved and (at.explained or not wrong):
        return Decision("not linear enough here", _join(at.place, failed))
    if not fitted and at.curved:
        if powers[0]:
            if "nis" in low:
                return Decision("undecided", contradiction)
            return Decision("not linear enough here", _join(at.place, failed))
        if "posterior_curvature" in high:
            return Decision(
                "not linear enough here", _join(at.place, seen.say({"posterior_curvature"}))
            )
        return Decision("undecided", _join(f"{at.place}; without a fit it is not known what it "
                                           f"has done", no_fit))  # fmt: skip
    powerful = {*OF_FILTER[:2], *OF_FIT[:2], *OF_SIGMA[:2], names[3], "rejected"}
    if (
        wrong and fitted and not optimistic and not high & powerful
        and "coloured_nees" in seen.there and "coloured_nees" not in high
    ):  # fmt: skip
        return Decision("undecided", _join(
            "the innovations are correlated in time: with too little process noise the filter is "
            "overconfident, with correlated errors of the measurements it is not",
            seen.say((*_SLOW, "whiteness", "fit_whiteness")),
        ))  # fmt: skip
    if wrong or optimistic or "rejected" in high:
        return Decision("overconfident", failed)
    if below := low & {*names[1:3], "final_nees"}:
        return Decision("underconfident", seen.say(low | below))
    return _accept(seen, at, names, fitted, no_fit)


def _accept(
    seen: _Seen, at: Circumstances, names: tuple[str, ...], fitted: bool, no_fit: str
) -> Decision:
    """Return "consistent", or why that cannot be said although no test has decided against it."""
    rest = (seen.high | seen.low) - set(_MEASURES)
    said = seen.say(rest)
    if rest and not at.curved:
        return Decision("undecided", f"tests fail that do not tell by themselves in which way the "
                                     f"covariance is wrong: {said}")  # fmt: skip
    if not fitted and at.asked:
        return Decision("undecided", f"the errors of the states cannot be tested: {no_fit}")
    if not seen.nis_limit < _TWICE:
        return Decision(
            "undecided",
            "there are too few measurements: errors twice as large as stated might pass, "
            f"{seen.checks['nis']}",
        )
    alone = "" if fitted else f"; only the innovations were tested, {no_fit}"
    if rest:
        return Decision(
            "consistent",
            "the tests that hold where updates or motion are curved pass"
            f"{alone}; curvature accounts for the failure of others: {said}",
        )
    return Decision("consistent", f"no test fails its limit{alone}")


def _join(*parts: str) -> str:
    return "; ".join(part for part in parts if part)
