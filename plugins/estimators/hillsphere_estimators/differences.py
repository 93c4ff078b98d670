"""Differences of measured values by the kind of their channel.

Numbers are subtracted. Angles differ by less than half a turn. The difference of two directions
(unit vectors, three rows) is the position of a as seen from b: two coordinates in the plane across
b, whose length is the angle between both, and a third row that is always zero. Means are formed of
such differences from one value near all of them, so that they are right where an angle wraps.
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
    """Kinds of the rows of a measurement.

    Parameters
    ----------
    rows : int
        Number of rows, m.
    angles : tuple of int
        Rows that are angles.
    directions : tuple of int
        First rows of directions.
    blocks : tuple of slice
        Rows of each block, that is of each sensor.
    """

    rows: int
    angles: tuple[int, ...]
    directions: tuple[int, ...]
    blocks: tuple[slice, ...]

    @cached_property
    def real(self) -> NDArray[np.bool_]:
        """Whether a row of a difference can be nonzero, (m,): all but the third of a direction."""
        real = np.ones(self.rows, dtype=bool)
        real[[row + 2 for row in self.directions]] = False
        real.flags.writeable = False
        return real

    def fitting(self, shown: Array) -> Array:
        """Return the output (m, …) of a model after a check of its number of rows.

        Raises
        ------
        InputError
            If it has more or fewer rows than the measurements.
        """
        if len(shown) != self.rows:
            raise InputError(
                f"the model shows {len(shown)} rows, the measurements have {self.rows}; both must "
                "be of the same channels (NaN where nothing was measured)"
            )
        return shown

    def difference(self, a: Array, b: Array) -> Array:
        """Return the difference a − b, row by row as the module says.

        Parameters
        ----------
        a, b : ndarray, shape (m, ...)
            Values, broadcast against each other.

        Returns
        -------
        ndarray, shape (m, ...)
            Differences; the two coordinates of a direction are an angle, rad.
        """
        off = np.asarray(a - b)
        if self.angles:
            rows = list(self.angles)
            # the nearest whole number of turns
            turns = np.rint(off[rows] / (2.0 * np.pi))
            if turns.any():
                off[rows] -= 2.0 * np.pi * turns
        for row in self.directions:
            own = slice(row, row + 3)
            first, second = across(b[own])
            one, other = np.sum(first * a[own], axis=0), np.sum(second * a[own], axis=0)
            sine, cosine = np.hypot(one, other), np.sum(a[own] * b[own], axis=0)
            # the coordinates have the length sin θ: stretched to θ, by 1 for equal directions
            small = sine < 1e-30
            stretch = np.where(small, 1.0, np.arctan2(sine, cosine) / np.where(small, 1.0, sine))
            off[row], off[row + 1], off[row + 2] = one * stretch, other * stretch, 0.0
        return off

    def tangent(self, slopes: Array, at: Array) -> Array:
        """Return the derivatives of a difference from the derivatives of the values.

        Parameters
        ----------
        slopes : ndarray, shape (N, m, n)
            Derivatives of the values by n states.
        at : ndarray, shape (m, N)
            The values.

        Returns
        -------
        ndarray, shape (N, m, n)
            Derivatives of `difference` from these values, at these values.
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

    def noise(self, covariance: Array, at: Array) -> Array:
        """Return the covariances of the errors of differences from those of the values.

        Parameters
        ----------
        covariance : ndarray, shape (N, m, m)
            Covariances of the errors of the values.
        at : ndarray, shape (m, N)
            The values from which the differences are taken.

        Returns
        -------
        ndarray, shape (N, m, m)
            Covariances of the errors of `difference` from these values, to first order.
        """
        half = self.tangent(covariance, at)
        return np.swapaxes(self.tangent(np.swapaxes(half, 1, 2), at), 1, 2)


def across(direction: Array) -> tuple[Array, Array]:
    """Return two unit vectors that make a right-handed frame with a direction.

    Parameters
    ----------
    direction : ndarray, shape (3, ...)
        Unit vectors.

    Returns
    -------
    first, second : ndarray, shape (3, ...)
        Continuous but for the direction (0, 0, −1) of a negative zero [1]_, at which they jump.

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
    """Return the layout of the rows of blocks of channels."""
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
