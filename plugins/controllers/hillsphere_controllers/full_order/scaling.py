"""Scaling of controls and measurements to norm one, so that units do not decide solvability."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.full_order.regularisation import Regularisation
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["Units"]

_ROUNDS = 3
"""Rounds of choosing units and balancing states in turn: units and scales are powers of two, so
that they settle exactly."""


@dataclass(frozen=True)
class Units:
    """Units of the controls and measurements of a generalised plant.

    Parameters
    ----------
    controls : ndarray, shape (k,)
        Powers of two: u in the new unit is u times that.
    measurements : ndarray, shape (q,)
        Powers of two: y in the new unit is y divided by that.
    """

    controls: Array
    measurements: Array

    @classmethod
    def of(cls, plant: LtiSystem, controls: int, measurements: int) -> Units:
        """Return the units in which each column [B2; D12] and row [C2 D21] has a norm near one."""
        k, q = controls, measurements
        (p, m), made = plant.shape, plant
        units = cls(np.ones(k), np.ones(q))
        for _ in range(_ROUNDS):  # units and scales of the states depend on each other
            made, _ = balance_states(made)
            columns = np.vstack([made.b[:, m - k :], made.d[: p - q, m - k :]])
            rows = np.hstack([made.c[p - q :], made.d[p - q :, : m - k]])
            one = cls(_power(columns), _power(rows.T))
            made = one.scale(made)
            units = cls(units.controls * one.controls, units.measurements * one.measurements)
        return units

    def scale(self, plant: LtiSystem) -> LtiSystem:
        """Return a plant in these units; the closed loop from w to z does not change."""
        (p, m), k, q = plant.shape, self.controls.size, self.measurements.size
        columns = np.concatenate([np.ones(m - k), self.controls])
        rows = np.concatenate([np.ones(p - q), self.measurements])[:, None]
        return replace(plant, b=plant.b / columns, c=plant.c / rows, d=plant.d / columns / rows)

    def scale_added(self, added: Regularisation) -> Regularisation:
        """Return weights and noise in these units, given in the original ones."""
        return replace(
            added,
            controls=added.controls / self.controls,
            measurements=added.measurements / self.measurements,
        )

    def restore_added(self, added: Regularisation) -> Regularisation:
        """Return weights and noise in the original units, given in these."""
        return replace(
            added,
            controls=added.controls * self.controls,
            measurements=added.measurements * self.measurements,
        )

    def restore(self, controller: LtiSystem) -> LtiSystem:
        """Return the controller for the plant in its original units."""
        rows = self.controls[:, None]
        return replace(
            controller,
            b=controller.b / self.measurements,
            c=controller.c / rows,
            d=controller.d / self.measurements / rows,
        )


def _power(columns: Array) -> Array:
    """Return the power of two nearest to each column's norm, one for a column of zeros."""
    size = np.sqrt(np.sum(columns**2, axis=0))
    return np.asarray(2.0 ** np.round(np.log2(np.where(size > 0.0, size, 1.0))))
