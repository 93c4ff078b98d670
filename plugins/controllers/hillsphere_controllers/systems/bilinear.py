r"""Between continuous and discrete time by the bilinear map s = (2/T) (z − 1)/(z + 1).

It maps the left half-plane onto the unit disc and the imaginary axis onto its circle, so that
stability and the H∞ norm are those of the image; frequencies are bent: ω = (2/T) tan(θ/2) for
z = exp(jθ).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem

__all__ = ["continuous", "discrete"]


def continuous(system: LtiSystem) -> LtiSystem:
    """Return the image in continuous time of a system in discrete time.

    Raises
    ------
    InputError
        If the system is one in continuous time, or has a pole at z = −1, whose image is infinite.
    """
    if system.dt_s is None:
        raise InputError("the system is one in continuous time already")
    n, root = system.order, np.sqrt(system.dt_s)
    one = np.eye(n)
    plus = one + system.a
    if n and np.linalg.cond(plus) > 1e14:
        raise InputError("a pole at z = −1 has no image in continuous time")
    inverse = np.linalg.inv(plus)
    return replace(
        system,
        a=2.0 / system.dt_s * (inverse @ (system.a - one)),
        b=2.0 / root * (inverse @ system.b),
        c=2.0 / root * (system.c @ inverse),
        d=system.d - system.c @ inverse @ system.b,
        dt_s=None,
    )


def discrete(system: LtiSystem, dt_s: float) -> LtiSystem:
    """Return the image in discrete time, of the period dt_s, of a system in continuous time.

    Raises
    ------
    InputError
        If the system is one in discrete time, the period not positive, or a pole is 2/dt_s.
    """
    if system.dt_s is not None:
        raise InputError("the system is one in discrete time already")
    if not dt_s > 0.0:
        raise InputError(f"a sampling period must be > 0 s, got {dt_s}")
    n, root, half = system.order, np.sqrt(dt_s), 0.5 * dt_s
    one = np.eye(n)
    minus = one - half * system.a
    if n and np.linalg.cond(minus) > 1e14:
        raise InputError(f"a pole at 2/dt = {2.0 / dt_s:.6g} 1/s has no image in discrete time")
    inverse = np.linalg.inv(minus)
    return replace(
        system,
        a=inverse @ (one + half * system.a),
        b=root * (inverse @ system.b),
        c=root * (system.c @ inverse),
        d=system.d + half * (system.c @ inverse @ system.b),
        dt_s=dt_s,
    )
