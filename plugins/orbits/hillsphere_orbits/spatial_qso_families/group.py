"""Families in space that start on the same mirror, computed and described together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.crossings import count_connected
from hillsphere_orbits.spatial_qso_families.family import ALONE, Spatial, first_members
from hillsphere_orbits.spatial_qso_families.following import HALF, height
from hillsphere_orbits.spatial_qso_families.members import LostMembersError, Members
from hillsphere_orbits.spatial_qso_families.samples import Families, Samples, sample_families
from hillsphere_orbits.spatial_qso_families.shooting import SpatialShooting
from hillsphere_orbits.spatial_qso_families.stability import ReturnMaps
from hillsphere_orbits.spatial_qso_families.windows import Event, bifurcations, windows
from hillsphere_orbits.survey import Surveyor

__all__ = ["Group", "OrbitDescriptions", "join_descriptions"]

LEAPS = "another family comes near, and the orbits beyond are not on one curve with those before"
BETWEEN = "beyond, orbits between two of the family could not be computed"
_NO_FIRST = "no orbit near the plane was found"
_TRACK_POINTS = 1600
"""Sub-steps of half a track; every second state is stored."""


@dataclass(frozen=True)
class OrbitDescriptions:
    """Orbits of families with their stability and accuracy, normalised; last axis: orbits.

    Parameters
    ----------
    family : ndarray of int
        Number of the family, in the requested order.
    place : ndarray
        Position along it.
    x, period, integral, monodromy : ndarray
        Initial state, period, integral, M.
    indices, multipliers : ndarray of complex, shape (2, N), (6, N)
        Of M.
    return_index : ndarray of complex, shape (2, N)
        Of the return map N.
    return_power : ndarray of int, shape (N,)
        M is N to this power.
    stable : ndarray of bool
        Whether no multiplier lies off the unit circle.
    height : ndarray
        Amplitude.
    half, closure : ndarray
        What should vanish after half a period and after a whole one, by the other integrator; NaN
        where it was not asked.
    """

    family: NDArray[np.int64]
    place: Array
    x: Array
    period: Array
    integral: Array
    monodromy: Array
    indices: NDArray[np.complex128]
    multipliers: NDArray[np.complex128]
    return_index: NDArray[np.complex128]
    return_power: NDArray[np.int64]
    stable: NDArray[np.bool_]
    height: Array
    half: Array
    closure: Array


def join_descriptions(
    parts: Sequence[OrbitDescriptions],
) -> tuple[OrbitDescriptions, NDArray[np.intp]]:
    """Return all orbits ordered by family, those of a family as they were, and the order."""
    family = np.concatenate([part.family for part in parts])
    order = np.argsort(family, kind="stable")
    together = {
        field.name: np.concatenate([getattr(p, field.name) for p in parts], axis=-1)[..., order]
        for field in fields(OrbitDescriptions)
    }
    return OrbitDescriptions(**together), order


@dataclass(frozen=True)
class Group:
    """Families of one start.

    Parameters
    ----------
    surveyor : Surveyor
        With the other integrator.
    families : Families
        Those that could be followed.
    number : ndarray of int, shape (F,)
        Their numbers in the requested order.
    ends : mapping of int to str
        Why each family, by number, was followed no further.
    curve : OrbitDescriptions
        All orbits along them.
    events : list of Event
        Secondary bifurcations; their `family` is a number.
    events_at : OrbitDescriptions
        The orbits there.
    windows : list of (int, float, float)
        Number of the family and amplitudes of the windows of stability.
    """

    surveyor: Surveyor
    families: Families
    number: NDArray[np.int64]
    ends: dict[int, str]
    curve: OrbitDescriptions
    events: list[Event]
    events_at: OrbitDescriptions
    windows: list[tuple[int, float, float]]

    @classmethod
    def follow(
        cls,
        surveyor: Surveyor,
        problem: SpatialShooting,
        symmetries: Sequence[tuple[int, ...]],
        number: NDArray[np.int64],
        x: Array,
        period: Array,
        n: Array,
        z_max: float,
        tick: Callable[[int], None],
    ) -> Group | dict[int, str]:
        """Follow families from planar orbits x (6, M); their ends alone if none can be followed.

        Parameters
        ----------
        surveyor, problem, symmetries, number
            As for the class, and the spatial symmetries of the equations.
        x, period, n : ndarray, shape (6, M), (M,), (M,)
            See `first_members`.
        z_max : float
            Amplitude at which to end.
        tick : callable
            See `Spatial.follow`.
        """
        problem, z, exists = first_members(problem, x, period, n)
        ends = {int(k): _NO_FIRST for k in number[~exists]}
        lanes = np.flatnonzero(exists)
        if not lanes.size:
            return ends
        number = number[lanes]
        spatial = Spatial.follow(problem.of(lanes), z[:, lanes], z_max, tick)
        while True:
            whole = np.flatnonzero(spatial.whole)
            for k, branch in zip(number, spatial.branches, strict=True):
                end = branch.ends[1]
                ends[int(k)] = end if branch.size > 1 else f"{ALONE} ({end})"
            if not whole.size:
                return ends
            number, spatial = number[whole], spatial.only(whole)
            sizes = [branch.size for branch in spatial.branches]
            if (good := count_connected(spatial)) != sizes:
                spatial = spatial.cut(good, LEAPS)
                continue
            families = Families(spatial, symmetries)
            try:
                samples = sample_families(families)
                curve = _describe_orbits(
                    surveyor, spatial, number, samples.family, samples.u, samples.members,
                    samples.maps,
                )  # fmt: skip
                if not np.all(curve.half <= HALF):
                    # orbits that the other integrator does not confirm are not returned, nor any
                    # beyond
                    spatial = spatial.cut(_good(spatial, samples, curve.half))
                    continue
                events, at = bifurcations(families, samples, curve.integral)
            except LostMembersError as lost:
                spatial = spatial.cut(lost.good(sizes), BETWEEN)
                continue
            break
        events_at = _describe_orbits(
            surveyor, spatial, number, at.family, at.u, at.members, at.maps, confirmed=False
        )
        tall = np.concatenate([curve.height, events_at.height])
        return cls(
            surveyor,
            families,
            number,
            ends,
            curve,
            [Event(int(number[e.family]), e.u, e.kind, e.changes) for e in events],
            events_at,
            [
                (int(number[f]), float(tall[a]), float(tall[b]))
                for f, a, b in windows(samples, events)
            ],
        )

    def members_at(
        self, heights: Sequence[float]
    ) -> tuple[OrbitDescriptions, NDArray[np.intp], Array]:
        """Return the orbits at amplitudes, the number of each one's amplitude, and tracks.

        Parameters
        ----------
        heights : sequence of float
            Amplitudes, normalised.

        Returns
        -------
        orbits : OrbitDescriptions
            By family, amplitude and arclength.
        target : ndarray of int, shape (N,)
            Number of the amplitude.
        tracks : ndarray, shape (3, P, N)
            Positions along one period, ends included.
        """
        spatial = self.families.spatial
        family, target, u, members = spatial.members_at(heights)
        samples = self.families.samples(family, u, members)
        made = _describe_orbits(
            self.surveyor, spatial, self.number, family, u, members, samples.maps
        )
        return made, target, _tracks(spatial.problem.of(family), members.z)


def _describe_orbits(
    surveyor: Surveyor,
    spatial: Spatial,
    number: NDArray[np.int64],
    family: NDArray[np.intp],
    u: Array,
    members: Members,
    maps: ReturnMaps,
    *,
    confirmed: bool = True,
) -> OrbitDescriptions:
    problem = spatial.exact(family, u)
    x = problem.state(members.z)
    half = closure = np.full(u.size, np.nan)
    if confirmed:
        half, closure = _closures(surveyor, problem, members.z)
    return OrbitDescriptions(
        family=number[family],
        place=u,
        x=x,
        period=problem.period(members.z),
        integral=surveyor.integral(x),
        monodromy=maps.monodromy,
        indices=maps.indices**maps.power - 2.0 * (maps.power - 1),
        multipliers=maps.multipliers,
        return_index=maps.indices,
        return_power=maps.power,
        stable=maps.stable,
        height=height(problem, members.z),
        half=half,
        closure=closure,
    )


def _closures(surveyor: Surveyor, problem: SpatialShooting, z: Array) -> tuple[Array, Array]:
    """Return the largest state with sign −1 after half a period, and the closure after a whole."""
    x = problem.state(z)
    if not z.shape[1]:
        return np.empty(0), np.empty(0)
    middle = surveyor.propagate(x, z[-1])
    end = surveyor.propagate(middle, z[-1])
    odd = np.array(problem.mirror) == -1
    return np.max(np.abs(middle[odd]), axis=0), np.linalg.norm(end - x, axis=0)


def _good(spatial: Spatial, samples: Samples, half: Array) -> list[int]:
    """Return how many members of each family, from the plane on, keep half a period."""
    good = []
    for f, branch in enumerate(spatial.branches):
        bad = samples.u[(samples.family == f) & ~(half <= HALF)]
        good.append(int(np.ceil(bad[0])) if bad.size else branch.size)
    return good


def _tracks(problem: SpatialShooting, z: Array) -> Array:
    """Return normalised positions (3, P, N) along one period, ends included."""
    if not z.shape[1]:
        return np.empty((3, _TRACK_POINTS + 2, 0))
    half = problem.path(z, _TRACK_POINTS)[:, ::2]
    sign = np.array(problem.mirror, dtype=float)[:, None, None]
    # the second half is the mirror image of the first, run backwards
    return np.ascontiguousarray(np.concatenate([half, (sign * half)[:, ::-1]], axis=1)[:3])
