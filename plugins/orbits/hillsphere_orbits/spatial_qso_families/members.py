"""Orbits of families in space, corrected lane by lane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.shooting import SpatialShooting

__all__ = ["CLOSED", "RETURNED", "Members", "join_members", "polish"]

CLOSED = 1e-9
"""Residual beyond which a member counts as not found."""

RETURNED = 3e-12
"""Residual at which Newton's iteration for a member stops."""

_NEWTON = 12  # evaluations


@dataclass(frozen=True)
class Members:
    """Orbits of families, with their states and matrices after half a period.

    Parameters
    ----------
    z : ndarray, shape (4, N)
        Unknowns.
    end : ndarray, shape (6, N)
        States after half a period.
    phi : ndarray, shape (6, 6, N)
        State transition matrices of half a period.
    error : ndarray, shape (N,)
        Largest residual.
    """

    z: Array
    end: Array
    phi: Array
    error: Array

    def of(self, lanes: NDArray[np.intp]) -> Members:
        """Return some of them."""
        return Members(
            self.z[:, lanes], self.end[:, lanes], self.phi[:, :, lanes], self.error[lanes]
        )

    def with_lanes(self, lanes: NDArray[np.intp], others: Members) -> Members:
        """Return a copy with other members in some lanes."""
        z, end, phi, error = (a.copy() for a in (self.z, self.end, self.phi, self.error))
        z[:, lanes], end[:, lanes] = others.z, others.end
        phi[:, :, lanes], error[lanes] = others.phi, others.error
        return Members(z, end, phi, error)

    def require_converged(self, family: NDArray[np.intp], u: Array) -> Members:
        """Return itself, or raise `LostMembersError` if a member was not found.

        Parameters
        ----------
        family, u : ndarray, shape (N,)
            Numbers of their families and positions along them.
        """
        failed = np.flatnonzero(~(self.error <= CLOSED))
        if failed.size:
            raise LostMembersError(family[failed], u[failed], self.error[failed])
        return self


def join_members(parts: Sequence[Members]) -> Members:
    """Return several sets of members as one."""
    return Members(
        *(
            np.concatenate([getattr(m, name) for m in parts], axis=-1)
            for name in ("z", "end", "phi", "error")
        )
    )


class LostMembersError(ConvergenceError):
    """Members between two others that could not be corrected.

    Parameters
    ----------
    family, u : ndarray, shape (K,)
        Numbers of their families and positions along them.
    error : ndarray, shape (K,)
        Residuals.
    """

    def __init__(self, family: NDArray[np.intp], u: Array, error: Array) -> None:
        shown = ", ".join(
            f"family {f}, position {v:.3f}" for f, v in zip(family[:5], u[:5], strict=True)
        )
        more = "" if u.size <= 5 else f" and {u.size - 5} more"
        super().__init__(
            f"member between two others: Newton's iteration did not converge for {shown}{more} "
            f"(residual {np.max(error):.1e})"
        )
        self.family, self.u = family, u

    def among(self, family: int, interval: int) -> bool:
        """Whether a lost member lies in an interval of a family."""
        return bool(np.any((self.family == family) & (np.floor(self.u) == interval)))

    def good(self, sizes: Sequence[int]) -> list[int]:
        """Return how many members of families of these sizes lie before the first one lost."""
        firsts = [self.u[self.family == f] for f in range(len(sizes))]
        return [
            min(size, int(np.floor(np.min(u))) + 1) if u.size else size
            for size, u in zip(sizes, firsts, strict=True)
        ]


def polish(
    problem: SpatialShooting, z: Array, normals: Array, points: Array, tolerance: float = RETURNED
) -> Members:
    """Correct members within planes; only those that need it are evaluated again.

    Parameters
    ----------
    problem : SpatialShooting
        Of these N lanes.
    z : ndarray, shape (4, N)
        Guesses.
    normals, points : ndarray, shape (4, N)
        normal·(z − point) = 0 is held.
    tolerance : float
        Residual at which a member is good.

    Returns
    -------
    Members
        The best iterate of each; not checked.
    """
    cases = z.shape[1]
    best, error = z.copy(), np.full(cases, np.inf)
    end, phi = np.full((6, cases), np.nan), np.full((6, 6, cases), np.nan)
    z, todo = z.copy(), np.arange(cases)
    for _ in range(_NEWTON):
        values, slopes, here, matrix = problem.of(todo).evaluate(z[:, todo])
        plane = np.sum(normals[:, todo] * (z[:, todo] - points[:, todo]), axis=0)
        # bordered by the plane's equation, which singles out one member of the curve
        values = np.concatenate([values, plane[None]])
        slopes = np.concatenate([slopes, normals[None, :, todo]])
        size = np.max(np.abs(values), axis=0)
        usable = np.isfinite(size) & np.isfinite(slopes).all(axis=(0, 1))
        before = error[todo]
        better = usable & (size < before)
        own = todo[better]
        best[:, own], error[own] = z[:, own], size[better]
        end[:, own], phi[:, :, own] = here[:, better], matrix[:, :, better]
        # Twice as good at least, or rounding is reached. Before that Newton's iteration may falter,
        # and is slow where another family branches off.
        go = (size > tolerance) & (size < 0.5 * before)
        go |= (size > CLOSED) & (size < 10.0 * before)
        go &= usable
        if not np.any(go):
            break
        # pseudo-inverse: near a bifurcation the system is almost singular
        step = np.linalg.pinv(np.moveaxis(slopes[:, :, go], 2, 0)) @ values[:, go].T[:, :, None]
        todo = todo[go]
        z[:, todo] -= step[:, :, 0].T
    return Members(best, end, phi, error)
