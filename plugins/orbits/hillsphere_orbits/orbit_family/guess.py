"""The family to which a periodic orbit near a guess belongs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.continuation import Boundary, StepControl, continue_both
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.flow import XY_MIRROR, flow_of
from hillsphere_orbits.qso.families import Family
from hillsphere_orbits.shooting import PeriodicShooting, Shooting, SymmetricShooting

__all__ = ["GuessedFamily"]

_STATES = ("x", "y", "z", "vx", "vy", "vz")
_PASSES = 4
"""Most times that the family is followed: each pass takes the sub-steps which the orbits of the
last one need, and the result of the last pass stands."""


class GuessedFamily:
    """Orbits near a guess, and the family they belong to; the amplitude is x at the start.

    Parameters
    ----------
    plant : Plant
        Equations with the states x, y, z, vx, vy, vz.
    guess : mapping of str to float
        States at the start, where y = 0, and ``period``; natural units, zero where left out.
    accuracy : float
        To which half or whole periods are propagated.

    Raises
    ------
    InputError
        If the plant has other states, or the guess names one that it has not.
    """

    def __init__(self, plant: Plant, guess: Mapping[str, float], accuracy: float) -> None:
        self.plant, self.guess, self.accuracy = plant, dict(guess), accuracy
        names = tuple(v.name for v in plant.states)
        if names != _STATES:
            raise InputError(
                f"orbits from a guess need a plant with states {', '.join(_STATES)}; "
                f"{type(plant).__name__} has {', '.join(names)}"
            )
        if unknown := sorted(set(guess) - {*names, "period"}):
            raise InputError(
                f"guess: there is no state {unknown[0]!r}; it may hold {', '.join(names)}, period"
            )
        if guess["x"] == 0.0 or guess.get("y", 0.0) != 0.0:
            raise InputError("guess: an orbit starts at y = 0 with x ≠ 0")

    @property
    def problem(self) -> tuple[Shooting, str]:
        """The shooting problem that suits equations and guess, and in words why."""
        flow = flow_of(self.plant)
        samples = _samples()
        flat = flow.keeps(XY_MIRROR, samples, reverses_time=False) and not (
            {"z", "vz"} & set(self.guess)
        )
        frozen = ("z", "vz") if flat else ()
        where = "in the plane z = 0" if flat else "in space"
        mirror = flow.system.mirrors.get("xz")
        upright = not any(self.guess.get(name, 0.0) for name in ("vx", "vz"))
        if mirror and upright and flow.keeps(mirror, samples, reverses_time=True):
            problem: Shooting = SymmetricShooting(flow, mirror, frozen)
            return problem, f"half a period between crossings of the mirror plane xz, {where}"
        return PeriodicShooting(flow, "y", frozen), f"a full period from y = 0, {where}"

    def family(self, low_m: float | None, high_m: float | None, members: int = 81) -> Family:
        """Compute the family between two amplitudes.

        Parameters
        ----------
        low_m, high_m : float or None
            Smallest and largest |x| at the start; by default half and twice that of the guess.
        members : int
            Members of the result, equally spaced in arclength.

        Returns
        -------
        Family
            From the smallest amplitude to the largest.

        Raises
        ------
        ConvergenceError
            If no orbit is found near the guess, or it has no neighbours.
        """
        problem, method = self.problem
        unit, x0 = self.plant.scales.length_m, self.guess["x"]
        state = np.array([[self.guess.get(name, 0.0)] for name in _STATES])
        guess = problem.unknowns_at(state, np.array([self.guess["period"]]))
        x = problem.unknowns.index("x")
        problem = problem.with_steps(self._steps(problem, guess))
        start = correct(problem, guess, fix_component(x, x0), iterations=25).require_converged(
            "orbit of the guess"
        )
        low = 0.5 * abs(x0) if low_m is None else low_m / unit
        high = 2.0 * abs(x0) if high_m is None else high_m / unit
        # the guess need not lie in the range: it is where following begins
        low, high = min(low, abs(x0)), max(high, abs(x0))
        sign = float(np.sign(x0))
        ends = [
            Boundary(f"smallest amplitude {low * unit / 1e3:.6g} km", lambda z: sign * z[x] - low),
            Boundary(f"largest amplitude {high * unit / 1e3:.6g} km", lambda z: high - sign * z[x]),
        ]
        control = StepControl(first=0.05 * abs(x0), largest=0.2 * abs(x0))
        direction = sign * np.eye(len(problem.unknowns))[x]
        for _ in range(_PASSES):
            branch = continue_both(
                problem, start[:, 0], direction, boundaries=ends, control=control
            )
            needed = self._steps(problem, branch.z)
            if needed <= problem.steps:
                break
            problem = problem.with_steps(needed)
        return Family(self.plant, problem, branch.resample(problem, members), method)

    def _steps(self, problem: Shooting, z: Array) -> int:
        return problem.flow.steps_for(problem.state(z), z[-1], 0.1 * self.accuracy)


def _samples() -> Array:
    """States around the body at which symmetries are tried, shape (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    place = np.geomspace(0.7, 4.0, 48) * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])
