"""Stability of systems with delays: known critical delays, neutral systems, a second way."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.algebra import delay, feedback, with_delays
from hillsphere_controllers.delays.expansion import Pencil, bound_perturbed
from hillsphere_controllers.delays.stability import cover_axis, judge_stability
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.systems.algebra import append, gain, lower_lft
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.toolbox.delays import isstable

INTEGRATOR = transfer_function([1.0], [1.0, 0.0])
LAG = transfer_function([1.0], [1.0, 1.0])


def chebyshev_delay(time_s: float, nodes: int = 30) -> LtiSystem:
    """Return a delay as transport v_t = v_θ on [−T, 0], by collocation at Chebyshev nodes.

    The eigenvalues of a system closed by such are those of the discretised infinitesimal generator
    (Breda, Maset, Vermiglio 2005), and near zero converge faster than any power of the nodes.
    """
    k = np.arange(nodes + 1)
    x = np.cos(np.pi * k / nodes)
    c = np.where((k == 0) | (k == nodes), 2.0, 1.0) * (-1.0) ** k
    away = x[:, None] - x + np.eye(nodes + 1)
    d = np.outer(c, 1.0 / c) / away
    d -= np.diag(d.sum(axis=1))
    d *= 2.0 / time_s
    last = np.zeros((1, nodes))
    last[0, -1] = 1.0
    return LtiSystem(d[1:, 1:], d[1:, :1], last, np.zeros((1, 1)))


def rightmost(system: DelaySystem, nodes: int = 30) -> NDArray[np.complex128]:
    """Return the approximate poles of a system, from the right."""
    parts = append(*(chebyshev_delay(time, nodes) for time in system.delays_s))
    poles = lower_lft(system.system, parts).poles
    return np.asarray(poles[np.argsort(-poles.real)])


@pytest.mark.parametrize(
    ("time_s", "poles"),
    # two more poles cross at each T = π/2 + 2π k
    [
        (1e-3, 0),
        (0.5 * np.pi - 1e-6, 0),
        (0.5 * np.pi + 1e-6, 2),
        (7.85, 2),
        (7.86, 4),
        (100.0, 32),
    ],
)
def test_delayed_integrator(time_s: float, poles: int) -> None:
    """The equation x' = −x(t − T) is stable just for T < π/2."""
    made = judge_stability(feedback(INTEGRATOR, delay(time_s)))
    assert (made.stable, made.unstable_poles) == (poles == 0, poles)
    ends = made.intervals_rad_s
    # the intervals cover the axis up to the bound of the poles, which is one
    assert_allclose(ends[1:, 0], ends[:-1, 1])
    assert ends[0, 0] == 0.0
    assert ends[-1, 1] >= 1.0


def test_a_pole_on_the_axis_is_undecided() -> None:
    loop = feedback(INTEGRATOR, delay(0.5 * np.pi))
    made = judge_stability(loop)
    assert (made.stable, made.unstable_poles) == (None, None)
    assert "near 1 rad/s" in made.reason
    with pytest.raises(ConvergenceError, match="undecided"):
        isstable(loop)


@pytest.mark.parametrize("k", [2.0, 5.0, 50.0])
def test_first_order_lag(k: float) -> None:
    """K e^{-sT}/(s + 1): |K/(jω + 1)| = 1 at ω = √(K² − 1), T = (π − arctan ω)/ω."""
    omega = np.sqrt(k * k - 1.0)
    critical = (np.pi - np.arctan(omega)) / omega
    assert judge_stability(feedback(LAG * k, delay(critical * (1.0 - 1e-6)))).stable
    assert judge_stability(feedback(LAG * k, delay(critical * (1.0 + 1e-6)))).unstable_poles == 2.0


def test_stable_for_any_delay() -> None:
    """|K| < 1: the gain of the loop is below one."""
    for time in (1e-2, 1.0, 1e3, 1e5):
        assert judge_stability(feedback(LAG * 0.9, delay(time))).stable


def test_a_delay_may_stabilise() -> None:
    """s² + 1 − 0.5 e^{-sT}: without damping, yet stable for small delays.

    At a crossing ω² = 1 ∓ 0.5. At ω² = 1.5, e^{-jωT} = −1 first at T = π/√1.5; there it is lost.
    """
    spring = LtiSystem([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])  # type: ignore[arg-type]
    lost = np.pi / np.sqrt(1.5)
    assert judge_stability(feedback(spring * 0.5, delay(lost * 0.999), 1)).stable
    assert judge_stability(feedback(spring * 0.5, delay(lost * 1.001), 1)).unstable_poles == 2.0
    assert judge_stability(feedback(spring * 0.5, delay(0.1), -1)).unstable_poles == 2.0


def test_a_plant_with_poles_on_the_right() -> None:
    """K e^{-sT}/(s − 1): stable for 1 < K and T < arccos(1/K)/√(K² − 1)."""
    plant, k = transfer_function([1.0], [1.0, -1.0]), 3.0
    critical = np.arccos(1.0 / k) / np.sqrt(k * k - 1.0)
    assert judge_stability(feedback(plant * k, delay(critical * 0.9999))).stable
    assert judge_stability(feedback(plant * k, delay(critical * 1.0001))).unstable_poles == 2.0
    assert judge_stability(feedback(plant * 0.9, delay(0.1))).unstable_poles == 1.0
    # outside a loop the delay does nothing
    assert judge_stability(with_delays(plant, input_s=1.0)).unstable_poles == 1.0


def test_smith_predictor_is_stable_and_cannot_stabilise() -> None:
    """The poles are those of the loop without delay and of the plant, twice a pole of its own."""

    def closed(plant: LtiSystem) -> DelaySystem:
        late = plant @ delay(3.0)
        return feedback(late @ feedback(gain(np.eye(1)) * 5.0, plant - late), np.eye(1))

    assert judge_stability(closed(LAG)).stable
    made = judge_stability(closed(transfer_function([1.0], [1.0, -1.0])))
    assert made.stable is not True


@pytest.mark.parametrize(
    ("d", "stable", "poles"),
    [(0.5, True, 0.0), (-0.99, True, 0.0), (1.0, None, None), (1.1, False, np.inf)],
)
def test_neutral_chain(d: float, stable: bool | None, poles: float | None) -> None:
    """(d s + 1)/(s + 1) closed by a delay: the chain of poles tends to Re s = ln|d|/T."""
    made = judge_stability(feedback(transfer_function([d, 1.0], [1.0, 1.0]), delay(2.0)))
    assert (made.stable, made.unstable_poles) == (stable, poles)
    assert stable or "chain" in made.reason


def test_neutral_system_with_several_delays() -> None:
    """w(t) = a w(t − 1) + b w(t − 2.2) is strongly stable just if |a| + |b| < 1."""

    def loop(a: float, b: float) -> DelaySystem:
        d = np.array([[1.0, 1.0, 1.0], [a, a, a], [b, b, b]])
        return DelaySystem(gain(d), (1.0, 2.2))

    assert judge_stability(loop(0.4, -0.5)).stable
    lost = judge_stability(loop(0.6, -0.5))
    assert lost.stable is None
    assert "not strongly stable" in lost.reason
    # entries of more than one that a scaling makes small
    twisted = np.array([[0.0, 1.0, 1.0], [1.0, 0.1, 5.0], [1.0, 0.1, 0.1]])
    assert judge_stability(DelaySystem(gain(twisted), (1.0, 2.2))).stable


def test_equal_delays_have_one_phase() -> None:
    """D = c [1 1; -1 -1] is nilpotent; with the phases 1 and −1 its spectral radius is 2 c."""

    def loop(d: Array, other_s: float) -> DelaySystem:
        m = np.block([[np.zeros((1, 1)), np.ones((1, 2))], [np.ones((2, 1)), d]])
        return DelaySystem(gain(m), (1.0, other_s))

    nilpotent = np.array([[0.6, 0.6], [-0.6, -0.6]])
    assert judge_stability(loop(nilpotent, 1.0)).stable
    apart = judge_stability(loop(nilpotent, 1.1))
    assert apart.stable is None
    assert "gain is 1.2" in apart.reason
    assert judge_stability(loop(nilpotent * 0.8, 1.1)).stable
    assert judge_stability(loop(np.full((2, 2), 0.55), 1.0)).unstable_poles == np.inf


def random_system(random: np.random.Generator, neutral: float) -> DelaySystem:
    """Return a system of three states, two delays, one input and one output."""
    a = random.normal(size=(3, 3)) - 1.5 * np.eye(3)
    # units of states that differ by some powers of ten
    scale = 10.0 ** random.integers(-4, 5, size=3)
    b, c = random.normal(size=(3, 3)), random.normal(size=(3, 3))
    d = np.zeros((3, 3))
    d[1:, 1:] = neutral * random.uniform(-1.0, 1.0, size=(2, 2))
    system = LtiSystem(a * scale[:, None] / scale, b * scale[:, None], c / scale, d)
    return DelaySystem(system, tuple(random.uniform(0.2, 3.0, size=2)))


@pytest.mark.parametrize("neutral", [0.0, 0.3])
def test_numbers_of_poles_are_those_of_the_discretised_generator(neutral: float) -> None:
    random = np.random.default_rng(11)
    counts = []
    for _ in range(30):
        system = random_system(random, neutral)
        made = judge_stability(system)
        poles = rightmost(system)
        counts.append(int((poles.real > 0.0).sum()))
        assert np.abs(poles.real).min() > 1e-6
        assert made.unstable_poles == counts[-1]
        assert np.abs(poles[poles.real > 0.0]).max(initial=0.0) <= made.bound_rad_s
    assert {0, 1, 2, 3} <= set(counts)


def test_abscissa_is_bracketed() -> None:
    """The rightmost pole of the discretised generator lies between two lines."""
    system = feedback(LAG * 2.0, delay(0.5))
    pole = rightmost(system)[0].real
    assert judge_stability(system, pole + 1e-6).stable
    assert judge_stability(system, pole - 1e-6).unstable_poles == 2.0
    with pytest.raises(InputError, match="finite"):
        judge_stability(system, np.nan)


def test_limits_are_said() -> None:
    made = judge_stability(feedback(INTEGRATOR, delay(1.5707)), most_intervals=3)
    assert made.stable is None
    assert "more than 3 intervals" in made.reason


def test_a_proof_covers_all_delays_near_these() -> None:
    """The equation x' = −x(t − T) is stable for T = 1 ± 0.5 s; 1.3 ± 0.3 s contains π/2."""
    near, far = (Pencil.of(feedback(INTEGRATOR, delay(one))) for one in (1.0, 1.3))
    assert cover_axis(near, 1.01, spread=np.array([0.5]))[1] == ""
    assert cover_axis(far, 1.01, spread=np.array([0.3]), most=2000)[1] != ""


def test_bound_of_a_perturbed_inverse() -> None:
    y = np.array([[[0.1, 1e8], [1e-9, 0.5]], [[0.1, 1e8], [1e-9, 0.9]], [[1.0, 0.0], [0.0, 0.1]]])
    right = np.abs(np.random.default_rng(0).normal(size=(3, 2, 2)))
    made = bound_perturbed(y, right)
    exact = np.linalg.solve(np.eye(2) - y[0], right[0])
    assert (made[0] >= exact).all()
    assert_allclose(made[0], exact, rtol=1e-6)
    # (1 − 0.1) (1 − 0.9) < 0.1: the spectral radius is above one
    assert np.isinf(made[1:]).all()
