"""Singular and badly scaled problems: what is added to them, and infima known in closed form."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from benchmarks.hostile_plants import KINDS, PLANTS, hostile_plant
from numpy.testing import assert_allclose
from tests.plugins.controllers.test_hinf_synthesis import changed, scalar_plant

import hillsphere_controllers as hc
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import NotStabilisableError, SingularProblemError
from hillsphere_controllers.full_order.h2 import h2_synthesis
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.full_order.mixed_sensitivity import (
    mixed_sensitivity,
    mixed_sensitivity_plant,
)
from hillsphere_controllers.full_order.modes import is_surely_stable
from hillsphere_controllers.full_order.regularisation import Regularisation
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.step_responses import step_responses
from hillsphere_controllers.stages.synthesis.presentation import present_synthesis
from hillsphere_controllers.stages.synthesis.specs import SynthesisSpec
from hillsphere_controllers.stages.synthesis.stage import SynthesisStage
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.bilinear import discrete
from hillsphere_controllers.systems.truncation import balanced_truncation


def solved(t: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(t, right), dtype=float)


def free_control() -> LtiSystem:
    """ẋ = x + w₁ + u, z = x, y = x + w₂: D12 = 0."""
    plant = scalar_plant(1.0)
    return changed(plant, c=plant.c[[0, 2]], d=plant.d[[0, 2]] * [[1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])


def test_a_control_without_weight() -> None:
    """The infimum is 1.

    High gain holds x = −w₂. The transfer from w₂ to z is −T with T(1) = 1 at the unstable pole, and
    no stable T has a norm below that (maximum modulus).
    """
    found = hinf_synthesis(free_control(), 1, 1)
    assert 1.0 - 1e-9 <= found.gamma <= 1.005
    assert found.least <= 1.0
    assert found.added
    assert found.added.controls[0] > 0.0
    loop = lower_lft(free_control(), found.controller)
    assert loop.is_stable
    assert_allclose(hinf_norm(loop).value, found.gamma, rtol=1e-6)
    with pytest.raises(SingularProblemError, match=r"D12 lacks full rank|as many weighted"):
        hinf_synthesis(free_control(), 1, 1, regularisation=0.0)


def test_the_same_in_discrete_time() -> None:
    """The bilinear image has the same infimum."""
    found = hinf_synthesis(discrete(free_control(), 0.1), 1, 1)
    assert 1.0 - 1e-9 <= found.gamma <= 1.005
    assert found.closed_loop.dt_s == 0.1
    assert found.added


def test_what_is_added_has_the_plants_units() -> None:
    """A control in units a thousandth as large bears a thousandth of the weight."""
    plant = free_control()
    one = hinf_synthesis(plant, 1, 1)
    other = hinf_synthesis(changed(plant, b=plant.b * [[1.0, 1.0, 1.0 / 1024.0]]), 1, 1)
    assert one.added is not None
    assert other.added is not None
    assert_allclose(1024.0 * other.added.controls, one.added.controls, rtol=1e-12)
    assert_allclose(other.gamma, one.gamma, rtol=1e-6)


def test_an_integrator_outside_of_the_disturbances_reach() -> None:
    """‖[S; ½ K S]‖ of 1/s: the infimum is 1.

    S(∞) = 1 for every proper controller; with S = s/(s + a) the square of the gain is
    (ω² + ¼ a² ω²)/(ω² + a²), at most 1 + ¼ a², for any small a.
    """
    found = mixed_sensitivity(hc.transfer_function([1.0], [1.0, 0.0]), 1.0, 0.5)
    assert 1.0 - 1e-9 <= found.gamma <= 1.005
    assert found.design.least <= 1.0
    assert found.design.added is not None
    with pytest.raises(SingularProblemError):
        mixed_sensitivity(hc.transfer_function([1.0], [1.0, 0.0]), 1.0, 0.5, regularisation=0.0)


def test_zeros_on_the_axis_and_no_weight_of_the_control() -> None:
    """‖W S‖ of (s² + 1)/(s + 1)³ with W = 1/(s + ½): the infimum is |W(j)| = 1/√1.25.

    S(j) = 1 at the plant's zero, and W(∞) = 0; S is free elsewhere, since nothing binds it in the
    open right half-plane.
    """
    plant = hc.transfer_function([1.0, 0.0, 1.0], [1.0, 3.0, 3.0, 1.0])
    found = mixed_sensitivity(plant, hc.transfer_function([1.0], [1.0, 0.5]))
    least = 1.0 / np.sqrt(1.25)
    assert least * (1.0 - 1e-6) <= found.gamma <= 1.01 * least
    assert found.design.least <= least


@pytest.mark.parametrize("small", [1e-7, 1e-4, 1e-2])
def test_a_control_with_nearly_no_weight(small: float) -> None:
    """Between the infimum without weight, 1, and what the controller of 1e-2 reaches."""
    plant = scalar_plant(1.0)
    d = plant.d.copy()
    d[1, 2] *= small
    found = hinf_synthesis(changed(plant, d=d), 1, 1)
    assert 1.0 - 1e-9 <= found.gamma <= 1.03
    assert found.least <= found.gamma
    assert found.norm.error < 1e-2


def test_h2_without_weight_of_the_control() -> None:
    """The filter's variance alone counts: Y = 1 + √2 of 2Y − Y² + 1 = 0."""
    found = h2_synthesis(free_control(), 1, 1)
    assert_allclose(found.norm, np.sqrt(1.0 + np.sqrt(2.0)), rtol=1e-3)
    assert found.norm >= np.sqrt(1.0 + np.sqrt(2.0)) * (1.0 - 1e-9)
    assert found.least == 0.0
    assert found.added is not None
    assert "weights on the controls" in str(found.added)
    with pytest.raises(SingularProblemError, match="D12 lacks full rank"):
        h2_synthesis(free_control(), 1, 1, regularisation=0.0)
    given = h2_synthesis(free_control(), 1, 1, regularisation=1e-3)
    assert_allclose(given.norm, found.norm, rtol=1e-2)
    with pytest.raises(InputError, match="regularisation must be"):
        h2_synthesis(free_control(), 1, 1, regularisation=-1.0)


def test_a_regular_problem_gets_nothing() -> None:
    plant = scalar_plant(1.0)
    assert hinf_synthesis(plant, 1, 1).added is None
    square = h2_synthesis(plant, 1, 1)
    assert square.added is None
    assert square.least == square.norm


def test_a_weights_integrator_is_refused_by_name() -> None:
    """Of W = 1/s on the error: its mode at 0 is out of every controller's reach."""
    with pytest.raises(NotStabilisableError, match="measurements do not show the mode at s = 0"):
        mixed_sensitivity(
            hc.transfer_function([1.0], [1.0, 1.0]), hc.transfer_function([1.0], [1.0, 0.0])
        )


def test_words_of_a_regularisation() -> None:
    added = Regularisation(np.array([1e-3, 0.0]), np.zeros(1), np.zeros(2), np.array([0.0, 0.25]))
    assert str(added) == "weights on the controls 0.001, 0, noise on the states up to 0.25"
    assert added
    none = Regularisation.even(0.0, 2, 1, 2)
    assert str(none) == ""
    assert not none


def test_toolbox_says_what_was_added() -> None:
    found = hc.hinfsyn(free_control(), 1, 1)
    assert found.added is not None
    assert hc.hinfsyn(scalar_plant(1.0), 1, 1).added is None


def test_hostile_plants_are_the_same_each_time() -> None:
    """Six kinds in turn, orders 2 to 20."""
    names = [hostile_plant(index)[0] for index in range(12)]
    assert names == [*KINDS, *KINDS]
    one, other = hostile_plant(PLANTS - 1), hostile_plant(PLANTS - 1)
    assert (one[1].d == other[1].d).all()
    orders = {hostile_plant(index)[1].order for index in range(120)}
    assert (min(orders), max(orders)) == (2, 20)


@pytest.mark.parametrize("denominator", [[1.0, 0.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
@pytest.mark.parametrize("seed", range(4))
def test_rounding_does_not_hide_a_weights_modes(denominator: list[float], seed: int) -> None:
    """Poles of a weight on the axis, in states mixed at random, often lie left of it by 1e-16."""
    plant = hc.transfer_function([1.0], [1.0, 1.5, 0.5])
    made = mixed_sensitivity_plant(plant, hc.transfer_function([1.0], denominator), 0.1)
    t = np.random.default_rng(seed).normal(size=(made.order, made.order))
    mixed = LtiSystem(solved(t, made.a @ t), solved(t, made.b), made.c @ t, made.d)
    with pytest.raises(NotStabilisableError, match="do not show the mode at s = "):
        hinf_synthesis(mixed, 1, 1)


def test_a_slow_mode_out_of_reach_is_no_mode_on_the_axis() -> None:
    """−1e-9 beside −1e6: an entry of its own, which rounding does not move."""
    plant = LtiSystem(
        np.diag([1.0, -1e-9, -1e6]),
        np.array([[1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]),
        np.array([[1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]),
        scalar_plant(1.0).d,
    )
    assert hinf_synthesis(plant, 1, 1).closed_loop.is_stable


def test_a_norm_that_a_pole_on_the_axis_hides() -> None:
    """−1e-17 in the entries given, and zero in balanced ones: no norm, and no warning."""
    t = np.random.default_rng(3).normal(size=(3, 3))
    a = solved(t, np.diag([-1.0, -2.0, -1e-18]) @ t)
    norm = hinf_norm(LtiSystem(a, np.ones((3, 1)), np.ones((1, 3)), np.zeros((1, 1))))
    assert norm.error > 1e-2 or not np.isfinite(norm.value)


def test_a_zero_on_the_axis_is_not_cancelled() -> None:
    """s/(s + 1) from u to z: a pole at −1e-16 would seem stable and have the least norm."""
    plant = LtiSystem(
        np.array([[-1.0]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[-1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    )
    found = hinf_synthesis(plant, 1, 1)
    assert found.closed_loop.poles.real.max() < -1e-9
    assert found.least <= found.gamma


def test_hostile_plant_whose_zeros_a_controller_would_cancel() -> None:
    """Without a look at rounding the slowest pole was −5.5e-16, on the stable side by luck."""
    _, plant, controls, measurements = hostile_plant(5)
    found = hinf_synthesis(plant, controls, measurements)
    assert is_surely_stable(found.closed_loop.a)
    assert found.closed_loop.poles.real.max() < -1e-6


def test_schur_form_keeps_fast_controllers_from_spoiling_the_loop() -> None:
    """In the states of the formulas rounding leaves this loop's norm no digit below 5.3e5."""
    _, plant, controls, measurements = hostile_plant(212)
    found = hinf_synthesis(plant, controls, measurements)
    assert found.norm.error < 1e-2
    assert found.gamma < 5.06014e5 * 1.01  # of a controller of SB10FD, rounded up


def test_what_rounding_hides_of_stability() -> None:
    t = np.random.default_rng(1).normal(size=(3, 3))
    assert is_surely_stable(np.diag([-1e-12, -1e6, -1.0]))  # of entries of their own
    assert not is_surely_stable(solved(t, np.diag([-1e-18, -1.0, -2.0]) @ t))
    assert not is_surely_stable(np.diag([1e-12, -1.0]))
    assert is_surely_stable(np.diag([0.5, -0.9]), discrete=True)
    assert not is_surely_stable(np.diag([0.5, 1.0]), discrete=True)


def test_a_norm_without_a_least_one_ends_the_search() -> None:
    """Of ẋ = −x + w + u, z = x, y = w the feedback u = −y makes z silent."""
    one = np.ones((1, 1))
    plant = LtiSystem(
        -one, np.ones((1, 2)), np.array([[1.0], [0.0]]), np.array([[0.0, 0.0], [1.0, 0.0]])
    )
    found = hinf_synthesis(plant, 1, 1)
    assert found.gamma < 1e-3
    assert found.least == 0.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("index", [1, 7, 23])
def test_nothing_warns_on_hostile_plants(index: int) -> None:
    """Synthesis and analysis end with a result or with an error of this project."""
    _, plant, k, q = hostile_plant(index)
    (p, m), a = plant.shape, plant.a
    inner = LtiSystem(a, plant.b[:, m - k :], plant.c[p - q :], plant.d[p - q :, m - k :])
    fastest = np.linalg.eigvals(a).real.max()
    stable = changed(inner, a=a - (1.001 * max(fastest, 0.0) + 1e-6) * np.eye(len(a)))
    loop = hinf_synthesis(plant, k, q).closed_loop
    calls: list[Callable[[], object]] = [
        lambda: h2_synthesis(plant, k, q),
        lambda: hc.ncfsyn(inner),
        lambda: hc.mixsyn(inner, 1.0, 0.1),
        lambda: hc.margins(inner),
        *(
            partial(function, system)
            for system in (loop, stable)
            for function in (hc.hinfnorm, hc.h2norm, hc.sigma, hc.bode, hc.step)
        ),
        *(partial(balanced_truncation, system, 2) for system in (loop, stable, inner)),
    ]
    for call in calls:
        with suppress(HillsphereError):
            call()


def test_truncation_of_poles_over_twenty_decades() -> None:
    """LAPACK's Lyapunov solver enlarges sums of poles to rounding, and warns of it."""
    poles = -(10.0 ** np.linspace(-12.0, 8.0, 6))
    one = np.ones((6, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        small = balanced_truncation(LtiSystem(np.diag(poles), one, one.T, np.zeros((1, 1))), 3)
    assert_allclose(np.sort(-small.poles.real)[:2], [1e-12, 1e-8], rtol=1e-3)


def test_step_response_of_a_mode_that_never_settles() -> None:
    """Of z = 1 − 1e-12, hardly seen: 7e12 samples would be waited for."""
    system = LtiSystem(
        np.diag([1.0 - 1e-12, 0.5]), np.ones((2, 1)), np.array([[1e-9, 1.0]]), np.zeros((1, 1)), 0.1
    )
    assert len(step_responses([system], None)[0]) <= 100_001


@pytest.mark.parametrize("method", ["hinf", "h2"])
def test_the_report_says_what_was_added(method: str) -> None:
    names = ("w", "v", "u"), ("z", "y")
    plant = free_control()
    plant = replace(plant, inputs=names[0], outputs=names[1])
    models = LinearModels(
        (plant,), ("one",), ("rate",), ("1/s",), np.ones((1, 1)), np.ones(1), 1, 1, ()
    )

    def said(**options: object) -> list[str]:
        table = {"needs": {"models": "m"}, "method": method, **options}
        spec = validate(SynthesisSpec, table, where="stage")
        assert isinstance(spec, SynthesisSpec)
        product = SynthesisStage(spec).run(RecordingContext(), models)
        assert product.lower_bound <= product.gamma
        return [one for one in present_synthesis(product, None).verdict if "regularised" in one]

    (sentence,) = said()
    assert "weights on the controls" in sentence
    if method == "hinf":
        assert "weights on the controls 0.01" in said(hinf={"regularisation": 0.01})[0]
        with pytest.raises(SingularProblemError):
            said(hinf={"regularisation": 0.0})
