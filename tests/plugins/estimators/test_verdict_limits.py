"""Where the verdict's tests hold: angles, exact states, mixtures, curvature, coloured errors.

Each case has a twin, or a value, that is derived without the verdict.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import Linear, nothing

from hillsphere import create
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel
from hillsphere_estimators.chi_square_tests import Check, expected_check
from hillsphere_estimators.consistency import nees, verdict
from hillsphere_estimators.decision import Circumstances, decide
from hillsphere_estimators.remainders import motion_curvature, update_curvature
from hillsphere_estimators.verdict import Verdict

MEASURES = ("curvature", "path", "posterior_curvature", "motion", "coloured_nees")


def fly(
    model: Any, prior: Belief, sigma: float, steps: int, *, type_: str = "unscented",
    correlation: float = 0.0, offset: Array | float = 0.0, seed: int = 1, **keys: Any,
) -> tuple[Verdict, list[Array]]:  # fmt: skip
    """Run a filter on its own model; return the verdict and the NEES (N,) after each set."""
    random, estimator = np.random.default_rng(seed), create("estimator", type_, **keys)
    n, cases = prior.x.shape
    x = prior.x + (prior.root @ random.normal(size=(cases, n, 1)))[:, :, 0].T + offset
    sets, after, innovations, errors = [], [], [], []
    now, error = prior, np.zeros(0)
    for k in range(steps):
        t_s = np.full(cases, float(k))
        if k:
            noise = model.process_noise(x, t_s - 1.0, t_s, nothing(cases))
            push = noise @ random.normal(size=(cases, noise.shape[2], 1))
            x = model.advance(x, t_s - 1.0, t_s, nothing(cases), None) + push[:, :, 0].T
            now = estimator.predict(model, now, t_s, nothing(cases))
        z = model.observe(x, t_s, None)
        fresh = random.normal(size=z.shape)
        error = correlation * error + np.sqrt(1.0 - correlation**2) * fresh if k else fresh
        sets.append(
            MeasurementSet.of(t_s, z + sigma * error, np.full((len(z), 1), sigma), model.blocks)
        )
        now, innovation = estimator.update(model, now, sets[-1])
        after.append(now)
        innovations.append(innovation)
        errors.append(nees(now, x, angles=getattr(model, "angles", ())))
    return verdict(model, prior, sets, after, innovations), errors


def belief(mean: tuple[float, ...], sigma: tuple[float, ...], cases: int) -> Belief:
    x = np.repeat(np.array(mean)[:, None], cases, axis=1)
    return Belief.of(x, np.repeat(np.diag(np.square(sigma))[None], cases, axis=0), np.zeros(cases))


class Heading:
    """A direction that turns at a slowly changing rate, and is measured; both wrapped."""

    blocks = ((Channel("heading", "rad", "angle"),),)
    angles = (0,)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Any) -> Array:
        return np.array([np.angle(np.exp(1j * (x[0] + (t1_s - t0_s) * x[1]))), x[1]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.repeat(np.diag([0.05, 0.01])[None], x.shape[1], axis=0)

    def observe(self, x: Array, t_s: Array, case: Any) -> Array:
        return np.asarray(np.angle(np.exp(1j * x[:1])))


def test_a_turn_of_all_directions_changes_no_verdict() -> None:
    # rotated by 3 rad the same draws are the same problem: every statistic must be the same
    checks = []
    for start in (0.1, 3.1):
        judged, _ = fly(Heading(), belief((start, 0.0), (0.3, 0.05), 40), 0.1, 10)
        assert judged.answer == "consistent", judged.reason
        checks.append({name: check.value for name, check in judged.checks.items()})
    assert checks[0].keys() == checks[1].keys()
    for name, value in checks[0].items():
        assert checks[1][name] == pytest.approx(value, rel=1e-6, abs=1e-8, nan_ok=True), name


def test_turns_are_no_curvature() -> None:
    at = belief((3.1, 0.0), (0.3, 0.05), 1)
    assert motion_curvature(Heading(), at, np.ones(1), nothing(1)).rms[0] < 1e-6
    measured = MeasurementSet.of(np.zeros(1), -3.1 * np.ones((1, 1)), np.full((1, 1), 0.1),
                                 Heading.blocks)  # fmt: skip
    after = Belief(np.array([[-3.1], [0.0]]), 0.5 * at.root, at.t_s)
    curve = update_curvature(Heading(), at, after, measured)
    assert max(curve.prior.max(), curve.path.max(), curve.posterior.max()) < 1e-6


def check(name: str, value: float, high: float = 1.1, low: float = 0.9) -> Check:
    one = np.ones(1)
    return Check(name, "statistic", value, low, high, value * one, low * one, high * one)


def test_words_and_answer_come_from_the_same_tests() -> None:
    names = ("nis", "late_nis", "slow_nis", "mean", "whiteness", "fit_nis", "fit_late_nis",
             "fit_slow_nis", "fit_bias", "fit_whiteness", "final_nees", "mean_nees")  # fmt: skip
    good = {name: check(name, 1.0) for name in names}
    straight = Circumstances(curved=False, explained=True)
    found = decide(good, None, straight)
    assert (found.answer, found.reason) == ("consistent", "no test fails its limit")
    # innovations that curvature disturbs are named; without curvature nothing excuses them
    bad = good | {"nis": check("nis", 2.0)}
    bent = decide(bad, None, Circumstances(curved=True, explained=True, place="the update"))
    assert bent.answer == "consistent"
    assert "nis: statistic 2" in bent.reason
    contradicting = decide(bad, None, straight)
    assert contradicting.answer == "undecided"
    assert "nis: statistic 2" in contradicting.reason
    # a band in which errors twice as large would pass is none
    short = decide(good | {"nis": check("nis", 1.0, high=12.0)}, None, straight)
    assert short.answer == "undecided"
    assert "too few measurements" in short.reason
    # the expected NEES was not tested: the answer says so
    lost = good["final_nees"]
    unfitted = good | {"final_nees": Check(
        "final_nees", "", np.nan, np.nan, np.nan, *(np.full(1, np.nan),) * 3, "no fit has settled"
    )}  # fmt: skip
    assert lost.value == 1.0
    silent = decide(unfitted, None, straight)
    assert (silent.answer, "no fit has settled" in silent.reason) == ("undecided", True)


OFFSET = Linear(
    np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    np.array([[0.1], [0.2], [0.0]]), np.array([[1.0, 0.0, 1.0]]),
)  # fmt: skip
"""Position, velocity, and the offset of the position's measurement."""
PLAIN = Linear(np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.1], [0.2]]), np.array([[1.0, 0.0]]))


def test_a_state_that_is_known_exactly_is_left_out() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        whole, _ = fly(PLAIN, belief((0.0, 1.0), (1.0, 0.5), 40), 1.0, 12)
    # the same innovations, from a model with one more state that has no variance
    estimator = create("estimator", "unscented")
    random = np.random.default_rng(4)
    judged = []
    for model, prior in (
        (PLAIN, belief((0.0, 1.0), (1.0, 0.5), 40)),
        (OFFSET, belief((0.0, 1.0, 3.0), (1.0, 0.5, 0.0), 40)),
    ):
        random = np.random.default_rng(4)
        shift = 3.0 if model is OFFSET else 0.0
        now, sets, after, innovations = prior, [], [], []
        for k in range(12):
            t_s = np.full(40, float(k))
            z = k + shift + np.sqrt(1.0 + k) * random.normal(size=(1, 40))
            sets.append(MeasurementSet.of(t_s, z, np.ones((1, 1)), model.blocks))
            now = estimator.predict(model, now, t_s, nothing(40)) if k else now
            now, innovation = estimator.update(model, now, sets[-1])
            after.append(now)
            innovations.append(innovation)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            judged.append(verdict(model, prior, sets, after, innovations))
    assert judged[1].answer == judged[0].answer
    for name in ("nis", "fit_nis", "fit_bias", "final_nees", "mean_nees"):
        two, three = (one.checks[name] for one in judged)
        assert not three.reason
        assert three.value == pytest.approx(two.value, rel=1e-6)
        assert three.high == pytest.approx(two.high, rel=1e-9)
    assert whole.answer == "consistent"


def test_an_offset_that_is_only_believed_to_be_known_is_overconfident() -> None:
    prior = belief((0.0, 1.0, 0.0), (1.0, 0.5, 0.0), 40)
    judged, errors = fly(OFFSET, prior, 1.0, 12, offset=np.array([[0.0], [0.0], [5.0]]))
    assert not np.isfinite(errors[-1]).any()
    assert judged.answer == "overconfident"


def test_where_all_is_known_nothing_is_judged_and_it_says_so() -> None:
    still = Linear(np.eye(1), np.zeros((1, 1)), np.eye(1))
    judged, _ = fly(still, belief((1.0,), (0.0,), 20), 1.0, 8)
    assert judged.answer == "undecided"
    assert "all states are known exactly" in judged.reason


@pytest.mark.parametrize("steps", [1, 3])
def test_one_case_of_few_measurements_is_undecided(steps: int) -> None:
    judged, _ = fly(PLAIN, belief((0.0, 1.0), (1.0, 0.5), 1), 1.0, steps)
    assert judged.answer == "undecided"
    assert judged.cases == ("undecided",)


class Cube(Linear):
    """A slowly moving state whose cube is measured."""

    def __init__(self) -> None:
        super().__init__(np.eye(1), np.array([[0.1]]), np.eye(1))

    def observe(self, x: Array, t_s: Array, case: Any) -> Array:
        return x**3

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        return (3.0 * x**2).T[:, :, None]


def test_curvature_is_no_constant_error() -> None:
    judged, _ = fly(Cube(), belief((0.5,), (1.0,), 60), 0.3, 12, update="iterated")
    # the model is right, and the measurements have no constant error
    assert not judged.checks["fit_bias"].above
    assert judged.answer != "overconfident", judged.reason


def test_correlated_errors_are_told_from_those_that_harm() -> None:
    # a state that is driven anew at each step is estimated from its own measurement alone: its
    # errors are those that are stated, whatever their correlation
    lively = Linear(np.zeros((1, 1)), np.array([[2.0]]), np.eye(1))
    judged, errors = fly(lively, belief((0.0,), (2.0,), 100), 1.0, 30, correlation=0.7)
    assert np.mean(errors) < 1.1
    assert judged.checks["fit_slow_nis"].above
    assert judged.checks["coloured_nees"].value == pytest.approx(1.0, abs=1e-6)
    assert judged.answer == "undecided"
    assert "correlated" in judged.reason
    # a smooth one is averaged over many, and the average is worse than stated
    smooth = Linear(np.eye(1), np.array([[0.2]]), np.eye(1))
    judged, errors = fly(smooth, belief((0.0,), (1.0,), 100), 1.0, 30, correlation=0.7)
    assert np.mean(errors) > 1.5
    assert judged.answer == "overconfident"
    # what is computed from the innovations is what the true states show
    assert judged.checks["coloured_nees"].value == pytest.approx(
        max(np.mean(errors), np.mean(errors[-1])), rel=0.15
    )


def test_mixtures_are_judged_by_their_spread() -> None:
    # squares with a spread far above that of χ²: one in twenty is 20 times as large as the others
    random, mixed = np.random.default_rng(2), np.ones(400, dtype=bool)
    squares = np.where(random.random(400) < 0.05, 10.0, 10.0 / 19.0 * 0.999)
    dof = np.ones(400)
    assert expected_check("nees", "", squares, dof, 5e-4, ~mixed).high < 1.3
    wide = expected_check("nees", "", squares, dof, 5e-4, mixed)
    # Student's limit of 399 degrees of freedom is 3.32 standard deviations of the mean
    assert wide.high == pytest.approx(1.0 + 3.32 * squares.std() / 20.0, rel=0.01)
    assert np.isnan(wide.each).all()
    few = expected_check("nees", "", squares[:9], dof[:9], 5e-4, mixed[:9])
    assert "9 cases of mixtures are too few" in str(few)


class Aside(Cube):
    """A slowly moving state on a line, and its distance from a place beside it: two solutions."""

    def observe(self, x: Array, t_s: Array, case: Any) -> Array:
        return np.hypot(x, 3.0)

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        return (x / np.hypot(x, 3.0)).T[:, :, None]


@pytest.mark.parametrize("mean, sigma", [(0.3, 0.1), (1.0, 0.3)])
def test_a_sound_mixture_raises_no_alarm(mean: float, sigma: float) -> None:
    judged, errors = fly(Aside(), belief((mean,), (4.0,), 60), sigma, 8, type_="gaussian_sum")
    assert np.mean(errors) < 1.1
    assert judged.answer == "consistent", judged.reason
    assert set(judged.cases) <= {"consistent", "undecided"}


def test_an_unsound_mixture_is_named() -> None:
    # the true noise is five times the stated one
    model, estimator = Aside(), create("estimator", "gaussian_sum")
    random = np.random.default_rng(1)
    now = prior = belief((0.3,), (4.0,), 60)
    x = prior.x + 4.0 * random.normal(size=(1, 60))
    sets, after, innovations = [], [], []
    for k in range(8):
        t_s = np.full(60, float(k))
        z = model.observe(x, t_s, None) + 0.5 * random.normal(size=x.shape)
        sets.append(MeasurementSet.of(t_s, z, np.full((1, 1), 0.1), model.blocks))
        now = estimator.predict(model, now, t_s, nothing(60)) if k else now
        now, innovation = estimator.update(model, now, sets[-1])
        after.append(now)
        innovations.append(innovation)
    assert nees(now, x).mean() > 1.3
    judged = verdict(model, prior, sets, after, innovations)
    assert judged.answer in ("overconfident", "not linear enough here"), judged.reason
