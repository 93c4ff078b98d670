"""The plant ``proximity`` with gravity that is a function of arrays: a polyhedron, a table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from hillsphere.gravity import GravityField, acceleration_within, is_array_model
from hillsphere.interfaces import Array, Variable
from hillsphere.symbolic import Overloaded, Params, Vec3, variables
from hillsphere_plants.moon_centred import vector
from hillsphere_plants.proximity import Proximity, of_gravity
from hillsphere_plants.proximity_orbit import axes_of
from hillsphere_plants.proximity_specs import ProximitySpec

__all__ = ["ArrayProximity", "proximity"]


class ArrayProximity(Proximity):
    """The same motion; the attractions enter as terms that the step map evaluates at each stage.

    Parameters
    ----------
    spec : ProximitySpec
        With its references bound.
    """

    @property
    def external(self) -> tuple[Variable, ...]:
        """Three components of the attraction a spacecraft, in the plant's frame."""
        count = len(self.spacecraft)
        return tuple(
            Variable(f"attraction:{axis}{i + 1}", 1, -2) for i in range(count) for axis in "xyz"
        )

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the attractions (3 S, N), m/s², at states x (6 S, N); p (k, N) all parameters."""
        places, turn = self._body_places(x, t, p)
        count = len(self.spacecraft)
        own = np.tile(p[len(self._own) :], (1, count))
        pull = self._field.acceleration(places.reshape(3, -1), own).reshape(3, count, -1)
        return np.asarray(np.einsum("jin,jsn->sin", turn, pull).reshape(3 * count, -1))

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        """Return the derivatives (3 S, 6 S, N) of the attractions by the states."""
        places, turn = self._body_places(x, t, p)
        own = p[len(self._own) :]
        slopes = np.zeros((3 * len(self.spacecraft), *x.shape))
        for i in range(len(self.spacecraft)):
            inner = self._field.gradient(places[:, i], own)
            block = np.einsum("ain,abn,bjn->ijn", turn, inner, turn)
            slopes[3 * i : 3 * i + 3, 6 * i : 6 * i + 3] = block
        return slopes

    def _attraction(self, craft: int, rows: Sequence[Vec3], r: Vec3, p: Params) -> Vec3:
        if isinstance(r[0], Overloaded):
            force = acceleration_within(self._model, axes_of(rows, r), of_gravity(p))
            return axes_of(rows, force, back=True)
        return vector(variables(*(v.name for v in self.external[3 * craft : 3 * craft + 3])))

    @cached_property
    def _field(self) -> GravityField:
        return GravityField(self._model, run_time=[q.name for q in self._model.parameters()])


def proximity(spec: ProximitySpec) -> Proximity:
    """Make the plant: of expressions, or with array gravity."""
    return ArrayProximity(spec) if is_array_model(spec.gravity.get()) else Proximity(spec)
