"""The observability Gramian along trajectories.

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
from hillsphere_estimators.casewise import replace_failed
from hillsphere_estimators.convergence import regular_scales
from hillsphere_estimators.gauss_newton import linearise_measurements
from hillsphere_estimators.innovations import usable
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import upper_triangle

__all__ = ["Observability", "observability"]


@dataclass(frozen=True)
class Observability:
    """Observability of the states at the start, in units of the given scales.

    All is NaN in a case whose motion or measured rows the model gives no numbers for.

    Parameters
    ----------
    root : ndarray, shape (N, n, n)
        Upper triangular root U of the Gramian Σ Φᵀ Hᵀ R⁻¹ H Φ = Uᵀ U.
    singular : ndarray, shape (N, n)
        Singular values of U, falling. Each is 1/σ, σ the standard deviation with which the
        measurements determine a direction; zero if they do not.
    directions : ndarray, shape (N, n, n)
        Unit vectors of scaled states in this order, as rows; the last is observed worst.
    """

    root: Array
    singular: Array
    directions: Array

    def rank(self, tolerance: float = 1e-12) -> Array:
        """Return the number of observable directions (N,); 0 in a case that is NaN.

        Parameters
        ----------
        tolerance : float
            Singular values below this part of the largest count as zero.
        """
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
        Start of the trajectories; its standard deviations set the steps of finite differences, if
        the model has no derivatives.
    measurements : sequence of MeasurementSet
        At K times, the first not before the start. Only which rows are present, and their standard
        deviations, are used.
    scales : ndarray, shape (n,)
        Size of one unit of each state, SI, so that metres and metres per second compare.
    controls : sequence of ndarray, shape (p, N), optional
        K: before each time.

    Returns
    -------
    Observability
        Observability of N trajectories, from the root of the Gramian: its condition number is the
        square root of that of the Gramian, which is never formed.

    Raises
    ------
    InputError
        If the scales do not fit the states, there are more or fewer controls than measurements, or
        the model gives no numbers in any case.
    """
    n, cases = start.x.shape
    if controls is not None and len(controls) != len(measurements):
        raise InputError(
            f"{len(measurements)} measurements need as many controls, got {len(controls)}"
        )
    now, phi = start, np.broadcast_to(np.diag(regular_scales(scales, n)), (cases, n, n))
    root = np.zeros((cases, n, n))
    failed = np.zeros(cases, dtype=bool)
    for k, measured in enumerate(measurements):
        control = np.zeros((0, cases)) if controls is None else controls[k]
        x, step = transition(model, now, measured.t_s, control)
        phi = step @ phi
        # the standard deviations are only the steps of differences here: those of the start
        now, lost, _ = replace_failed(Belief(x, start.root, measured.t_s))
        failed = failed | lost
        layout, used = usable(measured)
        slopes = linearise_measurements(model, now, layout, measured, used).linear
        # rows R^(−1/2) H Φ of this time below the root of the earlier ones
        root = upper_triangle(np.concatenate([root, np.swapaxes(slopes, 1, 2) @ phi], axis=1))
    failed = failed | ~np.isfinite(root).all(axis=(1, 2))
    if failed.all():
        raise InputError(
            "the model gives no finite motion, or no finite measurement of rows that are present, "
            "along the trajectory"
        )
    root = np.where(failed[:, None, None], np.eye(n), root)
    _, singular, directions = np.linalg.svd(root)
    for values in (root, singular, directions):
        values[failed] = np.nan
    return Observability(root, singular, directions)
