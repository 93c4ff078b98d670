"""Winding numbers of orbits about the bodies, which identify their family.

A solution of the shooting equations is periodic, but need not be of the family that was meant:
Newton's iteration also ends on orbits about the other body, on equilibria, and on flights of no
duration. The winding number about a body cannot change along a family without a collision, so that
it tells families apart without a tolerance.

References
----------
.. [1] Hénon, M., Generating Families in the Restricted Three-Body Problem, Springer, 1997,
   section 2.3 (classes of symmetric orbits by how they pass the two bodies).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.continuation import Boundary
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.survey import LockedMoon, TruePrimary

__all__ = [
    "Winding",
    "primary_distance",
    "require_motion",
    "require_smooth",
    "resolution",
    "sensitivity",
    "turns",
]

_MOST_STEPS = 1 << 11
"""Sub-steps of half a period with which orbits are still followed. One residual of so many costs a
tenth of a second, and a family needs some thousand of them."""
_PER_STEP = 0.25
"""Longest sub-step, in units of √(d³/GM) at a distance d from a body. A circle at that distance
has 25 such steps, for which the error of the eighth-order map is about 1e-12."""
_SENSITIVE = 1e-12 / float(np.finfo(float).eps)
"""Largest element of the matrix of the flight that is solved: rounding grows to what Newton's
iteration is to meet, so that members beyond could not be told from their neighbours."""
_SAME_MOTION = 1e-8
"""Largest distance from its start, relative to its size, of an equilibrium or vanishing orbit:
Newton's iteration meets these to 1e-12, and the smallest orbits that are followed are 1e-4."""
_LOOKS = 256  # of a period: neighbouring directions of a resolved orbit are less than π apart
_WHOLE = 0.1  # revolutions: a closed orbit winds a whole number of times, but for rounding
_JUMP = 5.0
"""Largest change of a stability index between neighbours, in terms of the changes beside it: where
two families meet an index may turn sharply, but a jump of one interval alone is another orbit."""
_SMALL_JUMP = 0.5  # of an index and of its size: neighbours that differ by less are never refused


def primary_distance(plant: Plant) -> float | None:
    """Return the distance of the primary in units of length; None where it is not in the equations.

    The primary of a locked moon rests at x = −distance in the moon's frame.
    """
    if isinstance(plant, LockedMoon) and isinstance(plant, TruePrimary):
        return plant.primary_distance_m / plant.scales.length_m
    return None


def turns(way: Array, x: float = 0.0) -> Array:
    """Return how often trajectories wind about a point of the x axis, seen along z.

    Parameters
    ----------
    way : ndarray, shape (n, P, N)
        States along each trajectory, positions first, ends included.
    x : float
        Where the point is.

    Returns
    -------
    ndarray, shape (N,)
        Revolutions, positive in the sense from +x to +y.
    """
    # the unwrapped angle grows by 2π with each turn; samples must be less than π apart
    angle = np.unwrap(np.arctan2(way[1], way[0] - x), axis=0)
    return np.asarray((angle[-1] - angle[0]) / (2.0 * np.pi))


@dataclass(frozen=True)
class Winding:
    """How often orbits of a family wind about the body, and about the primary.

    Parameters
    ----------
    body : int
        Revolutions about the origin per period; negative is retrograde.
    primary : int
        About the primary, seen in the rotating frame.
    distance : float or None
        Of the primary at negative x, normalised; None where the equations have none.
    """

    body: int
    primary: int
    distance: float | None

    def fits(self, problem: Shooting, z: Array) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Whether the orbits (m, N) wind so, (N,)."""
        way = _whole_way(problem, z)
        good = np.abs(turns(way) - self.body) < _WHOLE
        if self.distance is not None:
            good &= np.abs(turns(way, -self.distance) - self.primary) < _WHOLE
        return np.asarray(good)

    def require(self, problem: Shooting, z: Array, unit_m: float, what: str, remedy: str) -> None:
        """Raise `ConvergenceError` unless all the orbits (m, N) wind so.

        Parameters
        ----------
        problem : Shooting
            The equations.
        z : ndarray, shape (m, N)
            Orbits that solve them.
        unit_m : float
            Unit of length, m.
        what, remedy : str
            The family's name and what to do, for the message.
        """
        bad = np.flatnonzero(~self.fits(problem, z))
        if not bad.size:
            return
        way = _whole_way(problem, z[:, bad[:1]])
        about = f"{turns(way)[0]:.2f} times about the body"
        if self.distance is not None:
            about += f" and {turns(way, -self.distance)[0]:.2f} times about its primary"
        x_km = float(problem.state(z)[0, bad[0]]) * unit_m / 1e3
        raise ConvergenceError(
            f"the orbit found at x = {x_km:.6g} km is no {what}: it winds {about} per period, "
            f"where {self.body}"
            + (f" and {self.primary} are" if self.distance is not None else " is")
            + f" expected; {remedy}"
        )


def require_motion(problem: Shooting, z: Array, unit_m: float) -> None:
    """Raise `ConvergenceError` if one of the orbits (m, N) is an equilibrium or has no period."""
    way = _whole_way(problem, z)[:3]
    # largest distance from the start: zero along an equilibrium and over a period of zero
    away = np.max(np.linalg.norm(way - way[:, :1], axis=0), axis=0)
    size = np.maximum(np.linalg.norm(way[:, 0], axis=0), np.finfo(float).tiny)
    bad = np.flatnonzero(~((away > _SAME_MOTION * size) & (problem.period(z) > 0.0)))
    if bad.size:
        x_km = float(way[0, 0, bad[0]]) * unit_m / 1e3
        raise ConvergenceError(
            f"what was found at x = {x_km:.6g} km is no orbit: over its period of "
            f"{problem.period(z)[bad[0]]:.3g} natural units it moves "
            f"{away[bad[0]] * unit_m:.3g} m, which is an equilibrium or a flight of no duration; "
            "give a guess nearer to the orbit, or another amplitude"
        )


def require_smooth(indices: Array, x: Array, unit_m: float) -> None:
    """Raise `ConvergenceError` if a stability index jumps along a family.

    Parameters
    ----------
    indices : ndarray, shape (2, K)
        Of neighbouring members; NaN where they are complex.
    x : ndarray, shape (K,)
        What the members are named by, normalised.
    unit_m : float
        Unit of length, m.
    """
    # arsinh: relative changes of large indices, absolute ones of small indices
    for name, row in zip(("first", "second"), np.arcsinh(indices), strict=True):
        change = np.abs(np.diff(row))
        if change.size < 3:
            continue
        # the larger change of the two intervals beside each one
        padded = np.concatenate([change[1:2], change, change[-2:-1]])
        beside = np.fmax(padded[:-2], padded[2:])
        jumps = np.flatnonzero((change > _SMALL_JUMP) & (change > _JUMP * beside))
        if jumps.size:
            i = int(jumps[0])
            a, b = x[[i, i + 1]] * unit_m / 1e3
            raise ConvergenceError(
                f"the {name} stability index jumps from {np.sinh(row[i]):.6g} to "
                f"{np.sinh(row[i + 1]):.6g} between x = {a:.6g} km and {b:.6g} km: the orbits "
                "there belong to two families, or the curve has too few members; raise "
                "curve_members, or end the range of amplitudes before that place"
            )


def resolution(problem: Shooting, plant: Plant) -> Boundary:
    """Return the boundary at which a close passage needs more sub-steps than are taken.

    The sub-steps of an orbit are equal, so that the closest approach decides how many it needs: a
    quarter of √(d³/GM) each. The last orbit of the family that is resolved is the one that needs
    2048 of them for half a period.

    Parameters
    ----------
    problem : Shooting
        The equations.
    plant : Plant
        Where the primary is, if the equations have it at its true distance.

    Returns
    -------
    Boundary
        Positive where 2048 sub-steps suffice.
    """
    distance = primary_distance(plant)

    def room(z: Array) -> Array:
        way = _whole_way(problem, z)[:3]
        slow = _slowness(way, 0.0, 1.0)
        if distance is not None:
            # n² a³ = GM + Gm, which is distance³ in units in which n and Gm are one
            slow = np.minimum(slow, _slowness(way, -distance, distance**3 - 1.0))
        # sub-steps of half a period if the shortest local time scale √(d³/GM) sets all of them
        needed = 0.5 * problem.period(z) / (_PER_STEP * slow)
        return np.asarray(1.0 - needed / _MOST_STEPS)

    return Boundary(
        f"the next orbits pass so near to a body that {_MOST_STEPS} sub-steps of half a period no "
        "longer resolve them",
        room,
    )


def sensitivity(problem: Shooting, size: float = 1.0) -> Boundary:
    """Return the boundary at which rounding grows to Newton's tolerance over the flight.

    Parameters
    ----------
    problem : Shooting
        The equations.
    size : float
        Of the states at the end of the flight, by which their rounding is larger.
    """

    def calm(z: Array) -> Array:
        matrix = problem.flow.with_matrix(problem.state(z), z[-1], problem.steps)[1]
        return np.asarray(1.0 - np.max(np.abs(matrix), axis=(0, 1)) * size / _SENSITIVE)

    return Boundary("the orbit is too sensitive to be computed", calm)


def _slowness(way: Array, x: float, gm: float) -> Array:
    """Return the least √(d³/GM) along trajectories (3, P, N) about a body on the x axis, (N,)."""
    d2 = (way[0] - x) ** 2 + way[1] ** 2 + way[2] ** 2
    return np.asarray((_least_squared(d2) ** 1.5 / gm) ** 0.5)


def _least_squared(d2: Array) -> Array:
    """Return the least value of each column (P, N) of squared distances on closed curves.

    Near a pericentre d² is a parabola of time; its vertex through three samples keeps the value
    smooth from one orbit to the next.
    """
    points, lane = d2.shape[0] - 1, np.arange(d2.shape[1])
    i = np.argmin(d2[:-1], axis=0)
    here, before, after = d2[i, lane], d2[(i - 1) % points, lane], d2[(i + 1) % points, lane]
    # second and first difference of the parabola through the least sample and its neighbours
    bend, slope = before - 2.0 * here + after, 0.5 * (after - before)
    vertex = here - 0.5 * slope**2 / np.where(bend > 0.0, bend, np.inf)
    # of a sharp passage the parabola may miss the depth, but not by more than the samples' own
    return np.asarray(np.maximum(vertex, 0.25 * here))


def _whole_way(problem: Shooting, z: Array) -> Array:
    """Return states (n, P, N) along a whole period, by at least `_LOOKS` sub-steps."""
    steps = max(2 * problem.steps, _LOOKS)
    return problem.flow.trajectory(problem.state(z), problem.period(z), steps)
