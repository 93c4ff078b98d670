"""Equilibrium points of a uniformly rotating body, over which a particle can hover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.gravity import AnyGravityModel, GravityField
from hillsphere.interfaces import Array, ArraySurface, Surface
from hillsphere.model.shapes.levels import level_of

__all__ = ["SpinEquilibria", "spin_equilibria"]

_ITERATIONS = 100
"""Newton iterations at most. A step is at most a tenth of the distance, so that tens of them may
pass before the convergence is quadratic; lanes without an equilibrium nearby use them all and are
left out."""
_DONE = 1e-13
"""Length of the last step over the distance from the centre: a few hundred roundings."""
_SAME = 1e-6
"""Distance of two results, in synchronous radii, below which they are one point: far above what the
iterations leave, far below the distance of two equilibria of a real body."""
_FLAT = 1e-9
"""Singular values of the slope below this part of the largest count as zero, and no step is taken
along them: on the circle of equilibria of a round body they are rounding."""
_GUESSES = 24
"""Starts on the ring, every 15°. A body of degree and order 2 has four equilibria, an irregular one
a few more; with fewer starts one of these may be missed."""


@dataclass(frozen=True, eq=False)
class SpinEquilibria:
    """Equilibrium points and the motion about them.

    Parameters
    ----------
    position_m : ndarray, shape (3, K)
        Body-fixed, by longitude.
    eigenvalues : ndarray of complex, shape (6, K)
        Eigenvalues of the linear motion there, 1/s; a positive real part tells instability.
    potential : ndarray, shape (K,)
        ½ω²(x² + y²) + U, m²/s².
    """

    position_m: Array
    eigenvalues: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]
    potential: Array


def spin_equilibria(
    gravity: AnyGravityModel,
    rotation_rate_rad_s: float,
    surface: Surface | ArraySurface | None = None,
) -> SpinEquilibria:
    """Find the equilibrium points about a body that turns uniformly about +z.

    Nothing else attracts: a far primary's tide turns with the day and has no equilibrium.

    Parameters
    ----------
    gravity : GravityModel or ArrayGravityModel
        The body's attraction.
    rotation_rate_rad_s : float
        Angular velocity, either sign.
    surface : Surface or ArraySurface, optional
        Points inside of it are left out, among them the body's centre; by default the surface of
        the gravity model, if it has one.

    Returns
    -------
    SpinEquilibria
        Those that Newton's method finds from a ring of 24 points at the synchronous radius
        (GM/ω²)^(1/3): of a body that is not too irregular all outside of it. A series may have
        some of its own inside the sphere where it need not converge.

    Raises
    ------
    InputError
        If the body does not turn.
    ConvergenceError
        If no search ends.
    """
    rate = abs(rotation_rate_rad_s)
    if not 0.0 < rate < np.inf:
        raise InputError(f"rotation_rate_rad_s must not be zero, got {rotation_rate_rad_s}")
    field = GravityField(gravity)
    radius = (gravity.gm_m3_s2 / rate**2) ** (1.0 / 3.0)
    centrifugal = rate**2 * np.diag([1.0, 1.0, 0.0])
    angle = 2.0 * np.pi * np.arange(_GUESSES) / _GUESSES
    r = radius * np.array([np.cos(angle), np.sin(angle), np.zeros(_GUESSES)])
    done = np.zeros(_GUESSES, dtype=bool)
    for _ in range(_ITERATIONS):
        pull = field.acceleration(r) + centrifugal @ r
        slope = np.moveaxis(field.gradient(r), 2, 0) + centrifugal
        # Near a round body a whole circle is in equilibrium: the pseudo-inverse steps across it
        # only.
        step = -(np.linalg.pinv(slope, _FLAT) @ pull.T[..., None])[..., 0].T
        size, length = np.linalg.norm(r, axis=0), np.linalg.norm(step, axis=0)
        done = length <= _DONE * size
        if done.all():
            break
        # at most a tenth of the distance, so that the iterations do not leave the neighbourhood
        r = r + np.minimum(1.0, 0.1 * size / np.maximum(length, 1e-300)) * step
    converged = r[:, done]
    if not converged.size:
        raise ConvergenceError(
            f"no equilibrium point is found about {radius:.6g} m in {_ITERATIONS} iterations"
        )
    # by longitude from 0; the shift keeps a point at −1e-16 rad first and not last
    order = np.argsort(np.mod(np.arctan2(converged[1], converged[0]) + _SAME, 2.0 * np.pi))
    kept: list[Array] = []
    for point in converged[:, order].T:
        if all(np.linalg.norm(point - other) > _SAME * radius for other in kept):
            kept.append(point)
    points = np.array(kept).T
    if surface is None and isinstance(gravity, Surface | ArraySurface):
        surface = gravity
    if surface is not None:
        points = points[:, level_of(surface)(points) > 0.0]
    return SpinEquilibria(
        points,
        _eigenvalues(field, points, rate),
        field.potential(points) + 0.5 * rate**2 * np.sum(points[:2] ** 2, axis=0),
    )


def _eigenvalues(
    field: GravityField, r: Array, rate: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.complex128]]:
    """Return the eigenvalues (6, K) of δr̈ = (∇∇U + ω²)δr − 2ω×δṙ."""
    gradient = np.moveaxis(field.gradient(r), 2, 0)
    system = np.zeros((r.shape[1], 6, 6))
    system[:, :3, 3:] = np.eye(3)
    system[:, 3:, :3] = gradient + rate**2 * np.diag([1.0, 1.0, 0.0])
    system[:, 3, 4], system[:, 4, 3] = 2.0 * rate, -2.0 * rate
    return np.linalg.eigvals(system).T.astype(np.complex128)
