"""Tests of a filter's model and beliefs about a fit of the whole arc; see `refit`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.checks import OF_FIT, OF_SIGMA, innovation_checks, measured_rows
from hillsphere_estimators.chi_square_tests import (
    Check,
    expected_check,
    inapplicable_check,
    most_extreme_check,
    one_sided_check,
)
from hillsphere_estimators.coloured_errors import coloured_nees
from hillsphere_estimators.refit import Refit, refit
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

__all__ = [
    "fit_arc",
    "fit_checks",
    "is_explained",
    "reference_checks",
]

_TENTH = 1.1
"""NEES per state in the presence of correlated errors up to which they do no harm: standard
deviations are then too small by 5 %, which is less than what the estimated correlation tells."""


def fit_arc(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    after: Sequence[Belief],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    asked: bool,
    whole: NDArray[np.bool_],
    curved: bool,
) -> tuple[Refit | None, str]:
    """Fit the whole arc, if it can be fitted.

    Parameters
    ----------
    model : EstimationModel
        The filter's model.
    prior : Belief
        N cases before the first set.
    measurements : sequence of MeasurementSet
        K sets.
    after : sequence of Belief
        K: the filter's, after each set.
    innovations : sequence of Innovation
        K: the rows that the filter has used count.
    controls : sequence of ndarray, shape (p, N)
        K: before each set.
    asked : bool
        Whether a fit is wanted.
    whole : ndarray of bool, shape (N,)
        Cases whose beliefs are finite.
    curved : bool
        Whether the fit starts from several states.

    Returns
    -------
    arc : Refit or None
        The fit.
    why : str
        Why there is none, "" if there is one.
    """
    if not asked:
        return None, "it was not asked for"
    if not whole.any():
        return None, "no case has a finite belief"
    # a lost case keeps the prior, so that the batch is computed as a whole
    beliefs = [
        Belief(
            np.where(whole, b.x, prior.x), np.where(whole[:, None, None], b.root, prior.root), b.t_s
        )
        for b in after
    ]
    counted = _count_used(measurements, innovations)
    try:
        with np.errstate(all="ignore"):
            return refit(model, prior, counted, beliefs, controls, many_starts=curved), ""
    except InputError as error:
        return None, str(error)
    except np.linalg.LinAlgError:
        return None, "a covariance is singular"


def fit_checks(
    arc: Refit | None, why: str, share: float, n: int, whole: NDArray[np.bool_],
    mixed: NDArray[np.bool_],
) -> dict[str, Check]:  # fmt: skip
    """Test the model about the fit, and the expected NEES of the filter.

    Parameters
    ----------
    arc : Refit, optional
        The fit.
    why : str
        Why there is none.
    share : float
        Probability with which a consistent filter fails each limit.
    n : int
        Number of states.
    whole : ndarray of bool, shape (N,)
        Cases whose beliefs are finite.
    mixed : ndarray of bool, shape (N,)
        Cases whose beliefs are mixtures.

    Returns
    -------
    dict of str to Check
        Those of `OF_FIT`, ``final_nees`` and ``mean_nees``; ``coloured_nees`` if the innovations
        about the fit are not white.
    """
    says = {
        "final_nees": "expected NEES at the end, per state",
        "mean_nees": "expected NEES on average over the sets, per state",
    }
    if arc is not None and not (arc.settled & whole).any():
        arc, why = None, "no fit has settled"
    if arc is None:
        return {name: inapplicable_check(name, "", len(whole), why) for name in (*OF_FIT, *says)}
    good = arc.settled & whole
    made = {c.name: c for c in _model_checks(arc, share, good, n)}
    if made["fit_whiteness"].above:
        made |= _coloured_checks(arc, made["fit_nis"], made["fit_bias"], good)
    # directions that a filter knows exactly have no error; there may be others at each time
    if not arc.dof[:, good].any():
        none = "all states are known exactly"
        return made | {name: inapplicable_check(name, "", len(whole), none) for name in says}
    for name, total, dof in (
        ("final_nees", arc.expected[-1], arc.dof[-1]),
        ("mean_nees", arc.expected.mean(axis=0), arc.dof.mean(axis=0)),
    ):
        made[name] = expected_check(
            name, says[name], np.where(good, total, 0.0), np.where(good, dof, 0.0), share, mixed
        )
    return made


def is_explained(
    arc: Refit | None, checks: dict[str, Check], share: float, n: int, whole: NDArray[np.bool_]
) -> bool:
    """Return whether the model explains the measurements of most cases, and those perfectly.

    The fit of a case may end in a wrong solution. The cases in which it does are told from a wrong
    model by the others: without them the tests pass.

    Parameters
    ----------
    arc : Refit, optional
        The fit.
    checks : dict of str to Check
        Those of `fit_checks`.
    share : float
        As there.
    n : int
        Number of states.
    whole : ndarray of bool, shape (N,)
        Cases whose beliefs are finite.

    Returns
    -------
    bool
        False without a fit.
    """
    if arc is None or checks["fit_nis"].reason:
        return False
    good = arc.settled & whole
    apart = np.any([checks[name].each_above for name in OF_FIT], axis=0)
    rest = good & ~apart
    if 2 * rest.sum() < len(whole):
        return False
    return not any(check.above for check in _model_checks(arc, share, rest, n))


def reference_checks(
    model: EstimationModel,
    prior: Belief,
    measurements: Sequence[MeasurementSet],
    innovations: Sequence[Innovation],
    controls: Sequence[Array],
    share: float,
    whole: NDArray[np.bool_],
) -> dict[str, Check]:
    """Return the tests of the innovations of an iterated sigma-point filter.

    A model that some filter's innovations agree with is not wrong. Sigma points account for the
    curvature of the motion, which neither an extended filter nor a pass about the fit does.

    Parameters
    ----------
    model : EstimationModel
        The filter's model.
    prior : Belief
        N cases before the first set.
    measurements : sequence of MeasurementSet
        K sets.
    innovations : sequence of Innovation
        K: the rows that the filter has used count.
    controls : sequence of ndarray, shape (p, N)
        K: before each set.
    share : float
        Probability with which a consistent filter fails each limit.
    whole : ndarray of bool, shape (N,)
        Cases whose beliefs are finite.

    Returns
    -------
    dict of str to Check
        The first three of `OF_SIGMA`; none if that filter fails.
    """
    estimator = BatchedUnscented(BatchedUnscentedSpec(update="iterated"))
    belief, made = prior, []
    try:
        with np.errstate(all="ignore"):
            for k, measured in enumerate(_count_used(measurements, innovations)):
                if k or not np.array_equal(prior.t_s, measured.t_s):
                    belief = estimator.predict(model, belief, measured.t_s, controls[k])
                belief, innovation = estimator.update(model, belief, measured)
                made.append(innovation)
            good = whole & np.isfinite(belief.x).all(axis=0)
            for innovation in made:
                good &= np.isfinite(innovation.covariance).all(axis=(1, 2))
            checks = innovation_checks(made, share, good, True, len(prior.x), OF_SIGMA)
    except (InputError, np.linalg.LinAlgError):
        return {}
    return {check.name: check for check in checks[:3]}


def _count_used(
    measurements: Sequence[MeasurementSet], innovations: Sequence[Innovation]
) -> list[MeasurementSet]:
    """Return the sets with only those rows present that the filter has used."""
    return [
        replace(m, present=m.present & (i.used | ~measured_rows(m)[:, None]))
        for m, i in zip(measurements, innovations, strict=True)
    ]


def _coloured_checks(
    arc: Refit, nis: Check, bias: Check, good: NDArray[np.bool_]
) -> dict[str, Check]:
    """Return what correlated errors of the measurements would mean, where they explain the NIS.

    They multiply the variance of a mean by (1 + ρ)/(1 − ρ), and so the limits of constant errors.
    """
    rho, power, nees = coloured_nees(arc.about, good)
    if nis.value > power * nis.high:
        return {}
    each = np.where(good, np.maximum(nees[-1], nees.mean(axis=0)), np.nan)
    value = max(float(nees[-1, good].mean()), float(nees[:, good].mean()))
    factor = (1.0 + rho) / (1.0 - rho)
    says = f"NEES per state if the errors of successive measurements are correlated by {rho:.2g}"
    return {
        "fit_bias": replace(
            bias, says=f"{bias.says}, errors correlated by {rho:.2g},", high=factor * bias.high,
            each_high=factor * bias.each_high,
        ),
        "coloured_nees": Check(
            "coloured_nees", says, value, 0.0, _TENTH, each, np.zeros(len(each)),
            np.full(len(each), _TENTH),
        ),
    }  # fmt: skip


def _model_checks(arc: Refit, share: float, good: NDArray[np.bool_], n: int) -> list[Check]:
    """Return the tests of the innovations about the fit, with that of constant errors."""
    made = innovation_checks(arc.innovations, share, good, True, n, OF_FIT)
    made[OF_FIT.index("fit_bias")] = _bias_check("fit_bias", arc, good, share)
    return made


def _bias_check(name: str, arc: Refit, good: NDArray[np.bool_], share: float) -> Check:
    """Return the test of constant errors, the same in all cases or another in each.

    The score sᵀ I⁻¹ s is χ² with as many degrees of freedom as the information I has directions.
    Curvature adds at most c to the score, and so √(cᵀ I⁻¹ c) to the root of its square.
    """
    says = "squared score of constant errors, per row"

    def squares(score: Array, information: Array) -> tuple[Array, Array]:
        value, vector = np.linalg.eigh(information)
        # directions without information, as those of rows that were never measured
        there = value > 1e-9 * np.maximum(value[:, -1:], 1e-300)
        along = np.einsum("Nji,Nj->Ni", vector, score)
        return (
            np.sum(np.where(there, along**2 / np.where(there, value, 1.0), 0.0), axis=1),
            there.sum(axis=1),
        )

    score, bent = (np.where(good[:, None], own, 0.0) for own in (arc.score, arc.curvature))
    information = np.where(good[:, None, None], arc.information, 0.0)
    each, rows = squares(score, information)
    more = squares(bent, information)[0]
    every = information.sum(axis=0)[None]
    common, degrees = squares(score.sum(axis=0)[None], every)
    wide = squares(bent.sum(axis=0)[None], every)[0]
    made = []
    for total, dof, excess in (
        (common[0], degrees[0], wide[0]), (each.sum(), rows.sum(), more.sum()),
    ):  # fmt: skip
        check = one_sided_check(name, says, float(total), float(dof), each, rows, 0.5 * share)
        made.append(replace(
            check, high=(np.sqrt(check.high) + np.sqrt(excess / max(dof, 1))) ** 2,
            each_high=(np.sqrt(check.each_high) + np.sqrt(more / np.maximum(rows, 1))) ** 2,
        ))  # fmt: skip
    return most_extreme_check(made)
