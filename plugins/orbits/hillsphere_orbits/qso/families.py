"""The family of quasi-satellite orbits: its start, its correction, its ends."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array, ArrayConserved, Context, Plant
from hillsphere.symbolic import gradient
from hillsphere_orbits.continuation import Boundary, Branch, StepControl, continue_both, follow
from hillsphere_orbits.correction import Watch, correct, fix_component
from hillsphere_orbits.flow import XY_MIRROR, Flow, flow_of
from hillsphere_orbits.members import Quantity, coordinate
from hillsphere_orbits.qso.progress import FamilyProgress
from hillsphere_orbits.qso.specs import QsoSpec
from hillsphere_orbits.shooting import PeriodicShooting, Shooting, SymmetricShooting
from hillsphere_orbits.survey import LockedMoon, SeriesMoon, Surveyor
from hillsphere_orbits.winding import Winding, primary_distance, resolution, sensitivity

__all__ = ["Family", "Qso"]

_FAR = 4.0  # units of length: the 2:1 ellipse is good to a few per cent there
_CLEARANCE = 1e-9  # of an event: on the surface itself the gravity gradient is ambiguous
_FAR_SHARE = 0.05
"""Of the primary's distance: to this share the 2:1 ellipse of Hill's limit, which neglects terms of
the relative order amplitude/distance, is a guess for Newton's iteration. Beyond it another family
may be nearer (of the Moon at 4 units of length, orbits about the Earth)."""
_CLOSE = 0.1
"""Units of length: there the tide is 1e-3 of the attraction, and a retrograde Kepler circle the
limit of the family."""
_AT_PRIMARY = 10.0
"""Size of the states at the primary, in units of velocity, by which rounding is larger there.
Chosen: without it the last members of the Earth and Moon are met to 8.5e-12 only, not to 1e-12."""
_OFF_SURFACE = 1.05  # of the largest x: the first amplitude tried outside a surface
_GROWTH = 1.2  # from one amplitude that is tried for the first orbit to the next
_ALMOST_NONE = 2.0 * np.pi * 1e-3**1.5
"""Least period, natural units: that of a circle at 1e-3 units of length, inside the surface of any
body in hydrostatic equilibrium. Its speed is 32 units, and smaller orbits differ by little but
speed, so that members 0.5 apart would not reach farther in within the 400 of a direction."""
_FARTHEST = 1e3  # units of length
_PASSES = 4  # of continuation, each with the sub-steps that the last one's orbits need
_ITERATIONS = 20  # of Newton's method from an analytic limit, which is a rough guess
_STATES = ("x", "y", "z", "vx", "vy", "vz")


@dataclass(frozen=True)
class Family:
    """A computed piece of a family with the equations that its members solve.

    Parameters
    ----------
    plant : Plant
        The equations of motion.
    problem : Shooting
        The equations of the orbits, with as many sub-steps as rounding allows.
    branch : Branch
        Members from the largest amplitude to the smallest.
    method : str
        How the orbits were found, in words.
    """

    plant: Plant
    problem: Shooting
    branch: Branch
    method: str

    @property
    def amplitude(self) -> Quantity:
        """X at the crossing with the section, normalised."""
        return coordinate(self.problem.unknowns.index("x"))

    @property
    def period(self) -> Quantity:
        """Full period, normalised."""
        last = len(self.problem.unknowns) - 1
        whole = float(self.problem.period(np.ones((last + 1, 1)))[0])
        return coordinate(last, whole)

    @property
    def integral(self) -> Quantity:
        """Integral of motion, normalised; `InputError` if the plant has none."""
        flow = self.problem.flow
        if flow.system.integral is None:
            return self._array_integral()
        slopes = gradient(flow.system.integral, flow.system.x)
        compiled = flow.system.function(flow.system.integral, *slopes)
        rows = [1 + flow.names.index(name) for name in self.problem.unknowns[:-1]]

        def quantity(z: Array) -> tuple[Array, Array]:
            values = compiled(self.problem.state(z), flow.system.parameters(None, z.shape[1]))
            return values[0], np.concatenate([values[rows], np.zeros((1, z.shape[1]))])

        return quantity

    def _array_integral(self) -> Quantity:
        """Return the integral of a plant with array gravity; its gradient by differences.

        Newton's method tolerates an error of 1e-9 in the gradient without a further iteration.
        """
        surveyor, problem = Surveyor(self.plant, self.problem), self.problem
        if not isinstance(self.plant, ArrayConserved):
            raise InputError("the plant has no integral of motion; choose members by x or period")

        def values(z: Array) -> Array:
            return surveyor.integral(problem.state(z))

        def quantity(z: Array) -> tuple[Array, Array]:
            slopes = np.zeros_like(z)
            for i in range(z.shape[0] - 1):
                h = np.zeros_like(z)
                # central differences: their error of 1e-10 is enough for a gradient of Newton's
                # method
                h[i] = 1e-5
                slopes[i] = (values(z + h) - values(z - h)) / 2e-5
            return values(z), slopes

        return quantity


class Qso:
    """Quasi-satellite orbits: retrograde, from where one of the family's two limits holds.

    Far from the moon, but still near it beside the primary's distance, its attraction vanishes and
    the Hill equations have the solutions x = A cos nt, y = −2A sin nt: ellipses of axis ratio 2:1
    about the moon with its orbital period. Where the primary is too near for that, the family
    starts at its other limit, the retrograde Kepler circle close to the moon. From there it is
    followed inwards to the orbit that grazes the moon's surface, or without a surface to the last
    one that is resolved, and outwards to the largest amplitude. Every member winds once about the
    moon against its orbital motion, and not about the primary.

    If the equations keep the mirror plane xz, half a period between perpendicular crossings is
    solved, in the plane if they keep the plane z = 0 as well; otherwise (harmonics with S terms,
    a tilted body) a full period with the section y = 0.

    Parameters
    ----------
    spec : QsoSpec
        With its reference bound; the plant needs the states x, y, z, vx, vy, vz of a frame in
        which the moon stands still, and natural units in which its mean motion is 1.

    References
    ----------
    .. [1] Hénon, M., Numerical exploration of the restricted problem. V. Hill's case: periodic
       orbits and their stability, Astron. Astrophys. 1, 1969, p. 223 (family f).
    """

    def __init__(self, spec: QsoSpec) -> None:
        self.plant: Plant = spec.plant.get()
        self.accuracy = spec.accuracy
        names = tuple(v.name for v in self.plant.states)
        if names != _STATES:
            raise InputError(
                f"quasi-satellite orbits need a plant with states {', '.join(_STATES)}; "
                f"{type(self.plant).__name__} has {', '.join(names)}"
            )

    @cached_property
    def flow(self) -> Flow:
        """The plant's flow, normalised; compiled on first use."""
        return flow_of(self.plant)

    @cached_property
    def problem(self) -> tuple[Shooting, str]:
        """The shooting problem that suits the symmetries of the equations, and why."""
        flow = self.flow
        samples = _samples()
        frozen = ("z", "vz") if flow.keeps(XY_MIRROR, samples, reverses_time=False) else ()
        where = "in the plane z = 0" if frozen else "in space (the gravity has no mirror plane xy)"
        mirror = flow.system.mirrors.get("xz")
        if mirror is not None and flow.keeps(mirror, samples, reverses_time=True):
            problem: Shooting = SymmetricShooting(flow, mirror, frozen)
            return problem, f"half a period between perpendicular crossings of the x axis, {where}"
        problem = PeriodicShooting(flow, "y", frozen)
        return problem, (
            "a full period with the section y = 0 and least squares, because the equations do not "
            f"keep the mirror plane xz; {where}"
        )

    def family(
        self,
        x_min_m: float | None,
        x_max_m: float,
        members: int = 161,
        context: Context | None = None,
    ) -> Family:
        """Compute the family between two amplitudes.

        Parameters
        ----------
        x_min_m : float or None
            Smallest amplitude; None goes on until an orbit grazes the body (or, for a body
            without surface, to the radius outside which its gravity converges, or without such a
            radius to the last orbit that is resolved). A family whose amplitude turns back before
            ends there.
        x_max_m : float
            Largest amplitude.
        members : int
            Members of the result, equally spaced in arclength relative to distance.
        context : Context, optional
            Where progress is shown, from the first orbit's correction on.

        Returns
        -------
        Family
            From the largest amplitude to the smallest.

        Raises
        ------
        ConvergenceError
            If no orbit is found where the family starts, the family breaks off there, or what was
            found winds otherwise about the bodies.
        """
        unit = self.plant.scales.length_m
        problem, method = self.problem
        low, high = self._lowest() if x_min_m is None else x_min_m / unit, x_max_m / unit
        row = problem.unknowns.index("x")
        progress = FamilyProgress(context, row, unit / 1e3)
        start = self._start(problem, low, progress)
        problem = problem.with_steps(self._steps(problem, start))
        for _ in range(_PASSES):
            begin = float(start[row, 0])
            progress.begin_pass(min(max(low, self._innermost()), begin), max(high, begin), begin)
            branch = self._follow(problem, start, low, high, progress.watch_member)
            # The member at the surface is exact only if the steps are; it is left out here.
            needed = self._steps(problem, branch.z[:, :-1])
            if needed <= 2 * problem.steps:
                break
            problem = problem.with_steps(needed)
        problem = problem.with_steps(self._steps(problem, branch.z))
        shown = branch.resample(problem, members, relative=True)
        self.winding.require(
            problem, shown.z, unit, "quasi-satellite orbit", "ask for smaller amplitudes (x_max)"
        )
        return Family(self.plant, problem, shown, method)

    @cached_property
    def winding(self) -> Winding:
        """Once about the moon, retrograde, and not about the primary."""
        return Winding(-1, 0, primary_distance(self.plant))

    def _lowest(self) -> float:
        """Return the least amplitude of the family by default, normalised."""
        if "impact" in self.flow.system.events:
            return 0.0
        series = self.plant.series_radius_m if isinstance(self.plant, LockedMoon) else None
        return (series or 0.0) / self.plant.scales.length_m

    def _innermost(self) -> float:
        """Return an amplitude near which the family is likely to end, for its progress only."""
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        size = max((moon.semi_axes_m if moon else None) or (0.0,))
        return max(size, self._holds_from() or 0.0) / self.plant.scales.length_m or _CLOSE

    def _holds_from(self) -> float | None:
        """Return the distance, m, from which a series stands for the moon's gravity, if it does."""
        return self.plant.gravity_holds_from_m if isinstance(self.plant, SeriesMoon) else None

    def _start(self, problem: Shooting, low: float, progress: FamilyProgress) -> Array:
        """Return a member clear of the body, from the analytic limit that applies."""
        distance = self.winding.distance
        if distance is None or max(_FAR, low) <= _FAR_SHARE * distance:
            return self._far_start(problem, max(_FAR, low), progress)
        return self._close_start(problem, progress)

    def _far_start(self, problem: Shooting, amplitude: float, progress: FamilyProgress) -> Array:
        """Return a member near the 2:1 ellipse of Hill's limit, of an amplitude at least."""
        surface, distance = self._grazing(problem), self.winding.distance
        while True:
            # Hill's limit without the body's attraction: x = a cos t, y = −2a sin t, period 2π
            ellipse = np.array([[amplitude, 0.0, 0.0, 0.0, -2.0 * amplitude, 0.0]]).T
            guess = problem.unknowns_at(ellipse, np.array([2.0 * np.pi]))
            held = fix_component(problem.unknowns.index("x"), amplitude)
            name = f"amplitude {_km(amplitude * self.plant.scales.length_m)}"
            progress.begin_correction(_ITERATIONS)
            corrected = correct(
                problem, guess, held, iterations=_ITERATIONS, watch=progress.watch_iterate
            )
            z = corrected.require_converged("far 2:1 ellipse", [name])
            if all(boundary.function(z)[0] > 0.0 for boundary in surface):
                self._require_kind(problem, z)
                return z
            # the orbit grazes the body: try farther out
            amplitude *= 1.5
            if amplitude > (_FARTHEST if distance is None else _FAR_SHARE * distance):
                raise ConvergenceError(
                    f"no orbit clears the body up to {name}: it is too large for its gravity; "
                    "give it a smaller surface or a larger GM"
                )

    def _close_start(self, problem: Shooting, progress: FamilyProgress) -> Array:
        """Return a member near the retrograde Kepler circle, close to the surface."""
        unit, x = self.plant.scales.length_m, problem.unknowns.index("x")
        surface, distance = self._grazing(problem), self.winding.distance
        series = self.plant.series_radius_m if isinstance(self.plant, LockedMoon) else None
        axes = (self.plant.semi_axes_m if isinstance(self.plant, LockedMoon) else None) or (0.0,)
        first = max(_CLOSE, _OFF_SURFACE * max(max(axes), series or 0.0) / unit)
        radius = first
        # farther out the primary is as near as the moon
        while radius < 0.5 * (distance or _FARTHEST):
            # seen from the frame that turns with the moon once per 2π
            rate = radius**-1.5 + 1.0
            tide = radius**4 / (1.0 + radius**3)  # takes −r·rate over into the ellipse's −2r
            circle = np.array([[radius, 0.0, 0.0, 0.0, -(radius * rate + tide), 0.0]]).T
            guess = problem.unknowns_at(circle, np.array([2.0 * np.pi / rate]))
            some = problem.with_steps(self._steps(problem, guess))
            try:
                progress.begin_correction(_ITERATIONS)
                corrected = correct(
                    some, guess, fix_component(x, radius),
                    iterations=_ITERATIONS, watch=progress.watch_iterate,
                )  # fmt: skip
                clear = bool(corrected.converged[0]) and all(
                    boundary.function(corrected.z)[0] > 0.0 for boundary in surface
                )
            except PropagationError:  # through the body, where its gravity is not defined
                clear = False
            if clear and bool(self.winding.fits(some, corrected.z)[0]):
                self._require_kind(some, corrected.z)
                return corrected.z
            radius *= _GROWTH
        raise ConvergenceError(
            f"no retrograde orbit about the body was found between {_km(first * unit)} and "
            f"{_km(0.5 * (distance or _FARTHEST) * unit)}, half the way to its primary: its "
            "surface leaves no room for quasi-satellite orbits; give the body a smaller surface, "
            "or try the stage 'orbit_family' with a guess"
        )

    def _require_kind(self, problem: Shooting, z: Array) -> None:
        unit = self.plant.scales.length_m
        self.winding.require(
            problem, z, unit, "quasi-satellite orbit",
            "use the stage 'orbit_family' with a guess for other families",
        )  # fmt: skip

    def _follow(
        self, problem: Shooting, start: Array, low: float, high: float, watch: Watch | None = None
    ) -> Branch:
        """Follow the family from `high` to `low`, or to its ends, through a member or from it."""
        unit, x = self.plant.scales.length_m, problem.unknowns.index("x")
        ends = [*self._grazing(problem), *self._resolution_boundaries(problem)]
        inner = [*ends, Boundary(f"smallest amplitude {_km(low * unit)}", lambda z: z[x] - low)]
        outer = Boundary(f"largest amplitude {_km(high * unit)}", lambda z: high - z[x])
        # a long tail far out is nearly straight: steps in proportion to it
        largest = max(0.5, 0.02 * high)
        if self.winding.distance is not None:
            # beyond Hill's limit the family bends over a part of the primary's distance
            largest = min(largest, max(0.1, _FAR_SHARE * self.winding.distance))
        control = StepControl(first=min(0.1, 0.25 * float(start[x, 0])), largest=largest)
        inwards = -np.eye(len(problem.unknowns))[x]
        begin = float(start[x, 0])
        # the first member lies in the range: follow both ways from it
        if low <= begin <= high:
            whole = continue_both(
                problem, start[:, 0], inwards,
                boundaries=[outer, *inner], control=control, watch=watch,
            )  # fmt: skip
            return self._before_turn(whole, x)
        above = begin > high
        wanted = high if above else low
        sign = 1.0 if above else -1.0
        there = Boundary("the range begins", lambda z: sign * (z[x] - wanted))
        # otherwise follow to the edge of the range first, and from there through it
        approach = follow(
            problem, start[:, 0], sign * inwards,
            boundaries=[there, *ends], control=control, watch=watch,
        )  # fmt: skip
        if approach.ends[1] != there.reason:
            last = approach.z[x, -1] * unit
            raise ConvergenceError(
                f"there is no quasi-satellite orbit of amplitude {_km(wanted * unit)}: "
                f"{approach.ends[1]} at {_km(last)}; ask for "
                f"{'larger' if above else 'smaller'} amplitudes than that"
            )
        branch = follow(
            problem,
            approach.z[:, -1],
            sign * inwards,
            boundaries=inner if above else [*ends, outer],
            control=control,
            watch=watch,
        )
        if branch.size < 2:
            raise ConvergenceError(
                f"the family has a single member: {branch.ends[1]}; widen the range of amplitudes"
            )
        if not above:
            reasons = (branch.ends[1], f"smallest amplitude {_km(low * unit)}")
            branch = Branch(branch.z[:, ::-1], -branch.tangent[:, ::-1], reasons)
            return self._before_turn(branch, x)
        branch = Branch(branch.z, branch.tangent, (outer.reason, branch.ends[1]))
        return self._before_turn(branch, x)

    def _resolution_boundaries(self, problem: Shooting) -> list[Boundary]:
        """Return boundaries of resolution: close passages of a centre, vanishing periods."""
        ends = []
        if "impact" not in self.flow.system.events:
            ends.append(
                Boundary(
                    "the period of the next orbits is almost zero",
                    lambda z: problem.period(z) / _ALMOST_NONE - 1.0,
                )
            )
        if ends or self.winding.distance is not None:
            ends.append(resolution(problem, self.plant))
        if self.winding.distance is not None:
            # of the Kepler circles close in, matrices are large by the unit of time alone
            x, calm = problem.unknowns.index("x"), sensitivity(problem, _AT_PRIMARY)
            ends.append(
                Boundary(calm.reason, lambda z: np.where(z[x] < _CLOSE, 1.0, calm.function(z)))
            )
        return ends

    def _before_turn(self, branch: Branch, x: int) -> Branch:
        """Cut the branch where its amplitude stops falling: another family follows."""
        # chains run inwards: dx/ds < 0 as long as the family is single-valued in x
        turned = np.flatnonzero(branch.tangent[x] >= 0.0)
        if not turned.size:
            return branch
        kept = int(turned[0])
        place = _km(branch.z[x, max(kept - 1, 0)] * self.plant.scales.length_m)
        if kept < 2:
            raise ConvergenceError(f"the family turns back at once, at amplitude {place}")
        reason = f"the amplitude turns back near {place}"
        return Branch(branch.z[:, :kept], branch.tangent[:, :kept], (branch.ends[0], reason))

    def _steps(self, problem: Shooting, z: Array) -> int:
        x = problem.state(z)
        try:
            return self.flow.steps_for(x, z[-1], 0.1 * self.accuracy)
        except PropagationError:
            # Near the primary rounding exceeds a tenth of the accuracy; the orbits are judged by
            # the whole of it when they are propagated anew.
            return self.flow.steps_for(x, z[-1], self.accuracy)

    def _grazing(self, problem: Shooting) -> list[Boundary]:
        """Return the boundary at the surface, if there is one: clearance along the orbit.

        A series that stands for the gravity from a distance on, outside the surface, ends there.
        """
        flow = problem.flow
        if (holds := self._holds_from()) is not None:
            limit = holds / self.plant.scales.length_m

            def above(z: Array) -> Array:
                way = flow.trajectory(problem.state(z), problem.period(z), 2 * problem.steps)
                return _least(np.sum(way[:3] ** 2, axis=0) / limit**2 - 1.0) - _CLEARANCE

            reason = f"the orbit reaches the sphere of {_km(holds)} from which its gravity holds"
            return [Boundary(reason, above)]
        if "impact" not in flow.system.events:
            return []
        compiled = flow.system.function(flow.system.events["impact"])

        def clearance(z: Array) -> Array:
            way = flow.trajectory(problem.state(z), problem.period(z), 2 * problem.steps)
            states, points, cases = way.shape
            # all points of all orbits as lanes of one evaluation
            flat = np.ascontiguousarray(way.reshape(states, points * cases))
            values = compiled(flat, flow.system.parameters(None, points * cases))[0]
            return _least(values.reshape(points, cases)) - _CLEARANCE

        return [Boundary("the orbit grazes the surface", clearance)]


def _least(values: Array) -> Array:
    """Least value of each column (K, N) of samples on a closed curve, refined by a parabola."""
    i = np.argmin(values[:-1], axis=0)
    lane, points = np.arange(values.shape[1]), values.shape[0] - 1
    here = values[i, lane]
    before, after = values[(i - 1) % points, lane], values[(i + 1) % points, lane]
    bend = before - 2.0 * here + after
    slope = 0.5 * (after - before)
    refined: Array = here - np.where(
        bend > 0.0, 0.5 * slope**2 / np.where(bend > 0.0, bend, 1.0), 0.0
    )
    return refined


def _samples() -> Array:
    """States around the body at which symmetries are tried, shape (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    radius = np.geomspace(0.7, _FAR, 48)
    place = radius * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])


def _km(length_m: float) -> str:
    return f"{length_m / 1e3:.6g} km"
