"""Toy worlds that estimators are tried on, and runs of filters through them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, Channel, EstimationModel, Estimator, Integers

ANGLES = (Channel("az", "rad", "angle"), Channel("el", "rad", "angle"))
RANGED = (Channel("range", "m"), *ANGLES)
NONE = np.zeros((0, 1))


class Pair:
    """Two spacecraft about a small body, held by a weak spring; camera, lidar and a link.

    12 states; 13 rows: azimuth and elevation, then range, azimuth and elevation, of each, and the
    same of the second from the first.
    """

    blocks = (ANGLES, RANGED, ANGLES, RANGED, RANGED)
    sigma = np.array([5.2e-4, 5.2e-4, 10.0, 1.75e-5, 1.75e-5] * 2 + [2.0, 1.75e-6, 1.75e-6])
    start = np.array([29.0, -1503.0, 407.0, 0.0, 0.0, 0.0, -1.2, -2126.0, 550.0, 0.0, 0.0, 0.0])
    spring, push = 1e-10, 1e-9

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        dt, out = t1_s - t0_s, np.empty_like(x)
        for k in (0, 6):
            r, v = x[k : k + 3], x[k + 3 : k + 6]
            pull = -self.spring * r * (1.0 + 0.1 * np.tanh(r / 1e3))
            out[k : k + 3] = r + dt * v + 0.5 * dt**2 * pull
            out[k + 3 : k + 6] = v + dt * pull
        return out

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Pushes of 60 s each, independent of each other."""
        dt = float((t1_s - t0_s)[0])
        steps = max(round(dt / 60.0), 1)
        h = dt / steps
        lever = h * (h * np.arange(steps) + 0.5 * h)
        mixed = np.array([[np.sum(lever**2), np.sum(lever * h)], [np.sum(lever * h), steps * h**2]])
        root = self.push * np.linalg.cholesky(mixed + 1e-12 * np.diag(np.diag(mixed)))
        out = np.zeros((12, 12))
        for k in (0, 1, 2, 6, 7, 8):
            out[np.ix_((k, k + 3), (k, k + 3))] = root
        return np.repeat(out[None], x.shape[1], axis=0)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        first, second = sphere(x[:3]), sphere(x[6:9])
        return np.array([*first[1:], *first, *second[1:], *second, *sphere(x[6:9] - x[:3])])


class Linear:
    """x' = F x + G w, z = H x + v, with its derivatives."""

    def __init__(self, F: Array, G: Array, H: Array) -> None:
        self.F, self.G, self.H = F, G, H
        self.blocks = tuple((Channel(f"z{k}", "m"),) for k in range(len(H)))

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return np.asarray(self.F @ x)

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.repeat(self.G[None], x.shape[1], axis=0)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.asarray(self.H @ x)

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.repeat(self.F[None], x.shape[1], axis=0)

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        return np.repeat(self.H[None], x.shape[1], axis=0)


class Bearing:
    """A place in space seen as a direction and by its distance; it stays where it is."""

    blocks = ((Channel("direction", "", "direction"), Channel("range", "m")),)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return x.copy()

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], 3, 1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        distance = np.linalg.norm(x, axis=0)
        return np.array([*(x / distance), distance])


@dataclass(frozen=True)
class Flight:
    """True states at K times, measurements then, and what is believed before the first."""

    truth: list[Array]
    sets: list[MeasurementSet]
    prior: Belief


@dataclass(frozen=True)
class Filtered:
    """Beliefs after each set of measurements, those before, and what was brought."""

    after: list[Belief]
    before: list[Belief]
    brought: list[Innovation]


def sphere(r: Array) -> tuple[Array, Array, Array]:
    distance = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
    return distance, np.arctan2(r[1], r[0]), np.arcsin(r[2] / distance)


def nothing(cases: int) -> Array:
    return np.zeros((0, cases))


def fly(
    model: Any,
    x: Array,
    spread: Array,
    sigma: Array,
    times_s: Array,
    seed: int,
) -> Flight:
    """Fly N cases with noise; the prior is off by random errors of standard deviations `spread`."""
    random = np.random.default_rng(seed)
    cases = x.shape[1]
    prior = Belief.of(
        x + spread[:, None] * random.normal(size=x.shape),
        np.repeat(np.diag(spread**2)[None], cases, axis=0),
        np.full(cases, times_s[0]),
    )
    truth, sets = [], []
    for k, time in enumerate(times_s):
        t_s = np.full(cases, time)
        if k:
            last = np.full(cases, times_s[k - 1])
            noise = model.process_noise(x, last, t_s, nothing(cases))
            x = model.advance(x, last, t_s, nothing(cases), np.arange(cases))
            x = x + np.einsum("nij,nj->in", noise, random.normal(size=(cases, noise.shape[2])))
        z = model.observe(x, t_s, np.arange(cases))
        z = z + sigma[:, None] * random.normal(size=z.shape)
        truth.append(x)
        sets.append(MeasurementSet.of(t_s, z, sigma[:, None], model.blocks))
    return Flight(truth, sets, prior)


def pair_flight(cases: int, steps: int, *, period_s: float = 3600.0, seed: int = 1,
                share: float = 0.1, sigma: Array = Pair.sigma) -> Flight:  # fmt: skip
    """Fly the pair; positions are first known to a share of their distance, speeds to 1 mm/s."""
    x = np.repeat(Pair.start[:, None], cases, axis=1)
    one, other = (share * float(np.linalg.norm(Pair.start[k : k + 3])) for k in (0, 6))
    spread: Array = np.array([one] * 3 + [1e-3] * 3 + [other] * 3 + [1e-3] * 3)
    return fly(Pair(), x, spread, sigma, period_s * np.arange(float(steps)), seed)


def run_filter(estimator: Estimator, model: EstimationModel, flight: Flight) -> Filtered:
    """Run a filter over a flight."""
    belief, run = flight.prior, Filtered([], [], [])
    for k, measured in enumerate(flight.sets):
        if k:
            belief = estimator.predict(model, belief, measured.t_s, nothing(len(measured.t_s)))
        run.before.append(belief)
        belief, innovation = estimator.update(model, belief, measured)
        run.after.append(belief)
        run.brought.append(innovation)
    return run


def without(measured: MeasurementSet, missing: NDArray[np.bool_]) -> MeasurementSet:
    """Return the set with some rows missing, (m, N)."""
    return replace(measured, present=measured.present & ~missing)


def apart(one: Belief, other: Belief) -> float:
    """Return the largest difference of means and covariances, in standard deviations."""
    size = other.sigma.T
    mean = np.abs(one.x - other.x) / other.sigma
    spread = np.abs(one.covariance - other.covariance) / (size[:, :, None] * size[:, None])
    return float(max(mean.max(), spread.max()))
