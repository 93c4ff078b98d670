"""The joint filter of two spacecraft at an asteroid: 12 states, 13 measurements, 60 s steps.

Cameras, laser altimeters and a link between both measure; the motion is that of the plant
``proximity`` with a point mass. Beside ours stands FilterPy's unscented filter with the same
formula (RK6), motion and measurements written in Python for one state at a time, as it asks for
them: what a user would otherwise write. Its measurements are the same functions to rounding, and
its answer is compared with ours.

Times are CPU times, the shortest of some runs: of a prediction over 60 s and an update, for a case
alone and for each of a block of 64. A model is built anew for its own times; the first one compiles
(or reads from the cache), the next ones share what it made.
"""

from __future__ import annotations

from collections.abc import Callable
from math import asin, atan2, cos, hypot, pi, sin, sqrt
from time import process_time
from typing import Any

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from numpy.typing import NDArray

from hillsphere import create
from hillsphere.dynamics import tableau
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.sensor_suite import SensorSuite
from hillsphere_estimators.plant_model import PlantModel
from hillsphere_estimators.specs import BatchedUnscentedSpec
from hillsphere_estimators.unscented import BatchedUnscented

Array = NDArray[np.float64]
AU, SUN, GM, SPIN = 1.495978707e11, 1.32712440018e20, 1.801599, 5.8177e-5
AXES = (191.0, 135.0, 95.0)
AXIS_AU, ECCENTRICITY, PUSH, STEP = 0.9224, 0.1912, 0.2 * 0.04 * 4.56e-6, 60.0
START = np.array([29.0, -1503.4, 407.1, 1e-4, -2e-4, 3e-4, -1.2, -2126.2, 550.5, 0.0, 0.0, 0.0])
SPREAD = np.tile([5.0, 5.0, 5.0, 1e-3, 1e-3, 1e-3], 2)
BLOCK = 64


def world() -> tuple[Any, SensorSuite]:
    """Return the plant and its sensors."""
    body = create(
        "body", "asteroid", semi_major_axis_au=AXIS_AU, eccentricity=ECCENTRICITY,
        rotation_rate_rad_s=SPIN, semi_axes_m=AXES,
    )  # fmt: skip
    crafts = [{"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}] * 2
    plant = create(
        "plant", "proximity", body=body, gravity=create("gravity", "point_mass", gm_m3_s2=GM),
        spacecraft=crafts, true_anomaly_rad=0.0, acceleration_noise_m_s2=1e-9, radiation_noise=0.2,
    )  # fmt: skip
    sensors = [
        create("sensor", type_, body=body, spacecraft=k)
        for k in (1, 2)
        for type_ in ("camera", "lidar")
    ]
    return plant, SensorSuite([*sensors, create("sensor", "inter_satellite", partner=2)])


def shortest(work: Callable[[], Any], runs: int, times: int = 5) -> float:
    """Return the shortest CPU time of one call, s."""
    best = np.inf
    for _ in range(runs):
        begin = process_time()
        for _ in range(times):
            work()
        best = min(best, (process_time() - begin) / times)
    return best


class Problem:
    """N beliefs, the model and the measurements 60 s later."""

    def __init__(self, plant: Any, suite: SensorSuite, cases: int) -> None:
        random = np.random.default_rng(1)
        self.truth = np.repeat(START[:, None], cases, axis=1)
        x = self.truth + SPREAD[:, None] * random.normal(size=(12, cases))
        covariance = np.repeat(np.diag(SPREAD**2)[None], cases, axis=0)
        self.belief = Belief.of(x, covariance, np.zeros(cases))
        self.t_s, self.control = np.full(cases, STEP), np.zeros((6, cases))
        self.scene = plant.scene(self.t_s) | {"boresight": -np.array([x[:3], x[6:9]])}
        self.model = PlantModel(plant, suite, noise=plant.noise_sigma).within(self.scene)
        draws = [random.normal(size=(k, cases)) for k in suite.draws]
        self.measured: MeasurementSet = suite.measurements(
            self.truth, self.t_s, self.scene, draws[0], draws[1]
        )

    def run_filter(self, estimator: BatchedUnscented) -> Belief:
        """Predict and update."""
        later = estimator.predict(self.model, self.belief, self.t_s, self.control)
        return estimator.update(self.model, later, self.measured)[0]


# -- what a user would otherwise write -------------------------------------------------------------


def rate(t: float, x: list[float]) -> list[float]:
    """Return dx/dt of both spacecraft; the anomaly is 0 at time 0."""
    a, e = AXIS_AU * AU, ECCENTRICITY
    mean = sqrt(SUN / a**3) * t
    anomaly = mean
    for _ in range(20):
        step = (anomaly - e * sin(anomaly) - mean) / (1.0 - e * cos(anomaly))
        anomaly -= step
        if abs(step) < 1e-14:
            break
    far = a * (1.0 - e * cos(anomaly))
    turn = sqrt(SUN * a * (1.0 - e * e)) / far**2
    growth = -2.0 * turn * sqrt(SUN * a) * e * sin(anomaly) / far / far
    push = PUSH * (AU / far) ** 2
    found: list[float] = []
    for k in (0, 6):
        px, py, pz, vx, vy, vz = x[k : k + 6]
        q = (px * px + py * py + pz * pz + 2.0 * far * px) / far**2
        grown = (1.0 + q) ** 1.5
        f = q * (3.0 + 3.0 * q + q * q) / (1.0 + grown)
        tide = -SUN / (far**3 * grown)
        pull = -GM / sqrt(px * px + py * py + pz * pz) ** 3
        found += [
            vx, vy, vz,
            2.0 * turn * vy + growth * py + turn**2 * px + tide * (px - f * far) + pull * px + push,
            -2.0 * turn * vx - growth * px + turn**2 * py + tide * py + pull * py,
            tide * pz + pull * pz,
        ]  # fmt: skip
    return found


RK6 = tableau("rk6")


def propagate(x: Array, dt: float) -> Array:
    """Return the state one step later, by the same formula."""
    y, slopes = x.tolist(), []
    for row, node in zip(RK6.a.tolist(), RK6.c.tolist(), strict=True):
        at = [
            q + dt * sum(w * s[i] for w, s in zip(row, slopes, strict=False))
            for i, q in enumerate(y)
        ]
        slopes.append(rate(node * dt, at))
    weights = RK6.b.tolist()
    return np.array([
        q + dt * sum(w * s[i] for w, s in zip(weights, slopes, strict=True))
        for i, q in enumerate(y)
    ])  # fmt: skip


def predict_measurements(x: Array, boresight: Array, turn: Array) -> Array:
    """Return the 13 measurements of a state."""
    found: list[float] = []
    for k in (0, 1):
        r = x[6 * k : 6 * k + 3]
        z = boresight[k] / sqrt(float(boresight[k] @ boresight[k]))
        level = hypot(z[0], z[1])
        across = np.array([-z[1], z[0], 0.0]) / level
        up = np.cross(z, across)
        u, v, ahead = -float(across @ r), -float(up @ r), -float(z @ r)
        size = sqrt(float(r @ r))
        place = turn @ r / size
        radius = 1.0 / sqrt(sum((p / q) ** 2 for p, q in zip(place.tolist(), AXES, strict=True)))
        angles = [atan2(u, ahead), atan2(v, ahead)]
        found += [*angles, size - radius, *angles]
    d = x[6:9] - x[:3]
    size = sqrt(float(d @ d))
    return np.array([*found, size, atan2(d[1], d[0]), asin(d[2] / size)])


ANGLES = np.array([0, 1, 3, 4, 5, 6, 8, 9, 11, 12])


def angle_safe_difference(a: Array, b: Array) -> Array:
    """Return a − b, angles the short way round."""
    off = a - b
    off[ANGLES] = (off[ANGLES] + pi) % (2.0 * pi) - pi
    return np.asarray(off)


def filterpy_update(problem: Problem) -> Callable[[], tuple[Array, Array]]:
    """Return FilterPy's prediction and update of the first case."""
    boresight = problem.scene["boresight"][:, :, 0]
    turn = problem.scene["to_body"][:, :, 0]
    z, R = problem.measured.values[:, 0], np.diag(problem.measured.sigma[:, 0] ** 2)
    start = problem.belief.x[:, 0], problem.belief.covariance[0]
    pushes = np.concatenate([0.5 * STEP**2 * np.eye(3), STEP * np.eye(3)])
    levers = np.zeros((12, 6))
    levers[:6, :3], levers[6:, 3:] = pushes, pushes
    sigma = np.full(6, 1e-9)
    sigma[[0, 3]] = np.hypot(1e-9, 0.2 * PUSH / (AXIS_AU * (1.0 - ECCENTRICITY)) ** 2)
    Q = levers @ np.diag(sigma**2) @ levers.T
    points = MerweScaledSigmaPoints(12, 1.0, 2.0, 0.0)

    def work() -> tuple[Array, Array]:
        one = UnscentedKalmanFilter(
            12, 13, STEP, None, None, points, residual_z=angle_safe_difference
        )
        one.x, one.P, one.Q = start[0].copy(), start[1].copy(), Q
        one.predict(dt=STEP, fx=propagate)
        one.sigmas_f = points.sigma_points(one.x, one.P)
        one.update(z, R=R, hx=lambda x: predict_measurements(x, boresight, turn))
        return one.x, one.P

    return work


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    plant, suite = world()
    law = create("compensator", "lyapunov_formation", plant=plant, period_s=600.0)
    once, four = BatchedUnscented(BatchedUnscentedSpec()), BatchedUnscented(
        BatchedUnscentedSpec(update="tempered", powers=4)
    )  # fmt: skip
    alone, block = Problem(plant, suite, 1), Problem(plant, suite, BLOCK)
    ours = alone.run_filter(once)
    alone_s = shortest(lambda: alone.run_filter(once), 60)
    block_s = shortest(lambda: block.run_filter(once), 60) / BLOCK
    theirs = filterpy_update(alone)
    x, covariance = theirs()
    plain_s = shortest(theirs, 5, 1)
    size = np.sqrt(np.diag(covariance))
    off = max(
        float(np.max(np.abs(ours.x[:, 0] - x) / size)),
        float(np.max(np.abs(ours.covariance[0] - covariance) / np.outer(size, size))),
    )
    again = shortest(lambda: PlantModel(plant, suite, law=law, noise=plant.noise_sigma), 5)

    def predict_once() -> None:
        model = PlantModel(plant, suite, noise=plant.noise_sigma).within(alone.scene)
        once.predict(model, alone.belief, alone.t_s, alone.control)

    return {
        "alone_ms": alone_s * 1e3,
        "block_of_64_us_per_case": block_s * 1e6,
        "tempered_alone_ms": shortest(lambda: alone.run_filter(four), 30) * 1e3,
        "tempered_block_us_per_case": shortest(lambda: block.run_filter(four), 20) / BLOCK * 1e6,
        "filterpy_ms": plain_s * 1e3,
        "alone_faster_than_filterpy": plain_s / alone_s,
        "block_faster_than_filterpy": plain_s / block_s,
        "difference_from_filterpy_sigmas": off,
        "another_model_ms": again * 1e3,
        "another_model_and_its_first_prediction_ms": shortest(predict_once, 5, 1) * 1e3,
    }
