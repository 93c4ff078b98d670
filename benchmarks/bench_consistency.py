"""How many overconfident filters the verdict detects, on ten problems whose truth is known.

A run is a problem with a setting and an estimator, over draws of prior, process noise and
measurement noise. By its true errors it is

- overconfident, if its mean NEES, at the end or on average over the sets of measurements, is above
  the 99.9 % band of a mean over that many draws;
- else not overconfident.

The truth is taken of 400 draws, the verdict sees 100 of them: of 100 alone the band is so wide that
a filter with a wrong model of its noise may lie within it.

The definition does not use the verdict, and the verdict does not use the truth. A detection is an
overconfident run that the verdict calls "overconfident" or "not linear enough here"; a false alarm
is a run that is not overconfident and is called so. Beside it stands the test by the NIS alone: its
mean over all sets of measurements and draws above the same band.

Settings are: "nominal", where the filter's model is the true one; "wide", with a wider prior;
and faults of the model, of which the filter knows nothing: "quiet" (its process noise is a fifth
of the true one), "precise" (its measurement noise is half the true one), "biased" (the measurements
have a constant error), "coloured" (their errors are correlated from one to the next).

The limits of the verdict are those of its level and of χ² distributions. The problems were seen
while its rules were written, and none were held back: that the mean of the first innovations does
not count, that one of three linearisations clears the model, that a fit with a NIS above 2 is no
solution, and that correlated errors of the measurements may do no harm (van der Pol, "coloured")
were learned here.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation:
   constant velocity, range and bearing, coordinated turn.
.. [2] Athans, Wishner, Bertoni (1968), Suboptimal state estimation for continuous-time nonlinear
   systems from discrete noisy measurements, IEEE Trans. Automatic Control 13(5): the falling body.
.. [3] Gordon, Salmond, Smith (1993), Novel approach to nonlinear/non-Gaussian Bayesian state
   estimation, IEE Proceedings F 140(2): univariate growth.
.. [4] Särkkä (2013), Bayesian filtering and smoothing: the pendulum.
.. [5] Tapley, Schutz, Born (2004), Statistical orbit determination: spring and mass.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere import create
from hillsphere.errors import HillsphereError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Channel
from hillsphere_estimators.consistency import chi_square_band, nees, verdict
from hillsphere_estimators.verdict import Verdict

Array = NDArray[np.float64]
LONG = "HILLSPHERE_BENCHMARK_LONG"
DRAWS, TRUE_DRAWS = 100, 400
"""Draws that the verdict sees, and draws by which a run is judged in truth."""
ESTIMATORS: dict[str, tuple[str, dict[str, Any]]] = {
    "extended": ("iterated_extended", {"iterations": 1}),
    "iterated extended": ("iterated_extended", {}),
    "unscented": ("unscented", {}),
    "unscented, iterated": ("unscented", {"update": "iterated"}),
    "unscented, tempered": ("unscented", {"update": "tempered"}),
}


@dataclass
class World:
    """A problem: motion over one step, measurements, noise, prior.

    Parameters
    ----------
    move : callable
        (x (n, K), t_s (K,), dt) → states one step later.
    show : callable
        (x (n, K), t_s (K,)) → measurements (m, K).
    push : ndarray, shape (n, r)
        Root of the covariance of the process noise of a step.
    sigma : ndarray, shape (m,)
        Standard deviations of the measurements.
    mean, spread : ndarray, shape (n,)
        Prior.
    blocks : tuple
        Channels.
    steps, dt : int, float
        Number of sets of measurements and the time between them, s.
    settings : dict
        Name of a setting → the attributes that differ; those that begin with "true_" are of the
        truth alone.
    """

    move: Callable[[Array, Array, float], Array]
    show: Callable[[Array, Array], Array]
    push: Array
    sigma: Array
    mean: Array
    spread: Array
    blocks: Any
    steps: int
    dt: float = 1.0
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Any) -> Array:
        """Return the states later; each step is of `dt`."""
        return self.move(x, t0_s, self.dt)

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the noise of a step."""
        return np.repeat(self.push[None], x.shape[1], axis=0)

    def observe(self, x: Array, t_s: Array, case: Any) -> Array:
        """Return perfect measurements."""
        return self.show(x, t_s)


@dataclass(frozen=True)
class Run:
    """A filter over N draws: its record and the true states."""

    model: Any
    prior: Belief
    sets: list[MeasurementSet]
    truth: list[Array]
    before: list[Belief]
    after: list[Belief]
    innovations: list[Innovation]

    def true_nees(self) -> Array:
        """Return the NEES (K, N)."""
        return np.array([nees(b, x) for b, x in zip(self.after, self.truth, strict=True)])

    def is_overconfident(self) -> bool:
        """Return whether the errors are greater than the covariance states; see the module."""
        values = self.true_nees()
        n, draws = self.prior.x.shape
        high = float(chi_square_band(n, draws)[1])
        return not (values[-1].mean() <= high and values.mean() <= high)

    def nis_alarm(self) -> bool:
        """Return whether the mean NIS alone is above its 99.9 % band."""
        total = sum(float(i.nis.sum()) for i in self.innovations)
        rows = sum(int(i.dof.sum()) for i in self.innovations)
        return not total / rows <= chi_square_band(rows, 1)[1] / rows

    def first(self, draws: int) -> Run:
        """Return the run of the first draws only."""

        def cut(b: Belief) -> Belief:
            return Belief(b.x[:, :draws], b.root[:draws], b.t_s[:draws])

        return Run(
            self.model, cut(self.prior),
            [
                MeasurementSet(
                    m.t_s[:draws], m.values[:, :draws], m.sigma[:, :draws], m.blocks,
                    m.present[:, :draws],
                )
                for m in self.sets
            ],
            [x[:, :draws] for x in self.truth], [cut(b) for b in self.before],
            [cut(b) for b in self.after],
            [
                Innovation(
                    i.residual[:, :draws], i.covariance[:draws], i.used[:, :draws], i.nis[:draws]
                )
                for i in self.innovations
            ],
        )  # fmt: skip

    def judge(self) -> Verdict:
        """Return the verdict, which does not see the truth."""
        return verdict(
            self.model, self.prior, self.sets, self.after, self.innovations, before=self.before
        )


def _channels(*names: str, kind: str = "number", unit: str = "m") -> Any:
    return tuple(
        (Channel(name, unit, kind),) if kind != "number" else (Channel(name, unit),)
        for name in names
    )


RANGE_BEARING = (Channel("range", "m"), Channel("bearing", "rad", "angle"))


def _straight(x: Array, t_s: Array, dt: float) -> Array:
    half = len(x) // 2
    return np.concatenate([x[:half] + dt * x[half:], x[half:]])


def _pushes(axes: int, dt: float, size: float) -> Array:
    """Return the root of the noise of constant random accelerations over a step."""
    return size * np.concatenate([0.5 * dt**2 * np.eye(axes), dt * np.eye(axes)])


def _polar(x: Array, t_s: Array) -> Array:
    return np.array([np.hypot(x[0], x[1]), np.arctan2(x[1], x[0])])


def _kutta(rate: Callable[[Array], Array], steps: int) -> Callable[[Array, Array, float], Array]:
    """Return the motion by the classical Runge-Kutta formula."""

    def move(x: Array, t_s: Array, dt: float) -> Array:
        h = dt / steps
        for _ in range(steps):
            a = rate(x)
            b = rate(x + 0.5 * h * a)
            c = rate(x + 0.5 * h * b)
            x = x + h / 6.0 * (a + 2.0 * (b + c) + rate(x + h * c))
        return x

    return move


def _fall(x: Array) -> Array:
    """Altitude, ft; speed downwards, ft/s; ballistic parameter, 1/ft."""
    return np.array([-x[1], -np.exp(-5e-5 * x[0]) * x[1] ** 2 * x[2], 0.0 * x[2]])


def _turn(x: Array, t_s: Array, dt: float) -> Array:
    """Position, velocity and turn rate of a coordinated turn."""
    angle = x[4] * dt
    s = dt * np.sinc(angle / np.pi)
    c = np.where(
        np.abs(angle) < 1e-6,
        0.5 * angle * dt,
        (1.0 - np.cos(angle)) / np.where(x[4] == 0.0, 1.0, x[4]),
    )
    return np.array([
        x[0] + s * x[2] - c * x[3], x[1] + c * x[2] + s * x[3],
        np.cos(angle) * x[2] - np.sin(angle) * x[3], np.sin(angle) * x[2] + np.cos(angle) * x[3],
        x[4],
    ])  # fmt: skip


def _orbit(x: Array) -> Array:
    """Plane orbit with GM = 1: position and velocity."""
    return np.concatenate([x[2:], -x[:2] / np.hypot(x[0], x[1]) ** 3])


def _observer(t_s: Array) -> tuple[Array, Array]:
    return 8.0 * np.minimum(t_s, 600.0), 8.0 * np.maximum(t_s - 600.0, 0.0)


def _bearing(x: Array, t_s: Array) -> Array:
    along, across = _observer(t_s)
    return np.arctan2(x[1] - across, x[0] - along)[None]


SPRING = np.sqrt((2.5 + 3.7) / 1.5)


def _spring(x: Array, t_s: Array, dt: float) -> Array:
    c, s = np.cos(SPRING * dt), np.sin(SPRING * dt)
    return np.array([c * x[0] + s / SPRING * x[1], -s * SPRING * x[0] + c * x[1]])


def _ranging(x: Array, t_s: Array) -> Array:
    distance = np.hypot(x[0], 5.4)
    return np.array([distance, x[0] * x[1] / distance])


BEACONS = np.array([[0.0, 0.0], [100.0, 0.0], [40.0, 80.0]])


def _beacons(x: Array, t_s: Array) -> Array:
    return np.array([np.hypot(x[0] - a, x[1] - b) for a, b in BEACONS])


def worlds() -> dict[str, World]:
    """Return the ten problems."""

    def a(*values: float) -> Array:
        return np.array(values, dtype=float)

    none = np.zeros
    return {
        "constant velocity": World(
            _straight, lambda x, t: x[:1], _pushes(1, 1.0, 0.1), a(1.0), a(0.0, 1.0), a(10.0, 2.0),
            _channels("position"), 40,
            settings={
                "nominal": {}, "quiet": {"true_push": 5.0}, "precise": {"true_sigma": 2.0},
                "coloured": {"true_correlation": 0.7},
            },
        ),
        "radar": World(
            _straight, _polar, _pushes(2, 10.0, 0.01), a(10.0, 1e-3), a(8e3, 6e3, -10.0, 5.0),
            a(300.0, 300.0, 5.0, 5.0), (RANGE_BEARING,), 20, 10.0,
            settings={
                "nominal": {}, "quiet": {"true_push": 5.0}, "precise": {"true_sigma": 2.0},
                "long range": {"mean": a(8e4, 6e4, -10.0, 5.0), "spread": a(3e3, 3e3, 5.0, 5.0),
                               "sigma": a(1.0, 2e-2)},
            },
        ),
        "falling body": World(
            _kutta(_fall, 8), lambda x, t: np.hypot(1e5, x[:1] - 1e5), none((3, 0)), a(100.0),
            a(3e5, 2e4, 1e-3), a(1e3, 2e3, 1.5e-4), _channels("range", unit="ft"), 40,
            settings={
                "nominal": {}, "wide": {"spread": a(1e4, 4e3, 2e-4)},
                "precise": {"true_sigma": 2.0}, "biased": {"true_bias": a(500.0)},
            },
        ),
        "univariate growth": World(
            lambda x, t, dt: 0.5 * x + 25.0 * x / (1.0 + x**2) + 8.0 * np.cos(1.2 * t),
            lambda x, t: x**2 / 20.0, a(np.sqrt(10.0))[:, None], a(1.0), a(0.1), a(1.4),
            _channels("z"), 30,
            settings={"nominal": {}, "linear sensor": {"show": lambda x, t: x.copy()}},
        ),
        "bearings only": World(
            _straight, _bearing, none((4, 0)), a(2e-3), a(7e3, 7e3, -3.0, -2.0),
            a(200.0, 200.0, 1.0, 1.0), ((Channel("bearing", "rad", "angle"),),), 40, 30.0,
            settings={
                "nominal": {}, "wide": {"spread": a(2e3, 2e3, 4.0, 4.0)},
                "precise": {"true_sigma": 2.0}, "biased": {"true_bias": a(5e-3)},
            },
        ),
        "spring and mass": World(
            _spring, _ranging, none((2, 0)), a(1.0, 1.0), a(10.0, 2.0), a(1.0, 1.0),
            (( Channel("range", "m"), Channel("range_rate", "m/s")),), 11,
            settings={
                "nominal": {}, "wide": {"spread": a(31.6, 10.0)}, "precise": {"true_sigma": 2.0},
                "quiet": {"push": _pushes(1, 1.0, 0.1), "true_push": 5.0},
            },
        ),
        "van der Pol": World(
            _kutta(lambda x: np.array([x[1], (1.0 - x[0] ** 2) * x[1] - x[0]]), 20),
            lambda x, t: x[:1], _pushes(1, 1.0, 0.02), a(0.1), a(1.0, 0.0), a(0.2, 0.2),
            _channels("position"), 30, 1.0,
            settings={
                "nominal": {}, "wide": {"spread": a(1.0, 1.0)}, "quiet": {"true_push": 5.0},
                "coloured": {"true_correlation": 0.7},
            },
        ),
        "coordinated turn": World(
            _turn, _polar, np.concatenate([
                np.concatenate([_pushes(2, 1.0, 0.1), none((4, 1))], axis=1),
                a(0.0, 0.0, 1e-3)[None],
            ]), a(10.0, 3e-3), a(1000.0, 1000.0, 100.0, 0.0, 0.0), a(30.0, 30.0, 5.0, 5.0, 0.03),
            (RANGE_BEARING,), 40,
            settings={
                "nominal": {}, "wide": {"spread": a(100.0, 100.0, 30.0, 30.0, 0.3)},
                "quiet": {"true_push": 5.0}, "precise": {"true_sigma": 2.0},
            },
        ),
        "pendulum": World(
            lambda x, t, dt: np.array([x[0] + dt * x[1], x[1] - 9.81 * dt * np.sin(x[0])]),
            lambda x, t: np.sin(x[:1]), _pushes(1, 0.05, 0.5), a(0.3), a(1.0, 0.0), a(0.3, 0.3),
            _channels("sine", unit=""), 80, 0.05,
            settings={
                "nominal": {}, "wide": {"spread": a(1.5, 3.0)},
                "accurate": {"sigma": a(0.05), "spread": a(1.0, 2.0)}, "quiet": {"true_push": 5.0},
            },
        ),
        "beacons": World(
            lambda x, t, dt: x.copy(), _beacons, none((2, 0)), a(1.0, 1.0, 1.0), a(60.0, 30.0),
            a(3.0, 3.0), (_channels("near", "right", "top")), 5,
            settings={
                "nominal": {}, "wide": {"spread": a(50.0, 50.0)},
                "wide and precise": {"spread": a(50.0, 50.0), "sigma": a(0.01, 0.01, 0.01)},
                "biased": {"true_bias": a(2.0, 0.0, 0.0)},
            },
        ),
    }  # fmt: skip


def simulate(
    world: World, setting: dict[str, Any], draws: int, seed: int
) -> tuple[World, Belief, list[Array], list[MeasurementSet]]:
    """Return the filter's model, the prior, true states and measurements of a setting."""
    own = {name: value for name, value in setting.items() if not name.startswith("true_")}
    model = World(**{**vars(world), **own})
    random = np.random.default_rng(seed)
    n, m, case = len(model.mean), len(model.sigma), np.arange(draws)
    x = model.mean[:, None] + model.spread[:, None] * random.normal(size=(n, draws))
    prior = Belief.of(
        np.repeat(model.mean[:, None], draws, axis=1),
        np.repeat(np.diag(model.spread**2)[None], draws, axis=0), np.zeros(draws),
    )  # fmt: skip
    push = setting.get("true_push", 1.0) * model.push
    sigma = setting.get("true_sigma", 1.0) * model.sigma[:, None]
    memory = setting.get("true_correlation", 0.0)
    bias = setting.get("true_bias", np.zeros(m))[:, None]
    error = random.normal(size=(m, draws))
    truth, sets = [], []
    for k in range(model.steps):
        t_s = np.full(draws, k * model.dt)
        if k:
            x = model.advance(x, t_s - model.dt, t_s, np.zeros((0, draws)), case)
            x = x + push @ random.normal(size=(push.shape[1], draws))
            fresh = random.normal(size=(m, draws))
            error = memory * error + np.sqrt(1.0 - memory**2) * fresh
        z = model.observe(x, t_s, case) + bias + sigma * error
        truth.append(x)
        sets.append(MeasurementSet.of(t_s, z, model.sigma[:, None], model.blocks))
    return model, prior, truth, sets


def run_filter(
    estimator: Any, model: Any, prior: Belief, truth: list[Array], sets: list[MeasurementSet]
) -> Run:
    """Run a filter over the measurements."""
    nothing = np.zeros((0, len(prior.t_s)))
    belief, before, after, innovations = prior, [], [], []
    for measured in sets:
        if not np.array_equal(belief.t_s, measured.t_s):
            belief = estimator.predict(model, belief, measured.t_s, nothing)
        before.append(belief)
        belief, innovation = estimator.update(model, belief, measured)
        after.append(belief)
        innovations.append(innovation)
    return Run(model, prior, sets, truth, before, after, innovations)


def runs(
    draws: int = TRUE_DRAWS, names: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, str, str], Run]]:
    """Yield every run with the names of its problem, setting and estimator."""
    for number, (name, world) in enumerate(worlds().items()):
        if names and name not in names:
            continue
        for count, (label, setting) in enumerate(world.settings.items()):
            problem = simulate(world, setting, draws, 1000 * number + count)
            for called, (type_, keys) in ESTIMATORS.items():
                try:
                    with np.errstate(all="ignore"):
                        run = run_filter(create("estimator", type_, **keys), *problem)
                except (HillsphereError, np.linalg.LinAlgError):
                    continue  # the filter itself has refused: no run
                yield (name, label, called), run


@dataclass
class Score:
    """Counts of runs."""

    overconfident: int = 0
    detected: int = 0
    nis: int = 0
    others: int = 0
    false: int = 0
    false_nis: int = 0
    in_wide_band: int = 0

    def add(self, over: bool, alarm: bool, nis: bool) -> None:
        """Count a run."""
        if over:
            self.overconfident += 1
            self.detected += alarm
            self.nis += nis
        else:
            self.others += 1
            self.false += alarm
            self.false_nis += nis


ALARMS = ("overconfident", "not linear enough here")


def score(names: tuple[str, ...] = (), *, show: bool = False) -> Score:
    """Return the counts over all runs."""
    total = Score()
    for names_of_run, run in runs(TRUE_DRAWS, names):
        with np.errstate(all="ignore"):
            seen = run.first(DRAWS)
            over, nis, judged = run.is_overconfident(), seen.nis_alarm(), seen.judge()
            total.in_wide_band += over and not seen.is_overconfident()
        alarm = judged.answer in ALARMS
        total.add(over, alarm, nis)
        if show:
            values = run.true_nees()
            n = len(run.prior.x)
            mark = "" if alarm == over else ("MISS" if over else "FALSE")
            print(
                f"{' / '.join(names_of_run):58} nees {values[-1].mean() / n:9.3g} "
                f"{values.mean() / n:9.3g} {'over' if over else 'ok':5} nis {int(nis)} "
                f"{judged.answer:24} "
                + " ".join(
                    f"{c.name} {c.value:.3g}" for c in judged.checks.values() if c.above or c.below
                )
                + f" {mark}", flush=True,
            )  # fmt: skip
    return total


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py: of two problems, with --long of all ten."""
    long = LONG in os.environ
    total = score(() if long else ("constant velocity", "beacons"))
    end = "_long" if long else ""
    return {
        f"overconfident_runs{end}": total.overconfident,
        f"detected_share{end}": total.detected / total.overconfident,
        f"detected_by_nis_share{end}": total.nis / total.overconfident,
        f"false_alarm_share{end}": total.false / total.others,
    }


if __name__ == "__main__":
    print(score(names=tuple(sys.argv[1:]), show=True))
