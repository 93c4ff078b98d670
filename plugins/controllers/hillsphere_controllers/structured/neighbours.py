"""Neighbours of a structure: one of lower order that it contains, and a larger one.

A controller of lower order is one of the structure with a decoupled stable state, or with the gain
of an action at zero, so that its minimum is a stabilising start. A larger structure has a lower
minimum, and fewer local ones as a rule; a path leads from it to the structure (`continuation`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import (
    Diagonal,
    FreeEntries,
    Structure,
    free_state_space,
    static,
)

__all__ = ["larger_structure", "smaller_structure"]

_INPUT = 0.3
"""Entries of B of a decoupled state, in scaled parameters, with C = 0. With both at zero the
gradient by either vanishes, a saddle."""

Padding = Callable[[Array, Array, Array, float, np.random.Generator], Array]
"""From θ of the smaller structure, middle and spread of the structure, a rate in 1/s and a source
of random numbers to θ of the structure."""


def larger_structure(structure: Structure) -> Structure:
    """Return the free controller of the next order, or of the same if entries are prescribed.

    Parameters
    ----------
    structure : Structure
        Any.

    Returns
    -------
    Structure
        Contains the structure, without bounds of its parameters.
    """
    more = isinstance(structure, FreeEntries) and bool(structure.free.all())
    return free_state_space(
        structure.order + (1 if more or structure.order == 0 else 0), structure.controls,
        structure.measurements,
    )  # fmt: skip


def smaller_structure(structure: Structure) -> tuple[Structure, Padding] | None:
    """Return a structure of lower order, and how its parameters become those of this one.

    Parameters
    ----------
    structure : Structure
        Any.

    Returns
    -------
    tuple of Structure and callable, or None
        None for static gains and prescribed patterns.
    """
    if isinstance(structure, Pid):
        return _smaller_pid(structure)
    if isinstance(structure, TransferFunction):
        return _smaller_transfer_function(structure)
    if isinstance(structure, FreeEntries):
        return _smaller_state_space(structure)
    if isinstance(structure, Diagonal):
        return _smaller_diagonal(structure)
    return None


def _smaller_state_space(structure: FreeEntries) -> tuple[Structure, Padding] | None:
    k, free = structure.order, structure.free
    direct = free[k:, k:]
    if k == 0 or not free[:k].all() or not free[k:, :k].all():
        return None
    if direct.all() == (not direct.any()) or structure.gains(np.zeros(structure.size)).any():
        return None  # a pattern
    if k == 1 and not direct.any():
        return None  # nothing would be left
    proper = not direct.any()
    less = free_state_space(
        k - 1, structure.controls, structure.measurements, strictly_proper=proper
    )

    def pad(
        theta: Array, middle: Array, spread: Array, rate: float, random: np.random.Generator
    ) -> Array:
        small, units = less.gains(theta), structure.gains(spread)
        made = np.zeros_like(units)
        kept = np.r_[0 : k - 1, k : k + structure.controls]
        columns = np.r_[0 : k - 1, k : k + structure.measurements]
        made[np.ix_(kept, columns)] = small
        made[k - 1, k - 1] = -rate
        made[k - 1, k:] = _INPUT * units[k - 1, k:] * random.normal(size=structure.measurements)
        return np.asarray(made[structure.free])

    return less, pad


def _smaller_pid(structure: Pid) -> tuple[Structure, Padding] | None:
    if structure.integral and structure.derivative:
        less: Structure = Pid(integral=True, derivative=False)
    elif structure.integral or structure.derivative:
        less = static(1, 1)
    else:
        return None

    def pad(
        theta: Array, middle: Array, spread: Array, rate: float, random: np.random.Generator
    ) -> Array:
        # the action that is new has no gain, its filter the typical one
        return np.concatenate([theta, middle[theta.size :]])

    return less, pad


def _smaller_transfer_function(structure: TransferFunction) -> tuple[Structure, Padding] | None:
    n = structure.order
    relative = n - (structure.size - n - 1)
    if relative == n:
        return None  # a constant numerator: no factor can be added to it
    less: Structure = static(1, 1) if n == 1 else TransferFunction(n - 1, relative)

    def pad(
        theta: Array, middle: Array, spread: Array, rate: float, random: np.random.Generator
    ) -> Array:
        # numerator and denominator, from the lowest power, times s + rate
        a, b = np.append(theta[: n - 1], 1.0), theta[n - 1 :]
        factor = np.array([rate, 1.0])
        return np.concatenate([np.convolve(a, factor)[:n], np.convolve(b, factor)])

    return less, pad


def _smaller_diagonal(structure: Diagonal) -> tuple[Structure, Padding] | None:
    found = [smaller_structure(part) for part in structure.parts]
    if all(one is None for one in found):
        return None
    parts = [
        part if one is None else one[0] for part, one in zip(structure.parts, found, strict=True)
    ]

    def pad(
        theta: Array, middle: Array, spread: Array, rate: float, random: np.random.Generator
    ) -> Array:
        made, at, place = [], 0, 0
        for part, less, one in zip(structure.parts, parts, found, strict=True):
            own = theta[at : at + less.size]
            if one is not None:
                span = slice(place, place + part.size)
                own = one[1](own, middle[span], spread[span], rate, random)
            made.append(own)
            at, place = at + less.size, place + part.size
        return np.concatenate(made)

    return Diagonal(parts, alike=structure.alike), pad
