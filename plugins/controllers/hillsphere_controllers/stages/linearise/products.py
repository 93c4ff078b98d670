"""Product of the stage ``linearise``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape
from hillsphere_controllers.linear_products import LinearModels

__all__ = ["LinearisedFlight"]


@dataclass(frozen=True)
class LinearisedFlight(LinearModels):
    """Linear models at N points of a trajectory, and the effects of q dispersed parameters there.

    The models' first parameter is ``"point"``, from 1 to N; then come the dispersed ones under the
    names that the mission has for them (``"gravity.phobos.C2,1"``). Every point has a model with
    all parameters nominal, whose label begins with ``"nominal"``.
    """

    flight: str
    """Name of the trajectory."""
    frame: str
    """Of its states."""
    t_s: Annotated[Array, Shape("points"), Label("time", 6)]
    """Times of the points since its start."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the positions and velocities, in the order of the models' outputs."""
    rates: Annotated[tuple[str, ...], Shape("rates")]
    """Names of the velocities among them."""
    commands: Annotated[tuple[str, ...], Shape("commands")]
    """Names of the controls."""
    x: Annotated[Array, Shape("states", "points")]
    """States at the points, SI."""
    u: Annotated[Array, Shape("commands", "points")]
    """Command at the points, SI."""
    sigma: Annotated[Array, Shape("dispersed")]
    """Standard deviations of the dispersed parameters, in their units."""
    affine: Annotated[NDArray[np.bool_], Shape("dispersed")]
    """Whether the derivatives are affine in a parameter, each by itself."""
    acceleration_slopes: Annotated[Array, Shape("rates", "dispersed", "points")]
    """Derivatives of the accelerations by the parameters at the points, SI."""
    acceleration_covariance: Annotated[Array, Shape("rates", "rates", "points")]
    """Of the unknown acceleration: of the parameters and of the command's error, m²/s⁴."""
    jacobian_share: Annotated[Array, Shape("dispersed", "points")]
    """Norm of the change of A by one standard deviation of a parameter, relative to the norm of A
    on the rows and columns that any of them changes."""
    largest_acceleration: Annotated[Array, Shape("dispersed")]
    """Largest change of the acceleration along the whole trajectory by one standard deviation."""
    end_deviation_m: Annotated[Array, Shape("dispersed")]
    """By how much the end of the flight under the trajectory's command moves for one standard
    deviation; NaN if the flight does not end."""
    fit_weight: Annotated[Array, Shape("dispersed")]
    """Share of each parameter in the sum of squares of the changes of A by one standard deviation
    of each at all points."""

    @property
    def point(self) -> Integers:
        """Number of the point of each model, from 1."""
        return np.asarray(self.values[0].round(), dtype=np.int64)

    @property
    def dispersed(self) -> tuple[str, ...]:
        """Names of the dispersed parameters."""
        return self.parameters[1:]
