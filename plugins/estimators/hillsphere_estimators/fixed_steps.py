"""Derivatives of a model by differences whose steps do not depend on a belief."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Channel, ConsiderModel, EstimationModel, Integers
from hillsphere_estimators.differences import layout_of
from hillsphere_estimators.linearisation import DIFFERENCE_SIGMAS, sensitivity, transition

__all__ = ["FixedStepModel"]


class FixedStepModel:
    """A `hillsphere.interfaces.LinearisedModel` of a model without derivatives of its own.

    Differences take steps in standard deviations of the belief otherwise. Of a prior that knows
    next to nothing these would leave the region in which the model is smooth.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements.
    blocks : tuple of tuple of Channel
        Channels of its rows.
    steps : ndarray, shape (n,)
        Step of each state, SI.
    """

    def __init__(
        self, model: EstimationModel, blocks: tuple[tuple[Channel, ...], ...], steps: Array
    ) -> None:
        self.model, self._layout = model, layout_of(blocks)
        self._root = np.diag(np.asarray(steps, dtype=float) / DIFFERENCE_SIGMAS)

    @property
    def considered(self) -> NDArray[np.bool_]:
        """Whether a state is considered and not estimated, (n,)."""
        none = np.zeros(len(self._root), dtype=bool)
        return self.model.considered if isinstance(self.model, ConsiderModel) else none

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states later; see `hillsphere.interfaces.EstimationModel`."""
        return self.model.advance(x, t0_s, t1_s, control, case)

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots of the noise; see `hillsphere.interfaces.EstimationModel`."""
        return self.model.process_noise(x, t0_s, t1_s, control)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the measurements; see `hillsphere.interfaces.EstimationModel`."""
        return self.model.observe(x, t_s, case)

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the derivatives (N, n, n) of `advance` by the states x (n, N)."""
        return transition(self.model, self._about(x, t0_s), t1_s, control)[1]

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        """Return the derivatives (N, m, n) of `observe` by the states x (n, N)."""
        return sensitivity(self.model, self._about(x, t_s), self._layout)[1]

    def _about(self, x: Array, t_s: Array) -> Belief:
        root = np.broadcast_to(self._root, (x.shape[1], *self._root.shape))
        return Belief(x, root, t_s)
