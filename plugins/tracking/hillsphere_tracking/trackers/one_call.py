"""Prediction and first correction of the tracker `least_squares` in one compiled function.

A measurement of one antenna is a few hundred multiplications; as separate calls of arrays of one
case it costs ten times as much. The function joins the equations of `observation`, of the chart of
selected elements and of `correction`, whose values it returns.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from hillsphere import symbolic as sy
from hillsphere.base.constants import HOUR_S
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere_tracking.dynamics_brouwer import ZonalField
from hillsphere_tracking.trackers.correction import Correction, correction_of, packing_of
from hillsphere_tracking.trackers.observation import Site, measurement_columns, propagation_of

__all__ = ["compile_update", "predict_and_correct"]


def predict_and_correct(
    function: ArrayFunction,
    elements: Array,
    dt_s: Array,
    clock_s: Array,
    t_s: Array,
    site: Site,
    measured: Sequence[Array],
    covariance: Array,
    noise: Array,
) -> tuple[Array, Array, Correction]:
    """Propagate an estimate to a measurement and correct it.

    Parameters
    ----------
    function : ArrayFunction
        From `compile_update`.
    elements, dt_s, clock_s, t_s, site, measured
        As for `observation.propagate_and_compare`; `measured` are five arrays (N,).
    covariance : ndarray, shape (m, m, N)
        Covariance before.
    noise : ndarray, shape (2, N)
        Variances of azimuth and elevation, rad².

    Returns
    -------
    after : ndarray, shape (6, N)
        Elements at the measurement.
    prior : ndarray, shape (m, m, N)
        Covariance there.
    correction : Correction
        The correction, linearised there.
    """
    m, cases = len(covariance), t_s.size
    upper, full = packing_of(m)
    size = upper.size
    given = np.empty((28 + size, cases))
    measurement_columns(elements, clock_s, t_s, site, measured, given)
    given[25], given[26:28] = dt_s, noise
    given[28:] = covariance.reshape(m * m, cases)[upper]
    outputs = function(given)
    end = 6 + size
    step = outputs[end : end + m]
    return outputs[:6], outputs[6:end][full], Correction(
        step, outputs[end + m], outputs[end + m + 1], outputs[end + m + 2 :][full]
    )  # fmt: skip


@lru_cache(maxsize=16)
def compile_update(
    field: ZonalField,
    short_period: bool,
    rows: tuple[int, ...],
    others: tuple[int, ...],
    drift_m: float,
    gate: float,
    least_sigma: float,
) -> ArrayFunction:
    """Compile the function of `predict_and_correct`.

    Parameters
    ----------
    field : ZonalField
        Gravity field of the planet.
    short_period : bool
        Add the short-period terms of J2.
    rows : tuple of int
        Rows of the estimated elements, see `charts.SelectedElements`.
    others : tuple of int
        Columns of the estimated biases among the slopes of `observation.compare_directions`.
    drift_m : float
        Displacement by the random walk in an hour, see `charts.Chart.walk`.
    gate : float
        Number of standard deviations beyond which a measurement is an outlier.
    least_sigma : float
        Least standard deviation on the sky, rad.
    """
    later, turned, compared, inputs = propagation_of(field, short_period)
    n, m = len(rows), len(rows) + len(others)
    a, dt = inputs[0], inputs[-1]
    noise = sy.variables("noise0", "noise1")
    upper, full = packing_of(m)
    packed = sy.variables(*(f"p{k}" for k in range(upper.size)))
    prior = [[packed[k] for k in row] for row in full.tolist()]
    # the random walk, then Φ P Φᵀ, of which only the column of a differs from 1
    # (`charts.SelectedElements`)
    if drift_m > 0.0:
        for k, row in enumerate(rows):
            rate = drift_m * drift_m / HOUR_S * (1.0 if row == 0 else 1.0 / (a * a))
            prior[k][k] = prior[k][k] + rate * sy.absolute(dt)
    if rows[0] == 0:
        by_a = [turned[row - 3][0] for row in rows[1:]]
        for k in range(1, n):
            prior[k] = [p + by_a[k - 1] * q for p, q in zip(prior[k], prior[0], strict=True)]
        for line in prior:
            line[1:n] = [p + line[0] * by for p, by in zip(line[1:n], by_a, strict=True)]
    off, level2, by = compared[:2], compared[2], (compared[3:13], compared[13:])
    slopes = [[one[k] for k in (*rows, *others)] for one in by]
    variances = (noise[0] * level2 + least_sigma**2, noise[1] + least_sigma**2)
    none = [sy.constant(0.0)] * m
    outputs = correction_of(
        prior, (slopes[0], slopes[1]), off, variances, none, sy.constant(0.0), sy.constant(gate)
    )
    triangle = [prior[i][j] for i, j in zip(*np.triu_indices(m), strict=True)]
    return ArrayFunction([*later, *triangle, *outputs], (*inputs, *noise, *packed))
