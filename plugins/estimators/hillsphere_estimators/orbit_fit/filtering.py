"""A filter over the values that a fit has used, and its verdict."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Estimator
from hillsphere_estimators.consistency import verdict
from hillsphere_estimators.convergence import step_in_sigmas
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.orbit_fit.products import FilterRun

__all__ = ["NO_FILTER", "run_filter"]

_NONE = np.zeros((0, 1))
NO_FILTER = FilterRun(np.empty(0), np.empty(0), np.empty(0), "", "", float("nan"))
"""The result without a filter."""


def run_filter(
    model: FixedStepModel,
    prior: Belief,
    sets: Sequence[MeasurementSet],
    estimator: Estimator,
    fitted: Belief,
) -> FilterRun:
    """Filter sets of measurements, and compare the states with those of the fit.

    Parameters
    ----------
    model : FixedStepModel
        Motion and measurements.
    prior : Belief
        At the start, N = 1.
    sets : sequence of MeasurementSet
        In order.
    estimator : Estimator
        The filter.
    fitted : Belief
        Of the fit, at the start.

    Returns
    -------
    FilterRun
        At each update.

    Raises
    ------
    InputError
        If the start is after the first measurement.
    """
    late = float(prior.t_s[0] - sets[0].t_s[0])
    if late > 0.0:
        raise InputError(
            f"start.epoch: a filter begins at the start, which is {late:.6g} s after the first "
            "measurement; give an earlier start"
        )
    belief, x, t = prior, fitted.x, fitted.t_s
    after, innovations = [], []
    off: list[Array] = []
    for one in sets:
        if one.t_s[0] != belief.t_s[0]:
            belief = estimator.predict(model, belief, one.t_s, _NONE)
        belief, innovation = estimator.update(model, belief, one)
        after.append(belief)
        innovations.append(innovation)
        x, t = model.advance(x, t, one.t_s, _NONE, np.zeros(1, dtype=int)), one.t_s
        off.append(belief.x - x)
    judged = verdict(model, prior, sets, after, innovations)
    return FilterRun(
        np.array([one.t_s[0] for one in sets]),
        np.array([np.linalg.norm(d[:3]) for d in off]),
        np.array([np.linalg.norm(b.sigma[:3]) for b in after]),
        judged.answer,
        judged.reason,
        float(step_in_sigmas(belief, Belief(x, belief.root, belief.t_s))[0]),
    )
