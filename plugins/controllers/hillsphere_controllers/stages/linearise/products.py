"""Product of the stage ``linearise``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.linear_products import LinearModels

__all__ = ["LinearisedFlight"]


@dataclass(frozen=True)
class LinearisedFlight(LinearModels):
    """Linear models at N points of a trajectory, and what q dispersed parameters do there.

    The models' first parameter is ``"point"``, from 1 to N; then come the dispersed ones under the
    names that the mission has for them (``"gravity.phobos.C2,1"``). Every point has a model with
    all parameters nominal, whose label begins with ``"nominal"``.

    Parameters
    ----------
    flight : str
        Name of the trajectory.
    frame : str
        Of its states.
    t_s : ndarray, shape (N,)
        Times of the points since its start.
    states, rates, commands : tuple of str
        Names of the s positions and velocities (all s of them in the order of the models' outputs),
        of the r velocities among them, and of the m controls.
    x, u : ndarray, shape (s, N), (m, N)
        States and command at the points, SI.
    sigma : ndarray, shape (q,)
        Standard deviations of the dispersed parameters, in their units.
    affine : ndarray of bool, shape (q,)
        Whether the derivatives are affine in a parameter, each by itself.
    acceleration_slopes : ndarray, shape (r, q, N)
        Derivatives of the accelerations by the parameters at the points, SI.
    acceleration_covariance : ndarray, shape (r, r, N)
        Of the unknown acceleration: of the parameters and of the command's error, m²/s⁴.
    jacobian_share : ndarray, shape (q, N)
        Norm of the change of A by one standard deviation of a parameter, relative to the norm of A
        on the rows and columns that any of them changes.
    largest_acceleration : ndarray, shape (q,)
        Largest change of the acceleration along the whole trajectory by one standard deviation.
    end_deviation_m : ndarray, shape (q,)
        By how much the end of the flight under the trajectory's command moves for one standard
        deviation; NaN if the flight does not end.
    fit_weight : ndarray, shape (q,)
        Share of each parameter in the sum of squares of the changes of A by one standard deviation
        of each at all points.
    """

    flight: str
    frame: str
    t_s: Array
    states: tuple[str, ...]
    rates: tuple[str, ...]
    commands: tuple[str, ...]
    x: Array
    u: Array
    sigma: Array
    affine: NDArray[np.bool_]
    acceleration_slopes: Array
    acceleration_covariance: Array
    jacobian_share: Array
    largest_acceleration: Array
    end_deviation_m: Array
    fit_weight: Array

    @property
    def point(self) -> Integers:
        """Number of the point of each model, from 1."""
        return np.asarray(self.values[0].round(), dtype=np.int64)

    @property
    def dispersed(self) -> tuple[str, ...]:
        """Names of the dispersed parameters."""
        return self.parameters[1:]
