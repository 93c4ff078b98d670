"""Survey of a family's members: states, stability, extent, and checks."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.dynamics import Taylor
from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array, ArrayConserved, Plant
from hillsphere.products import PeriodicOrbits
from hillsphere_orbits.shooting import Shooting
from hillsphere_orbits.stability import determinant_error, multipliers

__all__ = [
    "NEARLY_PLANAR",
    "LockedMoon",
    "SeriesMoon",
    "Surveyor",
    "TruePrimary",
    "extent",
    "nearest",
    "require_accuracy",
    "tracks",
]

_TRACK_POINTS = 240
"""Points of a stored track, about: a smooth curve in a figure, and a small product."""
NEARLY_PLANAR = 0.05
"""Of an orbit's largest extent: one that leaves the plane by less has no limit of |z|. Gravity
without the mirror plane xy lifts every orbit by some metres, and twice that bounds nothing."""


@runtime_checkable
class LockedMoon(Contract, Protocol):
    """Optional data of a plant's moon, which is fixed in its frame."""

    body_name: str
    primary_distance_m: float

    @property
    def gravity_name(self) -> str:
        """Kind of its gravity model in words."""
        ...

    @property
    def semi_axes_m(self) -> tuple[float, float, float] | None:
        """Semi-axes of its surface along its own axes, m."""
        ...

    @property
    def prime_meridian_rad(self) -> float:
        """Angle from +x to its longitude 0."""
        ...

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which its gravity is a series that may diverge; None if it is none."""
        ...


@runtime_checkable
class SeriesMoon(Contract, Protocol):
    """A plant whose moon may have a series that stands for an exact gravity."""

    @property
    def gravity_holds_from_m(self) -> float | None:
        """Distance from which it does, m; None without such a series."""
        ...

    def gravity_error(self, x: Array) -> Array | None:
        """Return the relative error (N,) of the acceleration at x (3, N), m; None likewise."""
        ...


@runtime_checkable
class TruePrimary(Contract, Protocol):
    """A plant that has the primary at its true distance, not in Hill's approximation."""

    primary_gm_m3_s2: float


class Surveyor:
    """Describes the orbits that solve a shooting problem.

    Closure and drift are measured by another propagator than the one that found the orbits: the
    Taylor integrator, or for terms that are functions of arrays by steps chosen by their error.

    Parameters
    ----------
    plant : Plant
        The equations.
    problem : Shooting
        The same equations as the orbits solve them, normalised.
    """

    def __init__(self, plant: Plant, problem: Shooting) -> None:
        self.plant, self.problem = plant, problem
        self.system = problem.flow.system
        self._taylor = Taylor(self.system) if self.system.external is None else None
        self._energy = (
            self.system.function(self.system.integral) if self.system.integral is not None else None
        )

    @property
    def check(self) -> str:
        """How closure and drift are measured, in words."""
        if self._taylor is not None:
            return "re-propagated by Taylor series, independent of the step map that found them"
        return "re-propagated with steps chosen by their error"

    def propagate(self, x: Array, duration: Array, revolutions: int = 1) -> Array:
        """Return the states (n, N) after the durations (N,), normalised."""
        if self._taylor is not None:
            end: Array = self._taylor.propagate(x, duration)
            return end
        end = self.problem.flow.adaptive.propagate(x, duration, revolutions)
        return np.asarray(end)

    def integral(self, x: Array) -> Array:
        """Return the integral (N,) at normalised states; NaN if the plant has none."""
        if self._energy is not None:
            return np.asarray(self._energy(x, self.system.parameters(None, x.shape[1]))[0])
        if isinstance(self.plant, ArrayConserved):
            unit = self.plant.scales.length_m / self.plant.scales.time_s
            return self.plant.integral_array(x * self.system.unit[:, None]) / unit**2
        return np.full(x.shape[1], np.nan)

    def orbits(self, z: Array, labels: tuple[str, ...]) -> PeriodicOrbits:
        """Return the orbits of the unknowns z (m, N) as a product."""
        x, period = self.problem.state(z), self.problem.period(z)
        scales = self.plant.scales
        return PeriodicOrbits(
            frame=self.system.frame,
            states=self.problem.flow.names,
            x0=x * self.system.unit[:, None],
            period_s=period * self.system.time_unit_s,
            integral=self.integral(x),
            monodromy=self.problem.monodromy(z),
            residual=np.linalg.norm(self.propagate(x, period) - x, axis=0),
            labels=labels,
            length_m=scales.length_m,
            time_s=scales.time_s,
        )

    def drift(self, z: Array, revolutions: int) -> Array:
        """Return the largest change of the integral (N,) in ten looks over the revolutions."""
        x, period = self.problem.state(z), self.problem.period(z)
        start, worst = self.integral(x), np.zeros(z.shape[1])
        done = 0
        # ten looks, each after whole revolutions
        for target in np.unique(np.linspace(0, revolutions, 11).astype(int))[1:]:
            x = self.propagate(x, (target - done) * period, int(target - done))
            worst = np.maximum(worst, np.abs(self.integral(x) - start))
            done = int(target)
        return worst


def require_accuracy(orbits: PeriodicOrbits, accuracy: float, drift: Array | None = None) -> None:
    """Raise `ConvergenceError` unless orbits close, keep their integral and keep the volume.

    Parameters
    ----------
    orbits : PeriodicOrbits
        With the residual of an independent propagation.
    accuracy : float
        Largest closure relative to the size of the orbit and to its largest multiplier (which is
        how much one period magnifies rounding), and drift relative to the integral; natural units.
    drift : ndarray, shape (N,), optional
        Change of the integral; NaN where there is none.
    """
    unit = np.array([orbits.length_m] * 3 + [orbits.length_m / orbits.time_s] * 3)
    size = np.maximum(1.0, np.max(np.abs(orbits.x0) / unit[:, None], axis=0))
    # an unstable orbit magnifies the rounding of its start by its largest multiplier
    growth = np.maximum(1.0, np.abs(multipliers(orbits.monodromy)[0]))
    lost = ~(orbits.residual <= accuracy * size * growth)
    what = f"closure {np.max(orbits.residual):.1e}"
    # Liouville: det M = 1; products of large elements cancel in it, so that it is less accurate
    volume = np.abs(determinant_error(orbits.monodromy))
    lost |= ~(volume <= 1e3 * accuracy)
    what += f", determinant error {np.max(volume):.1e}"
    if drift is not None:
        lost |= drift > accuracy * np.maximum(1.0, np.abs(orbits.integral)) * growth
        what += f", drift {np.max(drift):.1e}"
    if np.any(lost):
        x_km = orbits.x0[0, lost] / 1e3
        shown = ", ".join(f"x = {x:.6g} km" for x in x_km[:5])
        more = f" and {len(x_km) - 5} more" if len(x_km) > 5 else ""
        raise ConvergenceError(
            f"orbits do not keep the accuracy {accuracy:g} when propagated anew: {shown}{more} "
            f"(worst: {what}); orbits nearer to the surface than rounding, or gravity that is not "
            "smooth, need another amplitude or a larger accuracy"
        )


def nearest(problem: Shooting, z: Array) -> float:
    """Return the least normalised distance of any of the orbits (m, N) from the origin."""
    way = problem.flow.trajectory(problem.state(z), problem.period(z), 2 * problem.steps)
    return float(np.sqrt(np.min(np.sum(way[:3] ** 2, axis=0))))


def tracks(problem: Shooting, z: Array) -> Array:
    """Return normalised positions (3, P, N) along one revolution, ends included."""
    # whole multiples of the sub-steps of a revolution, thinned to about as many as a figure needs
    steps = 2 * problem.steps
    way = problem.flow.trajectory(problem.state(z), problem.period(z), steps)
    return np.ascontiguousarray(way[:3, :: max(1, steps // _TRACK_POINTS)])


def extent(problem: Shooting, z: Array) -> tuple[Array, Array]:
    """Largest y of each orbit and vx there.

    Parameters
    ----------
    problem : Shooting
        The equations; states x, y, z, vx, vy, vz.
    z : ndarray, shape (m, N)
        Members.

    Returns
    -------
    y, vx : ndarray, shape (N,)
        Normalised, at the root of vy nearest to the largest y of the sub-steps.
    """
    flow, steps = problem.flow, 2 * problem.steps
    period = problem.period(z)
    way = flow.trajectory(problem.state(z), period, steps)
    lane = np.arange(z.shape[1])
    top = np.argmax(way[1], axis=0)
    base = way[:, top, lane]
    h = np.zeros(z.shape[1])
    here = base
    for _ in range(8):
        # Newton's iteration for ẏ = 0 at the largest sample of y
        change = here[4] / flow.rate(here)[4]
        h = h - change
        here = flow.at_once(base, h)
        if float(np.max(np.abs(change) / period)) < 1e-12:
            break
    return here[1], here[3]
