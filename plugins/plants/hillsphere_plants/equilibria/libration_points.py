"""Equilibrium points of motion about a moon, at which a particle can stay at rest in its frame."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, pi, sin

import numpy as np

from hillsphere.dynamics import Derivatives, system
from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array, Plant

__all__ = [
    "check_anomaly",
    "check_orbit",
    "equilibrium_near",
    "libration_points",
    "rest_eigenvalues",
]

_ITERATIONS = 60
"""Newton iterations at most; a step is at most a fifth of the distance, so that a few tens reach
any point about the moon before the convergence is quadratic."""
_EXACT, _CLOSE = 1e-15, 1e-6  # of the distance: a step that is done, one that may be rounding
_ANOMALIES = (0.0, 1.0, 2.5)
"""True anomalies, rad, at which accelerations are compared. No two of them are symmetric about the
apses (ν and −ν), where an elliptic orbit would give equal ones."""


def libration_points(plant: Plant, true_anomaly_rad: float | None = None) -> Mapping[str, Array]:
    """Find the libration points, in the moon's true gravity.

    Parameters
    ----------
    plant : Plant
        ``hill`` (L1, L2) or ``three_body`` (L1 to L5), circular, or elliptic with a circle for
        its ellipse. L1 lies between the moon and its primary, L4 leads the moon.
    true_anomaly_rad : float or None
        For an elliptic plant: where accelerations vanish for a moment, the moon being there; only
        L1 and L2.

    Returns
    -------
    mapping of str to ndarray, shape (3,)
        Positions in the plant's frame, m. Gravity that is not symmetric moves them off the axis.
        L3, L4 and L5 of a moon of mass ratio µ are known to about 1e-16/µ of their distance: all
        points of that circle are nearly in equilibrium.

    Raises
    ------
    InputError
        If the accelerations vary along the orbit.
    ConvergenceError
        If the search from the points of a point mass fails.
    """
    near = plant.scales.length_m * 3.0 ** (-1.0 / 3.0)
    alone = not hasattr(plant, "primary_gm_m3_s2")
    angle = getattr(plant, "primary_longitude_rad", pi)
    to_primary = np.array([cos(angle), sin(angle), 0.0])
    guesses = {"L1": near * to_primary, "L2": -near * to_primary}
    if not alone and true_anomaly_rad is None:
        distance: float = plant.primary_distance_m  # type: ignore[attr-defined]
        guesses["L3"] = 2.0 * distance * to_primary
        for name, turn in (("L4", -pi / 3.0), ("L5", pi / 3.0)):
            guesses[name] = distance * np.array([cos(angle + turn), sin(angle + turn), 0.0])
    points = equilibrium_near(plant, np.array(list(guesses.values())).T, true_anomaly_rad)
    return dict(zip(guesses, points.T, strict=True))


def equilibrium_near(plant: Plant, guess_m: Array, true_anomaly_rad: float | None = None) -> Array:
    """Find equilibrium points by Newton's method with exact derivatives.

    Parameters
    ----------
    plant : Plant
        States x, y, z, vx, vy, vz and perhaps a true anomaly.
    guess_m : ndarray, shape (3, N)
        First guesses, in the plant's frame.
    true_anomaly_rad : float or None
        Hold the plant's true anomaly here; None: the accelerations must not depend on it.

    Returns
    -------
    ndarray, shape (3, N)
        Where the acceleration of a particle at rest vanishes, m.

    Raises
    ------
    InputError
        If the accelerations vary along the orbit (an ellipse, a moon that librates).
    ConvergenceError
        If a search does not end.
    """
    equations = system(plant, normalised=True)
    slopes = Derivatives(equations)
    x = np.zeros((len(equations.x), guess_m.shape[1]))
    x[:3] = guess_m / plant.scales.length_m
    if true_anomaly_rad is not None:
        x[6:] = check_anomaly(plant, true_anomaly_rad)
    elif len(x) > 6:
        _check_steady(slopes, x)
    before = np.full(x.shape[1], np.inf)
    done = np.zeros(x.shape[1], dtype=bool)
    for _ in range(_ITERATIONS):
        rate, jacobian = slopes.both(x)
        step = np.linalg.solve(
            np.moveaxis(jacobian[3:6, :3], 2, 0), -np.moveaxis(rate[3:6], 1, 0)[..., None]
        )[..., 0].T
        size = np.linalg.norm(x[:3], axis=0)
        length = np.linalg.norm(step, axis=0)
        # Rounding: on the circle through L3, L4, L5 a light moon leaves next to no slope.
        done |= (length <= _EXACT * size) | ((length <= _CLOSE * size) & (length > 0.5 * before))
        if done.all():
            return np.asarray(x[:3] * plant.scales.length_m)
        # a step of more than a fifth of the distance leaves the neighbourhood of the guess
        x[:3] += (
            np.where(done, 0.0, np.minimum(1.0, 0.2 * size / np.maximum(length, 1e-300))) * step
        )
        before = length
    raise ConvergenceError(
        f"no equilibrium point is found from guess {np.flatnonzero(~done).tolist()} in "
        f"{_ITERATIONS} iterations; start nearer, outside the body"
    )


def check_orbit(plant: Plant, true_anomaly_rad: float | None = None) -> None:
    """Raise `InputError` unless a plant has equilibrium points, always or at a true anomaly."""
    if true_anomaly_rad is not None:
        check_anomaly(plant, true_anomaly_rad)
    elif len(plant.states) > 6:
        equations = system(plant, normalised=True)
        x = np.zeros((len(equations.x), 1))
        x[0] = 1.0
        _check_steady(Derivatives(equations), x)


def _check_steady(slopes: Derivatives, x: Array) -> None:
    """Raise `InputError` if accelerations at states (n, N) vary with the true anomaly, x[6]."""
    rates = []
    for anomaly in _ANOMALIES:
        x[6] = anomaly
        rates.append(slopes.rate(x)[3:6])
    if not all(np.allclose(rate, rates[0], rtol=1e-12, atol=1e-12) for rate in rates):
        raise InputError(
            "there is no equilibrium point: the accelerations vary along the orbit; give the body "
            "eccentricity 0 and lock it, take the circular plant, or ask for points at one true "
            "anomaly"
        )


def check_anomaly(plant: Plant, true_anomaly_rad: float) -> float:
    """Return the true anomaly at which a plant is held, or raise `InputError`.

    Raises
    ------
    InputError
        If the true anomaly is not the seventh and last state of the plant.
    """
    names = [v.name for v in plant.states]
    if names[6:] != ["true_anomaly"]:
        raise InputError(
            "a true anomaly is for a plant whose seventh and last state it is; this one has "
            f"{', '.join(names)}"
        )
    return true_anomaly_rad


def rest_eigenvalues(
    plant: Plant, position_m: Array, true_anomaly_rad: float | None = None
) -> np.ndarray[tuple[int, ...], np.dtype[np.complex128]]:
    """Return the eigenvalues of the linear motion about points of rest.

    Parameters
    ----------
    plant : Plant
        As for `equilibrium_near`.
    position_m : ndarray, shape (3, N)
        The points.
    true_anomaly_rad : float or None
        Held there.

    Returns
    -------
    ndarray of complex, shape (6, N)
        1/s, the largest real part first.
    """
    equations = system(plant, normalised=True)
    x = np.zeros((len(equations.x), position_m.shape[1]))
    x[:3] = position_m / plant.scales.length_m
    if true_anomaly_rad is not None:
        x[6:] = check_anomaly(plant, true_anomaly_rad)
    _, jacobian = Derivatives(equations).both(x)
    values = np.linalg.eigvals(np.moveaxis(jacobian[:6, :6], 2, 0)) / plant.scales.time_s
    order = np.lexsort((-values.imag, -values.real), axis=1)
    return np.take_along_axis(values, order, axis=1).T.astype(np.complex128)
