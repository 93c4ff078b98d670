"""Coordinates in which the unknowns of the matrix inequalities are near the identity.

Interior-point methods for matrix inequalities lose their digits where unknowns differ in size. A
linear-quadratic design for the same plant gives the sizes: X is about the covariance of the states
under white noise, Y about the inverse of the filter's error covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gramians import lyapunov_solution
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.riccati import stabilising_solution

__all__ = ["Coordinates", "output_feedback_coordinates", "state_feedback_coordinates"]

_SMALL = 1e-3
"""Weight and noise that are added, relative to those there are."""


@dataclass(frozen=True, eq=False)
class Coordinates:
    """States x = T x̃, and a unit of z.

    Parameters
    ----------
    t : ndarray, shape (n, n)
        T.
    unit : float
        A gain from w to z that a stabilising controller has.
    """

    t: Array
    unit: float

    def of(self, plant: LtiSystem, measurements: int = 0) -> LtiSystem:
        """Return a plant in these, unnamed; its last outputs keep their unit."""
        units = np.ones((plant.shape[0], 1))
        units[: plant.shape[0] - measurements] = self.unit
        inside = np.linalg.solve(self.t, np.hstack([plant.a @ self.t, plant.b])).astype(float)
        a, b = inside[:, : plant.order], inside[:, plant.order :]
        return LtiSystem(a, b, plant.c @ self.t / units, plant.d / units)


def state_feedback_coordinates(plant: LtiSystem, controls: int) -> Coordinates:
    """Return coordinates in which the covariance of a linear-quadratic design is the identity.

    Raises
    ------
    SynthesisFailedError
        If there is no such design in floating point.
    """
    covariance, loop = _lqr_covariance(plant, controls)
    return Coordinates(_root(covariance), hinf_norm(loop, 1e-3).value or 1.0)


def output_feedback_coordinates(plant: LtiSystem, controls: int, measurements: int) -> Coordinates:
    """Return coordinates in which X and Y of a linear-quadratic design are equal and diagonal.

    Raises
    ------
    SynthesisFailedError
        If there is no such design in floating point.
    """
    p = plant.shape[0] - measurements
    direct = LtiSystem(plant.a, plant.b, plant.c[:p], plant.d[:p])
    covariance, loop = _lqr_covariance(direct, controls)
    m = plant.shape[1] - controls
    errors, _ = _feedback(plant.a.T, plant.c[p:].T, plant.b[:, :m].T, plant.d[p:, :m].T)
    # T⁻¹ X T⁻ᵀ = Tᵀ Y T = diagonal
    x, y = _root(covariance + errors), _root(np.linalg.inv(errors).astype(float))
    # balancing of the pair (X, Y), as for Gramians
    _, values, vt = np.linalg.svd(y.T @ x)
    return Coordinates(x @ vt.T / np.sqrt(values), hinf_norm(loop, 1e-3).value or 1.0)


def _lqr_covariance(plant: LtiSystem, controls: int) -> tuple[Array, LtiSystem]:
    """Return the covariance (n, n) of the states under linear-quadratic feedback, and the loop."""
    m = plant.shape[1] - controls
    b1, b2, d12 = plant.b[:, :m], plant.b[:, m:], plant.d[:, m:]
    _, gain = _feedback(plant.a, b2, plant.c, d12)
    loop = LtiSystem(plant.a + b2 @ gain, b1, plant.c + d12 @ gain, plant.d[:, :m])
    covariance = lyapunov_solution(loop.a, _make_positive(b1 @ b1.T, 1.0))
    return np.asarray(0.5 * (covariance + covariance.T)), loop


def _feedback(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Return the cost matrix (n, n) and the gain of a regularised linear-quadratic design."""
    across = d.T @ c
    fast = float(np.linalg.norm(a)) or 1.0
    weight = _make_positive(
        d.T @ d, float(np.linalg.norm(c) * np.linalg.norm(b) / fast) ** 2 or 1.0
    )
    into = np.linalg.solve(weight, np.hstack([across, b.T]))
    n = len(a)
    cost = _make_positive(c.T @ c, 1.0) - across.T @ into[:, :n]
    x = stabilising_solution(a - b @ into[:, :n], -b @ into[:, n:], 0.5 * (cost + cost.T))
    if x is None:
        raise SynthesisFailedError(
            "not even a linear-quadratic design can be found in floating point; scale states, "
            "inputs and outputs to order one, or take modes out that are hardly controlled or seen"
        )
    return x, -(into[:, :n] + into[:, n:] @ x)


def _make_positive(matrix: Array, if_none: float) -> Array:
    """Return a positive definite matrix near one that may be singular or zero."""
    size = float(np.trace(matrix)) / len(matrix)
    return np.asarray(matrix + _SMALL**2 * (size or if_none) * np.eye(len(matrix)))


def _root(matrix: Array) -> Array:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 1e-12 * values[-1])))
