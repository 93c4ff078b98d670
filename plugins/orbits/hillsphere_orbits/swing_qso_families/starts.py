"""First members of all families that leave a planar resonance, each family once.

An orbit with a mirror crosses its axis perpendicularly twice per period, and an equation with more
symmetry has more such crossings of the same orbit (or of its image after half a turn). So the
families are enumerated by the crossings that they can start from (axis, side, and sense along the
kernel), and every first member strikes out the others that it owns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import Crossing
from hillsphere.errors import PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.correction import correct, tangents
from hillsphere_orbits.flow import XY_MIRROR, Z_HALF_TURN, Flow
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.swing_qso_families.branching import BranchPoint, branch_point, first_members
from hillsphere_orbits.swing_qso_families.curves import AXES, swing_problem

__all__ = ["Start", "Symmetries", "starts_at"]

_STEPS_PER_REVOLUTION = 64  # enough near a bifurcation; chains choose their own
_PERPENDICULAR = 1e-6
"""Normalised components below which a crossing of an axis is perpendicular. Corrected orbits come
to 1e-10, orbits without the symmetry differ by the 4e-3 or more that first members lie off."""
_NUDGE = 1e-5
"""Step of the central differences, normalised: their own error is its square, 1e-10, and that of
the located crossings, about 1e-13, grows to 1e-8 by the division."""
_SAME = 0.25  # of π/n, the angle between the rays of two families: nearer members are one

_Key = tuple[str, int, int]


@dataclass(frozen=True)
class Symmetries:
    """Which symmetries the equations of motion have.

    Parameters
    ----------
    axes : tuple of str
        Axes of mirrors with time reversal: ``"x"``, ``"y"``.
    half_turn : bool
        Whether half a turn about z changes nothing.
    plane : bool
        Whether the plane z = 0 is a mirror: there are planar orbits then.
    """

    axes: tuple[str, ...]
    half_turn: bool
    plane: bool

    @classmethod
    def of(cls, flow: Flow, samples: Array) -> Symmetries:
        """Try all symmetries at sample states (6, K)."""
        mirrors = flow.system.mirrors
        return cls(
            tuple(
                axis
                for axis, plane in AXES.items()
                if plane in mirrors and flow.keeps(mirrors[plane], samples, reverses_time=True)
            ),
            flow.keeps(Z_HALF_TURN, samples, reverses_time=False),
            flow.keeps(XY_MIRROR, samples, reverses_time=False),
        )


@dataclass(frozen=True)
class Start:
    """First member of a family.

    Parameters
    ----------
    d, n : int
        Resonance.
    axis : str
        See `SwingFamilies.axis`.
    direction : int
        +1 outwards along the kernel, −1 inwards.
    symmetry : str
        ``"x"``, ``"y"``, ``"xy"`` or ``"none"``.
    parent : int
        Family that it branches off; −1 for that of one revolution.
    origin : ndarray, shape (m,)
        The bifurcating orbit, in the unknowns of the family's problem.
    z : ndarray, shape (m,)
        The first member.
    """

    d: int
    n: int
    axis: str
    direction: int
    symmetry: str
    parent: int
    origin: Array
    z: Array

    @property
    def name(self) -> str:
        """Name of the family, see `SwingFamilies.name`."""
        kind = "asymmetric " if self.symmetry == "none" else ""
        born = " broken" if self.parent >= 0 and not kind else ""
        return f"{self.d}:{self.n} {kind}{self.axis}{'+' if self.direction > 0 else '−'}{born}"


def starts_at(
    flow: Flow, symmetries: Symmetries, x: Array, period: float, d: int, n: int
) -> tuple[list[Start], list[str]]:
    """Return first members of all families of n revolutions at a planar resonance.

    Parameters
    ----------
    flow : Flow
        Equations of motion, normalised.
    symmetries : Symmetries
        Of the equations.
    x : ndarray, shape (6,)
        The bifurcating orbit where it crosses the x axis, normalised.
    period : float
        Its period, of one revolution.
    d, n : int
        Resonance.

    Returns
    -------
    starts : list of Start
        One per family; images under half a turn are the same family.
    notes : list of str
        Branches that were expected and not found.
    """
    if not symmetries.axes:
        return _without_mirror(flow, symmetries, x, period, d, n)
    points = {
        (axis, side): _Crossing.of(flow, axis, state, period, n)
        for axis in symmetries.axes
        for side, state in enumerate(_crossings(flow, symmetries, axis, x, period))
    }
    seen: set[_Key] = set()
    lost: list[_Key] = []
    starts: list[Start] = []
    for (axis, side), crossing in points.items():
        z, exists = first_members(crossing.problem, crossing.point, crossing.apart)
        for k in np.argsort(-crossing.senses, kind="stable"):
            key = (axis, side, int(crossing.senses[k]))
            if key in seen:
                continue
            if not exists[k]:
                lost.append(key)
                continue
            own, symmetry = _equivalent_starts(flow, symmetries, points, axis, z[:, k])
            seen |= {key, *own}
            starts.append(Start(d, n, axis, key[2], symmetry, -1, crossing.point.z, z[:, k]))
    notes = [
        f"{d}:{n}: no orbit was found that leaves the {axis} axis "
        f"{'outwards' if sense > 0 else 'inwards'}"
        for axis, side, sense in lost
        if (axis, side, sense) not in seen
    ]
    return starts, notes


@dataclass(frozen=True)
class _Crossing:
    """A perpendicular crossing of the bifurcating orbit, with the shooting problem from there."""

    problem: Shooting
    point: BranchPoint
    n: int
    sign: float

    @classmethod
    def of(
        cls, flow: Flow, axis: str, state: Array, period: float, n: int, *, mirror: bool = True
    ) -> _Crossing:
        once = swing_problem(flow, axis, mirror=mirror).with_steps(_STEPS_PER_REVOLUTION)
        z = once.unknowns_at(state[:, None], np.array([period]))
        if mirror:
            z = correct(once, z).z  # the crossing of a mirror's axis is exact now
        line = tangents(once, z)[:, 0]
        z, line = z[:, 0].copy(), line.copy()
        z[-1], line[-1] = n * z[-1], n * line[-1]
        problem = once.with_steps(_STEPS_PER_REVOLUTION * n)
        return cls(problem, branch_point(problem, z, line), n, float(np.sign(z[0])))

    @property
    def senses(self) -> Array:
        """+1 for each direction that leads outwards along the axis, else −1, (K,)."""
        return self.sense(self.point.directions)

    def sense(self, change: Array) -> Array:
        """Return the senses of changes (m, N) of the unknowns, along the kernel."""
        kernel = self.point.kernel[:-1, 0]
        outwards = np.sign(self.sign * kernel[0]) or 1.0
        return np.asarray(np.where(outwards * (kernel @ change[:-1]) < 0.0, -1, 1))

    def apart(self, z: Array) -> Array:
        """How far orbits are from closing after one revolution."""
        x, period = self.problem.state(z), self.problem.period(z)
        end = self.problem.flow.with_matrix(x, period / self.n, 2 * _STEPS_PER_REVOLUTION)[0]
        return np.asarray(np.linalg.norm(end - x, axis=0))


def _crossings(
    flow: Flow, symmetries: Symmetries, axis: str, x: Array, period: float
) -> list[Array]:
    """Return the states of the planar orbit on an axis; one side where half a turn swaps them."""
    steps = 2 * _STEPS_PER_REVOLUTION
    start = x[:, None]
    if axis == "y":
        start = _crossing_states(
            flow.map.locate(flow.system.x[0], start, period, steps, direction=0)
        )
    if symmetries.half_turn:
        return [start[:, 0]]
    other = flow.with_matrix(start, np.array([0.5 * period]), steps)[0]
    return [start[:, 0], other[:, 0]]


def _equivalent_starts(
    flow: Flow,
    symmetries: Symmetries,
    points: dict[tuple[str, int], _Crossing],
    axis: str,
    z: Array,
) -> tuple[set[_Key], str]:
    """Return all starts that yield this orbit or its mirror image, and its symmetry."""
    problem = points[(axis, 0)].problem
    x, period = problem.state(z[:, None]), problem.period(z[:, None])
    quarters = [x]
    for _ in range(3):
        quarters.append(flow.with_matrix(quarters[-1], 0.25 * period, problem.steps)[0])
    states = [(axis, quarters[0]), (axis, quarters[2])]
    kept = axis
    for other in set(symmetries.axes) - {axis}:
        odd = np.array(flow.system.mirrors[AXES[other]]) == -1
        if float(np.max(np.abs(quarters[1][odd]))) < _PERPENDICULAR:
            states += [(other, quarters[1]), (other, quarters[3])]
            kept = "xy"
    own: set[_Key] = set()
    for name, state in states:
        place = 0 if name == "x" else 1
        side = 0 if points[(name, 0)].sign * state[place, 0] > 0.0 else 1
        if side and symmetries.half_turn:
            state, side = np.array(Z_HALF_TURN)[:, None] * state, 0
        crossing = points[(name, side)]
        there = crossing.problem.unknowns_at(state, period)
        sense = crossing.sense(there - crossing.point.z[:, None])
        own.add((name, side, int(sense[0])))
    return own, kept


def _without_mirror(
    flow: Flow, symmetries: Symmetries, x: Array, period: float, d: int, n: int
) -> tuple[list[Start], list[str]]:
    """Return the families at a resonance of equations that keep no mirror.

    In the coordinate ζ in which one revolution is a turn by 2π d/n, the n points of an orbit lie
    2π/n apart: members with the same angle modulo 2π/n, or with that of an image under half a
    turn, are of one family.
    """
    crossing = _Crossing.of(flow, "x", x, period, n, mirror=False)
    point = crossing.point
    if point.kernel.shape[1] != 2:
        return [], [f"{d}:{n}: the map of {n} revolutions has no kernel of two directions there"]
    normal = _normal_coordinate(flow, crossing)
    z, exists = first_members(crossing.problem, point, crossing.apart)
    starts: list[Start] = []
    angles: list[float] = []
    for k in np.flatnonzero(exists):
        own = [float(np.angle(normal @ (z[:, k] - point.z)))]
        if symmetries.half_turn:
            image = np.array(Z_HALF_TURN)[:, None] * crossing.problem.state(z[:, [k]])
            there = _next_crossing(flow, crossing, image, 0.2)
            own.append(float(np.angle(normal @ (there - point.z))))
        apart = [_circular(new - old, 2.0 * np.pi / n) for new in own for old in angles]
        if min(apart, default=np.inf) < _SAME * np.pi / n:
            continue
        angles += own
        direction = int(crossing.sense(z[:, [k]] - point.z[:, None])[0])
        starts.append(Start(d, n, "x", direction, "none", -1, point.z, z[:, k]))
    if len(starts) == 2:
        return starts, []
    return starts, [f"{d}:{n}: {len(starts)} families were found without a mirror, not 2"]


def _circular(angle: float, period: float) -> float:
    """Return the distance of an angle from the nearest multiple of a period."""
    return abs((angle + 0.5 * period) % period - 0.5 * period)


def _next_crossing(flow: Flow, crossing: _Crossing, x: Array, after: float) -> Array:
    """Return the unknowns (m,) where an orbit next meets the section as the first one does."""
    whole = crossing.point.z[-1]
    turn = np.array([whole / crossing.n])
    fall = crossing.problem.state(crossing.point.z[:, None])[4, 0]
    met = flow.map.locate(
        flow.system.x[1], x, 1.5 * turn, 3 * _STEPS_PER_REVOLUTION,
        direction=-1 if fall < 0.0 else 1, after=after * turn,
    )  # fmt: skip
    return crossing.problem.unknowns_at(_crossing_states(met), np.array([whole]))[:, 0]


def _crossing_states(crossing: Crossing) -> Array:
    """Return the states of crossings.

    Whether an earlier one is excluded does not matter: these orbits meet an axis twice a turn, and
    orbits that start there are corrected until they cross perpendicularly and close.

    Raises
    ------
    PropagationError
        If an orbit does not meet the axis.
    """
    if not np.all(crossing.found):
        raise PropagationError("an orbit beside the bifurcation does not meet the axis in time")
    return crossing.x


def _normal_coordinate(flow: Flow, crossing: _Crossing) -> NDArray[np.complex128]:
    """Return the row (m,) that maps changes of the unknowns to ζ, which one revolution turns."""
    point = crossing.point
    basis = np.concatenate([point.tangent[:, None], point.kernel], axis=1)
    dual = np.linalg.pinv(basis)[1:]  # changes → coordinates along the kernel
    columns = []
    for way in point.kernel.T:
        ends = [
            _next_crossing(
                flow, crossing, crossing.problem.state((point.z + h * way)[:, None]), 0.6
            )
            for h in (_NUDGE, -_NUDGE)
        ]
        # central difference of the map of one revolution, in coordinates of the kernel
        columns.append(dual @ (ends[0] - ends[1]) / (2.0 * _NUDGE))
    values, left = np.linalg.eig(np.array(columns))  # rows of the transpose: left eigenvectors
    return np.asarray(left[:, int(np.argmax(values.imag))] @ dual)
