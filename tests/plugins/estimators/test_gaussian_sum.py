"""Estimators with Gaussian mixtures: their parts, and wide priors where others are inconsistent."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel, Integers
from hillsphere_estimators.batch_gaussian_sum import batch_gaussian_sum
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.curvature import curved_points, expand
from hillsphere_estimators.mixture import Mixture, MixtureBelief, find_modes

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture(name="scenarios")
def scenarios_fixture(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the module of the scenarios."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    sys.modules.pop("wide_priors", None)
    return importlib.import_module("wide_priors")


def run(scenario: Any, name: str, **parameters: Any) -> list[Belief]:
    """Return the beliefs after each time."""
    estimator, belief, beliefs = create("estimator", name, **parameters), scenario.prior, []
    for measured in scenario.sets:
        if (measured.t_s != belief.t_s).any():
            belief = estimator.predict(scenario.model, belief, measured.t_s, scenario.nothing())
        belief, _ = estimator.update(scenario.model, belief, measured)
        beliefs.append(belief)
    return beliefs


def is_consistent(belief: Belief, truth: Array) -> bool:
    """Return whether the mean NEES over all cases lies in its 99.9 % band."""
    n, cases = truth.shape
    low, high = chi_square_band(n, cases, 0.999)
    return bool(low <= nees(belief, truth).mean() <= high)


def random_mixture(cases: int, parts: int, n: int) -> Mixture:
    """Return mixtures with as many components in each case."""
    random = np.random.default_rng(5)
    many = cases * parts
    weight = random.uniform(0.1, 1.0, many)
    root = np.tril(random.normal(size=(many, n, n))) + 2.0 * np.eye(n)
    mixture = Mixture(
        np.repeat(np.arange(cases), parts), weight, 3.0 * random.normal(size=(n, many)), root
    )
    return mixture.normalised()


# -- parts -----------------------------------------------------------------------------------------


def test_moments_are_those_of_the_density() -> None:
    """Mean Σ w μ and covariance Σ w (P + μ μᵀ) − mean meanᵀ, by their definition."""
    mixture = random_mixture(3, 4, 2)
    belief = mixture.moments(np.zeros(3))
    for case in range(3):
        own = mixture.owner == case
        w, mu = mixture.weight[own], mixture.x[:, own]
        mean = mu @ w
        second = np.einsum("j,jab,jcb->ac", w, mixture.root[own], mixture.root[own])
        second += (w * mu) @ mu.T - np.outer(mean, mean)
        assert belief.x[:, case] == pytest.approx(mean, rel=1e-12)
        assert belief.covariance[case] == pytest.approx(second, rel=1e-12)


def test_splitting_and_merging_keep_mean_and_covariance() -> None:
    """The parts of a split component have its mean and covariance to rounding."""
    mixture = random_mixture(3, 2, 3)
    before = mixture.moments(np.zeros(3))
    along = np.random.default_rng(2).normal(size=(2, 3))
    along /= np.linalg.norm(along, axis=1)[:, None]
    for changed in (
        mixture.split(np.array([1, 4]), along),
        mixture.merge_close(4.0),
    ):
        after = changed.moments(np.zeros(3))
        assert after.x == pytest.approx(before.x, abs=1e-12)
        assert after.covariance == pytest.approx(before.covariance, rel=1e-12, abs=1e-12)
        assert np.bincount(changed.owner, changed.weight) == pytest.approx(1.0)
    assert len(mixture.split(np.array([1, 4]), along).owner) == 6 + 2 * 6
    assert len(mixture.merge_close(4.0).owner) < 6


def test_a_split_component_has_its_own_density() -> None:
    """The seven parts differ from the standard normal density by 6.5e-3 of its largest value."""
    one = Mixture(np.zeros(1, dtype=int), np.ones(1), np.zeros((1, 1)), np.ones((1, 1, 1)))
    parts = one.split(np.array([0]), np.ones((1, 1)))
    grid = np.linspace(-4.0, 4.0, 401)[:, None]
    sigma = parts.root[:, 0, 0]
    heights = parts.weight / sigma * np.exp(-0.5 * ((grid - parts.x[0]) / sigma) ** 2)
    assert heights.sum(axis=1) == pytest.approx(np.exp(-0.5 * grid[:, 0] ** 2), abs=7e-3)


def test_expansion_of_a_quadratic_function_is_exact() -> None:
    """H = bᵀx + xᵀAx/2: L = Sᵀ(b + A μ), C = Sᵀ A S, with the products of two states."""
    random = np.random.default_rng(3)
    A = random.normal(size=(3, 3))
    A, b = A + A.T, random.normal(size=3)
    root = np.tril(random.normal(size=(1, 3, 3)))
    belief = Belief(random.normal(size=(3, 1)), root, np.zeros(1))
    points = curved_points(belief)
    h = np.einsum("a,akN->kN", b, points) + 0.5 * np.einsum("akN,ab,bkN->kN", points, A, points)
    shift, linear, bent = expand(h[None, 1:] - h[None, :1], 3)
    S, C = root[0], root[0].T @ A @ root[0]
    assert linear[0, :, 0] == pytest.approx(S.T @ (b + A @ belief.x[:, 0]), abs=1e-12)
    assert shift[0, 0] == pytest.approx(0.5 * np.trace(C), abs=1e-12)
    # the variance that curvature adds is tr(C C)/2
    assert np.sum(bent**2) == pytest.approx(0.5 * np.trace(C @ C), rel=1e-12)


def test_modes_are_those_of_the_density() -> None:
    """Two normal densities six standard deviations apart have two modes, one apart a single one."""
    for apart, weights in ((6.0, [0.7, 0.3]), (1.0, [1.0])):
        mixture = Mixture(
            np.zeros(2, dtype=int), np.array([0.3, 0.7]), np.array([[0.0, apart]]),
            np.ones((2, 1, 1)),
        )  # fmt: skip
        belief = MixtureBelief.of_mixture(mixture, np.zeros(1), np.zeros(1))
        modes = find_modes(belief)
        assert modes.weight == pytest.approx(weights)
        assert modes.ambiguous().tolist() == [len(weights) > 1]
        assert modes.heaviest().x[0, 0] == pytest.approx(apart if apart > 1.0 else 0.7)
    assert find_modes(Belief(np.zeros((1, 2)), np.ones((2, 1, 1)), np.zeros(2))).owner.tolist() == [
        0, 1,
    ]  # fmt: skip


class Square:
    """A number whose square is measured: its sign is never seen."""

    blocks = ((Channel("square", "m2"),),)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return x

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], 1, 1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return x**2


class Function(Square):
    """A number of which a function is measured."""

    def __init__(self, function: Callable[[Array], Array]) -> None:
        self._function = function

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return self._function(x)


class HeldSquare(Square):
    """The same, with a state that is considered."""

    considered = np.array([True])


def test_the_sign_of_a_square_is_ambiguous() -> None:
    """Against the density on a grid: prior N(0.5, 2²), x² = 4 ± 0.2.

    The weight is off by 0.013; the tolerance is about twice that, and four times for the mean,
    which is 2 (2 w − 1).
    """
    prior = Belief(np.array([[0.5]]), np.full((1, 1, 1), 2.0), np.zeros(1))
    measured = MeasurementSet.of(
        np.zeros(1), np.array([[4.0]]), np.full((1, 1), 0.2), Square.blocks
    )
    grid = np.linspace(-8.0, 8.0, 40001)
    density = np.exp(-0.5 * ((grid - 0.5) / 2.0) ** 2 - 0.5 * ((grid**2 - 4.0) / 0.2) ** 2)
    density /= density.sum()
    mean = density @ grid
    sigma = np.sqrt(density @ (grid - mean) ** 2)
    plus = density[grid > 0.0].sum()
    for belief in (
        create("estimator", "gaussian_sum").update(Square(), prior, measured)[0],
        batch_gaussian_sum(Square(), prior, [measured]),
    ):
        modes = find_modes(belief)
        assert modes.weight == pytest.approx([plus, 1.0 - plus], abs=0.025)
        assert modes.x[0] == pytest.approx([2.0, -2.0], abs=0.01)
        assert belief.x[0, 0] == pytest.approx(mean, abs=0.1)
        assert belief.sigma[0, 0] == pytest.approx(sigma, rel=0.03)
        assert modes.ambiguous().all()


@pytest.mark.parametrize(
    ("function", "sigma", "noise"),
    [(lambda x: np.sin(3.0 * x), 1.0, 0.05), (np.tanh, 2.0, 0.02)],
    ids=["sine", "tanh"],
)
def test_what_is_odd_about_the_mean_is_split(
    function: Callable[[Array], Array], sigma: float, noise: float
) -> None:
    """Its second differences vanish: a linear update has a mean NEES of some hundred."""
    random = np.random.default_rng(0)
    truth = sigma * random.normal(size=(1, 100))
    prior = Belief(np.zeros((1, 100)), np.full((100, 1, 1), sigma), np.zeros(100))
    measured = MeasurementSet.of(
        np.zeros(100), function(truth) + noise * random.normal(size=(1, 100)),
        np.full((1, 1), noise), Square.blocks,
    )  # fmt: skip
    model = Function(function)
    assert is_consistent(
        create("estimator", "gaussian_sum").update(model, prior, measured)[0], truth
    )
    assert is_consistent(batch_gaussian_sum(model, prior, [measured]), truth)


def test_what_does_not_fit_is_refused() -> None:
    """Considered states, and limits that are not positive."""
    prior = Belief(np.ones((1, 1)), np.ones((1, 1, 1)), np.zeros(1))
    measured = MeasurementSet.of(np.zeros(1), np.ones((1, 1)), np.ones((1, 1)), Square.blocks)
    with pytest.raises(InputError, match="considered ones; take an estimator of type unscented"):
        create("estimator", "gaussian_sum").update(HeldSquare(), prior, measured)
    with pytest.raises(InputError, match="has considered ones"):
        batch_gaussian_sum(HeldSquare(), prior, [measured])
    with pytest.raises(InputError, match="components and curvature must be above zero, got 0"):
        batch_gaussian_sum(Square(), prior, [measured], components=0)
    with pytest.raises(InputError, match="one control before each of 1 times, got 2"):
        batch_gaussian_sum(Square(), prior, [measured], [np.zeros((0, 1))] * 2)


def test_too_few_components_are_reported() -> None:
    """With one component the curvature counts as noise: tr(C²)/2 = 2 (σ²/noise)² before it."""
    prior = Belief(np.array([[2.0]]), np.full((1, 1, 1), 1.0), np.zeros(1))
    measured = MeasurementSet.of(
        np.zeros(1), np.array([[4.0]]), np.full((1, 1), 0.01), Square.blocks
    )
    one, _ = create("estimator", "gaussian_sum", components=1).update(Square(), prior, measured)
    many, _ = create("estimator", "gaussian_sum").update(Square(), prior, measured)
    assert isinstance(one, MixtureBelief)
    assert isinstance(many, MixtureBelief)
    assert one.unresolved is not None
    assert many.unresolved is not None
    assert many.unresolved[0] == 0.0
    # powers narrow the single component until the other sign is out of reach, or it says so
    assert (one.unresolved[0] > 0.0) or abs(one.x[0, 0] - 2.0) < 0.1


class RootOf(Square):
    """The root of a number, which has no value below zero."""

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.sqrt(np.where(x < 0.0, np.nan, x))


def test_a_case_without_a_value_does_not_disturb_others() -> None:
    """It ends as not a number; the other case is as it is alone."""
    estimator = create("estimator", "gaussian_sum")
    prior = Belief(np.array([[-50.0, 25.0]]), np.full((2, 1, 1), 6.0), np.zeros(2))
    measured = MeasurementSet.of(
        np.zeros(2), np.array([[5.1, 5.1]]), np.full((1, 1), 1e-3), RootOf.blocks
    )
    after, _ = estimator.update(RootOf(), prior, measured)
    alone, _ = estimator.update(
        RootOf(),
        Belief(prior.x[:, 1:], prior.root[1:], prior.t_s[1:]),
        MeasurementSet.of(np.zeros(1), np.array([[5.1]]), np.full((1, 1), 1e-3), RootOf.blocks),
    )
    assert np.isnan(after.x[0, 0])
    assert after.x[0, 1] == pytest.approx(alone.x[0, 0], rel=1e-12)
    assert abs(alone.x[0, 0] - 5.1**2) < 3.0 * alone.sigma[0, 0]
    assert alone.sigma[0, 0] == pytest.approx(2.0 * 5.1 * 1e-3, rel=0.05)


# -- wide priors -----------------------------------------------------------------------------------


def test_the_springs_mass_of_a_textbook(scenarios: ModuleType) -> None:
    """Both signs are left, equally likely up to the prior; the whole belief is consistent.

    The likelihood is the same at (x, v) and (−x, −v). The exact posterior, on a grid of 601 by 1001
    points, has the weight 0.506 of the positive sign and, over 200 draws, the mean NEES 2.15.
    """
    scenario = scenarios.spring_mass(25)
    recursive = run(scenario, "gaussian_sum")[-1]
    batch = batch_gaussian_sum(scenario.model, scenario.prior, scenario.sets)
    for belief, truth in ((recursive, scenario.truth[-1]), (batch, scenario.start)):
        assert is_consistent(belief, truth)
        modes = find_modes(belief)
        assert modes.ambiguous().all()
        weight = modes.weight[np.flatnonzero(np.diff(modes.owner, prepend=-1))]
        assert (weight < 0.75).all()
    assert not is_consistent(run(scenario, "unscented", update="iterated")[-1], scenario.truth[-1])


def test_bearings_only(scenarios: ModuleType) -> None:
    """Where the plain and the iterated unscented filters are not consistent."""
    scenario = scenarios.bearings_only(25)
    belief = run(scenario, "gaussian_sum", components=64)[-1]
    assert is_consistent(belief, scenario.truth[-1])
    for update in ("plain", "iterated"):
        assert not is_consistent(run(scenario, "unscented", update=update)[-1], scenario.truth[-1])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spring_mass", "bearings_only", "low_earth_orbit"])
def test_the_filter_on_wide_priors(scenarios: ModuleType, name: str) -> None:
    """Mean NEES over 200 draws in its 99.9 % band at the end of the arc."""
    scenario = getattr(scenarios, name)(200)
    assert is_consistent(run(scenario, "gaussian_sum")[-1], scenario.truth[-1])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spring_mass", "bearings_only", "low_earth_orbit"])
def test_the_batch_on_wide_priors(scenarios: ModuleType, name: str) -> None:
    """The same for the states at the start, given all measurements."""
    scenario = getattr(scenarios, name)(200)
    belief = batch_gaussian_sum(scenario.model, scenario.prior, scenario.sets)
    assert is_consistent(belief, scenario.start)
    if name != "spring_mass":
        # where one mode is left and all is linear there, the result is the best fit
        fit = batch_least_squares(
            scenario.model, scenario.prior, scenario.sets, start=scenario.start
        )
        off = np.linalg.solve(fit.belief.root, (belief.x - fit.belief.x).T[:, :, None])
        assert np.linalg.norm(off, axis=(1, 2)).max() < 1e-3


class _Heading:
    """A heading that turns at a constant rate; a sensor shows it."""

    blocks = ((Channel("heading", "rad", "angle"),),)
    angles = (0,)

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return np.array([x[0] + (t1_s - t0_s) * x[1], x[1]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.full((x.shape[1], 2, 1), 0.1)

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return x[:1]


def test_states_that_are_angles_are_refused_by_name() -> None:
    belief = Belief.of(np.array([[3.1], [0.0]]), np.eye(2)[None], np.zeros(1))
    shown = MeasurementSet.of(np.zeros(1), np.array([[3.0]]), np.array([[0.1]]), _Heading.blocks)
    filter_ = create("estimator", "gaussian_sum")
    for work in (
        lambda: filter_.predict(_Heading(), belief, np.ones(1), np.zeros((0, 1))),
        lambda: filter_.update(_Heading(), belief, shown),
        lambda: batch_gaussian_sum(_Heading(), belief, [shown]),
    ):
        with pytest.raises(InputError, match="are angles"):
            work()


def test_a_fit_begins_the_short_way_from_its_prior() -> None:
    prior = Belief.of(np.array([[3.1], [0.0]]), 0.01 * np.eye(2)[None], np.zeros(1))
    shown = MeasurementSet.of(np.zeros(1), np.array([[3.2]]), np.array([[0.1]]), _Heading.blocks)
    start = np.array([[3.3 - 2.0 * np.pi], [0.0]])
    fit = batch_least_squares(_Heading(), prior, [shown], start=start)
    # two values of one variance each: their mean, a turn away from it
    off = np.mod(fit.belief.x[0, 0] - 3.15 + np.pi, 2.0 * np.pi) - np.pi
    assert off == pytest.approx(0.0, abs=1e-12)
