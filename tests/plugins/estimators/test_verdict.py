"""The verdict on a filter's run: its tests against closed forms, and on filters known to be wrong.

The benchmark ``bench_consistency`` counts detections and false alarms on ten problems; here stand
the pieces, whose values are derived, and one run of each answer.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Linear, nothing

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, Channel
from hillsphere_estimators.checks import OF_FILTER, innovation_checks
from hillsphere_estimators.consistency import chi_square_band, nees, verdict
from hillsphere_estimators.refit import refit
from hillsphere_estimators.remainders import CURVED, motion_curvature, update_curvature
from hillsphere_estimators.verdict import Verdict

CASES, STEPS = 60, 16


class Curve:
    """One still state and two measurements: a x + b x² and, of two states, their product."""

    blocks = ((Channel("square", "m"), Channel("product", "m")),)

    def __init__(self, a: float, b: float) -> None:
        self.a, self.b = a, b

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Any) -> Array:
        return np.array([x[0] + self.b * (t1_s - t0_s) * x[0] ** 2, x[1]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], 2, 0))

    def observe(self, x: Array, t_s: Array, case: Any) -> Array:
        return np.array([self.a * x[0] + self.b * x[0] ** 2, x[0] * x[1]])


class Ranging(Linear):
    """A mass at constant velocity with random pushes, and its distance from 3 m off its line."""

    def __init__(self, push: float) -> None:
        F = np.array([[1.0, 1.0], [0.0, 1.0]])
        super().__init__(F, push * np.array([[0.5], [1.0]]), np.array([[1.0, 0.0]]))


def belief(sigma: tuple[float, ...], mean: tuple[float, ...], cases: int = 1) -> Belief:
    spread = np.diag(np.array(sigma) ** 2)
    x = np.repeat(np.array(mean, dtype=float)[:, None], cases, axis=1)
    return Belief.of(x, np.repeat(spread[None], cases, axis=0), np.zeros(cases))


def fly(
    model: Any, truth: Any, sigma: float, prior: Belief, estimator: Any, *, seed: int = 1,
    error: float = 0.0,
) -> tuple[Verdict, Array]:  # fmt: skip
    """Run a filter with one model on the measurements of another; return verdict and last NEES."""
    random = np.random.default_rng(seed)
    n, cases = prior.x.shape
    x = prior.x + (prior.root @ random.normal(size=(cases, n, 1)))[:, :, 0].T
    sets, after, before, innovations = [], [], [], []
    now = prior
    for k in range(STEPS):
        t_s = np.full(cases, float(k))
        if k:
            noise = truth.process_noise(x, t_s - 1.0, t_s, nothing(cases))
            push = noise @ random.normal(size=(cases, noise.shape[2], 1))
            x = truth.advance(x, t_s - 1.0, t_s, nothing(cases), None) + push[:, :, 0].T
            now = estimator.predict(model, now, t_s, nothing(cases))
        z = truth.observe(x, t_s, None)
        z = z + sigma * random.normal(size=z.shape) + error
        sets.append(MeasurementSet.of(t_s, z, np.full((len(z), 1), 1.0), model.blocks))
        before.append(now)
        now, innovation = estimator.update(model, now, sets[-1])
        after.append(now)
        innovations.append(innovation)
    judged = verdict(model, prior, sets, after, innovations, before=before)
    return judged, nees(after[-1], x)


def test_curvature_of_a_square_is_that_of_the_normal_distribution() -> None:
    # h = a x + b x² about the mean 0: the remainder b x² has the mean b s² and, on points at ±√n s
    # in either frame, the mean square of a quadratic form; the exact one is 3 b² s⁴
    model, s, b, sigma = Curve(2.0, 0.5), 1.5, 0.5, 0.2
    before = belief((s, 0.1), (0.0, 0.0))
    measured = MeasurementSet.of(
        np.zeros(1), np.zeros((2, 1)), np.full((2, 1), sigma), model.blocks
    )
    curve = update_curvature(model, before, before, measured)
    innovation = np.sqrt((2.0 * s) ** 2 + sigma**2)
    assert curve.shift[0, 0] == pytest.approx(b * s**2 / innovation, rel=1e-9)
    # the points along the axes give 2 b² s⁴, those turned by 45° b² s⁴: their mean is half the 3
    assert curve.prior[0, 0] * sigma == pytest.approx(b * s**2 * np.sqrt(1.5), rel=1e-9)
    # a linear function of x has none; its variance is that of the linearisation
    straight = update_curvature(Curve(2.0, 0.0), before, before, measured)
    assert straight.prior[0, 0] < 1e-9
    assert straight.ratio[0, 0] == pytest.approx(1.0, abs=1e-9)


def test_curvature_of_a_product_is_seen() -> None:
    # x y about (0, 0) has no derivatives there, and the variance s² t²; points along the axes alone
    # give zero
    model, s, t = Curve(1.0, 0.0), 2.0, 3.0
    measured = MeasurementSet.of(np.zeros(1), np.zeros((2, 1)), np.ones((2, 1)), model.blocks)
    at = belief((s, t), (0.0, 0.0))
    curve = update_curvature(model, at, at, measured)
    # of the points turned by 45° all four have (x y)² = s² t², of the others none
    assert curve.prior[1, 0] == pytest.approx(s * t * np.sqrt(0.5), rel=1e-9)


def test_path_of_an_update_is_its_remainder() -> None:
    model = Curve(1.0, 0.5)
    before, after = belief((1.0, 1.0), (0.0, 0.0)), belief((0.1, 0.1), (3.0, 0.0))
    measured = MeasurementSet.of(np.zeros(1), np.zeros((2, 1)), np.full((2, 1), 0.5), model.blocks)
    # from 0 to 3 the square departs from its tangent by 0.5 · 9 m, that is nine standard deviations
    assert update_curvature(model, before, after, measured).path[0, 0] == pytest.approx(9.0)


def test_curvature_of_the_motion_is_in_units_of_the_prediction() -> None:
    # x' = x + b x² about 0: remainder b x², predicted standard deviation s
    s, b = 1.5, 0.4
    bent = motion_curvature(Curve(1.0, b), belief((s, 1.0), (0.0, 0.0)), np.ones(1), nothing(1))
    assert bent.rms[0] == pytest.approx(b * s * np.sqrt(1.5), rel=1e-9)
    assert bent.shift[0] == pytest.approx(b * s, rel=1e-9)


def white(count: int, cases: int, rows: int, seed: int = 3) -> list[Innovation]:
    random = np.random.default_rng(seed)
    root = np.array([[2.0, 0.0], [1.0, 0.5]])[:rows, :rows]
    covariance = np.repeat((root @ root.T)[None], cases, axis=0)
    used = np.ones((rows, cases), dtype=bool)
    made = []
    for _ in range(count):
        unit = random.normal(size=(rows, cases))
        made.append(Innovation(root @ unit, covariance, used, np.sum(unit**2, axis=0)))
    return made


def test_limits_hold_for_white_innovations_and_are_exceeded_at_their_rate() -> None:
    # 2000 cases, each limit at a share of 1 %: 20 are expected beyond, 99.9 % of times 8 to 36
    cases = 2000
    checks = innovation_checks(white(20, cases, 2), 0.01, np.ones(cases, bool), True, 2, OF_FILTER)
    rate = {check.name: int(check.each_above.sum()) for check in checks}
    assert all(8 <= rate[name] <= 36 for name in ("nis", "late_nis", "mean"))
    # correlations at few lags of short runs are less than χ² in the tail, windows in Bonferroni's
    assert all(rate[name] <= 36 for name in ("slow_nis", "whiteness"))
    assert not any(check.above or check.below for check in checks)


def test_a_linear_filter_with_its_true_model_is_consistent() -> None:
    model = Ranging(0.2)
    prior = belief((5.0, 1.0), (0.0, 1.0), CASES)
    judged, _ = fly(model, model, 1.0, prior, create("estimator", "unscented"))
    assert judged.answer == "consistent"
    assert judged.nonlinear is None
    assert judged.cases.count("consistent") >= CASES - 3
    # the fit at the last set is the filter's own estimate: the expected NEES is that of its states
    assert judged.checks["final_nees"].value == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("wrong", ["process noise", "measurement noise", "constant error"])
def test_a_wrong_model_is_overconfident(wrong: str) -> None:
    model = Ranging(0.2 if wrong != "process noise" else 0.04)
    prior = belief((5.0, 1.0), (0.0, 1.0), CASES)
    if wrong == "constant error":
        # of a position that is measured nothing tells a constant error: of a known one it does
        prior = belief((0.5, 0.5), (0.0, 1.0), CASES)
    judged, errors = fly(
        model, Ranging(0.2), 2.0 if wrong == "measurement noise" else 1.0, prior,
        create("estimator", "unscented"), error=2.0 if wrong == "constant error" else 0.0,
    )  # fmt: skip
    assert errors.mean() / 2.0 > 1.5
    assert judged.answer == "overconfident"
    named = {"process noise": "slow_nis", "measurement noise": "nis", "constant error": "fit_bias"}
    assert judged.checks[named[wrong]].above
    assert named[wrong].split("_")[0] in judged.reason


def test_too_much_process_noise_is_underconfident() -> None:
    prior = belief((5.0, 1.0), (0.0, 1.0), CASES)
    judged, errors = fly(Ranging(2.0), Ranging(0.1), 1.0, prior, create("estimator", "unscented"))
    assert errors.mean() / 2.0 < 0.8
    assert judged.answer == "underconfident"


class Beacons:
    """A place in the plane that stands still, and its distances from three beacons."""

    blocks = tuple((Channel(name, "m"),) for name in ("near", "right", "top"))
    places = np.array([[0.0, 0.0], [100.0, 0.0], [40.0, 80.0]])

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Any) -> Array:
        return x

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], 2, 0))

    def observe(self, x: Array, t_s: Array, case: Any) -> Array:
        return np.array([np.hypot(x[0] - a, x[1] - b) for a, b in self.places])


def test_a_wide_prior_is_not_linear_enough_for_one_linear_update() -> None:
    model = Beacons()
    prior = belief((50.0, 50.0), (60.0, 30.0), CASES)
    linear, errors = fly(
        model, model, 1.0, prior, create("estimator", "iterated_extended", iterations=1)
    )
    assert errors.mean() > 20.0
    assert linear.answer == "not linear enough here"
    first = linear.nonlinear
    assert first is not None
    assert (first.index, first.time_s, first.cases) == (0, 0.0, CASES)
    assert first.channel in ("near", "right", "top")
    assert first.size > 10.0 * CURVED
    assert f"t = 0 s with {first.channel}" in linear.reason
    assert "final_nees" in linear.reason
    # the same measurements with the update iterated: as curved, but consistent
    good, errors = fly(
        model, model, 1.0, prior, create("estimator", "unscented", update="iterated")
    )
    assert errors.mean() < 3.0
    assert good.answer == "consistent"
    assert good.nonlinear is not None


def test_two_solutions_are_found_and_weighed() -> None:
    # the distance from the origin of a place on a line: ±4 fit equally well about a prior of zero
    # mean, so that a filter that has decided for one has an expected NEES of ½ (8/σ)² and more
    class Line(Beacons):
        blocks = ((Channel("range", "m"),),)

        def observe(self, x: Array, t_s: Array, case: Any) -> Array:
            return np.hypot(x[:1], 3.0)

    model = Line()
    prior = belief((4.0, 1.0), (0.3, 0.0))
    exact = np.array([[5.0]])
    sets = [
        MeasurementSet.of(np.full(1, float(k)), exact, np.full((1, 1), 0.1), model.blocks)
        for k in range(3)
    ]
    decided = belief((0.1, 1.0), (4.0, 0.0))
    after = [replace(decided, t_s=m.t_s) for m in sets]
    found = refit(model, prior, sets, after, [nothing(1)] * 3)
    assert found.solutions[0] == 2
    # weights by the prior: (4 − 0.3)² and (4 + 0.3)² over 16 differ by 0.3
    assert found.weight[0] == pytest.approx(1.0 / (1.0 + np.exp(-0.15)), abs=0.01)
    assert found.expected[-1, 0] == pytest.approx((1.0 - found.weight[0]) * 80.0**2, rel=0.05)


def test_without_a_fit_the_innovations_decide_and_it_says_why() -> None:
    model = Ranging(0.2)
    prior = belief((5.0, 1.0), (0.0, 1.0), 3)
    sets = [
        MeasurementSet.of(
            np.full(3, float(k)), np.full((1, 3), k + 0.1), np.ones((1, 1)), model.blocks
        )
        for k in range(4)
    ]
    estimator, now = create("estimator", "unscented"), prior
    after, innovations = [], []
    for k, measured in enumerate(sets):
        now = estimator.predict(model, now, measured.t_s, nothing(3)) if k else now
        now, innovation = estimator.update(model, now, measured)
        after.append(now)
        innovations.append(innovation)
    judged = verdict(model, prior, sets, after, innovations, fit=False)
    assert judged.fit is None
    assert "it was not asked for" in str(judged.checks["final_nees"])
    assert judged.answer in ("consistent", "underconfident")
    # a belief that is not finite is no ground for a verdict on its case
    broken = Belief(np.where([True, False, False], np.nan, now.x), now.root, now.t_s)
    lost = verdict(model, prior, sets, [*after[:-1], broken], innovations)
    assert lost.cases[0] == "undecided"
    assert "1 cases are not finite" in lost.reason
    with pytest.raises(InputError, match="one entry for each of 4 sets"):
        verdict(model, prior, sets, after[:-1], innovations)
    with pytest.raises(InputError, match="at least one set"):
        verdict(model, prior, [], [], [])
    with pytest.raises(InputError, match="level must lie"):
        verdict(model, prior, sets, after, innovations, level=1.0)


WIDE = Path(__file__).parents[3] / "benchmarks" / "wide_priors.py"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "draws", "channel"),
    [
        ("spring_mass", 60, "range"),
        ("bearings_only", 60, "bearing"),
        ("low_earth_orbit", 8, "range"),
    ],
)
@pytest.mark.parametrize(
    ("type_", "keys"),
    [
        ("iterated_extended", {"iterations": 1}),
        ("iterated_extended", {}),
        ("unscented", {}),
        ("unscented", {"update": "iterated"}),
    ],
)
def test_overconfident_filters_of_wide_priors_are_told_so(
    problem: str, draws: int, channel: str, type_: str, keys: dict[str, Any]
) -> None:
    """Every one that is overconfident in truth, with the first curved update and its channel."""
    spec = spec_from_file_location("wide_priors", WIDE)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules["wide_priors"] = module
    spec.loader.exec_module(module)
    scenario = getattr(module, problem)(draws)
    estimator, belief, none = create("estimator", type_, **keys), scenario.prior, nothing(draws)
    before, after, innovations, errors = [], [], [], []
    for measured, x in zip(scenario.sets, scenario.truth, strict=True):
        if not np.array_equal(belief.t_s, measured.t_s):
            belief = estimator.predict(scenario.model, belief, measured.t_s, none)
        before.append(belief)
        belief, innovation = estimator.update(scenario.model, belief, measured)
        after.append(belief)
        innovations.append(innovation)
        errors.append(nees(belief, x))
    judged = verdict(
        scenario.model, scenario.prior, scenario.sets, after, innovations, before=before
    )
    high = float(chi_square_band(len(belief.x), draws)[1])
    if errors[-1].mean() > high or np.mean(errors) > high:
        assert judged.answer == "not linear enough here"
    first = judged.nonlinear
    assert first is not None
    assert (first.channel, first.index) == (channel, 0)
    assert first.size > 5.0
