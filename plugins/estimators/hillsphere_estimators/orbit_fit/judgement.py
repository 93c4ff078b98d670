"""Whether recorded data agree with the fit: a verdict from the residuals alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.stats import chi2, norm

from hillsphere.interfaces import Array
from hillsphere_estimators.orbit_fit.fitting import EditedFit
from hillsphere_estimators.orbit_fit.records import Arc

__all__ = ["LEVEL", "Answer", "Judgement", "RowCheck", "judge_fit"]

Answer: TypeAlias = Literal["consistent", "inconsistent", "cautious", "undecided"]

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
    rms : float
        Root mean square of the residuals over what it should be; NaN without values.
    bias : float
        Constant error over its standard deviation; NaN where the states take it up.
    correlation : float
        Of neighbours in time, times the root of their number; NaN for few values.
    """

    count: int
    edited: int
    rms: float
    bias: float
    correlation: float


@dataclass(frozen=True)
class Judgement:
    """A verdict.

    Parameters
    ----------
    answer : str
        "consistent", "inconsistent", "cautious" (the residuals are smaller than their standard
        deviations say) or "undecided".
    reasons : tuple of str
        Why, a sentence each.
    squares, low, high : float
        Sum of squares per degree of freedom, and its band.
    dof : int
        Degrees of freedom.
    rows : tuple of RowCheck
        In the order of the sets' rows.
    """

    answer: Answer
    reasons: tuple[str, ...]
    squares: float
    low: float
    high: float
    dof: int
    rows: tuple[RowCheck, ...]


def judge_fit(
    edited: EditedFit,
    arc: Arc,
    threshold: float | None,
    free_of_prior: int,
    labels: Sequence[str],
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
    threshold : float or None
        Of the editing.
    free_of_prior : int
        Number of states without a prior.
    labels : sequence of str
        Names of the rows.
    doubts : sequence of str
        Other reasons for which the fit decides nothing.

    Returns
    -------
    Judgement
        The verdict.
    """
    about, fit = edited.residuals, edited.fit
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
    wrong, small = [], []
    if squares > high:
        wrong.append(
            f"the residuals are too large: their squares are {squares:.4g} a degree of freedom, "
            f"above {high:.4g}"
        )
    elif squares < low:
        small.append(
            f"the residuals are smaller than their standard deviations say: their squares are "
            f"{squares:.4g} a degree of freedom, below {low:.4g}"
        )
    bound = float(norm.isf(0.5 * share))
    for check, label in zip(rows, labels, strict=True):
        if abs(check.bias) > bound:
            wrong.append(f"{label} has a constant error of {check.bias:+.1f} standard deviations")
        if abs(check.correlation) > bound:
            wrong.append(
                f"neighbouring residuals of {label} are correlated, {check.correlation:+.1f} "
                "standard deviations"
            )
        if check.edited > max(_FEW_EDITED, _MOST_EDITED * check.count):
            wrong.append(f"{check.edited} of {check.count} values of {label} were left out")
    doubts = [*doubts, *_doubts(edited, dof, free_of_prior)]
    answer: Answer = "consistent"
    if doubts:
        answer = "undecided"
    elif wrong:
        answer = "inconsistent"
    elif small:
        answer = "cautious"
    reasons = tuple(doubts or [*wrong, *small] or ["no test fails its limit"])
    return Judgement(answer, reasons, squares, low, high, dof, rows)


def _doubts(edited: EditedFit, dof: int, free_of_prior: int) -> list[str]:
    """Return the reasons for which a fit decides nothing."""
    doubts = []
    if not edited.fit.settled[0]:
        doubts.append(f"the fit has not converged in {int(edited.fit.iterations[0])} steps")
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
        return RowCheck(count, edit, np.nan, np.nan, np.nan)
    score, spread = about.constant_error(np.where(own, 1.0 / arc.sigma, 0.0))
    values = normal[kept]
    correlation = np.nan
    if len(values) >= _FEWEST_IN_LINE:
        off = values - values.mean()
        correlation = float(
            np.sqrt(len(off)) * np.sum(off[1:] * off[:-1]) / max(np.sum(off * off), 1e-30)
        )
    return RowCheck(
        count, edit, float(np.sqrt(np.mean(values**2))), score / spread if spread else np.nan,
        correlation,
    )  # fmt: skip


def _truncated_variance(threshold: float) -> float:
    """Return the variance of a normal number within ± the threshold: 1 − 2 k φ(k)/(2 Φ(k) − 1)."""
    inside = 2.0 * norm.cdf(threshold) - 1.0
    return float(1.0 - 2.0 * threshold * norm.pdf(threshold) / inside)
