"""Parameters and variables of models, and units in which their values are of order one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array

__all__ = ["Parameter", "Scales", "Variable"]


@dataclass(frozen=True)
class Parameter:
    """A number in a model's equations that may become a run-time parameter.

    Parameters
    ----------
    name : str
        Unique within the model, e.g. ``"gm"`` or ``"C2,0"``.
    value : float
        Nominal value, SI.
    unit : str
        E.g. ``"m3/s2"``, ``"-"``.
    positive : bool
        Whether the value must be positive; a case of a campaign with another value is not
        computed.
    """

    name: str
    value: float
    unit: str = "-"
    positive: bool = False


@dataclass(frozen=True)
class Variable:
    """A state or control of a plant.

    Parameters
    ----------
    name : str
        Unique within the plant.
    length, time : int
        Exponents of its dimension: a speed is ``Variable("vx", 1, -1)``. They fix the unit and
        the factor between physical and normalised values.
    frame : str
        Frame in which it is expressed; ``""`` for the plant's own.
    unit : str
        Overrides the unit that follows from the exponents (``"rad"`` for an angle).
    """

    name: str
    length: int = 0
    time: int = 0
    frame: str = ""
    unit: str = ""


@dataclass(frozen=True)
class Scales:
    """Units of length and time in which a plant's numbers are of order one.

    Parameters
    ----------
    length_m : float
        Unit of length, m.
    time_s : float
        Unit of time, s.
    """

    length_m: float
    time_s: float

    def of(self, variables: Sequence[Variable]) -> Array:
        """SI size of one normalised unit of each variable, shape (n,)."""
        return np.array([self.length_m**v.length * self.time_s**v.time for v in variables])
