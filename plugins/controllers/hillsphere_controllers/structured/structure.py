r"""Structures of a controller: its matrices as functions of a few parameters θ.

A controller of order k is one matrix,

.. math::

    \begin{bmatrix} \dot x_K \\ u \end{bmatrix} =
    K \begin{bmatrix} x_K \\ y \end{bmatrix}, \qquad
    K = \begin{bmatrix} A_K & B_K \\ C_K & D_K \end{bmatrix},

u = K(s) y without a change of sign. A structure gives K(θ) and, for the chain rule, Jᵀ vec(dK).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem

__all__ = [
    "Alike",
    "Diagonal",
    "FreeEntries",
    "Sizes",
    "Structure",
    "controller_of",
    "free_state_space",
    "mask_gains",
    "static",
]  # fmt: skip


@dataclass(frozen=True)
class Sizes:
    """Typical sizes of a plant's signals and poles: the scale of the starts.

    Parameters
    ----------
    controls : ndarray, shape (controls,)
        Typical u.
    measurements : ndarray, shape (measurements,)
        Typical y.
    rate : float
        Typical pole, 1/s.
    """

    controls: Array
    measurements: Array
    rate: float


class Structure(Protocol):
    """A fixed structure."""

    @property
    def order(self) -> int:
        """Number of states k."""
        ...

    @property
    def controls(self) -> int:
        """Number of outputs u."""
        ...

    @property
    def measurements(self) -> int:
        """Number of inputs y."""
        ...

    @property
    def size(self) -> int:
        """Number of parameters."""
        ...

    def gains(self, theta: Array) -> Array:
        """Return K (order + controls, order + measurements)."""
        ...

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return Jᵀ vec(dK) (..., size) of slopes (..., order + controls, order + measurements)."""
        ...

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return the middle (size,) and spread (size,) > 0 of starts."""
        ...


def controller_of(structure: Structure, theta: Array) -> LtiSystem:
    """Return the controller of parameters (size,) as a system from y to u.

    Parameters
    ----------
    structure : Structure
        The structure.
    theta : ndarray, shape (size,)
        Values of its free parameters.

    Returns
    -------
    LtiSystem
        The controller.
    """
    k, gains = structure.order, structure.gains(np.asarray(theta, dtype=float))
    return LtiSystem(gains[:k, :k], gains[:k, k:], gains[k:, :k], gains[k:, k:])


class FreeEntries:
    """A structure whose parameters are the free entries of K, row by row.

    Parameters
    ----------
    gains : ndarray, shape (order + controls, order + measurements)
        Fixed entries; NaN where an entry is free.
    order : int
        k.

    Raises
    ------
    InputError
        If the order does not fit, or nothing is free.
    """

    def __init__(self, gains: Array, order: int) -> None:
        given = np.array(gains, dtype=float)
        if given.ndim != 2 or not 0 <= order < min(given.shape):
            raise InputError(
                f"K of order {order} needs more rows and columns than that, got {given.shape}"
            )
        self.free = np.isnan(given)
        if not self.free.any():
            raise InputError("no entry of the controller is free; mark those that are with NaN")
        self._fixed = np.where(self.free, 0.0, given)
        self.order = order
        self.controls, self.measurements = given.shape[0] - order, given.shape[1] - order
        self.size = int(self.free.sum())

    def gains(self, theta: Array) -> Array:
        """Return K."""
        made = self._fixed.copy()
        made[self.free] = theta
        return made

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of the free entries."""
        return np.asarray(slope[..., self.free])

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return zeros, and spreads that make a loop of order one."""
        root = np.full(self.order, np.sqrt(sizes.rate))
        rows = np.concatenate([root, sizes.controls])
        columns = np.concatenate([1.0 / root, 1.0 / sizes.measurements])
        spread = rows[:, None] * columns
        # x_K is of order one: A_K like a pole, B_K C_K like a pole times u/y
        spread[: self.order, : self.order] = sizes.rate
        spread[self.order :, : self.order] = sizes.controls[:, None] * root
        return np.zeros(self.size), spread[self.free]


def static(controls: int, measurements: int) -> FreeEntries:
    """Return u = D y with any D.

    Parameters
    ----------
    controls, measurements : int
        Size of D.

    Returns
    -------
    FreeEntries
        The structure.
    """
    return free_state_space(0, controls, measurements)


def free_state_space(
    order: int, controls: int, measurements: int, *, strictly_proper: bool = False
) -> FreeEntries:
    """Return any controller of an order; with D = 0 if strictly proper.

    Parameters
    ----------
    order : int
        Number of states.
    controls, measurements : int
        Numbers of outputs and inputs.
    strictly_proper : bool
        Whether D is zero.

    Returns
    -------
    FreeEntries
        The structure.
    """
    gains = np.full((order + controls, order + measurements), np.nan)
    if strictly_proper:
        gains[order:, order:] = 0.0
    return FreeEntries(gains, order)


def mask_gains(gains: Array, order: int = 0) -> FreeEntries:
    """Return a controller with fixed entries; NaN marks the free ones.

    Parameters
    ----------
    gains : array_like, shape (order + controls, order + measurements)
        [A B; C D], NaN where an entry is free.
    order : int
        Number of states.

    Returns
    -------
    FreeEntries
        The structure.
    """
    return FreeEntries(gains, order)


class Diagonal:
    """A block-diagonal controller: each part has its own measurements and controls, in turn.

    Parameters
    ----------
    parts : sequence of Structure
        At least one.
    alike : bool
        Whether the parts have the same parameters, and are about the same at a minimum: random
        searches then first vary all of them together, and let them apart at its end.

    Raises
    ------
    InputError
        If there is no part, or the parts that are to be alike differ.
    """

    def __init__(self, parts: Sequence[Structure], *, alike: bool = False) -> None:
        if not parts:
            raise InputError("a diagonal controller needs at least one part")
        self.parts, self.alike = tuple(parts), alike
        kinds = {(part.order, part.controls, part.measurements, part.size) for part in parts}
        if alike and len(kinds) > 1:
            raise InputError(
                "parts that are to be alike must have the same order, controls, measurements and "
                f"number of parameters, got {sorted(kinds)}"
            )
        self.order = sum(part.order for part in parts)
        self.controls = sum(part.controls for part in parts)
        self.measurements = sum(part.measurements for part in parts)
        self.size = sum(part.size for part in parts)
        self._places: list[tuple[Integers, Integers, slice]] = []
        state, row, column, start = 0, self.order, self.order, 0
        for part in parts:
            states = np.arange(state, state + part.order)
            self._places.append(
                (
                    np.concatenate([states, np.arange(row, row + part.controls)])[:, None],
                    np.concatenate([states, np.arange(column, column + part.measurements)]),
                    slice(start, start + part.size),
                )
            )
            state, row = state + part.order, row + part.controls
            column, start = column + part.measurements, start + part.size

    def gains(self, theta: Array) -> Array:
        """Return K."""
        made = np.zeros((self.order + self.controls, self.order + self.measurements))
        for part, (rows, columns, span) in zip(self.parts, self._places, strict=True):
            made[rows, columns] = part.gains(theta[span])
        return made

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of each part's parameters."""
        return np.concatenate(
            [
                part.pull_back(theta[span], slope[..., rows, columns])
                for part, (rows, columns, span) in zip(self.parts, self._places, strict=True)
            ],
            axis=-1,
        )

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return the typical values of the parts."""
        values, row, column = [], 0, 0
        for part in self.parts:
            u, y = sizes.controls[row:], sizes.measurements[column:]
            values.append(
                part.typical(Sizes(u[: part.controls], y[: part.measurements], sizes.rate))
            )
            row, column = row + part.controls, column + part.measurements
        return np.concatenate([m for m, _ in values]), np.concatenate([s for _, s in values])


class Alike:
    """A diagonal controller whose parts share the values of their parameters.

    Parameters
    ----------
    diagonal : Diagonal
        Its parts are of one kind.
    """

    def __init__(self, diagonal: Diagonal) -> None:
        self.diagonal, self._count = diagonal, len(diagonal.parts)
        self.order, self.size = diagonal.order, diagonal.parts[0].size
        self.controls, self.measurements = diagonal.controls, diagonal.measurements

    def apart(self, theta: Array) -> Array:
        """Return the parameters of all parts."""
        return np.tile(theta, self._count)

    def gains(self, theta: Array) -> Array:
        """Return K."""
        return self.diagonal.gains(self.apart(theta))

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes, summed over the parts."""
        slopes = self.diagonal.pull_back(self.apart(theta), slope)
        return np.asarray(slopes.reshape(*slopes.shape[:-1], self._count, self.size).sum(axis=-2))

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return the means of the parts' middles, and of the logarithms of their spreads."""
        middle, spread = self.diagonal.typical(sizes)
        shape = self._count, self.size
        return middle.reshape(shape).mean(axis=0), np.exp(
            np.log(spread).reshape(shape).mean(axis=0)
        )
