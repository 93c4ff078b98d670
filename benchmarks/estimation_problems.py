"""Problems of state estimation that textbooks and other packages use as examples.

Each is stated once, as plain functions of columns of states, so that any filter can be run on it.
The sources state equations and numbers; those were entered without the books at hand, and
measurements are drawn anew here. A truth is drawn from the prior unless the source fixes it: only
then is a filter that is consistent also inside the band of the mean NEES.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from wide_priors import Scenario

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Channel

Array = NDArray[np.float64]
Motion = Callable[[Array, float, float], Array]
Noise = Callable[[Array, float, float], Array]

__all__ = ["PROBLEMS", "ProblemModel", "TextbookProblem", "draw"]


@dataclass(frozen=True)
class TextbookProblem:
    """A problem of estimation in discrete time.

    Parameters
    ----------
    name, source : str
        What it is called, and where it stands.
    mean, covariance : ndarray, shapes (n,) and (n, n)
        Prior, SI.
    times_s : ndarray, shape (K,)
        Of the measurements, all later than the prior, which holds at time 0.
    move : callable
        States (n, M), from a time over an interval, s → states (n, M).
    noise : callable
        States (n, M), time, interval → factors (M, n, r) of the covariance of the process noise.
    observe : callable
        States (n, M), time → measurements (m, M).
    sigma : ndarray, shape (m,)
        Standard deviations of the measurements.
    angles : tuple of int
        Rows of the measurements that are angles.
    """

    name: str
    source: str
    mean: Array
    covariance: Array
    times_s: Array
    move: Motion
    noise: Noise
    observe: Callable[[Array, float], Array]
    sigma: Array
    angles: tuple[int, ...] = ()


class ProblemModel:
    """A problem as an `EstimationModel`."""

    def __init__(self, problem: TextbookProblem) -> None:
        self.problem = problem
        self.blocks = tuple(
            (Channel(f"z{i}", "rad" if i in problem.angles else "1",
                     "angle" if i in problem.angles else "linear"),)
            for i in range(problem.sigma.size)
        )  # fmt: skip

    def advance(
        self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: NDArray[np.int64]
    ) -> Array:
        """Return the states at t1_s; all columns have one time."""
        return self.problem.move(x, float(t0_s[0]), float(t1_s[0] - t0_s[0]))

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return factors (N, n, r) of the covariance of the process noise."""
        return self.problem.noise(x, float(t0_s[0]), float(t1_s[0] - t0_s[0]))

    def observe(self, x: Array, t_s: Array, case: NDArray[np.int64]) -> Array:
        """Return the measurements (m, N) without errors."""
        return self.problem.observe(x, float(t_s[0]))


def draw(problem: TextbookProblem, draws: int, seed: int = 1) -> Scenario:
    """Draw truths from the prior and the process noise, and measurements of them.

    Parameters
    ----------
    problem : TextbookProblem
        One of `PROBLEMS`.
    draws : int
        N.
    seed : int
        Of the draws.
    """
    random, model = np.random.default_rng(seed), ProblemModel(problem)
    n, m = problem.mean.size, problem.sigma.size
    mean = np.repeat(problem.mean[:, None], draws, axis=1)
    prior = Belief.of(mean, np.repeat(problem.covariance[None], draws, axis=0), np.zeros(draws))
    start = x = mean + prior.root[0] @ random.normal(size=(n, draws))
    truth, sets, now = list[Array](), list[MeasurementSet](), 0.0
    for t in problem.times_s:
        factor = problem.noise(x, now, t - now)
        pushed = np.einsum("knr,kr->nk", factor, random.normal(size=(draws, factor.shape[2])))
        x, now = problem.move(x, now, t - now) + pushed, t
        z = problem.observe(x, t) + problem.sigma[:, None] * random.normal(size=(m, draws))
        rows = list(problem.angles)
        z[rows] = np.mod(z[rows] + np.pi, 2.0 * np.pi) - np.pi
        truth.append(x)
        sets.append(MeasurementSet.of(np.full(draws, t), z, problem.sigma[:, None], model.blocks))
    return Scenario(model, prior, truth, sets, start)


def _white(covariance: Callable[[float], Array]) -> Noise:
    """Return process noise of a covariance that depends on the interval only."""

    def noise(x: Array, t: float, dt: float) -> Array:
        value, vectors = np.linalg.eigh(covariance(dt))
        kept = value > 1e-15 * value[-1]
        factor = vectors[:, kept] * np.sqrt(value[kept])
        return np.repeat(factor[None], x.shape[1], axis=0)

    return noise


def _none(x: Array, t: float, dt: float) -> Array:
    return np.zeros((x.shape[1], len(x), 0))


def _integrated(rate: Callable[[Array, float], Array], steps: int) -> Motion:
    """Return the motion of a differential equation by steps of Runge and Kutta's fourth order."""

    def move(x: Array, t: float, dt: float) -> Array:
        h = dt / steps
        for k in range(steps):
            now = t + k * h
            a = rate(x, now)
            b = rate(x + 0.5 * h * a, now + 0.5 * h)
            c = rate(x + 0.5 * h * b, now + 0.5 * h)
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + h * c, now + h))
        return x

    return move


def _velocity(density: float) -> Callable[[float], Array]:
    """Return the covariance of white acceleration over an interval, for position and velocity."""
    return lambda dt: density * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])


def _line(x: Array, t: float, dt: float) -> Array:
    return np.array([x[0] + dt * x[1], x[1]])


def _plane(x: Array, t: float, dt: float) -> Array:
    return np.array([x[0] + dt * x[1], x[1], x[2] + dt * x[3], x[3]])


def _in_plane(density: float) -> Noise:
    one = _velocity(density)
    return _white(lambda dt: np.kron(np.eye(2), one(dt)))


def _bearing_range(east: float, north: float) -> Callable[[Array, float], Array]:
    def observe(x: Array, t: float) -> Array:
        dx, dy = x[0] - east, x[2] - north
        return np.array([np.arctan2(dy, dx), np.hypot(dx, dy)])

    return observe


def _seconds(count: int, step: float = 1.0) -> Array:
    return step * np.arange(1.0, count + 1.0)


def _falling(x: Array, t: float) -> Array:
    # altitude and speed downwards, ft and ft/s; the logarithm of the ballistic parameter over 1e-3,
    # so that the drag of no draw accelerates
    drag = 1e-3 * np.exp(x[2] - 5e-5 * x[0]) * x[1] ** 2
    return np.array([-x[1], -drag, 0.0 * x[2]])


def _entry(x: Array, t: float) -> Array:
    # km and km/s; drag of an exponential atmosphere and the Earth's attraction
    r, v = np.hypot(x[0], x[1]), np.hypot(x[2], x[3])
    drag = -0.59783 * np.exp(x[4]) * np.exp((6374.0 - r) / 13.406) * v
    pull = -3.9860e5 / r**3
    return np.array([x[2], x[3], drag * x[2] + pull * x[0], drag * x[3] + pull * x[1], 0.0 * x[4]])


def _turn(x: Array, t: float, dt: float) -> Array:
    w = np.where(np.abs(x[4]) < 1e-9, 1e-9, x[4])
    s, c = np.sin(w * dt), np.cos(w * dt)
    return np.array([
        x[0] + s / w * x[1] - (1.0 - c) / w * x[3], c * x[1] - s * x[3],
        x[2] + (1.0 - c) / w * x[1] + s / w * x[3], s * x[1] + c * x[3], x[4],
    ])  # fmt: skip


def _motor(x: Array, t: float) -> Array:
    # currents of two windings, speed and angle; R = 1.9 ohm, L = 3 mH, k = 0.1, J = 1.8e-4
    s, c = np.sin(x[3]), np.cos(x[3])
    a = -1.9 / 3e-3 * x[0] + x[2] * 0.1 / 3e-3 * s + np.sin(2.0 * np.pi * t) / 3e-3
    b = -1.9 / 3e-3 * x[1] - x[2] * 0.1 / 3e-3 * c + np.cos(2.0 * np.pi * t) / 3e-3
    w = 1.5 * 0.1 / 1.8e-4 * (x[1] * c - x[0] * s) - 0.001 / 1.8e-4 * x[2]
    return np.array([a, b, w, x[2]])


def _lorenz(x: Array, t: float) -> Array:
    return np.array([10.0 * (x[1] - x[0]), x[0] * (28.0 - x[2]) - x[1], x[0] * x[1] - 8 / 3 * x[2]])


def _drive(x: Array, t: float, dt: float) -> Array:
    # a bicycle of wheelbase 0.5 m at 1.1 m/s, steering to and fro
    steer = 0.1 + 0.2 * np.sin(0.1 * t)
    turned = dt * 1.1 / 0.5 * np.tan(steer)
    radius = 0.5 / np.tan(steer)
    return np.array([
        x[0] + radius * (np.sin(x[2] + turned) - np.sin(x[2])),
        x[1] - radius * (np.cos(x[2] + turned) - np.cos(x[2])),
        x[2] + turned,
    ])  # fmt: skip


def _landmarks(x: Array, t: float) -> Array:
    rows = []
    for east, north in ((5.0, 10.0), (10.0, 5.0), (15.0, 15.0)):
        dx, dy = east - x[0], north - x[1]
        rows += [np.hypot(dx, dy), np.arctan2(dy, dx) - x[2]]
    return np.array(rows)


def _two_bearings(x: Array, t: float) -> Array:
    return np.array([np.arctan2(x[2] + 2.0, x[0] + 1.5), np.arctan2(x[2] - 1.0, x[0] - 1.0)])


PROBLEMS = (
    TextbookProblem(
        "position of a target in the plane", "Stone Soup, tutorial 1 (Kalman filter)",
        np.array([0.0, 1.0, 0.0, 1.0]), np.diag([1.5, 0.5, 1.5, 0.5]), _seconds(20), _plane,
        _in_plane(0.05), lambda x, t: x[[0, 2]], np.full(2, np.sqrt(5.0)),
    ),
    TextbookProblem(
        "bearing and range, sensor at (50, 0)", "Stone Soup, tutorial 2 (extended Kalman filter)",
        np.array([0.0, 1.0, 0.0, 1.0]), np.diag([1.5, 0.5, 1.5, 0.5]), _seconds(20), _plane,
        _in_plane(0.05), _bearing_range(50.0, 0.0), np.array([np.radians(0.2), 1.0]), (0,),
    ),
    TextbookProblem(
        "bearing and range, near pass", "Stone Soup, tutorial 3 (unscented Kalman filter)",
        np.array([0.0, 1.0, 0.0, 1.0]), np.diag([1.5, 0.5, 1.5, 0.5]), _seconds(20), _plane,
        _in_plane(0.05), _bearing_range(10.0, 8.0), np.array([np.radians(1.0), 0.1]), (0,),
    ),
    TextbookProblem(
        "dog on a line, unknown start", "Labbe, Kalman and Bayesian filters in Python, ch. 6",
        np.array([10.0, 4.5]), np.diag([500.0, 49.0]), _seconds(50), _line,
        _white(lambda dt: 0.1 * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])),
        lambda x, t: x[:1], np.array([np.sqrt(10.0)]),
    ),
    TextbookProblem(
        "aircraft, slant range only", "Labbe, ch. 11 (extended Kalman filter)",
        np.array([-100.0, 100.0, 1000.0]), np.diag([50.0**2, 10.0**2, 50.0**2]),
        _seconds(200, 0.1),
        lambda x, t, dt: np.array([x[0] + dt * x[1], x[1], x[2]]),
        _white(lambda dt: np.diag([0.0, 0.1 * dt, 0.1 * dt])),
        lambda x, t: np.hypot(x[0], x[2])[None], np.array([5.0]),
    ),
    TextbookProblem(
        "climbing aircraft, range and elevation", "Labbe, ch. 10 (unscented Kalman filter)",
        np.array([0.0, 90.0, 1100.0, 0.0]), np.diag([300.0**2, 9.0, 150.0**2, 9.0]),
        _seconds(60, 3.0), _plane, _in_plane(0.05),
        lambda x, t: np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])]),
        np.array([5.0, np.radians(0.5)]), (1,),
    ),
    TextbookProblem(
        "robot among three landmarks", "Labbe, ch. 10",
        np.array([2.0, 6.0, 0.3]), np.diag([0.1, 0.1, 0.05]), _seconds(100), _drive,
        _white(lambda dt: np.diag([1e-4, 1e-4, 1e-4]) * dt), _landmarks,
        np.tile([0.3, 0.1], 3), (1, 3, 5),
    ),
    TextbookProblem(
        "random walk", "Särkkä (2013), example 4.1",
        np.zeros(1), np.eye(1), _seconds(100), lambda x, t, dt: x, _white(lambda dt: np.eye(1)),
        lambda x, t: x, np.array([1.0]),
    ),
    TextbookProblem(
        "pendulum, sine measured", "Särkkä (2013), example 5.1",
        np.array([1.5, 0.0]), 0.1 * np.eye(2), _seconds(400, 0.0125),
        lambda x, t, dt: np.array([x[0] + dt * x[1], x[1] - 9.8 * dt * np.sin(x[0])]),
        _white(_velocity(0.01)), lambda x, t: np.sin(x[:1]), np.array([np.sqrt(0.1)]),
    ),
    TextbookProblem(
        "car, bearings from two sensors", "Särkkä (2013), exercise of chapter 4",
        np.array([0.0, 1.0, 0.0, 0.0]), np.diag([0.1, 10.0, 0.1, 10.0]), _seconds(500, 0.01),
        _plane, _in_plane(0.1), _two_bearings, np.full(2, 0.05), (0, 1),
    ),
    TextbookProblem(
        "univariate growth model", "Kitagawa (1987); Gordon, Salmond, Smith (1993)",
        np.array([0.1]), 2.0 * np.eye(1), _seconds(50),
        lambda x, t, dt: 0.5 * x + 25.0 * x / (1.0 + x**2) + 8.0 * np.cos(1.2 * t),
        _white(lambda dt: 10.0 * np.eye(1)), lambda x, t: x**2 / 20.0, np.array([1.0]),
    ),
    TextbookProblem(
        "falling body, range from the side", "Athans, Wishner, Bertoni (1968), logarithmic",
        np.array([3e5, 2e4, 0.0]), np.diag([1e6, 4e6, 0.25]), _seconds(30),
        _integrated(_falling, 64), _none,
        lambda x, t: np.sqrt(1e10 + (x[:1] - 1e5) ** 2), np.array([100.0]),
    ),
    TextbookProblem(
        "re-entry, range and elevation", "Julier, Uhlmann (2004), section VI",
        np.array([6500.4, 349.14, -1.8093, -6.7967, 0.6932]),
        np.diag([1e-6, 1e-6, 1e-6, 1e-6, 0.25]), _seconds(1000, 0.1), _integrated(_entry, 1),
        _white(lambda dt: np.diag([0.0, 0.0, 2.4064e-5 * dt, 2.4064e-5 * dt, 1e-6 * dt])),
        lambda x, t: np.array([np.hypot(x[0] - 6374.0, x[1]), np.arctan2(x[1], x[0] - 6374.0)]),
        np.array([1e-3, 1.7e-2]), (1,),
    ),
    TextbookProblem(
        "turn of unknown rate", "Arasaratnam, Haykin (2009), section VII",
        np.array([1000.0, 300.0, 1000.0, 0.0, np.radians(-3.0)]),
        np.diag([100.0, 10.0, 100.0, 10.0, 1e-4]), _seconds(100), _turn,
        _white(lambda dt: np.block([
            [0.1 * np.kron(np.eye(2), _velocity(1.0)(dt)), np.zeros((4, 1))],
            [np.zeros((1, 4)), np.full((1, 1), 1.75e-4 * dt)],
        ])),
        lambda x, t: np.array([np.hypot(x[0], x[2]), np.arctan2(x[2], x[0])]),
        np.array([10.0, np.sqrt(10.0) * 1e-3]), (1,),
    ),
    TextbookProblem(
        "van der Pol oscillator", "Kandepu, Foss, Imsland (2008), section 4.1",
        np.array([1.4, 0.0]), 0.01 * np.eye(2), _seconds(100, 0.1),
        _integrated(lambda x, t: np.array([-x[1], x[0] - 0.2 * (1.0 - x[0] ** 2) * x[1]]), 4),
        _white(lambda dt: 1e-3 * np.eye(2) * dt), lambda x, t: x, np.full(2, np.sqrt(1e-3)),
    ),
    TextbookProblem(
        "Lorenz's attractor, one coordinate measured", "Evensen (1997)",
        np.array([1.508870, -1.531271, 25.46091]), 2.0 * np.eye(3), _seconds(160, 0.05),
        _integrated(_lorenz, 5), _white(lambda dt: 2.0 * np.eye(3) * dt), lambda x, t: x[:1],
        np.array([np.sqrt(2.0)]),
    ),
    TextbookProblem(
        "two-phase motor, currents measured", "Simon (2006), example 13.1",
        np.zeros(4), np.eye(4), _seconds(400, 1e-3), _integrated(_motor, 5),
        _white(lambda dt: np.diag([11.1 * dt, 11.1 * dt, 0.25 * dt, 1e-9 * dt])),
        lambda x, t: x[:2], np.array([0.1, 0.1]),
    ),
    TextbookProblem(
        "oscillator of unknown frequency", "Simon (2006), example 13.3",
        np.array([1.0, 0.0, 4.0]), np.diag([0.25, 0.25, 0.5]), _seconds(100, 0.1),
        _integrated(lambda x, t: np.array([x[1], -x[2] * x[0] - 0.2 * x[1], 0.0 * x[2]]), 4),
        _white(lambda dt: np.diag([0.0, 0.01 * dt, 0.0])), lambda x, t: x[:2], np.full(2, 0.3),
    ),
)  # fmt: skip
"""Eighteen of them."""
