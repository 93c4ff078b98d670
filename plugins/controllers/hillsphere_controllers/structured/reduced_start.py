"""A start of the search from the controller of full order, reduced to the structure.

It solves the same problem without the structure, so that what is left of it is often near a good
minimum; where it is not, it is one start among others. Its states are cut by balanced truncation. A
constant gain is the one whose output is nearest, in the mean square, to that of the controller of
full order in its own closed loop.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.structure import Structure
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.truncation import balanced_truncation

__all__ = ["gain_size", "reduced_start", "static_starts"]

_AFFINE = 1e-9
"""Relative deviation from linearity up to which a structure counts as linear in its parameters:
rounding of its evaluation."""
_FREQUENCIES = 12
"""Frequencies at which a controller is taken for a constant gain: two in a decade where the closed
loop's poles span six."""


def reduced_start(
    plant: LtiSystem, controller: LtiSystem, structure: Structure, middle: Array, rate: float
) -> Array | None:
    """Return parameters (size,) whose K is nearest to the controller's, reduced to the order.

    Parameters
    ----------
    plant : LtiSystem
        Its last inputs are the controls, its last outputs the measurements.
    controller : LtiSystem
        From y to u; it stabilises the plant.
    structure : Structure
        K is to be linear in its parameters.
    middle : ndarray, shape (size,)
        Of its typical parameters.
    rate : float
        Of a pole for states that the controller does not have, 1/s.

    Returns
    -------
    ndarray or None
        None if K is not linear in the parameters, or more states are unstable than the order.
    """
    order = structure.order
    if order == 0:
        wanted = _constant(plant, controller)
    else:
        small = balanced_truncation(controller, order)
        if small.order > order:
            return None
        k, (nu, ny) = small.order, small.shape
        wanted = np.zeros((order + nu, order + ny))
        # states that the reduced controller does not have stay uncoupled
        wanted[:order, :order] = -rate * np.eye(order)
        wanted[:k, :k], wanted[:k, order:] = small.a, small.b
        wanted[order:, :k], wanted[order:, order:] = small.c, small.d
    return _fit(structure, middle, wanted)


def static_starts(
    plant: LtiSystem, controller: LtiSystem, structure: Structure, middle: Array
) -> list[Array]:
    """Return parameters (size,) whose K is the real part of the controller's gain at a frequency.

    Where the controller acts at high frequencies with gains that those at rest do not show, the
    gain that is nearest in the mean square to its output may be far too small.

    Parameters
    ----------
    plant, controller, structure, middle
        As of `reduced_start`.

    Returns
    -------
    list of ndarray
        One for each of some frequencies among the closed loop's poles; none if the structure has
        states or K is not linear in the parameters.
    """
    if structure.order:
        return []
    made = [
        _fit(structure, middle, gains.real)
        for gains in controller.response(_loop_frequencies(plant, controller))
    ]
    return [theta for theta in made if theta is not None]


def gain_size(plant: LtiSystem, controller: LtiSystem) -> float:
    """Return the largest gain of a controller at frequencies of its closed loop's poles.

    Parameters
    ----------
    plant, controller
        As of `reduced_start`.

    Returns
    -------
    float
        The largest Frobenius norm of K(jω).
    """
    gains = controller.response(_loop_frequencies(plant, controller))
    return float(np.linalg.norm(gains, axis=(1, 2)).max())


def _loop_frequencies(plant: LtiSystem, controller: LtiSystem) -> Array:
    sizes = np.abs(lower_lft(plant, controller).poles)
    sizes = sizes[sizes > 1e-8 * sizes.max(initial=1.0)]
    low, high = (sizes.min(), sizes.max()) if sizes.size else (1.0, 1.0)
    return np.asarray(np.geomspace(low, high, _FREQUENCIES))


def _fit(structure: Structure, middle: Array, wanted: Array) -> Array | None:
    """Return the parameters whose K is nearest to a matrix; None if K is not linear in them."""
    start = structure.gains(middle)
    units = np.eye(wanted.size).reshape(wanted.size, *wanted.shape)
    # K is linear in θ: the slopes of all its entries give θ by least squares
    slopes = structure.pull_back(middle, units)
    step = np.linalg.lstsq(slopes, (wanted - start).ravel(), rcond=None)[0]
    if not np.isfinite(step).all():
        return None
    bent = structure.gains(middle + step).ravel() - start.ravel() - slopes @ step
    if np.linalg.norm(bent) > _AFFINE * max(1.0, float(np.linalg.norm(slopes @ step))):
        return None
    return np.asarray(middle + step)


def _constant(plant: LtiSystem, controller: LtiSystem) -> Array:
    """Return E(u yᵀ) E(y yᵀ)⁻¹ for white noise on w, y without the noise on it."""
    (nu, ny), n = controller.shape, plant.order
    p, m = plant.shape
    b1, b2, c2 = plant.b[:, : m - nu], plant.b[:, m - nu :], plant.c[p - ny :]
    d21, d22 = plant.d[p - ny :, : m - nu], plant.d[p - ny :, m - nu :]
    well = np.linalg.inv(np.eye(nu) - controller.d @ d22)
    u = well @ np.hstack([controller.d @ c2, controller.c])
    y = np.hstack([c2, np.zeros((ny, controller.order))]) + d22 @ u
    a = np.block(
        [
            [plant.a, np.zeros((n, controller.order))],
            [np.zeros((controller.order, n)), controller.a],
        ]
    )
    a = a + np.vstack([b2 @ u, controller.b @ y])
    noise = well @ controller.d @ d21
    b = np.vstack([b1 + b2 @ noise, controller.b @ (d21 + d22 @ noise)])
    # covariance of the closed loop's states, and from it the regression of u on y
    covariance = solve_continuous_lyapunov(a, -b @ b.T)
    return np.asarray(np.linalg.lstsq(y @ covariance @ y.T, y @ covariance @ u.T, rcond=1e-10)[0].T)
