"""The observability Gramian along trajectories: what a stretch of measurements tells of a state.

References
----------
.. [1] Chen (1999), Linear system theory and design, section 6.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.convergence import regular_scales
from hillsphere_estimators.gauss_newton import linearise_measurements
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import upper_triangle

__all__ = ["Observability", "observability"]


@dataclass(frozen=True)
class Observability:
    """What measurements tell of the states at their beginning, in units of the scales given.

    Parameters
    ----------
    root : ndarray, shape (N, n, n)
        Upper triangular U; the Gramian Σ Φᵀ Hᵀ R⁻¹ H Φ is Uᵀ U.
    singular : ndarray, shape (N, n)
        Singular values of U, falling: 1/σ of what is known best to worst. Zero where nothing is.
    directions : ndarray, shape (N, n, n)
        Unit vectors of scaled states in this order, as rows: the last is told worst.
    """

    root: Array
    singular: Array
    directions: Array

    def rank(self, tolerance: float = 1e-12) -> Array:
        """Return how many directions are told at all, (N,): beyond a share of the best."""
        return np.asarray(np.sum(self.singular > tolerance * self.singular[:, :1], axis=1))


def observability(
    model: EstimationModel,
    start: Belief,
    measurements: Sequence[MeasurementSet],
    scales: Array,
    controls: Sequence[Array] | None = None,
) -> Observability:
    """Return the observability of the states at the start, without any prior or process noise.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements.
    start : Belief
        Where the trajectories begin; its standard deviations serve as steps of differences, where
        the model does not know its derivatives.
    measurements : sequence of MeasurementSet
        At K times, the first not before the start: which rows there are, with which errors.
    scales : ndarray, shape (n,)
        Size of one unit of each state, SI, so that metres and metres per second compare.
    controls : sequence of ndarray, shape (p, N), optional
        K: before each time.

    Returns
    -------
    Observability
        Of N trajectories. By roots: the Gramian, whose condition is the square, is never formed.

    Raises
    ------
    InputError
        If scales do not fit the states, or there are more or fewer controls than measurements.
    """
    n, cases = start.x.shape
    if controls is not None and len(controls) != len(measurements):
        raise InputError(
            f"{len(measurements)} measurements need as many controls, got {len(controls)}"
        )
    now, phi = start, np.broadcast_to(np.diag(regular_scales(scales, n)), (cases, n, n))
    root = np.zeros((cases, n, n))
    for k, measured in enumerate(measurements):
        control = np.zeros((0, cases)) if controls is None else controls[k]
        x, step = transition(model, now, measured.t_s, control)
        phi = step @ phi
        # the steps of differences stay those of the start
        now = Belief(x, start.root, measured.t_s)
        layout, used = usable(measured)
        slopes = linearise_measurements(model, now, layout, measured, used).linear
        root = upper_triangle(np.concatenate([root, np.swapaxes(slopes, 1, 2) @ phi], axis=1))
    _, singular, directions = np.linalg.svd(root)
    return Observability(root, singular, directions)
