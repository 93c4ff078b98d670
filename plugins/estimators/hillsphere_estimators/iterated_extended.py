"""The damped iterated extended Kalman filter in square-root form, for all cases at once.

References
----------
.. [1] Bell, Cathey (1993), The iterated Kalman filter update as a Gauss–Newton method, IEEE Trans.
   Automatic Control 38(2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.casewise import CasewiseEstimator, drop_failed
from hillsphere_estimators.gauss_newton import iterate_update, linearise_measurements
from hillsphere_estimators.innovations import (
    WhitenedInnovation,
    apply_gate,
    refer_to_prior,
    usable_at,
)
from hillsphere_estimators.linearisation import noise_between, transition
from hillsphere_estimators.roots import lower_root, sort_roots
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.specs import IteratedExtendedSpec
from hillsphere_estimators.unscented import linear_update

__all__ = ["IteratedExtended"]


class IteratedExtended(CasewiseEstimator):
    """An extended Kalman filter whose update is iterated to the maximum a posteriori states [1]_.

    Its gate relies on the derivatives at the prior and has no measure of curvature. It is meant for
    beliefs that have converged.

    Parameters
    ----------
    spec : IteratedExtendedSpec
        Its parameters.
    """

    def __init__(self, spec: IteratedExtendedSpec) -> None:
        self.spec = spec

    def _predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at other times."""
        noise = noise_between(model, belief, t_to_s, control)
        x, phi = transition(model, belief, t_to_s, control)
        rows = np.concatenate([phi @ belief.root, noise], axis=2)
        return Belief(x, lower_root(np.swapaxes(rows, 1, 2)), t_to_s)

    def _update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation, NDArray[np.bool_]]:
        """Return the belief after measurements, the innovation, and which cases have failed."""
        spec = self.spec
        layout, used = usable_at(belief, measurements)
        free = update_mask(model, len(belief.x))
        at_prior, failed = drop_failed(
            linearise_measurements(model, belief, layout, measurements, used)
        )
        first = refer_to_prior(belief, belief.x, at_prior)
        rows, sorted_root = belief, sort_roots(belief.root, first.linear)
        if sorted_root is not None:
            rows = Belief(belief.x, sorted_root, belief.t_s)
            first = refer_to_prior(rows, belief.x, at_prior)
        if spec.gate_sigmas is not None:
            first = apply_gate(layout, first, spec.gate_sigmas)

        def solve(prior: Belief, x: Array, expected: WhitenedInnovation) -> Belief:
            return linear_update(rows, refer_to_prior(rows, x, expected), 1.0, None)

        after = iterate_update(
            model, belief, layout, measurements, first.used, solve,
            spec.iterations, spec.tolerance_sigmas,
        )  # fmt: skip
        if free is not None:
            # about the solution for all states; the extended filter stays at the prior
            at = after if spec.iterations > 1 else belief
            expected = linearise_measurements(model, at, layout, measurements, first.used)
            after = linear_update(rows, refer_to_prior(rows, at.x, expected), 1.0, free)
        return after, first.innovation(measurements.sigma), failed
