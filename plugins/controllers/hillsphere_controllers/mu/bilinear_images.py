"""Bilinear images of systems in discrete time: µ stays the same, frequencies are warped."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.systems.bilinear import continuous

__all__ = [
    "check_loop",
    "continuous_image",
    "discrete_frequency",
    "finite_frequency",
    "image_frequency",
]


def check_loop(system: LtiSystem, structure: BlockStructure) -> None:
    """Check that a system is stable and fits the block structure.

    Raises
    ------
    InputError
        If the system is not stable, or does not fit the structure.
    """
    if system.shape != structure.shape:
        raise InputError(
            f"these blocks close a system of {structure.shape[0]} outputs and "
            f"{structure.shape[1]} inputs, got {system.shape[0]} and {system.shape[1]}"
        )
    if not system.is_stable:
        poles = system.poles
        worst = np.argmax(poles.real if system.dt_s is None else np.abs(poles))
        raise InputError(
            "µ over frequency needs a stable system, but the nominal one has a pole at "
            f"{poles[worst]:.6g}: stabilise it first"
        )


def continuous_image(system: LtiSystem, structure: BlockStructure) -> LtiSystem:
    """Return a system in continuous time, or the bilinear image of one in discrete time.

    Raises
    ------
    InputError
        If the system is not stable, or does not fit the structure.
    """
    check_loop(system, structure)
    return system if system.dt_s is None else continuous(system)


def image_frequency(omega_rad_s: float, dt_s: float | None) -> float:
    """Return the image of a frequency, 2/dt tan(ω dt/2); the same in continuous time."""
    if dt_s is None:
        return omega_rad_s
    if omega_rad_s >= np.pi / dt_s:  # the tangent of a rounded right angle is finite
        return np.inf
    return float(2.0 / dt_s * np.tan(0.5 * dt_s * omega_rad_s))


def discrete_frequency(omega_rad_s: float, dt_s: float | None) -> float:
    """Return the frequency in discrete time, 2/dt atan(ω dt/2), of a frequency of the image."""
    return omega_rad_s if dt_s is None else float(2.0 / dt_s * np.arctan(0.5 * dt_s * omega_rad_s))


def finite_frequency(system: LtiSystem, omega_rad_s: float) -> float:
    """Return a frequency far below all poles for zero, far above them for infinity."""
    size = np.abs(system.poles)
    size = size[size > 0.0] if size.any() else np.ones(1)
    return float(1e-3 * size.min() if omega_rad_s == 0.0 else 1e3 * size.max())
