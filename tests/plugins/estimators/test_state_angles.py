"""States that are angles, where they wrap: as far from the cut as on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators.estimation_models import nothing

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import AngularModel, Array, Channel, Integers
from hillsphere.testing import example
from hillsphere_estimators.batch_least_squares import batch_least_squares
from hillsphere_estimators.bias_states import BiasAugmentedModel, BiasStates
from hillsphere_estimators.consistency import chi_square_band, nees
from hillsphere_estimators.covariance_intersection import covariance_intersection
from hillsphere_estimators.linearisation import transition
from hillsphere_estimators.sigma_points import SigmaRule
from hillsphere_estimators.smoother import link, smooth
from hillsphere_estimators.state_angles import state_angles, wrap_differences

TYPES = ["unscented", "iterated_extended", "information", "ukf", "ekf"]
TURN = 2.0 * np.pi


class Rotor:
    """An angle, kept in (−π, π] by the motion itself, and its rate; the angle is measured."""

    angles = (0,)
    blocks = ((Channel("angle", "rad", "angle"),),)
    push = 0.02

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        ahead = x[0] + (t1_s - t0_s) * x[1]
        return np.array([np.arctan2(np.sin(ahead), np.cos(ahead)), x[1]])

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        dt = (t1_s - t0_s)[:, None, None]
        return np.asarray(self.push * np.concatenate([0.5 * dt**2, dt], axis=1))

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        return np.arctan2(np.sin(x[:1]), np.cos(x[:1]))


class Still(Rotor):
    push = 0.0


def wrapped(x: Array) -> Array:
    return np.array([np.arctan2(np.sin(x[0]), np.cos(x[0])), x[1]])


def fly(
    model: Rotor, turned: float, cases: int
) -> tuple[Belief, list[MeasurementSet], list[Array]]:
    """Return prior, measurements and truths about `turned`, with the same random numbers."""
    random = np.random.default_rng(5)
    spread = np.array([0.4, 0.1])[:, None]
    x = np.array([[turned], [0.2]]) + spread * random.normal(size=(2, cases))
    centre = np.repeat([[turned], [0.2]], cases, axis=1)
    P = np.repeat(np.diag(spread[:, 0] ** 2)[None], cases, axis=0)
    prior, truth, sets = Belief.of(wrapped(centre), P, np.zeros(cases)), [], []
    for k in range(8):
        if k:
            w = model.push * random.normal(size=cases)
            x = np.array([x[0] + x[1] + 0.5 * w, x[1] + w])
        z = x[:1] + 0.1 * random.normal(size=(1, cases))
        t_s = np.full(cases, float(k))
        sets.append(MeasurementSet.of(t_s, np.arctan2(np.sin(z), np.cos(z)),
                                      np.full((1, 1), 0.1), model.blocks))  # fmt: skip
        truth.append(wrapped(x))
    return prior, sets, truth


def run(model: Any, type_: str, prior: Belief, sets: list[MeasurementSet]) -> list[Belief]:
    estimator, belief, after = example("estimator", type_), prior, []
    for k, measured in enumerate(sets):
        if k:
            belief = estimator.predict(model, belief, measured.t_s, nothing(len(measured.t_s)))
        belief, _ = estimator.update(model, belief, measured)
        after.append(belief)
    return after


@pytest.mark.parametrize("type_", TYPES)
def test_filters_and_smoothers_are_the_same_on_the_cut(type_: str) -> None:
    cases = 300 if type_ not in ("ukf", "ekf") else 20
    ends = []
    for turned in (0.0, np.pi - 0.1):
        prior, sets, truth = fly(Rotor(), turned, cases)
        after = run(Rotor(), type_, prior, sets)
        for belief, x in zip(after, truth, strict=True):
            assert (np.abs(belief.x[0]) <= np.pi).all()
            low, high = chi_square_band(2, cases, 0.99999)
            assert low < nees(belief, x, angles=(0,)).mean() < high
        for rule in (None, SigmaRule()):
            ties = [
                link(Rotor(), after[k], sets[k + 1].t_s, nothing(cases), rule) for k in range(7)
            ]
            back = smooth(after, ties)
            assert (np.abs(back[0].x[0]) <= np.pi).all()
            assert low < nees(back[0], truth[0], angles=(0,)).mean() < high
        ends.append((after[-1], back[0], turned))
    for one, other in zip(ends[0][:2], ends[1][:2], strict=True):
        off = wrap_differences(other.x - one.x - [[ends[1][2]], [0.0]], [0])
        np.testing.assert_allclose(off, 0.0, rtol=0, atol=1e-9)
        np.testing.assert_allclose(other.covariance, one.covariance, rtol=0, atol=1e-9)


def test_fits_are_the_same_on_the_cut() -> None:
    fits = []
    for turned in (0.0, np.pi - 0.1):
        prior, sets, truth = fly(Still(), turned, 200)
        fit = batch_least_squares(Still(), prior, sets)
        assert fit.settled.all()
        assert (np.abs(fit.belief.x[0]) <= np.pi).all()
        low, high = chi_square_band(2, 200, 0.9999)
        assert low < nees(fit.belief, truth[0], angles=(0,)).mean() < high
        fits.append(fit)
    np.testing.assert_allclose(fits[0].squares, fits[1].squares, rtol=1e-6)


def test_mean_of_sigma_points_is_circular() -> None:
    """Images on both sides of the cut, two radians to either side of their mean."""
    belief = Belief.of(np.array([[3.0], [0.3]]), np.diag([2.0, 0.02])[None], np.zeros(1))
    later = example("estimator", "unscented").predict(Still(), belief, np.ones(1), nothing(1))
    np.testing.assert_allclose(later.x[0], 3.3 - TURN, rtol=1e-12)
    np.testing.assert_allclose(
        later.covariance[0], [[2.02, 0.02], [0.02, 0.02]], rtol=0, atol=1e-12
    )
    _, phi = transition(Still(), belief, np.ones(1), nothing(1))
    np.testing.assert_allclose(phi[0], [[1.0, 1.0], [0.0, 1.0]], rtol=0, atol=1e-10)


@pytest.mark.parametrize("type_", TYPES)
def test_angles_that_are_hardly_known(type_: str) -> None:
    """Sigma points beyond half a turn: the motion is linear, so that the covariance is exact."""
    estimator = example("estimator", type_)
    P = np.diag([9.0, 4.0])
    belief = Belief.of(np.array([[3.0], [0.3]]), P[None], np.zeros(1))
    later = estimator.predict(Still(), belief, np.full(1, 2.0), nothing(1))
    moved = np.array([[1.0, 2.0], [0.0, 1.0]])
    ahead = moved @ P @ moved.T
    np.testing.assert_allclose(later.covariance[0], ahead, rtol=1e-9)
    measured = MeasurementSet.of(later.t_s, np.full((1, 1), -2.0), np.full((1, 1), 0.1),
                                 Rotor.blocks)  # fmt: skip
    after, _ = estimator.update(Still(), later, measured)
    gain = ahead[:, :1] / (ahead[0, 0] + 0.01)
    np.testing.assert_allclose(after.covariance[0], ahead - gain * ahead[:1], rtol=0, atol=1e-7)
    off = -2.0 - (3.6 - TURN)
    expected = np.array([[3.6 - TURN], [0.3]]) + gain * off
    np.testing.assert_allclose(after.x, expected, rtol=0, atol=1e-7)


def test_beliefs_on_both_sides_are_fused_between() -> None:
    """As beliefs about zero, half a turn further."""
    fused = []
    for centre, angles in ((0.0, ()), (np.pi, (0,))):
        one, other = (
            Belief.of(
                wrap_differences(np.array([[centre + a], [0.0]]), angles),
                np.diag(variance)[None], np.zeros(1),
            )
            for a, variance in ((0.1, [1.0, 4.0]), (-0.3, [4.0, 1.0]))
        )  # fmt: skip
        fused.append(covariance_intersection(one, other, angles=angles)[0].x[0, 0] - centre)
    assert -0.3 < fused[0] < 0.1
    np.testing.assert_allclose((fused[1] - fused[0]) % TURN, 0.0, rtol=0, atol=1e-9)


def test_biases_pass_the_declaration_on() -> None:
    biases = BiasStates(np.ones(1), np.full(1, np.inf), np.ones((1, 1)), np.zeros((0, 1)),
                        np.zeros(1, dtype=bool))  # fmt: skip
    model = BiasAugmentedModel(Rotor(), 2, biases)
    assert isinstance(model, AngularModel)
    assert state_angles(model, 3) == [0]


@pytest.mark.parametrize("angles", [(2,), (-1,), (0, 0), (0.5,), (True,)])
def test_angles_that_are_no_states(angles: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="angles must be different numbers of states, 0 to 1"):
        nees(fly(Rotor(), 0.0, 2)[0], np.zeros((2, 2)), angles=angles)


def test_half_a_turn_is_positive() -> None:
    off = np.array([[-np.pi, np.pi, 3.0 * np.pi, 0.1, -4.0]])
    np.testing.assert_allclose(
        wrap_differences(off, [0]), [[np.pi, np.pi, np.pi, 0.1, TURN - 4.0]], rtol=1e-15
    )
