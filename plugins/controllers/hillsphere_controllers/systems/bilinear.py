r"""Bilinear (Tustin) map between continuous and discrete time, s = (2/T) (z − 1)/(z + 1).

It maps the left half-plane onto the unit disc and the imaginary axis onto its circle, so that
stability and the H∞ norm are those of the image; frequencies are warped: ω = (2/T) tan(θ/2) for
z = exp(jθ).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["continuous", "discrete"]

_POLE = 1e-13
"""Distance of a pole from z = −1 below which rounding alone decides where its image lies."""
_REST = 1e-8
"""Of a matrix times its inverse, besides the unit matrix; larger if a pole has no image."""


def continuous(system: LtiSystem) -> LtiSystem:
    """Return the image in continuous time of a system in discrete time.

    Parameters
    ----------
    system : LtiSystem
        In discrete time.

    Returns
    -------
    LtiSystem
        Of the same order; its H∞ norm and stability are those of the original.

    Raises
    ------
    InputError
        If the system is one in continuous time, or has a pole at z = −1, whose image is infinite.
    """
    if system.dt_s is None:
        raise InputError("the system is one in continuous time already")
    dt, one = system.dt_s, np.eye(system.order)
    # balance the states, so that their scales do not affect the inverse
    even, scale = balance_states(system)
    away = np.abs(1.0 + even.poles)
    if away.size and away.min() <= _POLE:
        raise InputError(
            f"a pole at z = −1 (to {away.min():.1e}) has no image in continuous time; it is an "
            "oscillation at half the sampling rate: damp it a little, or leave it out"
        )
    inverse = np.linalg.inv(one + even.a)
    root = np.sqrt(dt)
    return replace(
        system,
        # A_c = (2/T) (I + A)⁻¹ (A − I), with the factor √T shared between B and C
        a=2.0 / dt * (inverse @ (even.a - one)) * scale[:, None] / scale,
        b=2.0 / root * (inverse @ even.b) * scale[:, None],
        c=2.0 / root * (even.c @ inverse) / scale,
        d=system.d - even.c @ inverse @ even.b,
        dt_s=None,
    )


def discrete(system: LtiSystem, dt_s: float) -> LtiSystem:
    """Return the image in discrete time, of the period dt_s, of a system in continuous time.

    Parameters
    ----------
    system : LtiSystem
        In continuous time.
    dt_s : float
        Sampling period, s.

    Returns
    -------
    LtiSystem
        Of the same order; its H∞ norm and stability are those of the original.

    Raises
    ------
    InputError
        If the system is one in discrete time, the period not positive, or a pole is 2/dt_s.
    """
    if system.dt_s is not None:
        raise InputError("the system is one in discrete time already")
    if not dt_s > 0.0:
        raise InputError(f"a sampling period must be > 0 s, got {dt_s}")
    root, half = np.sqrt(dt_s), 0.5 * dt_s
    even, scale = balance_states(system)
    one = np.eye(system.order)
    minus = one - half * even.a
    # rows of one size: of a fast mode all entries are large
    size = np.abs(minus).max(axis=1, initial=0.0)[:, None]
    size[size == 0.0] = 1.0
    try:
        inverse = np.linalg.solve(minus / size, one)
        rest = float(np.abs(minus / size @ inverse - one).max(initial=0.0))
    except np.linalg.LinAlgError:
        rest = np.inf
    if not rest <= _REST:
        raise InputError(f"a pole at 2/dt = {2.0 / dt_s:.6g} 1/s has no image in discrete time")
    inverse = inverse / size.T
    return replace(
        system,
        a=inverse @ (one + half * even.a) * scale[:, None] / scale,
        b=root * (inverse @ even.b) * scale[:, None],
        c=root * (even.c @ inverse) / scale,
        d=system.d + half * (even.c @ inverse @ even.b),
        dt_s=dt_s,
    )
