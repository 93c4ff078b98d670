"""A second code: problems, simulations and reference posteriors in plain NumPy and SciPy.

Written from the textbooks: Anderson and Moore (1979) for the phase and the cubic sensor, Gelb
(1974) for mismodelled noise, Bar-Shalom, Li and Kirubarajan (2001) for the test of the NEES,
Särkkä (2013) for the Kalman and the point-mass filter, Gordon, Salmond and Smith (1993) for the
particle filter, Crassidis and Junkins (2012) for gyro and bias, Harvey, Ruiz and Shephard (1994)
for the stochastic volatility, Uppal, Ray and Poore (1974) for the stirred reactor. It shares no
line with the estimators that it examines.

The exact posterior mean and covariance have an expected NEES equal to the number of states,
whatever the distributions are. This checks the simulations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.stats import chi2

Array = NDArray[np.float64]
Motion = Callable[[Array, Array], Array]
Errors = Callable[[np.random.Generator, tuple[int, int, int]], Array]
SURE = 0.999
"""Probability of the band of the mean NEES, as in `chi_square_band`."""


@dataclass(frozen=True)
class Problem:
    """What a filter believes, and where the truth differs from it.

    States (n, N), measurements (m, N), times in s; `noise` is a factor (n, r) of the covariance of
    the process noise of a step.
    """

    name: str
    mean: Array
    sd: Array
    move: Motion
    noise: Array
    see: Motion
    sigma: Array
    steps: int = 25
    dt: float = 1.0
    true_move: Motion | None = None
    true_noise: Array | None = None
    errors: Errors | None = None
    true_see: Callable[[np.random.Generator, Array, Array], Array] | None = None

    def draw(self, seed: int, count: int) -> tuple[Array, Array]:
        """Return true states (steps, n, N) and their measurements (steps, m, N)."""
        random = np.random.default_rng(seed)
        normal = random.normal
        x = self.mean[:, None] + self.sd[:, None] * normal(size=(len(self.mean), count))
        noise = self.noise if self.true_noise is None else self.true_noise
        shape = (self.steps, len(self.sigma), count)
        make = self.errors or (lambda r, s: self.sigma[:, None] * r.normal(size=s))
        errors = make(random, shape)
        truth, values = [], []
        for k in range(self.steps):
            t = np.full(count, k * self.dt)
            if k:
                x = (self.true_move or self.move)(x, t - self.dt)
                x = x + noise @ normal(size=(noise.shape[1], count))
            shown = self.see(x, t) if self.true_see is None else self.true_see(random, x, t)
            truth.append(x)
            values.append(shown + errors[k])
        return np.array(truth), np.array(values)


def mean_nees(x: Array, covariance: Array, truth: Array) -> float:
    """Return the mean of eᵀ P⁻¹ e over N cases; x and truth (n, N), covariance (N, n, n)."""
    e = (x - truth).T[:, :, None]
    return float((np.swapaxes(e, 1, 2) @ np.linalg.solve(covariance, e)).mean())


def nees_band(states: int, count: int, probability: float = SURE) -> tuple[float, float]:
    """Return the band of the mean NEES of a consistent filter (Bar-Shalom et al., 5.4.2)."""
    tail = 0.5 * (1.0 - probability)
    low, high = chi2.ppf([tail, 1.0 - tail], states * count) / count
    return float(low), float(high)


def kalman(problem: Problem, values: Array) -> tuple[Array, Array]:
    """Return the Kalman filter's last means and covariances of a linear problem."""
    n, (steps, _, count) = len(problem.mean), values.shape
    zero = np.zeros((n, 1))
    x = np.repeat(problem.mean[:, None], count, axis=1)
    P = np.diag(problem.sd**2)
    Q, R = problem.noise @ problem.noise.T, np.diag(problem.sigma**2)
    for k in range(steps):
        if k:
            t0 = np.full(1, (k - 1) * problem.dt)
            c = problem.move(zero, t0)
            F = np.hstack([problem.move(zero + e[:, None], t0) for e in np.eye(n)]) - c
            x, P = F @ x + c, F @ P @ F.T + Q
        t = np.full(1, k * problem.dt)
        d = problem.see(zero, t)
        H = np.hstack([problem.see(zero + e[:, None], t) for e in np.eye(n)]) - d
        gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        x = x + gain @ (values[k] - H @ x - d)
        rest = np.eye(n) - gain @ H
        P = rest @ P @ rest.T + gain @ R @ gain.T
    return x, np.repeat(P[None], count, axis=0)


def point_masses(problem: Problem, values: Array, cells: int = 1200) -> tuple[Array, Array]:
    """Return the last means and covariances of a one-dimensional problem on a fixed grid."""
    steps, _, count = values.shape
    spread = np.sqrt(problem.sd[0] ** 2 + steps * (problem.noise**2).sum())
    grid = problem.mean[0] + np.linspace(-5.0, 5.0, cells) * spread
    offset = 0.0
    """How far the grid has moved: all masses move alike where the motion is a translation."""
    mass = np.exp(-0.5 * ((grid - problem.mean[0]) / problem.sd[0]) ** 2)[:, None]
    mass = np.repeat(mass, count, axis=1)
    q = float(np.sqrt((problem.noise**2).sum()))
    kernel = np.exp(-0.5 * ((grid[:, None] - grid) / max(q, 1e-9)) ** 2)
    kernel /= kernel.sum(axis=0)
    for k in range(steps):
        if k:
            origin = problem.move(np.zeros((1, 1)), np.full(1, (k - 1) * problem.dt))
            offset += float(origin[0, 0])
            mass = kernel @ mass
        shown = problem.see(grid[None] + offset, np.full(cells, k * problem.dt))
        off = (values[k][:, None] - shown[:, :, None]) / problem.sigma[:, None, None]
        log = -0.5 * (off**2).sum(axis=0)
        mass = mass * np.exp(log - log.max(axis=0))
        mass /= mass.sum(axis=0)
    mean = grid @ mass
    variance = ((grid[:, None] - mean) ** 2 * mass).sum(axis=0)
    return (mean + offset)[None], variance[:, None, None]


def particles(
    problem: Problem, values: Array, count: int, seed: int = 0
) -> tuple[Array, Array, float]:
    """Return the bootstrap filter's last means and covariances, and its least effective number."""
    random = np.random.default_rng(seed)
    n, (steps, _, cases) = len(problem.mean), values.shape
    least, means, covariances = float(count), [], []
    for case in range(cases):
        x = problem.mean[:, None] + problem.sd[:, None] * random.normal(size=(n, count))
        log = np.zeros(count)
        for k in range(steps):
            if k:
                x = problem.move(x, np.full(count, (k - 1) * problem.dt))
                x = x + problem.noise @ random.normal(size=(problem.noise.shape[1], count))
            shown = problem.see(x, np.full(count, k * problem.dt))
            log = log - 0.5 * (
                ((values[k, :, [case]].T - shown) / problem.sigma[:, None]) ** 2
            ).sum(0)
            weight = np.exp(log - log.max())
            weight /= weight.sum()
            effective = 1.0 / (weight**2).sum()
            least = min(least, effective)
            if problem.noise.any() and effective < 0.5 * count and k < steps - 1:
                start = (random.random() + np.arange(count)) / count
                x = x[:, np.minimum(np.searchsorted(weight.cumsum(), start), count - 1)]
                log = np.zeros(count)
        mean = x @ weight
        away = x - mean[:, None]
        means.append(mean)
        covariances.append((away * weight) @ away.T)
    return np.array(means).T, np.array(covariances), least


def runge_kutta(rate: Callable[[Array], Array], dt: float, parts: int) -> Motion:
    """Return the motion by the classical fourth-order rule in equal parts."""
    h = dt / parts

    def move(x: Array, t0: Array) -> Array:
        for _ in range(parts):
            a = rate(x)
            b = rate(x + 0.5 * h * a)
            c = rate(x + 0.5 * h * b)
            x = x + h / 6.0 * (a + 2 * b + 2 * c + rate(x + h * c))
        return x

    return move


def autoregressive(sigma: Array, rho: float) -> Errors:
    """Return errors with standard deviations sigma and the correlation rho between steps."""

    def make(random: np.random.Generator, shape: tuple[int, int, int]) -> Array:
        e = sigma[:, None] * random.normal(size=shape)
        for k in range(1, shape[0]):
            e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
        return e

    return make


def _linear(F: Array) -> Motion:
    return lambda x, t: F @ x


def _first(x: Array, t: Array) -> Array:
    return x[:1]


def _stay(x: Array, t: Array) -> Array:
    return 1.0 * x


def _phase(sigma: float, spread: float) -> Problem:
    def move(x: Array, t: Array) -> Array:
        return np.array([0.9 * x[0], x[1] + 0.3 * x[0]])

    def see(x: Array, t: Array) -> Array:
        return np.array([np.sin(3.0 * t + x[1]), np.cos(3.0 * t + x[1])])

    return Problem(
        "phase", np.zeros(2), np.array([1.0, spread]), move,
        np.array([[0.4], [0.0]]), see, np.full(2, sigma), 40,
    )  # fmt: skip


def _battery() -> Problem:
    def current(t: Array) -> Array:
        return 2.0 + np.sin(0.01 * t)

    def move(x: Array, t: Array) -> Array:
        a = np.exp(-60.0 / 200.0)
        return np.array([x[0] - 60.0 * current(t) / 7200.0, a * x[1] + (1 - a) * 0.03 * current(t)])

    def see(x: Array, t: Array) -> Array:
        s = x[0]
        open_circuit = 3.2 + 0.9 * s - 0.3 * np.exp(-12.0 * s) + 0.1 * s**3
        return np.asarray((open_circuit - x[1] - 0.05 * current(t))[None])

    return Problem(
        "battery", np.array([0.7, 0.0]), np.array([0.1, 0.02]), move,
        np.diag([2e-4, 1e-3]), see, np.array([0.005]), 25, 60.0,
    )  # fmt: skip


def _battery_biased() -> Problem:
    good = _battery()

    def move(x: Array, t: Array) -> Array:
        return np.asarray(good.move(x, t) - np.array([[60.0 * 0.3 / 7200.0], [0.0]]))

    return replace(good, true_move=move)


def _epidemic() -> Problem:
    def rate(x: Array) -> Array:
        s, log_i, log_beta = x
        beta = np.exp(log_beta)
        return np.array([-beta * s * np.exp(log_i), beta * s - 0.2, 0.0 * s])

    return Problem(
        "epidemic", np.array([0.95, np.log(0.005), np.log(0.5)]), np.array([0.02, 0.4, 0.3]),
        runge_kutta(rate, 1.0, 2), np.diag([1e-4, 0.02, 1e-3]),
        lambda x, t: 1000.0 * np.exp(x[1:2]), np.array([8.0]),
    )  # fmt: skip


def _reactor(spread: float) -> Problem:
    def rate(x: Array) -> Array:
        c, warm = x
        r = 0.072 * (1.0 - c) * np.exp(warm / (1.0 + warm / 20.0))
        return np.array([-c + r, -warm + 8.0 * r - 0.3 * warm])

    return Problem(
        "reactor", np.array([0.45, 2.8]), spread * np.array([0.1, 0.4]), runge_kutta(rate, 0.1, 2),
        np.diag([0.005, 0.03]), lambda x, t: x[1:2], np.array([0.1]), 30, 0.1,
    )  # fmt: skip


def _heat() -> Problem:
    def rate(x: Array) -> Array:
        u = np.concatenate([np.ones((1, x.shape[1])), x[:5], np.zeros((1, x.shape[1]))])
        flow = 0.02 * np.exp(x[5]) * 36.0 * (u[2:] - 2 * u[1:-1] + u[:-2])
        return np.concatenate([flow, np.zeros((1, x.shape[1]))])

    return Problem(
        "heat", np.zeros(6), np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.6]), runge_kutta(rate, 0.15, 2),
        np.diag([0.003] * 5 + [1e-3]), lambda x, t: x[1:4:2], np.full(2, 0.03), 25, 0.15,
    )  # fmt: skip


def _orbit(spread: float) -> Problem:
    def rate(x: Array) -> Array:
        r = np.hypot(x[0], x[1])
        return np.array([x[2], x[3], -x[0] / r**3, -x[1] / r**3])

    return Problem(
        "orbit", np.array([1.0, 0.0, 0.0, 1.0]), np.full(4, spread), runge_kutta(rate, 0.3, 3),
        np.zeros((4, 1)), lambda x, t: np.hypot(x[0] - 0.3, x[1] - 0.1)[None],
        np.array([0.002]), 20, 0.3,
    )  # fmt: skip


def _source(spread: float) -> Problem:
    stations = np.array([[0.0, 0.0], [80.0, 0.0], [0.0, 80.0], [-60.0, -60.0]])

    def see(x: Array, t: Array) -> Array:
        d = np.hypot(*(x[:, None] - stations.T[:, :, None]))
        return np.asarray(d[1:] - d[0])

    return Problem(
        "source", np.array([200.0, 150.0]), np.full(2, spread), _stay, np.zeros((2, 1)),
        see, np.full(3, 1.0), 8,
    )  # fmt: skip


def _tone(spread: float) -> Problem:
    return Problem(
        "tone", np.array([1.0, 0.0, 1.0]), np.array([spread, 0.5, 0.1]), _stay, np.zeros((3, 1)),
        lambda x, t: (x[2] * np.sin(x[0] * t + x[1]))[None], np.array([0.2]), 40, 0.5,
    )  # fmt: skip


def _one(
    name: str, mean: float, sd: float, see: Motion, q: float, sigma: float, steps: int
) -> Problem:
    return Problem(
        name, np.array([mean]), np.array([sd]), _stay, np.array([[q]]), see,
        np.array([sigma]), steps,
    )  # fmt: skip


def _terrain(spread: float) -> Problem:
    def see(x: Array, t: Array) -> Array:
        return 20.0 * np.sin(x / 30.0) + 10.0 * np.sin(x / 13.0 + 1.0)

    start = _one("terrain", 0.0, spread, see, 1.0, 2.0, 25)
    return replace(start, move=lambda x, t: x + 5.0)


def _volatility() -> Problem:
    def errors(random: np.random.Generator, shape: tuple[int, int, int]) -> Array:
        # log χ²₁ has the mean −γ − log 2 and the variance π²/2
        return np.asarray(np.log(random.normal(size=shape) ** 2) + np.euler_gamma + np.log(2.0))

    return Problem(
        "volatility", np.zeros(1), np.ones(1), _linear(np.array([[0.95]])), np.array([[0.3]]),
        _first, np.array([np.pi / np.sqrt(2.0)]), 40, errors=errors,
    )  # fmt: skip


def _gyro() -> Problem:
    F = np.array([[1.0, -1.0], [0.0, 1.0]])
    noise = np.array([[0.05, 0.0], [0.0, 0.003]])
    start, sd = np.zeros(2), np.array([1.0, 0.1])
    return Problem("gyro", start, sd, _linear(F), noise, _first, np.array([0.3]), 30)


def _integrator(factor: float) -> Problem:
    F = np.array([[1.0, 1.0], [0.0, 1.0]])
    G = 0.03 * np.array([[0.5], [1.0]])
    return Problem(
        "integrator", np.zeros(2), np.array([2.0, 0.3]), _linear(F), G, _first, np.array([0.3]),
        30, true_noise=factor * G,
    )  # fmt: skip


def _jump() -> Problem:
    calm = _integrator(1.0)

    def move(x: Array, t: Array) -> Array:
        return np.asarray(calm.move(x, t) + np.array([[2.0], [0.0]]) * (np.abs(t - 26.0) < 0.5))

    return replace(calm, true_move=move)


def _level(bias: float = 0.0, multiplied: float = 0.0) -> Problem:
    def errors(random: np.random.Generator, shape: tuple[int, int, int]) -> Array:
        constant = bias * random.normal(size=(1, 1, shape[2]))
        return 0.3 * random.normal(size=shape) + constant

    def see(random: np.random.Generator, x: Array, t: Array) -> Array:
        return x * (1.0 + multiplied * random.normal(size=x.shape))

    level = _one("level", 5.0, 3.0, _first, 0.05, 0.3, 25)
    return replace(level, errors=errors, true_see=see)


def _relaxation() -> Problem:
    start = np.array([5.0])
    slow = _linear(np.array([[0.97]]))
    return Problem(
        "relaxation", start, np.ones(1), _linear(np.array([[0.9]])), np.array([[0.05]]),
        _first, np.array([1.0]), 25, true_move=slow,
    )  # fmt: skip


def _unobservable() -> Problem:
    noise = block_diag(np.array([[0.1]]), np.array([[0.0]]))
    start, sd = np.zeros(2), np.array([1.0, 2.0])
    return Problem("unobservable", start, sd, _stay, noise, _first, np.array([0.3]))


PROBLEMS: dict[str, Problem] = {
    "phase, strong signal": _phase(0.3, 0.3),
    "phase, weak signal": _phase(1.0, 1.5),
    "terrain, narrow": _terrain(4.0),
    "terrain, wide": _terrain(40.0),
    "volatility": _volatility(),
    "battery": _battery(),
    "battery, biased current": _battery_biased(),
    "epidemic": _epidemic(),
    "reactor, near": _reactor(0.3),
    "reactor, wide": _reactor(2.0),
    "gyro": _gyro(),
    "gyro, correlated errors": replace(_gyro(), errors=autoregressive(np.array([0.3]), 0.8)),
    "tone, narrow": _tone(0.01),
    "tone, wide": _tone(0.2),
    "scale": _one("scale", 0.0, 1.5, lambda x, t: np.exp(x), 0.0, 0.3, 10),
    "cubic sensor": _one("cubic", 0.5, 1.0, lambda x, t: x**3, 0.1, 0.3, 20),
    "sine sensor, narrow": _one("sine", 0.0, 0.3, lambda x, t: np.sin(x), 0.02, 0.1, 20),
    "sine sensor, wide": _one("sine", 0.0, 2.5, lambda x, t: np.sin(x), 0.05, 0.1, 20),
    "source, near": _source(15.0),
    "source, wide": _source(100.0),
    "orbit, near": _orbit(0.003),
    "orbit, wide": _orbit(0.1),
    "heat": _heat(),
    "integrator": _integrator(1.0),
    "integrator, noise too low": _integrator(4.0),
    "integrator, noise slightly low": _integrator(1.5),
    "integrator, jump": _jump(),
    "multiplied errors": _level(multiplied=0.1),
    "relaxation, wrong constant": _relaxation(),
    "unobservable": _unobservable(),
    "hidden bias": _level(bias=0.3),
}

LINEAR = ("volatility", "gyro", "integrator", "unobservable")
"""Problems whose model is linear and right: the Kalman filter is the reference."""

ONE = ("terrain, narrow", "terrain, wide", "scale", "cubic sensor", "sine sensor, wide")
"""Nonlinear problems of one state: the point-mass filter is the reference."""
