"""A batch least-squares fit with editing: values that the fit cannot explain are left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere_estimators.batch_least_squares import Fit, batch_least_squares
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.orbit_fit.failure import Patience
from hillsphere_estimators.orbit_fit.records import Arc
from hillsphere_estimators.orbit_fit.residuals import Residuals, linearise_arc

__all__ = ["EditedFit", "fit_and_edit"]

TOLERANCE_SIGMAS = 1e-4
"""A step that is shorter, in standard deviations, ends a fit. Places at 1 au are rounded to 30 µm,
which moves a fit of precise ranges by some 1e-5."""
_MOST_STEPS = 80
"""Steps of all fits together after which no other one is made: twelve rounds of a sound fit, of
three to six steps each, take fewer."""
_SHARE_OF_WORST = 0.3
"""A round leaves out only residuals above this share of the largest one, besides the threshold: an
outlier draws the fit, and residuals of sound values near it are large until it is gone."""


@dataclass(frozen=True)
class EditedFit:
    """The last fit of one case.

    Parameters
    ----------
    fit : Fit
        States at the start.
    residuals : Residuals
        About it, with the mask of the values that it has used.
    rounds : int
        Number of fits.
    is_stable : bool
        Whether a further round would leave out the same values.
    """

    fit: Fit
    residuals: Residuals
    rounds: int
    is_stable: bool


def fit_and_edit(
    model: FixedStepModel,
    prior: Belief,
    arc: Arc,
    threshold: float | None,
    most_rounds: int,
    advance: Callable[[int], None],
) -> EditedFit:
    """Fit, leave out what is beyond the threshold, and fit again until nothing changes.

    A fit that has not converged is returned as it is.

    Parameters
    ----------
    model : FixedStepModel
        Motion and measurements.
    prior : Belief
        At the start, N = 1; the iteration begins at its mean.
    arc : Arc
        The data.
    threshold : float or None
        In standard deviations that a residual should have, see `Residuals.sigma`; None for no
        editing. In the first half of the rounds a value that was left out comes back if a later fit
        explains it.
    most_rounds : int
        Fits at most.
    advance : callable
        Called with 1 after each.

    Returns
    -------
    EditedFit
        The last fit.
    """
    free = ~model.considered
    steps = 0
    used: NDArray[np.bool_] = np.ones(len(arc.row), dtype=bool)
    start: Array | None = None
    for number in range(1, most_rounds + 1):
        fit = batch_least_squares(
            model, prior, arc.only(used), start=start, tolerance_sigmas=TOLERANCE_SIGMAS,
            give_up=Patience(),
        )  # fmt: skip
        steps += int(fit.iterations[0])
        residual, rows = linearise_arc(model, prior, fit.belief, arc.sets)
        about = Residuals(residual, rows, used, free)
        advance(1)
        # residuals about states that are no solution say nothing of single values
        if threshold is None or not fit.settled[0]:
            return EditedFit(fit, about, number, True)
        size = np.abs(residual) / np.maximum(about.sigma(), _LEAST_SIGMA)
        bound = max(threshold, _SHARE_OF_WORST * float(np.max(size[used], initial=0.0)))
        wanted = size <= np.where(used, bound, threshold)
        if number > most_rounds // 2:
            # two sets of values may bring each other back for ever: now none comes back
            wanted &= used
        if (wanted == used).all() and bound == threshold:
            return EditedFit(fit, about, number, True)
        # with fewer values than unknowns there is nothing to edit by
        if wanted.sum() <= len(prior.x) or steps > _MOST_STEPS:
            return EditedFit(fit, about, number, False)
        used, start = wanted, fit.belief.x
    return EditedFit(fit, about, most_rounds, False)


_LEAST_SIGMA = 1e-3
"""Of a residual, in units of its noise: a value that alone determines a state has none."""
