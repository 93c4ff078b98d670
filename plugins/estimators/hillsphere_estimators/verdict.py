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
prior meets a curved measurement, then decide nothing. Without a fit they decide, but nothing is
called consistent, unless no fit was asked for. The rules are in `decision`; where the theory of a
test does not hold the test does not decide:

- constant errors count only as far as curvature does not explain them (`fit_checks`);
- correlated innovations alone do not decide if errors of measurements that are correlated explain
  them and leave the filter consistent (`coloured_errors`);
- of mixtures only the means of squares are tested, by their spread (`expected_check`);
- directions of the states that are known exactly are left out.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation,
   section 5.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.checks import OF_FILTER, innovation_checks, rejected_check
from hillsphere_estimators.chi_square_tests import Check
from hillsphere_estimators.decision import Answer, Circumstances, decide
from hillsphere_estimators.fit_checks import (
    fit_arc,
    fit_checks,
    is_explained,
    reference_checks,
)
from hillsphere_estimators.linearity import NonlinearUpdate, measure_curvatures
from hillsphere_estimators.mixture import mixture_of
from hillsphere_estimators.refit import Refit
from hillsphere_estimators.sigma_points import update_mask

__all__ = ["Answer", "Verdict", "verdict"]

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
        ``final_nees`` and ``mean_nees``, the expected NEES; ``coloured_nees``, what correlated
        errors of the measurements would make of it; ``curvature``, ``path``,
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
    mixed = _find_mixtures(after)
    for check in innovation_checks(
        innovations, share, whole, optimal, len(prior.x), OF_FILTER, mixed
    ):
        checks[check.name] = check
    checks["rejected"] = rejected_check(measurements, innovations)
    bent = measure_curvatures(model, prior, measurements, after, innovations, controls, before)
    nonlinear, curved = bent.first(), bent.curved
    checks |= bent.checks()
    arc, why = fit_arc(
        model, prior, measurements, after, innovations, controls, fit, whole, bool(curved.any())
    )
    checks |= fit_checks(arc, why, share, len(prior.x), whole, mixed)
    if curved.any():
        checks |= reference_checks(model, prior, measurements, innovations, controls, share, whole)
    explained = is_explained(arc, checks, share, len(prior.x), whole)
    about = checks["fit_nis"]
    at = Circumstances(
        nonlinear is not None, explained, bool(about.value > _POORLY_FITTED), fit,
        "" if nonlinear is None else str(nonlinear), int((~whole).sum()),
    )  # fmt: skip
    poorly = about.each > np.maximum(_POORLY_FITTED, about.each_high)
    answers = tuple(
        decide(
            checks, k, replace(at, curved=bool(curved[k]), poorly_fitted=bool(poorly[k]), lost=0)
        ).answer
        for k in range(cases)
    )
    found = decide(checks, None, at)
    return Verdict(found.answer, found.reason, answers, checks, nonlinear, arc, level)


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


def _find_mixtures(after: Sequence[Belief]) -> NDArray[np.bool_]:
    """Return the cases (N,) whose belief has more than one component at any time."""
    return np.asarray(np.any([mixture_of(belief)[0].count > 1 for belief in after], axis=0))
