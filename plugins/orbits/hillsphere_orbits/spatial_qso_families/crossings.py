"""Detection of leaps from a family to another one nearby along a chain of members.

Two families that nearly meet avoid each other: each turns off along the other. A chain whose steps
are longer than the gap goes straight on and is from there on the other family's. Neither a residual
nor a turn of the tangent tells, but the sense of the equations does: det [F'; t], t along the
curve, never vanishes on a regular curve, so that it changes sign between two members only if two
families cross between them (which symmetry allows), or if they are on two that do not meet [1]_.
Which of the two it is shows when the interval is halved again and again.

References
----------
.. [1] Allgower, E. L., Georg, K., Introduction to Numerical Continuation Methods, SIAM, 2003,
   chapter 8 (bifurcation points, and how perturbation separates the curves).
"""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.family import Spatial
from hillsphere_orbits.spatial_qso_families.members import CLOSED, Members, join_members, polish

__all__ = ["count_connected"]

_HALVINGS = 12
"""Halvings of an interval in which the sense changes: to a 4096th of the distance of two members,
where families that avoid each other are told from those that cross."""


def count_connected(spatial: Spatial) -> list[int]:
    """Return how many members of each family, from the plane on, are on one curve for certain.

    An interval between two members in which the sense of the equations changes is halved, always
    on the side where it still does. Where two families cross, what is left of the chain goes
    straight through; where they avoid each other, the two members do not come together, or none
    is found between them.

    Parameters
    ----------
    spatial : Spatial
        Families, of corrected members.
    """
    good = [branch.size for branch in spatial.branches]
    rows = [(f, i) for f in range(len(good)) for i in _changes(spatial, f)]
    if not rows:
        return good
    family, first = np.array(rows, dtype=np.intp).T
    members = join_members([spatial.members[f].of(np.array([i, i + 1])) for f, i in rows])
    low, high = members.z[:, ::2], members.z[:, 1::2]
    chord = (high - low) / np.linalg.norm(high - low, axis=0)
    begin, end = first.astype(float), first + 1.0
    sense = _sense(spatial, members.of(np.arange(0, 2 * family.size, 2)), chord)
    apart = np.zeros(family.size, dtype=bool)
    # what is known beside each interval: members of the branch, and the middles one by one
    places = [np.arange(max(i - 2, 0), min(i + 4, good[f])) for f, i in rows]
    row = np.repeat(np.arange(family.size), [each.size for each in places])
    place = np.concatenate(places).astype(float)
    beside = join_members(
        [spatial.members[f].of(j) for (f, _), j in zip(rows, places, strict=True)]
    )
    for _ in range(_HALVINGS):
        # bisection on the sense: its change stays within the interval
        u = 0.5 * (begin + end)
        guess = np.concatenate(
            [spatial.branches[f].guess(u[[k]])[0] for k, f in enumerate(family)], axis=1
        )
        start = spatial.predict(np.arange(family.size), u, guess, chord, (row, place, beside))
        # only a sign is needed, which further digits do not change
        middle = polish(spatial.exact(family, u), start, chord, guess, CLOSED)
        # others may have no finite tangent
        met = np.flatnonzero(middle.error <= CLOSED)
        row, place = np.append(row, met), np.append(place, u[met])
        order = np.lexsort((place, row))
        row, place = row[order], place[order]
        beside = join_members([beside, middle.of(met)]).of(order)
        before = _sense(spatial, middle, chord) == sense
        begin, end = np.where(before, u, begin), np.where(before, end, u)
        low, high = np.where(before, middle.z, low), np.where(before, high, middle.z)
        # members of one curve approach each other along the chord; families that avoid each other
        # stay apart beside it
        ahead = np.sum(chord * (high - low), axis=0)
        aside = np.linalg.norm(high - low - ahead * chord, axis=0)
        apart |= ~(middle.error <= CLOSED) | ~(aside <= ahead)
    for f, i in zip(family[apart], first[apart], strict=True):
        good[f] = min(good[f], int(i) + 1)
    return good


def _changes(spatial: Spatial, f: int) -> list[int]:
    """Return the members of a family after which the sense of the equations changes."""
    members = spatial.members[f]
    chords = np.diff(members.z, axis=1)
    each = np.arange(members.error.size)
    pairs = [_sense(spatial, members.of(k), chords) for k in (each[:-1], each[1:])]
    return [int(i) for i in np.flatnonzero(pairs[0] != pairs[1])]


def _sense(spatial: Spatial, members: Members, along: Array) -> Array:
    """Return the sign of det [F'; t] (N,) at members, t along (4, N)."""
    slopes = spatial.problem.conditions(members.z, members.end, members.phi)[1]
    matrix = np.concatenate([slopes, along[None]])
    return np.asarray(np.sign(np.linalg.det(np.moveaxis(matrix, 2, 0))))
