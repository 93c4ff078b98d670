"""Self-test of an installation: compiled code and propagators against closed forms.

It takes seconds: one compiled expression, and one Kepler orbit by each propagator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, pi, sin, sqrt

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import PropagationError
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.step_map import StepMap
from hillsphere.engine.dynamics.system import system
from hillsphere.engine.dynamics.taylor import Taylor
from hillsphere.interfaces.quantities import Parameter, Scales, Variable
from hillsphere.symbolic.expressions import Expr, Params, variables
from hillsphere.symbolic.expressions import sin as sine

__all__ = ["CHECKS", "KeplerPlant", "kepler_state"]

ECCENTRICITY = 0.5
"""Eccentricity of the test orbit: the angular velocity varies by a factor of nine along it, so
that a fault of the step-size control shows."""
TOLERANCE = 1e-11
"""Largest error of a state of order one; the propagators reach about 1e-14."""


class KeplerPlant:
    """The two-body problem with GM = 1, in normalised units: one orbit is 2π long."""

    frame = "inertial"
    states = (
        Variable("x", 1), Variable("y", 1), Variable("z", 1),
        Variable("vx", 1, -1), Variable("vy", 1, -1), Variable("vz", 1, -1),
    )  # fmt: skip
    controls: tuple[Variable, ...] = ()
    external: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return no parameters."""
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt: r̈ = −r/r³."""
        position, velocity = x[:3], x[3:]
        square = sum((c * c for c in position[1:]), position[0] * position[0])
        factor = -(square**-1.5)
        return (*velocity, *(c * factor for c in position))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return no events."""
        return {}


def kepler_state(time: float, eccentricity: float) -> Array:
    """Planar Kepler orbit of semi-major axis 1 and GM = 1, from its pericentre.

    Parameters
    ----------
    time : float
        Time since pericentre.
    eccentricity : float
        Below one.

    Returns
    -------
    numpy.ndarray, shape (6,)
        Position and velocity, from Kepler's equation M = E − e sin E [1]_.

    References
    ----------
    .. [1] Battin (1999), An Introduction to the Mathematics and Methods of Astrodynamics, §4.3.
    """
    anomaly = time
    for _ in range(60):
        error = anomaly - eccentricity * sin(anomaly) - time
        anomaly -= error / (1.0 - eccentricity * cos(anomaly))
    b = sqrt(1.0 - eccentricity**2)
    rate = 1.0 / (1.0 - eccentricity * cos(anomaly))
    position = (cos(anomaly) - eccentricity, b * sin(anomaly), 0.0)
    velocity = (-sin(anomaly) * rate, b * cos(anomaly) * rate, 0.0)
    return np.array(position + velocity)


def _compile() -> str:
    x, y = variables("x", "y")
    points = np.array([[0.5, 1.5, -2.0], [3.0, -0.25, 1.0]])
    values = ArrayFunction([sine(x) * y + x * x], [x, y])(points)[0]
    error = float(np.abs(values - (np.sin(points[0]) * points[1] + points[0] ** 2)).max())
    return _accurate(error, 1e-14)


def _step_map() -> str:
    start = kepler_state(0.0, ECCENTRICITY)[:, None]
    flow = StepMap(system(KeplerPlant()))
    middle = flow.propagate(start, 4.0, 400)[:, 0]
    end = flow.propagate(start, 2.0 * pi, 600)[:, 0]
    return _accurate(_largest(middle, end), TOLERANCE)


def _taylor() -> str:
    start = kepler_state(0.0, ECCENTRICITY)[:, None]
    flow = Taylor(system(KeplerPlant()))
    middle = flow.propagate(start, 4.0)[:, 0]
    end = flow.propagate(start, 2.0 * pi)[:, 0]
    return _accurate(_largest(middle, end), TOLERANCE)


def _largest(middle: Array, end: Array) -> float:
    errors = (
        middle - kepler_state(4.0, ECCENTRICITY),
        end - kepler_state(0.0, ECCENTRICITY),
    )
    return float(max(np.abs(error).max() for error in errors))


def _accurate(error: float, tolerance: float) -> str:
    if not error <= tolerance:
        raise PropagationError(f"error {error:.1e} against the closed form, over {tolerance:.0e}")
    return f"error {error:.1e}"


CHECKS: Mapping[str, Callable[[], str]] = {
    "compiled expression": _compile,
    "Kepler orbit, step map": _step_map,
    "Kepler orbit, Taylor": _taylor,
}
"""Name → check, which returns its result as text and raises `HillsphereError` if it fails."""
