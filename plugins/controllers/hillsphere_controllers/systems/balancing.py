"""Balancing: scaling of a system's states, so that its entries are of similar size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem

__all__ = ["balance_states"]

_SWEEPS = 20
"""Sweeps over the states at most. Each sweep brings the norms of rows and columns closer; the limit
ends sweeps that only undo each other."""
_GAIN = 0.95
"""A scale is changed only if the sum of the squares of both norms falls below this share, as in
[1]_ of `balance_states`; a value nearer to one costs sweeps that gain nothing."""
_LARGEST = 1e150
"""Size of an entry whose square, and its inverse, still lie within the range of double precision
(1e±308)."""


def balance_states(system: LtiSystem, tolerated: float = 2.0) -> tuple[LtiSystem, Array]:
    """Scale the states by powers of two.

    Row and column of each state in [[A, B], [C, 0]], the diagonal left out, come to have about the
    same norm [1]_. The transfer function keeps all its digits, since powers of two round nothing.

    Parameters
    ----------
    system : LtiSystem
        Of order n.
    tolerated : float
        Nothing is scaled if no norm of a row is larger or smaller than that of its column by this
        factor, from two on.

    Returns
    -------
    system : LtiSystem
        The same with states x/scale.
    scale : ndarray, shape (n,)
        Powers of two.

    Raises
    ------
    InputError
        If the largest entry of A, B or C is above 1e150 or below 1e-150, but for zeros.

    References
    ----------
    .. [1] B. N. Parlett, C. Reinsch (1969), Balancing a matrix for calculation of eigenvalues and
       eigenvectors, Numerische Mathematik 13, 293-304.
    """
    n = system.order
    for name, matrix in (("A", system.a), ("B", system.b), ("C", system.c)):
        size = float(np.abs(matrix).max(initial=0.0))
        if size > _LARGEST or 0.0 < size < 1.0 / _LARGEST:
            raise InputError(
                f"{name} has the size {size:.3g}, whose square is no number: scale inputs, outputs "
                "and time"
            )
    a2, scale = system.a * system.a, np.ones(n)
    a2.flat[:: n + 1] = 0.0
    # squares of the norms that B and C add to rows and columns
    b2, c2 = np.sum(system.b**2, axis=1), np.sum(system.c**2, axis=0)
    rows, columns = a2.sum(axis=1) + b2, a2.sum(axis=0) + c2
    # of norms within a factor of two the nearest power of two is one
    ratio = tolerated**2
    if ((rows < ratio * columns) & (columns < ratio * rows)).all():
        return system, scale
    for _ in range(_SWEEPS):
        if not _uneven(a2.sum(axis=1) + b2, a2.sum(axis=0) + c2).any():
            break
        settled = True
        for i in range(n):
            row, column = float(a2[i].sum() + b2[i]), float(a2[:, i].sum() + c2[i])
            if row == 0.0 or column == 0.0:
                continue
            # the power of two nearest to what makes both norms the same
            power = 2.0 ** round(0.25 * np.log2(row / column))
            if power == 1.0:
                continue
            square = power * power
            if row / square + column * square < _GAIN * (row + column):
                settled = False
                scale[i] *= power
                a2[i] /= square
                a2[:, i] *= square
                b2[i] /= square
                c2[i] *= square
        if settled:
            break
    return (
        replace(
            system, a=system.a / scale[:, None] * scale, b=system.b / scale[:, None],
            c=system.c * scale,
        ),
        scale,
    )  # fmt: skip


def _uneven(rows: Array, columns: Array) -> NDArray[np.bool_]:
    """Return which states (n,) are worth another scale, of squares of their rows and columns."""
    known = (rows > 0.0) & (columns > 0.0)
    ratio = np.where(known, rows, 1.0) / np.where(known, columns, 1.0)
    square = 4.0 ** np.round(0.25 * np.log2(ratio))
    return np.asarray(known & (rows / square + columns * square < _GAIN * (rows + columns)))
