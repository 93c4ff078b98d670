"""Lyapunov and halo orbits: where the families start, how they are followed, where they end."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.continuation import Boundary, Branch, StepControl, follow
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.flow import XY_MIRROR, Flow, flow_of
from hillsphere_orbits.libration.ends import BRANCHING, branching, ends_of, up_to
from hillsphere_orbits.libration.points import CollinearPoint, collinear_point
from hillsphere_orbits.libration.specs import HaloSpec, LyapunovSpec
from hillsphere_orbits.members import Quantity
from hillsphere_orbits.qso.families import Family
from hillsphere_orbits.shooting import SymmetricShooting

__all__ = ["Halo", "LibrationFamily", "Lyapunov"]

_STATES = ("x", "y", "z", "vx", "vy", "vz")
_SMALL = 1e-3  # first amplitude, in distances of the point from the body
_PASSES = 4  # of continuation, each with the sub-steps that the last one's orbits need
_COARSE = 1e-6
"""Tolerance of a first flight that only measures how much the transition matrix magnifies
errors."""
_FOLLOWED = 1e-10  # of half a period while following; returned orbits are exact
_ROUNDING = 1e-14  # rounding, relative to the largest element of the matrix


@dataclass(frozen=True)
class LibrationFamily(Family):
    """A computed piece of a family of libration orbits.

    Parameters
    ----------
    point : CollinearPoint
        About which.
    state : str
        Unknown that measures the amplitude.
    sign, origin : float
        The amplitude is sign · (state − origin).
    """

    point: CollinearPoint
    state: str
    sign: float
    origin: float

    @property
    def amplitude(self) -> Quantity:
        """Amplitude at the start, normalised."""
        return _offset(self.problem.unknowns.index(self.state), self.sign, self.origin)


class Lyapunov:
    """Planar orbits about L1 or L2, from the linear oscillation outwards.

    They start on the x axis where they cross it far from the body; the amplitude is the distance
    of that crossing from the libration point. The family ends where orbits graze the body, pass the
    centre of one without surface too closely to be resolved, or are too sensitive to be computed.

    Parameters
    ----------
    spec : LyapunovSpec
        With its reference bound; the plant needs the states x, y, z, vx, vy, vz of a frame in
        which the body rests at the origin with its primary at negative x, and the mirrors xy and
        xz.

    References
    ----------
    .. [1] Hénon, M., Numerical exploration of the restricted problem. V. Hill's case: periodic
       orbits and their stability, Astron. Astrophys. 1, 1969, p. 223 (families a and c).
    """

    def __init__(self, spec: LyapunovSpec | HaloSpec) -> None:
        self.plant: Plant = spec.plant.get()
        self.point_name: str = spec.point
        self.accuracy = spec.accuracy
        names = tuple(v.name for v in self.plant.states)
        if names != _STATES:
            raise InputError(
                f"libration orbits need a plant with states {', '.join(_STATES)}; "
                f"{type(self.plant).__name__} has {', '.join(names)}"
            )

    @cached_property
    def flow(self) -> Flow:
        """The plant's flow, normalised; compiled on first use."""
        return flow_of(self.plant)

    @cached_property
    def point(self) -> CollinearPoint:
        """The libration point."""
        return collinear_point(self.flow, self.point_name)

    @property
    def problem(self) -> tuple[SymmetricShooting, str]:
        """The shooting problem of the planar orbits."""
        return _shooting(self.flow, frozen=True), (
            "half a period between perpendicular crossings of the x axis, in the plane z = 0"
        )

    def family(
        self, low_m: float | None = None, high_m: float | None = None, members: int = 161
    ) -> LibrationFamily:
        """Compute the family between two amplitudes.

        Parameters
        ----------
        low_m : float or None
            Smallest amplitude; None starts at a thousandth of the point's distance.
        high_m : float or None
            Largest amplitude; None goes on to the end of the family.
        members : int
            Members of the result, equally spaced in arclength.

        Returns
        -------
        LibrationFamily
            From the smallest amplitude on.

        Raises
        ------
        InputError
            If the plant has no such point or lacks a mirror.
        ConvergenceError
            If the family cannot be followed, or ends before `low_m`.
        """
        problem, method = self.problem
        size = abs(self.point.x)
        amplitude = _offset(problem.unknowns.index("x"), self.point.side, self.point.x)
        start = self._first(problem, _SMALL * size)
        direction = self.point.side * np.eye(3)[0]
        problem, branch = _compute_branch(self, problem, start, direction, amplitude, low_m, high_m)
        shown = branch.resample(problem, members)
        name = f"{method}, about {self.point_name}"
        return LibrationFamily(
            self.plant, problem, shown, name, self.point, "x", self.point.side, self.point.x
        )

    def branching(self) -> tuple[SymmetricShooting, Array]:
        """Find where halo orbits branch off: the vertical stability index is 2.

        The out-of-plane block of the half-period's matrix is [[p, q], [r, s]] and the index
        2 (1 + 2qr); r = 0 is the orbit at which a start with z ≠ 0, ż = 0 comes back to ż = 0 after
        half a period [1]_.

        Returns
        -------
        problem : SymmetricShooting
            Of the planar orbits, with sub-steps for the orbit found.
        z : ndarray, shape (3,)
            That orbit.

        Raises
        ------
        ConvergenceError
            If the family ends before.

        References
        ----------
        .. [1] Hénon, M., Vertical stability of periodic orbits in the restricted problem, Astron.
           Astrophys. 28, 1973, p. 415.
        """
        problem, _ = self.problem
        start = self._first(problem, _SMALL * abs(self.point.x))
        steps = 4 * _steps(problem, start, 0.1 * self.accuracy)
        while True:
            problem = problem.with_steps(steps)
            branch = follow(
                problem,
                start[:, 0],
                self.point.side * np.eye(3)[0],
                boundaries=[branching(problem, start), *ends_of(problem, self.plant)],
                control=_control(self.point),
            )
            if branch.ends[1] != BRANCHING:
                last = abs(float(branch.z[0, -1]) - self.point.x) * self.plant.scales.length_m
                raise ConvergenceError(
                    f"no halo orbits branch off the Lyapunov orbits of {self.point_name}: "
                    f"{branch.ends[1]} at amplitude {last / 1e3:.6g} km"
                )
            z = branch.z[:, -1:]
            needed = 2 * _steps(problem, z, 0.1 * self.accuracy)
            if needed <= steps:
                return problem, z[:, 0]
            steps = needed

    def _first(self, problem: SymmetricShooting, amplitude: float) -> Array:
        """Return the orbit of a small amplitude (3, 1), from the linear oscillation."""
        point = self.point
        # linear solution ξ = a cos ωt, η = −ratio·a sin ωt, started on the x axis, for half a
        # period
        a = point.side * amplitude
        guess = np.array(
            [[point.x + a], [-a * point.ratio * point.frequency], [np.pi / point.frequency]]
        )
        corrected = correct(problem, guess, fix_component(0, guess[0]))
        return corrected.require_converged(f"Lyapunov orbit beside {self.point_name}")


class Halo:
    """Halo orbits about L1 or L2, from where they branch off the Lyapunov orbits.

    They start where they cross y = 0 far from the body; the amplitude is |z| there. Along the
    family it may reach a maximum and fall again.

    Parameters
    ----------
    spec : HaloSpec
        With its reference bound; the plant as for `Lyapunov`.

    References
    ----------
    .. [1] Howell, K. C., Three-dimensional, periodic, 'halo' orbits, Celestial Mechanics 32, 1984,
       p. 53.
    """

    def __init__(self, spec: HaloSpec) -> None:
        self.planar = Lyapunov(spec)
        self.plant: Plant = self.planar.plant
        self.accuracy = spec.accuracy
        self.sign = 1.0 if spec.branch == "north" else -1.0

    @property
    def point(self) -> CollinearPoint:
        """The libration point."""
        return self.planar.point

    @property
    def problem(self) -> tuple[SymmetricShooting, str]:
        """The shooting problem of the orbits in space."""
        return _shooting(self.planar.flow, frozen=False), (
            "half a period between perpendicular crossings of the plane xz"
        )

    def family(
        self, low_m: float | None = None, high_m: float | None = None, members: int = 161
    ) -> LibrationFamily:
        """Compute the family between two amplitudes; arguments and errors as for `Lyapunov`."""
        flat, z = self.planar.branching()
        problem, method = self.problem
        problem = problem.with_steps(flat.steps)
        small = _SMALL * abs(self.point.x)
        # bifurcation along z: to first order the other unknowns keep their values
        guess = np.array([[z[0]], [self.sign * small], [z[1]], [z[2]]])
        index = problem.unknowns.index("z")
        start = correct(problem, guess, fix_component(index, guess[index])).require_converged(
            "first halo orbit"
        )
        amplitude = _offset(index, self.sign, 0.0)
        # follow away from the plane, towards the chosen branch
        direction = self.sign * np.eye(4)[index]
        problem, branch = _compute_branch(
            self.planar, problem, start, direction, amplitude, low_m, high_m
        )
        shown = branch.resample(problem, members)
        name = f"{method}, about {self.planar.point_name}"
        return LibrationFamily(self.plant, problem, shown, name, self.point, "z", self.sign, 0.0)


def _shooting(flow: Flow, *, frozen: bool) -> SymmetricShooting:
    """Return the half-period problem, in the plane or in space, if the equations allow it."""
    samples = _samples()
    mirror = flow.system.mirrors.get("xz")
    if (
        mirror is None
        or not flow.keeps(mirror, samples, reverses_time=True)
        or not flow.keeps(XY_MIRROR, samples, reverses_time=False)
    ):
        raise InputError(
            "libration orbits need equations that keep the mirror planes xy and xz; this plant's "
            "do not (harmonics with S terms or of odd degree minus order, a tilted body)"
        )
    return SymmetricShooting(flow, mirror, ("z", "vz") if frozen else ())


def _samples() -> Array:
    """States around the body at which symmetries are tried, shape (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    # from near the body to well beyond the libration points, in all directions
    place = np.geomspace(0.7, 4.0, 48) * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])


def _offset(index: int, sign: float, origin: float) -> Quantity:
    """Return the quantity sign · (z[index] − origin)."""

    def quantity(z: Array) -> tuple[Array, Array]:
        slopes = np.zeros_like(z)
        slopes[index] = sign
        return sign * (z[index] - origin), slopes

    return quantity


def _control(point: CollinearPoint) -> StepControl:
    size = abs(point.x)
    return StepControl(first=0.01 * size, smallest=1e-7 * size, largest=0.15 * size, members=400)


def _compute_branch(
    family: Lyapunov,
    problem: SymmetricShooting,
    start: Array,
    direction: Array,
    amplitude: Quantity,
    low_m: float | None,
    high_m: float | None,
) -> tuple[SymmetricShooting, Branch]:
    """Follow a family from its first member (m, 1), with as many sub-steps as it needs."""
    unit = family.plant.scales.length_m
    first = float(amplitude(start)[0][0])
    low = None if low_m is None or low_m / unit <= first else low_m / unit
    top = None if high_m is None else high_m / unit
    if top is not None and top <= (first if low is None else low):
        raise InputError(
            f"the range of amplitudes is empty: up to {top * unit / 1e3:.6g} km, and the first "
            f"orbit has {(low or first) * unit / 1e3:.6g} km"
        )
    control = _control(family.point)
    problem = problem.with_steps(_steps(problem, start, _FOLLOWED))
    for _ in range(_PASSES):
        ends = ends_of(problem, family.plant)
        begin = start[:, 0]
        if low is not None:
            there = up_to("the range begins", amplitude, low)
            approach = follow(problem, begin, direction, boundaries=[there, *ends], control=control)
            if approach.ends[1] != there.reason:
                raise ConvergenceError(
                    f"there is no orbit of amplitude {low * unit / 1e3:.6g} km: "
                    f"{approach.ends[1]} at {_tall(amplitude, approach) * unit / 1e3:.6g} km"
                )
            begin, direction = approach.z[:, -1], approach.tangent[:, -1]
        if top is not None:
            reason = f"largest amplitude {top * unit / 1e3:.6g} km"
            ends.append(up_to(reason, amplitude, top))
        ends.append(Boundary("the amplitude falls to nothing", lambda z: amplitude(z)[0]))
        branch = follow(problem, begin, direction, boundaries=ends, control=control)
        if branch.size < 2:
            raise ConvergenceError(f"the family has a single member: {branch.ends[1]}")
        # orbits at the far end of the branch may pass closer to the body than the first one
        needed = _steps(problem, branch.z, _FOLLOWED)
        if needed <= problem.steps:
            break
        problem = problem.with_steps(2 * needed)
    problem = problem.with_steps(2 * _steps(problem, branch.z, 0.1 * family.accuracy))
    begins = "the first orbit computed" if low is None else "where it was to begin"
    return problem, Branch(branch.z, branch.tangent, (begins, branch.ends[1]))


def _tall(amplitude: Quantity, branch: Branch) -> float:
    return float(amplitude(branch.z[:, -1:])[0][0])


def _steps(problem: SymmetricShooting, z: Array, tolerance: float) -> int:
    """Return sub-steps of half a period that keep a tolerance, or rounding where that is more."""
    x, flow = problem.state(z), problem.flow
    # a coarse flight is enough to measure the magnification of rounding
    coarse = flow.map.choose_steps(x, z[-1], _COARSE)
    _, half = flow.with_matrix(x, z[-1], coarse)
    floor = _ROUNDING * float(np.max(np.abs(half)))
    return flow.map.choose_steps(x, z[-1], max(tolerance, floor))
