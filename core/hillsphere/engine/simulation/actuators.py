"""Actuator models: limits, quantisation and execution errors of commands."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError

__all__ = ["Thruster"]


@dataclass(frozen=True)
class Thruster:
    r"""A thruster in the commanded direction, with limits, quantisation and execution errors.

    The commanded magnitude is rounded to a multiple of the quantum, limited to the maximum, and set
    to zero below the minimum. The result is executed with errors of magnitude and direction,

    .. math:: |u|(1 + \sigma_m w_0)\,(\cos\delta\,\hat u + \sin\delta\,\hat e),
              \qquad \delta\,\hat e = \sigma_p\,(w - (w\cdot\hat u)\hat u),

    independent from sample to sample: Gates' model [1]_ without its fixed errors.

    Parameters
    ----------
    magnitude_sigma : float
        Relative standard deviation of the magnitude.
    pointing_sigma_rad : float
        Standard deviation of the angle about each axis normal to the command.
    minimum, maximum, quantum : float
        In the unit of the command, m/s for impulses and m/s² for held acceleration.
    dimension : int
        Components of one thruster's command; the rows of several thrusters are consecutive.
    thrusters : int
        Number of thrusters.

    References
    ----------
    .. [1] C. R. Gates (1963), A simplified model of midcourse maneuver execution errors, JPL
       Technical Report 32-504.
    """

    magnitude_sigma: float = 0.0
    pointing_sigma_rad: float = 0.0
    minimum: float = 0.0
    maximum: float = inf
    quantum: float = 0.0
    dimension: int = 3
    thrusters: int = 1

    def __post_init__(self) -> None:
        for name in ("magnitude_sigma", "pointing_sigma_rad", "minimum", "quantum"):
            if not 0 <= (value := getattr(self, name)) < inf:
                raise InputError(f"{name} must be ≥ 0 and finite, got {value}")
        if not self.maximum >= self.minimum:
            raise InputError(f"maximum must be ≥ minimum, got {self.maximum} < {self.minimum}")
        if min(self.dimension, self.thrusters) < 1:
            raise InputError("dimension and thrusters must be at least 1")

    @property
    def noise(self) -> int:
        """Number of normal numbers per case and sample: magnitude and direction per thruster."""
        exact = self.magnitude_sigma == 0 and self.pointing_sigma_rad == 0
        return 0 if exact else self.thrusters * (1 + self.dimension)

    def execute(self, u: Array, w: Array) -> Array:
        """Return the executed command (p, N) for the command u (p, N), with noise w (noise, N)."""
        if len(u) != self.dimension * self.thrusters:
            raise InputError(
                f"{self.thrusters} thruster(s) of {self.dimension} components cannot do a command "
                f"of {len(u)}; set dimension and thrusters"
            )
        command = u.reshape(self.thrusters, self.dimension, -1)
        size = np.sqrt(np.add.reduce(command * command, axis=1))
        wanted = np.round(size / self.quantum) * self.quantum if self.quantum else size
        wanted = np.minimum(wanted, self.maximum)
        wanted = np.where(wanted < self.minimum, 0.0, wanted)
        along = command / np.where(size > 0, size, 1.0)[:, None]
        if self.noise:
            normal = w.reshape(self.thrusters, 1 + self.dimension, -1)
            wanted = wanted * (1.0 + self.magnitude_sigma * normal[:, 0])
            # The component of the noise normal to the command gives δ ê; with sin δ/δ by sinc the
            # direction is cos δ û + sin δ ê, also for δ = 0.
            within = np.add.reduce(normal[:, 1:] * along, axis=1)
            across = normal[:, 1:] - within[:, None] * along
            across *= self.pointing_sigma_rad
            angle = np.sqrt(np.add.reduce(across * across, axis=1))[:, None]
            along = np.cos(angle) * along + np.sinc(angle / np.pi) * across
        done: Array = (along * wanted[:, None]).reshape(u.shape)
        return done
