"""Three estimation problems whose priors are wide: the scenarios, for tests and comparisons.

Each function returns a `Scenario`: the model, the prior, the true states and the measurements of N
draws. The first prior is so wide that the measurements are strongly curved across it:

- `spring_mass`: the example of Tapley, Schutz and Born [1]_, section 4.8.2. Range and range-rate do
  not change if the signs of position and velocity both change: the posterior has two modes.
- `bearings_only`: a target on a straight course, seen in bearing by an observer that turns once;
  before the turn the distance is not observable [2]_.
- `low_earth_orbit`: a satellite in the field of a point mass with J2, measured in range and
  range-rate by three stations on the rotating Earth.

References
----------
.. [1] Tapley, Schutz, Born (2004), Statistical orbit determination.
.. [2] Nardone, Aidala (1981), Observability criteria for bearings-only target motion analysis, IEEE
   Trans. Aerospace and Electronic Systems 17(2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Channel, EstimationModel

__all__ = ["Scenario", "bearings_only", "low_earth_orbit", "spring_mass"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Scenario:
    """N draws of an estimation problem.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements, without process noise.
    prior : Belief
        At time 0, not after the first measurements.
    truth : list of ndarray, shape (n, N)
        True states at K times, SI.
    sets : list of MeasurementSet
        Measurements at these times.
    start : ndarray, shape (n, N)
        True states at the time of the prior.
    """

    model: EstimationModel
    prior: Belief
    truth: list[Array]
    sets: list[MeasurementSet]
    start: Array

    def nothing(self) -> Array:
        """Return the controls (0, N): there are none."""
        return np.zeros((0, len(self.prior.t_s)))


class _Noiseless:
    """A model without process noise."""

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return no noise, (N, n, 0)."""
        return np.zeros((x.shape[1], len(x), 0))


# -- spring and mass -------------------------------------------------------------------------------


class SpringMass(_Noiseless):
    """A mass between two springs: position and velocity; range and range-rate from a point aside.

    Constants of [1]_: k1 = 2.5 N/m, k2 = 3.7 N/m, m = 1.5 kg, h = 5.4 m.
    """

    blocks = ((Channel("range", "m"), Channel("range_rate", "m/s")),)
    rate_rad_s = np.sqrt((2.5 + 3.7) / 1.5)
    height_m = 5.4

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states of the harmonic oscillator later."""
        turn = self.rate_rad_s * (t1_s - t0_s)
        c, s = np.cos(turn), np.sin(turn)
        return np.array([
            c * x[0] + s / self.rate_rad_s * x[1], -s * self.rate_rad_s * x[0] + c * x[1],
        ])  # fmt: skip

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return range, m, and range-rate, m/s."""
        distance = np.hypot(x[0], self.height_m)
        return np.array([distance, x[0] * x[1] / distance])


def spring_mass(draws: int, seed: int = 1, sigma: float = 1.0) -> Scenario:
    """Return the textbook's problem: the truth is (3, 0), the prior (4, 0.2).

    Parameters
    ----------
    draws : int
        N: draws of the noise. Truth and prior are the same for all.
    seed : int
        Of the draws.
    sigma : float
        Standard deviation of range (m) and range-rate (m/s).
    """
    model, random = SpringMass(), np.random.default_rng(seed)
    prior = Belief.of(
        np.repeat([[4.0], [0.2]], draws, axis=1),
        np.repeat(np.diag([1000.0, 100.0])[None], draws, axis=0),
        np.zeros(draws),
    )
    x = np.repeat([[3.0], [0.0]], draws, axis=1)
    return _simulate(model, prior, x, np.arange(11.0), np.array([sigma, sigma]), random)


# -- bearings only ---------------------------------------------------------------------------------


class BearingsOnly(_Noiseless):
    """A target with constant velocity in the plane; its bearing from an observer that turns once.

    States: position, m, and velocity, m/s. The observer begins at the origin and moves with
    `observer_m_s` in the first coordinate; after `turn_s` it moves in the second one.
    """

    blocks = ((Channel("bearing", "rad", "angle"),),)
    observer_m_s, turn_s = 8.0, 600.0

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states on a straight line later."""
        return np.concatenate([x[:2] + (t1_s - t0_s) * x[2:], x[2:]])

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the bearing, rad."""
        first = self.observer_m_s * np.minimum(t_s, self.turn_s)
        second = self.observer_m_s * np.maximum(t_s - self.turn_s, 0.0)
        return np.arctan2(x[1] - second, x[0] - first)[None]


def bearings_only(draws: int, seed: int = 2) -> Scenario:
    """Return a target 10 km away, its distance known to 3 km, its bearing measured to 2 mrad.

    Parameters
    ----------
    draws : int
        N: draws of the prior mean about the truth, and of the noise.
    seed : int
        Of the draws.
    """
    model, random = BearingsOnly(), np.random.default_rng(seed)
    # distance along the diagonal of the axes, 3 km; across it 0.5 km; velocities 4 m/s
    turn = np.sqrt(0.5) * np.array([[1.0, -1.0], [1.0, 1.0]])
    root = np.zeros((4, 4))
    root[:2, :2] = turn * [3000.0, 500.0]
    root[2:, 2:] = 4.0 * np.eye(2)
    start = np.array([[10000.0], [10000.0], [-3.0], [-2.0]]) * np.sqrt([[0.5], [0.5], [1.0], [1.0]])
    # the truth is drawn about a common prior mean, so that it is a draw from the prior
    mean = np.repeat(start, draws, axis=1)
    prior = Belief.of(mean, np.repeat((root @ root.T)[None], draws, axis=0), np.zeros(draws))
    x = mean + root @ random.normal(size=(4, draws))
    return _simulate(model, prior, x, np.arange(0.0, 1201.0, 30.0), np.array([2e-3]), random)


# -- low Earth orbit -------------------------------------------------------------------------------

GM, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3
"""Earth: m³/s², m, and the zonal coefficient (EGM96)."""
SPIN = 7.2921159e-5
"""Rotation of the Earth, rad/s."""


class LowEarthOrbit(_Noiseless):
    """An Earth satellite in the field of a point mass with J2; range and range-rate of stations.

    States: position, m, and velocity, m/s, in axes that do not rotate. The stations stand on a
    sphere at the latitudes and longitudes `stations_deg`. The motion is integrated by the classical
    Runge-Kutta formula in steps of at most `step_s`; truth and model share it.
    """

    stations_deg = ((-35.4, 149.0), (40.4, -4.2), (35.3, -116.9))
    blocks = ((Channel("range", "m"), Channel("range_rate", "m/s")),) * 3
    step_s = 30.0

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states later."""
        dt = t1_s - t0_s
        steps = max(1, int(np.ceil(np.max(np.abs(dt), initial=0.0) / self.step_s - 1e-9)))
        h = dt / steps
        for _ in range(steps):
            a = _acceleration(x)
            b = _acceleration(x + 0.5 * h * a)
            c = _acceleration(x + 0.5 * h * b)
            d = _acceleration(x + h * c)
            x = x + h / 6.0 * (a + 2.0 * (b + c) + d)
        return x

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return range, m, and range-rate, m/s, of each station, also below its horizon."""
        rows = []
        for place, motion in self.stations(t_s):
            off, drift = x[:3] - place, x[3:] - motion
            distance = np.sqrt(np.sum(off**2, axis=0))
            rows += [distance, np.sum(off * drift, axis=0) / distance]
        return np.array(rows)

    def stations(self, t_s: Array) -> list[tuple[Array, Array]]:
        """Return positions (3, K), m, and velocities, m/s, of the stations."""
        found = []
        for latitude, longitude in np.deg2rad(self.stations_deg):
            turn = longitude + SPIN * t_s
            c, s = RADIUS * np.cos(latitude) * np.array([np.cos(turn), np.sin(turn)])
            place = np.array([c, s, np.full(t_s.shape, RADIUS * np.sin(latitude))])
            found.append((place, SPIN * np.array([-s, c, np.zeros(t_s.shape)])))
        return found

    def sees(self, x: Array, t_s: Array) -> NDArray[np.bool_]:
        """Return which rows (6, K) are measured: satellite more than 10 degrees high."""
        rows = []
        for place, _ in self.stations(t_s):
            off = x[:3] - place
            sine = np.sum(off * place, axis=0) / np.linalg.norm(off, axis=0) / RADIUS
            rows += [sine > np.sin(np.deg2rad(10.0))] * 2
        return np.array(rows)


def low_earth_orbit(draws: int, seed: int = 3, hours: float = 5.0) -> Scenario:
    """Return an orbit of 800 km height; range to 1 cm, range-rate to 1 mm/s; prior 1 km and 1 m/s.

    Parameters
    ----------
    draws : int
        N: draws of the prior mean about the same true orbit, and of the noise.
    seed : int
        Of the draws.
    hours : float
        Length of the arc. It is measured every 60 s above 10 degrees.
    """
    model, random = LowEarthOrbit(), np.random.default_rng(seed)
    a = RADIUS + 800e3
    speed, tilt, node = np.sqrt(GM / a), np.deg2rad(65.0), np.deg2rad(235.0)
    along = np.array([-np.sin(node) * np.cos(tilt), np.cos(node) * np.cos(tilt), np.sin(tilt)])
    start = np.concatenate([[a * np.cos(node), a * np.sin(node), 0.0], speed * along])
    sigma = np.repeat([1e3, 1.0], 3)
    truth = np.repeat(start[:, None], draws, axis=1)
    mean = truth + sigma[:, None] * random.normal(size=(6, draws))
    t, x = np.zeros(1), start[:, None]
    times = []
    for k in range(round(hours * 60.0) + 1):
        later = np.full(1, 60.0 * k)
        x, t = model.advance(x, t, later, np.zeros((0, 1)), np.zeros(1, dtype=np.int64)), later
        if model.sees(x, t).any():
            times.append(60.0 * k)
    prior = Belief.of(mean, np.repeat(np.diag(sigma**2)[None], draws, axis=0), np.zeros(draws))
    return _simulate(model, prior, truth, np.array(times), np.tile([1e-2, 1e-3], 3), random)


def _acceleration(x: Array) -> Array:
    """Return the derivatives (6, K) of the states of a satellite."""
    r2 = np.sum(x[:3] ** 2, axis=0)
    pull = -GM / (r2 * np.sqrt(r2))
    flat = 1.5 * J2 * RADIUS**2 / r2
    level = 5.0 * x[2] ** 2 / r2
    polar = pull * (1.0 + flat * (3.0 - level))
    equatorial = pull * (1.0 + flat * (1.0 - level))
    return np.concatenate([x[3:], [equatorial * x[0], equatorial * x[1], polar * x[2]]])


def _simulate(
    model: SpringMass | BearingsOnly | LowEarthOrbit, prior: Belief, x: Array, times: Array,
    sigma: Array, random: np.random.Generator,
) -> Scenario:  # fmt: skip
    """Return the scenario of the true states x at the prior's time 0."""
    draws = x.shape[1]
    t, case, nothing = prior.t_s, np.arange(draws), np.zeros((0, draws))
    start, truth, sets = x, list[Array](), list[MeasurementSet]()
    for time in times:
        later = np.full(draws, time)
        x, t = model.advance(x, t, later, nothing, case), later
        shown = model.observe(x, t, case) + sigma[:, None] * random.normal(size=(len(sigma), draws))
        if isinstance(model, LowEarthOrbit):
            shown = np.where(model.sees(x, t), shown, np.nan)
        truth.append(x)
        sets.append(MeasurementSet.of(t, shown, sigma[:, None], model.blocks))
    return Scenario(model, prior, truth, sets, start)
