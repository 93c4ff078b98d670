"""Digits: ill-conditioned problems against exact rational arithmetic, and large states."""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, Channel, Integers
from hillsphere_estimators.batch_least_squares import batch_least_squares


class Constant:
    """Constant states x, of which H x is measured."""

    def __init__(self, slopes: Array) -> None:
        self.slopes = slopes
        self.blocks = tuple((Channel(f"row_{k}", "m"),) for k in range(len(slopes)))

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return x

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], len(x), 1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return self.slopes @ x

    def measure(self) -> MeasurementSet:
        """Return ones, with noise of unit variance."""
        ones = np.ones((len(self.slopes), 1))
        return MeasurementSet.of(np.zeros(1), ones, ones, self.blocks)


@lru_cache
def exact_covariance(problem: str) -> Array:
    """Return (HᵀH + 1/variance)⁻¹ by elimination in fractions, rounded at the end only."""
    slopes, variance = PROBLEMS[problem]
    n = slopes.shape[1]
    rows = [[Fraction(h) for h in row] for row in slopes.tolist()]
    table = [
        [sum((r[i] * r[j] for r in rows), Fraction(i == j) / Fraction(variance)) for j in range(n)]
        + [Fraction(i == j) for j in range(n)]
        for i in range(n)
    ]
    for i in range(n):
        table[i] = [a / table[i][i] for a in table[i]]
        for k in range(n):
            if k != i:
                table[k] = [a - table[k][i] * b for a, b in zip(table[k], table[i], strict=True)]
    return np.array([[float(a) for a in row[n:]] for row in table])


BIERMAN = np.array([[1.0, 1e-12], [1.0, 1.0]])
"""Bierman (1977), Factorization methods for discrete sequential estimation, section V.2: the
measurements x1 + ε x2 and x1 + x2 with a prior of variance 1/ε², here ε = 1e-12."""
POLYNOMIAL = np.vander(np.linspace(-1.0, 1.0, 41), 20, increasing=True)
"""A polynomial of degree 19 at 41 points. Its condition number is 1.0e7, that of the normal
equations 1.0e14."""
PROBLEMS = {"bierman": (BIERMAN, 1e24), "polynomial": (POLYNOMIAL, 1e12)}
"""Rows H, and the variance of the prior of each state."""
FORMS = {
    "information": {},
    "iterated_extended": {},
    "unscented": {},
    "gaussian_sum": {},
    "unscented iterated": {"update": "iterated"},
}


def misfit(covariance: Array, exact: Array) -> float:
    """Return the largest error of a covariance over the product of the standard deviations."""
    size = np.sqrt(np.diag(exact))
    return float(np.max(np.abs(covariance - exact) / np.outer(size, size)))


@pytest.mark.parametrize("form", [*FORMS, "batch"])
@pytest.mark.parametrize("together", [True, False])
@pytest.mark.parametrize("problem", ["bierman", "polynomial"])
def test_covariance_of_ill_conditioned_fits(problem: str, together: bool, form: str) -> None:
    """Within 1e-6 of exact arithmetic, whether the rows come at once or one after the other."""
    slopes, variance = PROBLEMS[problem]
    n = slopes.shape[1]
    belief = Belief(np.zeros((n, 1)), np.sqrt(variance) * np.eye(n)[None], np.zeros(1))
    models = [Constant(slopes)] if together else [Constant(row[None]) for row in slopes]
    if form == "batch":
        fit = batch_least_squares(Constant(slopes), belief, [Constant(slopes).measure()])
        assert fit.settled.all()
        belief = fit.belief
    else:
        estimator = create("estimator", form.split()[0], **FORMS[form])
        for model in models:
            belief, _ = estimator.update(model, belief, model.measure())
    assert misfit(belief.covariance[0], exact_covariance(problem)) < 1e-6


def test_forms_that_subtract_covariances_lose_digits() -> None:
    """FilterPy's two filters beside, on Bierman's case: digits are lost, or the filter breaks off.

    The extended filter errs by 4e-9 here, thousands of times more than ours; with ε = 1e-12 the
    covariance of the unscented filter becomes indefinite.
    """
    pytest.importorskip("filterpy")
    prior = Belief(np.zeros((2, 1)), 1e12 * np.eye(2)[None], np.zeros(1))
    errors = {}
    for name in ("ekf", "iterated_extended"):
        belief, estimator = prior, create("estimator", name)
        for row in BIERMAN:
            model = Constant(row[None])
            belief, _ = estimator.update(model, belief, model.measure())
        errors[name] = misfit(belief.covariance[0], exact_covariance("bierman"))
    assert errors["ekf"] > 1e3 * errors["iterated_extended"]
    model = Constant(BIERMAN)
    with pytest.raises(InputError, match="not positive definite"):
        create("estimator", "ukf").update(model, prior, model.measure())


class FarAway:
    """A body on a straight course at distances of an astronomical unit from three stations."""

    blocks = tuple((Channel(f"range_{k}", "m"),) for k in range(3))
    stations = np.array([[0.0, 0.0, 0.0], [1.5e11, 0.0, 0.0], [0.0, 1.5e11, 0.0]])

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        return np.concatenate([x[:3] + (t1_s - t0_s) * x[3:], x[3:]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        return np.zeros((x.shape[1], 6, 1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.array([np.linalg.norm(x[:3] - s[:, None], axis=0) for s in self.stations])


def test_fits_of_large_states_end_converged() -> None:
    """States of 1e11 m, spaced 1.5e-5 m as doubles: to 1 cm they converge, to 0.1 mm they cannot.

    The default tolerance of 1e-6 standard deviations lies far below the rounding of the states.
    """
    cases, model = 10, FarAway()
    at = np.array([[1e11, 1e11, 3e10, 1e3, 2e4, -3e3]]).T
    sigma = np.repeat([1e6, 10.0], 3)
    for noise, converges in ((1.0, True), (1e-2, True), (1e-4, False)):
        random = np.random.default_rng(0)
        truth = np.repeat(at, cases, axis=1)
        prior = Belief.of(
            truth + sigma[:, None] * random.normal(size=(6, cases)),
            np.repeat(np.diag(sigma**2)[None], cases, axis=0), np.zeros(cases),
        )  # fmt: skip
        sets = []
        for k in range(20):
            t = np.full(cases, 3600.0 * k)
            x = model.advance(truth, np.zeros(cases), t, np.zeros((0, cases)), np.arange(cases))
            shown = model.observe(x, t, np.arange(cases)) + noise * random.normal(size=(3, cases))
            sets.append(MeasurementSet.of(t, shown, np.full((3, 1), noise), model.blocks))
        fit = batch_least_squares(model, prior, sets)
        assert (fit.settled == converges).all(), noise
        assert (fit.rounding < 0.1).all() == converges
        if converges:
            assert fit.iterations.max() < 15
            off = np.linalg.solve(fit.belief.root, (fit.belief.x - truth).T[:, :, None])
            assert np.abs(np.mean(off**2) - 1.0) < 5.0 * np.sqrt(2.0 / (6 * cases))
