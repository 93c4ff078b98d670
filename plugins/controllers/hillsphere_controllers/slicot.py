"""Initial guesses from SLICOT, by the optional package slycot; every guess is checked.

Nothing depends on whether it is installed: it is used only where it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem

__all__ = ["hinf_guess"]


def hinf_guess(
    plant: LtiSystem, controls: int, measurements: int, above: float, tolerance: float
) -> float:
    """Return the least γ of H∞ synthesis as SB10AD finds it by bisection, NaN if it does not.

    Parameters
    ----------
    plant : LtiSystem
        Generalised plant in continuous time.
    controls, measurements : int
        Numbers of u and y.
    above : float
        A γ for which there is a controller.
    tolerance : float
        Width, relative to that, at which its bisection ends.

    Raises
    ------
    InputError
        If slycot is not installed.
    """
    slycot = _slycot()
    p, m = plant.shape
    unit = np.ones((p, 1))
    unit[: p - measurements] = 1.0 / above
    try:
        result = slycot.sb10ad(
            plant.order, m, p, controls, measurements, 1.0, plant.a, plant.b, unit * plant.c,
            unit * plant.d, job=1, gtol=tolerance, actol=0.0,
        )  # fmt: skip
    except (slycot.exceptions.SlycotError, ValueError):  # badly conditioned, say
        return np.nan
    return above * float(result[0])


def _slycot() -> ModuleType:
    try:
        slycot = import_module("slycot")
    except ImportError:
        raise InputError(
            "SLICOT was asked for, but its package slycot is not installed: install "
            "hillsphere[slicot], or do not ask for it"
        ) from None
    return slycot
