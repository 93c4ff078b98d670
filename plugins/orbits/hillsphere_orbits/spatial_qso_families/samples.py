"""Samples along families, dense enough to resolve every change of stability.

Between neighbouring members a spline through the index says where it may come near an edge of
stability; an orbit is computed there, and by how much the spline erred says how far it can be
trusted in the two parts. That goes on until no part of a family can hide a pair of roots.

The index is that of the return map N (see `hillsphere_orbits.spatial_qso_families.stability`):
where M = N², c = ±2 both are λ = 1, and c = 0 is λ = −1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.family import Spatial
from hillsphere_orbits.spatial_qso_families.members import RETURNED, Members, join_members
from hillsphere_orbits.spatial_qso_families.stability import (
    CIRCLE,
    ReturnMaps,
    return_maps,
    return_symmetry,
)

__all__ = ["Families", "Samples", "sample_families"]

_NEAR = 6.0  # index up to which an interval is looked into in any case
_PASSES = 9
"""Most rounds of new samples. Each about halves the intervals in doubt, so that the last ones reach
the narrowest interval (`_NARROW`), a 2⁻¹⁰th."""
_TRUST = 2.0  # times the last error of the spline
_FINE = 1e-7  # error of the spline below which it is as good as the index itself
_NARROW = 1e-3  # width of an interval, in distances of two members of the branch
_LOOKS = np.linspace(0.0, 1.0, 33)[1:-1]


@dataclass(frozen=True)
class Samples:
    """Members of families with their return maps, ordered by family and position.

    Parameters
    ----------
    family : ndarray of int, shape (K,)
        Number of the family.
    u : ndarray, shape (K,)
        Position on its branch.
    members : Members
        The members.
    maps : ReturnMaps
        Theirs.
    """

    family: NDArray[np.intp]
    u: Array
    members: Members
    maps: ReturnMaps

    def guess(self, family: NDArray[np.intp], u: Array) -> Array:
        """Return unknowns (4, K) at positions, by splines through the samples."""
        z = np.empty((len(self.members.z), u.size))
        for f in np.unique(family):
            own = self.family == f
            wanted = family == f
            z[:, wanted] = CubicSpline(self.u[own], self.members.z[:, own], axis=1)(u[wanted])
        return z

    def rows(self, own: NDArray[np.intp]) -> list[tuple[str, Array, tuple[float, ...]]]:
        """Return (name, values, edges) of the smooth functions that decide on stability.

        With a second pair 1, 1 it is the other index, else the characteristic polynomial at the
        edges, the product of both indices' distances, and the discriminant.
        """
        c = self.maps.indices[:, own]
        edges = (-2.0 - CIRCLE, 2.0 + CIRCLE)
        middle = (0.0,) if self.maps.power[own[0]] == 2 else ()
        neutral = self.maps.neutral[own]
        if bool(np.all(neutral)):
            return [("index", c[0].real, (*edges, *middle))]
        rows: list[tuple[str, Array, tuple[float, ...]]] = [
            ("index", np.where(neutral, c[0].real, np.nan), edges),
            ("krein", ((c[0] - c[1]) ** 2).real, (0.0,)),
        ]
        for edge in (*edges, *middle):
            values = ((edge - c[0]) * (edge - c[1])).real
            # beside a pair 1, 1 the other index alone counts
            values = np.where(neutral & (edge > 0.0), np.nan, values)
            rows.append((f"{edge:.0f}", values, (0.0,)))
        return rows


class Families:
    """Families with their symmetries: makes samples of members.

    Parameters
    ----------
    spatial : Spatial
        The families.
    symmetries : sequence of tuple of int
        Spatial symmetries of the equations, see `kernel.symmetries_of`.
    """

    def __init__(self, spatial: Spatial, symmetries: Sequence[tuple[int, ...]]) -> None:
        self.spatial = spatial
        self.signs = np.zeros((6, len(spatial.branches)), dtype=np.int64)
        for f, members in enumerate(spatial.members):
            if members.z.shape[1]:
                start = spatial.problem.state(members.z[:, :1])[:, 0]
                self.signs[:, f] = return_symmetry(start, members.end[:, 0], symmetries)

    def samples(self, family: NDArray[np.intp], u: Array, members: Members) -> Samples:
        """Return members (K,) of families at positions as samples."""
        mirror = self.spatial.problem.mirror
        return Samples(family, u, members, return_maps(members.phi, self.signs[:, family], mirror))

    def at(
        self, samples: Samples, family: NDArray[np.intp], u: Array, tolerance: float = RETURNED
    ) -> Samples:
        """Return orbits at positions between samples that are known."""
        guess = samples.guess(family, u)
        known = samples.family, samples.u, samples.members
        return self.samples(family, u, self.spatial.at(family, u, guess, tolerance, known))

    def merge(self, a: Samples, b: Samples) -> Samples:
        """Return both, ordered by family and position."""
        family, u = np.concatenate([a.family, b.family]), np.concatenate([a.u, b.u])
        order = np.lexsort((u, family))
        return self.samples(family[order], u[order], join_members([a.members, b.members]).of(order))


def sample_families(families: Families) -> Samples:
    """Return all members of the branches, and more where stability may change between them."""
    spatial = families.spatial
    family, u = spatial.positions
    samples = families.samples(family, u, join_members(spatial.members))
    errors: dict[tuple[int, str], tuple[Array, Array]] = {}
    for _ in range(_PASSES):
        wanted = [
            (f, place)
            for f in range(len(spatial.branches))
            if spatial.branches[f].size >= 4
            for place in _places(samples, f, errors)
        ]
        if not wanted:
            break
        more_family = np.array([f for f, _ in wanted], dtype=np.intp)
        more_u = np.array([place for _, place in wanted])
        more = families.at(samples, more_family, more_u)
        merged = families.merge(samples, more)
        _learn(samples, merged, more_family, more_u, errors)
        samples = merged
    return samples


def _places(
    samples: Samples, f: int, errors: dict[tuple[int, str], tuple[Array, Array]]
) -> list[float]:
    """Return the positions at which a family needs further samples."""
    own = np.flatnonzero(samples.family == f)
    u = samples.u[own]
    places: dict[int, float] = {}
    for name, values, edges in samples.rows(own):
        known = np.isfinite(values)
        if np.count_nonzero(known) < 4:
            continue
        # arsinh tames indices that grow exponentially and keeps the sign of small ones
        curve = CubicSpline(u[known], np.arcsinh(values[known]))
        middles, last = errors.get((f, name), (np.empty(0), np.empty(0)))
        for i in range(u.size - 1):
            width = u[i + 1] - u[i]
            if i in places or not (known[i] and known[i + 1]) or width < _NARROW:
                continue
            look = u[i] + width * _LOOKS
            seen = curve(look)
            looked = np.flatnonzero((middles >= u[i]) & (middles <= u[i + 1]))
            if not looked.size:
                # never tried: in the neighbourhood of the edges every interval is
                if np.min(np.abs(seen)) < np.arcsinh(_NEAR):
                    places[i] = u[i] + 0.5 * width
                continue
            error = float(last[looked[-1]])
            if error < _FINE:
                continue
            # the error of a spline falls to zero at its samples: a parabola bounds it in between
            doubt = _TRUST * error * 4.0 * _LOOKS * (1.0 - _LOOKS)
            ends = np.arcsinh(values[[i, i + 1]])
            for edge in np.arcsinh(edges):
                side = np.sign(ends - edge)
                passes = seen - edge
                if side[0] == side[1]:
                    hidden = side[0] * passes < doubt
                else:
                    # one root is known of; two more would make the spline turn
                    slope = curve(look, 1)
                    hidden = (np.abs(passes) < doubt) & (slope * (ends[1] - ends[0]) < 0.0)
                if np.any(hidden):
                    at = int(np.argmin(np.where(hidden, side[0] * passes - doubt, np.inf)))
                    places[i] = float(
                        np.clip(look[at], u[i] + 0.05 * width, u[i + 1] - 0.05 * width)
                    )
                    break
    return list(places.values())


def _learn(
    before: Samples,
    after: Samples,
    family: NDArray[np.intp],
    u: Array,
    errors: dict[tuple[int, str], tuple[Array, Array]],
) -> None:
    """Record the error of the old spline at the positions of new samples."""
    for f in np.unique(family):
        old, new = (np.flatnonzero(s.family == f) for s in (before, after))
        fresh = np.isin(after.u[new], u[family == f])
        truth = {name: values[fresh] for name, values, _ in after.rows(new)}
        for name, values, _ in before.rows(old):
            known = np.isfinite(values)
            if np.count_nonzero(known) < 4 or name not in truth:
                continue
            curve = CubicSpline(before.u[old][known], np.arcsinh(values[known]))
            at = after.u[new][fresh]
            error = np.abs(curve(at) - np.arcsinh(truth[name]))
            error = np.where(np.isfinite(error), error, 1.0)
            places, last = errors.get((int(f), name), (np.empty(0), np.empty(0)))
            errors[int(f), name] = (np.concatenate([places, at]), np.concatenate([last, error]))
