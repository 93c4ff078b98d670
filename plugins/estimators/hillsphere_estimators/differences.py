"""Differences of measured values by the kinds of their channels.

Numbers are subtracted. Angles differ the short way round. Of a direction (a unit vector, three
rows) the difference is where a lies as seen from b: two coordinates across b, whose length is the
angle between both, and an empty third row. Means are taken of such differences from one value
near all of them, so that they, too, are safe at the turn of an angle.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Channel

__all__ = ["Layout", "across", "layout_of"]


@dataclass(frozen=True)
class Layout:
    """Which rows of a measurement are what.

    Parameters
    ----------
    rows : int
        m.
    angles : tuple of int
        Rows that are angles.
    directions : tuple of int
        First rows of directions.
    blocks : tuple of slice
        Rows of each block.
    """

    rows: int
    angles: tuple[int, ...]
    directions: tuple[int, ...]
    blocks: tuple[slice, ...]

    @cached_property
    def real(self) -> NDArray[np.bool_]:
        """Which rows of a difference are not empty, (m,)."""
        real = np.ones(self.rows, dtype=bool)
        real[[row + 2 for row in self.directions]] = False
        real.flags.writeable = False
        return real

    def fitting(self, shown: Array) -> Array:
        """Return what a model shows (m, …), if it has the rows of the measurements.

        Raises
        ------
        InputError
            If it has more or fewer.
        """
        if len(shown) != self.rows:
            raise InputError(
                f"the model shows {len(shown)} rows, the measurements have {self.rows}; both must "
                "be of the same channels (NaN where nothing was measured)"
            )
        return shown

    def difference(self, a: Array, b: Array) -> Array:
        """Return a minus b.

        Parameters
        ----------
        a, b : ndarray, shape (m, ...)
            Values, broadcast against each other.

        Returns
        -------
        ndarray, shape (m, ...)
            As the module says.
        """
        off = np.asarray(a - b)
        if self.angles:
            rows = list(self.angles)
            turns = np.rint(off[rows] / (2.0 * np.pi))
            if turns.any():
                off[rows] -= 2.0 * np.pi * turns
        for row in self.directions:
            own = slice(row, row + 3)
            first, second = across(b[own])
            one, other = np.sum(first * a[own], axis=0), np.sum(second * a[own], axis=0)
            sine, cosine = np.hypot(one, other), np.sum(a[own] * b[own], axis=0)
            small = sine < 1e-30
            stretch = np.where(small, 1.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))
            off[row], off[row + 1], off[row + 2] = one * stretch, other * stretch, 0.0
        return off

    def tangent(self, slopes: Array, at: Array) -> Array:
        """Return derivatives of a difference from those of the values.

        Parameters
        ----------
        slopes : ndarray, shape (N, m, n)
            Derivatives of the values.
        at : ndarray, shape (m, N)
            The values.

        Returns
        -------
        ndarray, shape (N, m, n)
            Derivatives of `difference` from these values, there.
        """
        if not self.directions:
            return slopes
        flat = slopes.copy()
        for row in self.directions:
            own = slice(row, row + 3)
            first, second = across(at[own])
            flat[:, row] = np.einsum("kN,Nkn->Nn", first, slopes[:, own])
            flat[:, row + 1] = np.einsum("kN,Nkn->Nn", second, slopes[:, own])
            flat[:, row + 2] = 0.0
        return flat


def across(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors that make a right-handed frame with a direction.

    Parameters
    ----------
    direction : ndarray, shape (3, ...)
        Unit vectors.

    Returns
    -------
    first, second : ndarray, shape (3, ...)
        Without a singular place but one, at which they jump [1]_.

    References
    ----------
    .. [1] Duff et al. (2017), Building an orthonormal basis, revisited, J. Computer Graphics
       Techniques 6(1).
    """
    x, y, z = direction
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.array([1.0 + sign * x * x * a, sign * b, -sign * x])
    second = np.array([b, sign + y * y * a, -y])
    return first, second


@lru_cache(maxsize=64)
def layout_of(blocks: tuple[tuple[Channel, ...], ...]) -> Layout:
    """Return which rows are what, for the channels of each block."""
    angles, directions, slices, row = [], [], [], 0
    for block in blocks:
        start = row
        for channel in block:
            if channel.kind == "angle":
                angles.append(row)
            elif channel.kind == "direction":
                directions.append(row)
            row += channel.rows
        slices.append(slice(start, row))
    return Layout(row, tuple(angles), tuple(directions), tuple(slices))
