"""The damped iterated extended Kalman filter in square-root form, for all cases at once.

References
----------
.. [1] Bell, Cathey (1993), The iterated Kalman filter update as a Gauss–Newton method, IEEE Trans.
   Automatic Control 38(2).
"""

from __future__ import annotations

import numpy as np

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.gauss_newton import iterate_update, linearise_measurements
from hillsphere_estimators.innovations import (
    WhitenedInnovation,
    apply_gate,
    refer_to_prior,
    usable_at,
)
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import lower_root, sort_roots
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.specs import IteratedExtendedSpec
from hillsphere_estimators.unscented import linear_update

__all__ = ["IteratedExtended"]


class IteratedExtended:
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

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times; see `hillsphere.interfaces.Estimator`."""
        x, phi = transition(model, belief, t_to_s, control)
        noise = model.process_noise(belief.x, belief.t_s, t_to_s, control)
        rows = np.concatenate([phi @ belief.root, noise], axis=2)
        return Belief(x, lower_root(np.swapaxes(rows, 1, 2)), t_to_s)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements; see `hillsphere.interfaces.Estimator`."""
        spec = self.spec
        layout, used = usable_at(belief, measurements)
        free = update_mask(model, len(belief.x))
        at_prior = linearise_measurements(model, belief, layout, measurements, used)
        first = refer_to_prior(belief, belief.x, at_prior)
        rows, sorted_root = belief, sort_roots(belief.root, first.linear)
        if sorted_root is not None:
            rows = Belief(belief.x, sorted_root, belief.t_s)
            first = refer_to_prior(rows, belief.x, at_prior)
        if spec.gate_sigmas is not None:
            first = apply_gate(layout, first, spec.gate_sigmas)

        def solve(prior: Belief, x: Array, expected: WhitenedInnovation) -> Belief:
            return linear_update(rows, refer_to_prior(rows, x, expected), 1.0, free)

        # with considered states a step need not reduce the sum of squares: it is not damped
        after = iterate_update(
            model, belief, layout, measurements, first.used, solve,
            spec.iterations, spec.tolerance_sigmas, damped=free is None,
        )  # fmt: skip
        return after, first.innovation(measurements.sigma)
