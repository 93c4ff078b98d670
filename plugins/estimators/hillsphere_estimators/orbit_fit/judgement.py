"""Whether recorded data agree with the fit: a verdict from the residuals alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from scipy.stats import chi2, norm

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere_estimators.orbit_fit.fitting import EditedFit
from hillsphere_estimators.orbit_fit.hints import explain_misfit
from hillsphere_estimators.orbit_fit.records import Arc, Record, labels_of

__all__ = ["LEVEL", "Answer", "Judgement", "RowCheck", "judge_fit"]

Answer: TypeAlias = Literal["consistent", "inconsistent", "noise overstated", "undecided"]

LEVEL = 0.01
"""Probability with which a right model and right standard deviations are called anything else; it
is divided equally among all tests (Bonferroni)."""
_MOST_EDITED = 0.1
"""Share of the values of a row that may be left out. Receivers lose a few percent; editing that
takes more removes the evidence against the model."""
_FEW_EDITED = 2
"""So many may be left out of any row, however short."""
_FEWEST_IN_LINE = 30
"""Values of a row from which the correlation of neighbours is tested; the fit itself correlates the
residuals of fewer."""
_DETERMINED = 0.5
"""Standard deviation of a combination of states after the fit over that before, above which data
without a prior have not determined it."""


@dataclass(frozen=True)
class RowCheck:
    """Residuals of one row of a record that the fit has used, in standard deviations.

    Parameters
    ----------
    count, edited : int
        Values of the row, and those left out.
    mean : float
        Mean residual of all values, about a fit of all, in the stated standard deviations.
    rms : float
        Root mean square of the residuals over what it should be; NaN without values.
    bias : float
        Constant error over its standard deviation; NaN where the states take it up.
    correlation : float
        Of neighbours in time, times the root of their number; NaN for few values.
    """

    count: int
    edited: int
    mean: float
    rms: float
    bias: float
    correlation: float


@dataclass(frozen=True)
class Judgement:
    """A verdict.

    Parameters
    ----------
    answer : str
        "consistent", "inconsistent", "noise overstated" (the residuals are smaller than their
        standard deviations say) or "undecided".
    reasons : tuple of str
        Why, the end of a sentence each, the weightiest first.
    hints : tuple of str
        What would explain it, in sentences.
    squares, low, high : float
        Sum of squares per degree of freedom, and its band.
    dof : int
        Degrees of freedom.
    rows : tuple of RowCheck
        In the order of the sets' rows.
    """

    answer: Answer
    reasons: tuple[str, ...]
    hints: tuple[str, ...]
    squares: float
    low: float
    high: float
    dof: int
    rows: tuple[RowCheck, ...]


def judge_fit(
    edited: EditedFit,
    arc: Arc,
    prior: Belief,
    records: Sequence[Record],
    threshold: float | None,
    free_of_prior: int,
    doubts: Sequence[str] = (),
) -> Judgement:
    """Judge a fit by its residuals.

    Tested are the sum of squares (χ²), a constant error of each row that the states do not take up,
    the correlation of neighbouring residuals of each row, and how much was left out.

    Parameters
    ----------
    edited : EditedFit
        The fit.
    arc : Arc
        All data.
    prior : Belief
        At the start, N = 1.
    records : sequence of Record
        The same data.
    threshold : float or None
        Of the editing.
    free_of_prior : int
        Number of states without a prior.
    doubts : sequence of str
        Other reasons for which the fit decides nothing.

    Returns
    -------
    Judgement
        The verdict.
    """
    about, fit, labels = edited.residuals, edited.fit, labels_of(records)
    normal = about.residual / np.maximum(about.sigma(), 1e-3)
    rows = tuple(
        _check_row(edited, arc, normal, row) for row in range(len(labels))
    )  # fmt: skip
    tests = 2 + 2 * len(rows)
    share = LEVEL / tests
    # the squares of normal numbers of which those beyond the threshold were left out
    spared = 1.0 if threshold is None else _truncated_variance(threshold)
    dof = int(fit.rows[0]) - free_of_prior
    unit = max(dof, 1)
    low, high = (spared * float(chi2.ppf(p, unit)) / unit for p in (share, 1.0 - share))
    squares = float(fit.squares[0]) / unit
    wrong: list[tuple[float, str]] = []
    small = []
    if squares > high:
        wrong.append((squares / high - 10.0, (
            f"the residuals are too large: their squares are {squares:.4g} a degree of freedom, "
            f"above {high:.4g}"
        )))  # fmt: skip
    elif squares < low:
        small.append(
            f"the residuals are smaller than their standard deviations say: their squares are "
            f"{squares:.4g} a degree of freedom, below {low:.4g}"
        )
    bound = float(norm.isf(0.5 * share))
    for check, label in zip(rows, labels, strict=True):
        share_out = check.edited / max(check.count, 1)
        if check.edited > max(_FEW_EDITED, _MOST_EDITED * check.count):
            text = f"{label}: {check.edited} of {check.count} values were left out"
            wrong.append((1e3 + share_out, text))
        if abs(check.bias) > bound:
            text = f"{label}: a constant error of {check.bias:+.1f} standard deviations"
            wrong.append((abs(check.bias) / bound, text))
        if abs(check.correlation) > bound:
            text = (
                f"{label}: neighbouring residuals are correlated, {check.correlation:+.1f} "
                "standard deviations"
            )
            wrong.append((abs(check.correlation) / bound - 1.0, text))
    doubts = [*doubts, *_doubts(edited, dof, free_of_prior, bool(doubts))]
    answer: Answer = "consistent"
    if doubts:
        answer = "undecided"
    elif wrong:
        answer = "inconsistent"
    elif small:
        answer = "noise overstated"
    worst_first = [text for _, text in sorted(wrong, key=lambda one: -one[0])]
    reasons = tuple(doubts or [*worst_first, *small] or ["no test fails its limit"])
    is_misfit = bool(fit.settled[0]) and (answer == "inconsistent" or not edited.is_stable)
    hints = explain_misfit(
        edited, arc, prior, [record.observable for record in records], threshold, is_misfit
    )
    rows = tuple(replace(row, mean=float(hints.means[k])) for k, row in enumerate(rows))
    return Judgement(answer, reasons, hints.sentences, squares, low, high, dof, rows)


def _doubts(edited: EditedFit, dof: int, free_of_prior: int, told: bool) -> list[str]:
    """Return the reasons for which a fit decides nothing, besides one that is told already."""
    doubts = []
    if not edited.fit.settled[0] and not told:
        doubts.append(f"it has not converged in {int(edited.fit.iterations[0])} steps")
    if not edited.is_stable:
        doubts.append(
            f"the editing has not come to rest in {edited.rounds} rounds; a better start or more "
            "rounds may help"
        )
    if dof <= 0:
        doubts.append("there are no more values than unknowns, so that nothing tests the model")
    elif free_of_prior and edited.residuals.weakest()[0] > _DETERMINED:
        doubts.append("the data do not determine all states; give a prior or more data")
    return doubts


def _check_row(edited: EditedFit, arc: Arc, normal: Array, row: int) -> RowCheck:
    about = edited.residuals
    own = arc.row == row
    kept = own & about.used
    count, edit = int(own.sum()), int((own & ~about.used).sum())
    if not kept.any():
        return RowCheck(count, edit, np.nan, np.nan, np.nan, np.nan)
    score, spread = about.constant_error(np.where(own, 1.0 / arc.sigma, 0.0))
    values = normal[kept]
    correlation = np.nan
    if len(values) >= _FEWEST_IN_LINE:
        off = values - values.mean()
        correlation = float(
            np.sqrt(len(off)) * np.sum(off[1:] * off[:-1]) / max(np.sum(off * off), 1e-30)
        )
    rms, bias = float(np.sqrt(np.mean(values**2))), score / spread if spread else np.nan
    return RowCheck(count, edit, np.nan, rms, bias, correlation)


def _truncated_variance(threshold: float) -> float:
    """Return the variance of a normal number within ± the threshold: 1 − 2 k φ(k)/(2 Φ(k) − 1)."""
    inside = 2.0 * norm.cdf(threshold) - 1.0
    return float(1.0 - 2.0 * threshold * norm.pdf(threshold) / inside)
