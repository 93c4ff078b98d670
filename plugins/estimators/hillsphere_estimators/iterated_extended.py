"""The damped iterated extended Kalman filter in square-root form, on all cases at once.

References
----------
.. [1] Bell, Cathey (1993), The iterated Kalman filter update as a Gauss–Newton method, IEEE Trans.
   Automatic Control 38(2).
"""

from __future__ import annotations

import numpy as np

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.gauss_newton import expected_by_slopes, settled
from hillsphere_estimators.innovations import Expected, about_prior, gated, usable_at
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.roots import lower_root
from hillsphere_estimators.sigma_points import considered
from hillsphere_estimators.specs import IteratedExtendedSpec
from hillsphere_estimators.unscented import absorbed

__all__ = ["IteratedExtended"]


class IteratedExtended:
    """The extended filter, its update iterated to the most probable states [1]_ (see the module).

    Its gate takes the prior's slopes at their word: it knows of no curvature, and is for beliefs
    that have converged.

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
        free = considered(model, len(belief.x))
        at_prior = expected_by_slopes(model, belief, layout, measurements, used)
        first = about_prior(belief, belief.x, at_prior)
        if spec.gate_sigmas is not None:
            first = gated(layout, first, spec.gate_sigmas)

        def solve(prior: Belief, x: Array, expected: Expected) -> Belief:
            return absorbed(prior, about_prior(prior, x, expected), 1.0, free)

        # the cost that damping watches is not what a step that leaves states out lessens
        after = settled(
            model, belief, layout, measurements, first.used, solve,
            spec.iterations, spec.tolerance_sigmas, damped=free is None,
        )  # fmt: skip
        return after, first.innovation(measurements.sigma)
