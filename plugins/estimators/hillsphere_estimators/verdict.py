"""Verdict on a run of a filter from what is known without the true states.

Four kinds of tests are made, of each case and of all cases together:

- the normalised innovations squared (NIS), their mean and their correlation in time [1]_;
- the curvature of each measurement and motion over the beliefs (`linearity`);
- a fit of the whole arc (`refit`): whether the model explains the measurements, and the expected
  NEES of the filter's beliefs in its light.

Every test is at a share of the level: the sum of the shares is the level (Bonferroni), so that a
consistent filter in a linear problem is called anything else with less than that probability.
Where the fit has settled, the innovations about the fitted trajectory decide on the model and the
expected NEES decides on the filter. The filter's own innovations, which are not normal where a wide
prior meets a curved measurement, then decide nothing. Without a fit they decide.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation,
   section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.checks import OF_FILTER, Check, innovation_checks, rejected_check
from hillsphere_estimators.fit_checks import (
    OF_FIT,
    OF_SIGMA,
    fit_arc,
    fit_checks,
    is_explained,
    reference_checks,
)
from hillsphere_estimators.linearity import (
    NonlinearUpdate,
    curvature_checks,
    curved_cases,
    first_nonlinear,
    measure_curvatures,
)
from hillsphere_estimators.refit import Refit
from hillsphere_estimators.sigma_points import update_mask

__all__ = ["Answer", "Verdict", "verdict"]

Answer: TypeAlias = Literal[
    "consistent", "overconfident", "underconfident", "not linear enough here", "undecided"
]
"""What a verdict says of a run. "not linear enough here" is an overconfident filter whose model is
right but curved; "overconfident" one whose model does not explain the measurements, or whose
covariance is too small for another reason."""
_LIMITS = 20
"""Limits among which the level is divided. Innovations have eight: NIS, late NIS and slow NIS, high
and low each, mean and whiteness; they are tested about the filter and about the fit. The expected
NEES has four: at the end and on average, high and low each. With the level 0.01 each limit is that
of a two-sided band of 99.9 %."""
_POORLY_FITTED = 2.0
"""Mean NIS per row about a fit above which it is no solution although the model explains the
measurements: curvature adds some ten percent to it, a wrong minimum many times its value."""


@dataclass(frozen=True)
class Verdict:
    """Verdict on a run of N cases.

    Parameters
    ----------
    answer : str
        Of all cases together: "consistent", "overconfident", "underconfident", "not linear enough
        here" or "undecided".
    reason : str
        Why, in a sentence.
    cases : tuple of str
        The same of each case.
    checks : dict of str to Check
        Tests by name: ``nis``, ``late_nis``, ``slow_nis``, ``mean``, ``whiteness`` and
        ``rejected`` of the filter's innovations; with ``fit_`` and ``sigma_`` of those about the
        fit and of a sigma-point filter; ``fit_bias``, constant errors of the measurements;
        ``final_nees`` and ``mean_nees``, the expected NEES; ``curvature``, ``path``,
        ``posterior_curvature`` and ``motion``.
    nonlinear : NonlinearUpdate, optional
        The first update or motion that is too curved, whatever the answer.
    fit : Refit, optional
        The fit of the whole arc, if there is one.
    level : float
        Probability with which a consistent filter in a linear problem is called anything else.
    """

    answer: Answer
    reason: str
    cases: tuple[Answer, ...]
    checks: dict[str, Check]
    nonlinear: NonlinearUpdate | None
    fit: Refit | None
    level: float

    def lines(self) -> list[str]:
        """Return the answer with its reason, and a line for each test."""
        return [f"{self.answer}: {self.reason}", *(str(check) for check in self.checks.values())]


def verdict(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array] | None = None,
    *,
    before: Sequence[Belief] | None = None,
    level: float = 0.01,
    fit: bool = True,
) -> Verdict:
    """Judge a run of a filter without the true states; see the module.

    Parameters
    ----------
    model : EstimationModel
        The filter's model.
    prior : Belief
        N cases before the first set of measurements, at its time or before.
    measurements : sequence of MeasurementSet
        K sets, in order.
    after : sequence of Belief
        K: the filter's beliefs after each set.
    innovations : sequence of Innovation
        K: those of the filter.
    controls : sequence of ndarray, shape (p, N), optional
        K: before each set; none by default. The first counts only if the prior is earlier.
    before : sequence of Belief, optional
        K: the filter's beliefs before each set; by default predicted by linearisation from those
        after the sets before.
    level : float
        Probability of a false alarm in a linear problem, divided equally among the tests.
    fit : bool
        Whether the whole arc is fitted. It costs some ten runs of an extended filter, three times
        as much where an update is curved.

    Returns
    -------
    Verdict
        With every test's statistic and limit.

    Raises
    ------
    InputError
        If the sequences differ in length, hold other numbers of cases, or there is no measurement.
    """
    cases, count = len(prior.t_s), len(measurements)
    if controls is None:
        controls = [np.zeros((0, cases))] * count
    _check_lengths(prior, measurements, after, innovations, controls, before, level)
    share = level / _LIMITS
    finite = np.array(
        [np.isfinite(b.x).all(axis=0) & np.isfinite(b.root).all(axis=(1, 2)) for b in after]
    )
    whole = np.asarray(finite.all(axis=0))
    checks: dict[str, Check] = {}
    optimal = update_mask(model, len(prior.x)) is None
    for check in innovation_checks(innovations, share, whole, optimal, len(prior.x), OF_FILTER):
        checks[check.name] = check
    checks["rejected"] = rejected_check(measurements, innovations)
    curves, motions = measure_curvatures(
        model, prior, measurements, after, innovations, controls, before
    )
    nonlinear = first_nonlinear(curves, motions, measurements)
    checks |= curvature_checks(curves, motions)
    curved = curved_cases(curves, motions)
    arc, why = fit_arc(
        model, prior, measurements, after, innovations, controls, fit, whole, bool(curved.any())
    )
    checks |= fit_checks(arc, why, share, len(prior.x), whole)
    if curved.any():
        checks |= reference_checks(model, prior, measurements, innovations, controls, share, whole)
    explained = is_explained(arc, checks, share, len(prior.x), whole)
    about = checks["fit_nis"]
    answers = tuple(
        _classify(
            _Flags.of(checks, k), bool(curved[k]), explained,
            bool(about.each[k] > np.maximum(_POORLY_FITTED, about.each_high[k])),
        )
        for k in range(cases)
    )  # fmt: skip
    overall = _classify(
        _Flags.of(checks), nonlinear is not None, explained, bool(about.value > _POORLY_FITTED)
    )
    if not whole.all() and overall in ("consistent", "underconfident"):
        overall = "undecided" if nonlinear is None else "not linear enough here"
    reason = _reason(overall, checks, nonlinear, arc, int((~whole).sum()))
    return Verdict(overall, reason, answers, checks, nonlinear, arc, level)


def _check_lengths(
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    before: Sequence[Belief] | None,
    level: float,
) -> None:
    if not 0.0 < level < 1.0:
        raise InputError(f"level must lie between 0 and 1, got {level:g}")
    count, cases = len(measurements), len(prior.t_s)
    if not count:
        raise InputError("a verdict needs at least one set of measurements, got none")
    lengths = {"after": after, "innovations": innovations, "controls": controls}
    if before is not None:
        lengths["before"] = before
    for name, given in lengths.items():
        if len(given) != count:
            raise InputError(
                f"{name} must have one entry for each of {count} sets of measurements, got "
                f"{len(given)}"
            )
    for k in range(count):
        others = len(measurements[k].t_s), len(after[k].t_s), innovations[k].used.shape[1]
        if set(others) != {cases}:
            raise InputError(
                f"set {k}: the prior has {cases} cases, but measurements, beliefs and innovations "
                f"have {others[0]}, {others[1]} and {others[2]}"
            )


@dataclass(frozen=True)
class _Flags:
    """Which tests of a case, or of all cases together, are above or below their limits."""

    high: frozenset[str]
    low: frozenset[str]
    there: frozenset[str]

    @classmethod
    def of(cls, checks: dict[str, Check], case: int | None = None) -> _Flags:
        """Return those of one case, or of all together."""

        def names(pooled: str, each: str) -> frozenset[str]:
            return frozenset(
                name for name, check in checks.items()
                if (getattr(check, pooled) if case is None else getattr(check, each)[case])
            )  # fmt: skip

        there = frozenset(
            name for name, check in checks.items()
            if np.isfinite(check.value if case is None else check.each[case])
        )  # fmt: skip
        return cls(names("above", "each_above"), names("below", "each_below"), there)


def _classify(flags: _Flags, curved: bool, explained: bool, poorly_fitted: bool = False) -> Answer:
    """Return the answer from the tests of one case or of all.

    Innovations show whether the model is right. They are taken about three linearisations, the
    filter's, that about the fit, and by sigma points; if the tests of any of them pass the model is
    not wrong. The expected NEES then shows whether the filter's beliefs are.

    Parameters
    ----------
    flags : _Flags
        Tests that have failed.
    curved : bool
        Whether the motion or an update is curved.
    explained : bool
        Whether the model explains most cases, see `is_explained`.
    poorly_fitted : bool
        Whether the NIS about the fit is above `_POORLY_FITTED`.
    """
    if "nis" not in flags.there:
        return "undecided"
    fitted = "final_nees" in flags.there
    # the power of the innovations, about whatever linearisation: one that passes clears the model
    powers = [
        bool(flags.high & set(names[:3]))
        for names in (OF_FILTER, OF_FIT, OF_SIGMA)
        if names[0] in flags.there
    ]
    wrong = all(powers)
    if fitted and flags.high & set(OF_FIT[:3]) and poorly_fitted and not (wrong or explained):
        fitted = False
    bias = (OF_FIT if fitted else OF_FILTER)[3]
    if not (fitted and flags.high & set(OF_FIT[:3])):
        wrong = wrong or bias in flags.high
    optimistic = fitted and bool(flags.high & {"final_nees", "mean_nees"})
    # innovations smaller than stated, and a fit that is worse than the model: they contradict
    if curved and poorly_fitted and "nis" in flags.low and not explained and not optimistic:
        return "undecided"
    if optimistic and curved and (explained or not wrong):
        return "not linear enough here"
    if not fitted and curved:
        if powers[0]:
            return "undecided" if "nis" in flags.low else "not linear enough here"
        return "not linear enough here" if "posterior_curvature" in flags.high else "undecided"
    if wrong or optimistic or "rejected" in flags.high:
        return "overconfident"
    names = OF_FIT if fitted else OF_FILTER
    if flags.low & {*names[1:3], "final_nees"}:
        return "underconfident"
    # coloured innovations of a filter that shows no power too much: of a curved one by curvature
    return "undecided" if names[4] in flags.high and not curved else "consistent"


def _reason(
    answer: Answer,
    checks: dict[str, Check],
    nonlinear: NonlinearUpdate | None,
    arc: Refit | None,
    lost: int,
) -> str:
    """Return why, in a sentence."""
    failed = [
        str(check)
        for name, check in checks.items()
        if check.above and name not in ("curvature", "path", "posterior_curvature", "motion")
    ]
    low = [str(check) for check in checks.values() if check.below]
    gone = f"; the beliefs of {lost} cases are not finite" if lost else ""
    if answer == "not linear enough here":
        more = f"; {'; '.join(failed)}" if failed else ""
        return f"{nonlinear}{more}{gone}"
    if answer == "overconfident":
        return "; ".join(failed) + gone
    if answer == "underconfident":
        return "; ".join(low) + gone
    if answer == "undecided":
        return f"no test can decide: {checks['final_nees']}{gone}"
    return f"no test fails its limit{gone}"
