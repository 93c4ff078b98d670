"""A sensor that Hillsphere does not ship: how large the body looks, from its limb against the sky.

Its geometry is its own; estimators know of it only what every sensor says: channels, values and
their standard deviations.
"""

from __future__ import annotations

import numpy as np
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Channel, Scene
from numpy.typing import NDArray

from hillsphere_dumbbell.specs import LimbRangerSpec

__all__ = ["LimbRanger"]


class LimbRanger:
    r"""Apparent angular radius of a warm, round body, which tells the distance.

    .. math:: \rho = \arcsin(R / |r|), \qquad |d\rho/d|r|| = \tan(\rho)/|r| .

    There is nothing to measure where the limb is less than the resolution, or beyond the field of
    view.

    Parameters
    ----------
    spec : LimbRangerSpec
        Its parameters.
    """

    channels = (Channel("angular_radius", "rad", "angle"),)
    draws = (1, 1)

    def __init__(self, spec: LimbRangerSpec) -> None:
        self.spec = spec

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the true angular radius (1, N), rad; π/2 at and under the surface."""
        return np.arcsin(np.minimum(1.0, self.spec.radius_m / self._distance(x)))[None]

    def visible(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        """Say where the limb is resolved and fits into the field of view, (N,)."""
        seen = self.observe(x, t_s, scene)[0]
        spec = self.spec
        return np.asarray((seen >= spec.resolution_rad) & (seen <= 0.5 * spec.field_of_view_rad))

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviation of the noise (1, N), rad."""
        return np.full((1, np.size(t_s)), self.spec.sigma_rad)

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return the measured angular radius (1, N), rad; NaN where nothing is."""
        off = self.spec.sigma_rad * noise[0] + self.spec.bias_rad * constant[0]
        shown = self.observe(x, t_s, scene)[0] + off
        return np.where(self.visible(x, t_s, scene), shown, np.nan)[None]

    def _distance(self, x: Array) -> Array:
        first = 6 * (self.spec.spacecraft - 1)
        if len(x) < first + 3:
            raise InputError(
                f"limb_ranger: spacecraft {self.spec.spacecraft} needs {first + 6} states, there "
                f"are {len(x)}"
            )
        return np.maximum(np.sqrt(np.sum(x[first : first + 3] ** 2, axis=0)), 1e-9)
