r"""The posterior Cramér–Rao bound: what no filter's mean square error falls below.

With the information J of the states at one time, motion x' = f(x) + w, w ~ N(0, Q), and noise of
unit variance on measurements whose slopes are H, for motions whose Φ hardly differ between the
trajectories [1]_

.. math::

    J' = E[H^T H] + (Φ J^{-1} Φ^T + Q)^{-1},

the expectation over true trajectories. Φ, and HᵀH unless it is pooled, are those along each
trajectory: the bound is that of flights near it. This form holds for a singular Q as well; it is
computed by roots.

References
----------
.. [1] Tichavský, Muravchik, Nehorai (1998), Posterior Cramér–Rao bounds for discrete-time nonlinear
   filtering, IEEE Trans. Signal Processing 46(5).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.gauss_newton import linearise_measurements
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import lower_root, upper_triangle

__all__ = ["cramer_rao", "rms"]


def cramer_rao(
    model: EstimationModel,
    truth: Sequence[Array],
    prior: Array,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array] | None = None,
    *,
    pooled: bool = False,
) -> list[Belief]:
    """Return the bounds along true trajectories.

    Parameters
    ----------
    model : EstimationModel
        Motion, its noise, and measurements; those that are not smooth, such as the centroid of the
        points that a camera sees, must be replaced by smooth ones.
    truth : sequence of ndarray, shape (n, N)
        True states of N trajectories at K times, SI.
    prior : ndarray, shape (N, n, n)
        Covariance of the first states before any measurement.
    measurements : sequence of MeasurementSet
        At the K times: which rows there are, with which errors. Values count for nothing.
    controls : sequence of ndarray, shape (p, N), optional
        K − 1: between the times.
    pooled : bool
        Whether the information of the measurements is averaged over the trajectories. Where these
        lie apart that is a bound as well, but a lower one than need be: some see better than
        others.

    Returns
    -------
    list of Belief
        At each time the true states with the bound as covariance, after the measurements.

    Raises
    ------
    InputError
        If there are not as many sets of measurements as times.
    """
    if len(truth) != len(measurements):
        raise InputError(
            f"there must be one set of measurements for each of the {len(truth)} times, got "
            f"{len(measurements)}"
        )
    now = Belief.of(truth[0], prior, measurements[0].t_s)
    found = []
    for k, (x, measured) in enumerate(zip(truth, measurements, strict=True)):
        if k:
            control = np.zeros((0, x.shape[1])) if controls is None else controls[k - 1]
            _, phi = transition(model, now, measured.t_s, control)
            noise = model.process_noise(now.x, now.t_s, measured.t_s, control)
            rows = np.concatenate([phi @ now.root, noise], axis=2)
            now = Belief(x, lower_root(np.swapaxes(rows, 1, 2)), measured.t_s)
        now = Belief(x, _add_information(model, now, measured, pooled), measured.t_s)
        found.append(now)
    return found


def rms(bounds: Belief, states: slice | Sequence[int]) -> float:
    """Return the root mean square over trajectories of the length of some states' error.

    Parameters
    ----------
    bounds : Belief
        At one time.
    states : slice or sequence of int
        Which states, of one unit: a position's three, for instance.

    Returns
    -------
    float
        √(mean of the trace), SI.
    """
    return float(np.sqrt(np.mean(np.sum(bounds.sigma[states] ** 2, axis=0))))


def _add_information(
    model: EstimationModel, now: Belief, measured: MeasurementSet, pooled: bool
) -> Array:
    """Return the root of (P⁻¹ + HᵀH)⁻¹ = S (1 + SᵀHᵀHS)⁻¹ Sᵀ, which needs no inverse of S."""
    layout, used = usable(measured)
    slopes = linearise_measurements(model, now, layout, measured, used).linear
    if pooled:
        cases, n, m = slopes.shape
        every: Array = slopes.transpose(0, 2, 1).reshape(1, cases * m, n)
        slopes = np.repeat(lower_root(every) * float(cases) ** -0.5, cases, axis=0)
    inner = upper_triangle(_under_unit(np.swapaxes(slopes, 1, 2) @ now.root))
    # S U⁻¹, and its lower triangular form
    return lower_root(
        np.asarray(np.linalg.solve(np.swapaxes(inner, 1, 2), np.swapaxes(now.root, 1, 2)))
    )


def _under_unit(rows: Array) -> Array:
    """Return rows (N, k, n) with those of the unit matrix above them."""
    cases, _, n = rows.shape
    return np.concatenate([np.broadcast_to(np.eye(n), (cases, n, n)), rows], axis=1)
