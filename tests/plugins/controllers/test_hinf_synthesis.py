from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import (
    NotStabilisableError,
    SingularProblemError,
    SynthesisFailedError,
)
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.full_order.modes import check_modes
from hillsphere_controllers.full_order.riccati import solution_by_pencil, stabilising_solution
from hillsphere_controllers.systems.algebra import gain, lower_lft
from hillsphere_controllers.systems.bilinear import continuous, discrete


def random_plant(seed: int, order: int, controls: int, measurements: int) -> LtiSystem:
    random = np.random.default_rng(seed)
    m, p = controls + measurements + 1, controls + measurements + 1
    return LtiSystem(
        random.normal(size=(order, order)),
        random.normal(size=(order, m + controls)),
        random.normal(size=(p + measurements, order)),
        random.normal(size=(p + measurements, m + controls)),
    )


def scalar_plant(a: float) -> LtiSystem:
    """ẋ = a x + w₁ + u, z = (x, u), y = x + w₂."""
    return LtiSystem(
        np.array([[a]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
    )


@pytest.mark.parametrize("a", [-2.0, -0.1, 0.0, 1.0, 3.0])
def test_scalar_problem_in_closed_form(a: float) -> None:
    """Both equations read (1 − 1/γ²)x² − 2ax − 1 = 0; the least γ has x = γ, or x infinite."""
    # x(γ) = γ: (γ² − 1) − 2aγ − 1 = 0
    least = a + np.sqrt(a * a + 2.0)
    found = hinf_synthesis(scalar_plant(a), 1, 1, tolerance=1e-8)
    assert_allclose(found.least, least, rtol=1e-6)
    assert least * (1 - 1e-9) <= found.gamma <= least * 1.0051
    assert found.closed_loop.is_stable


def norm_by_sampling(system: LtiSystem) -> float:
    omega = np.concatenate([[0.0], np.logspace(-4, 5, 20_000)])
    return float(np.linalg.svd(system.response(omega), compute_uv=False).max())


@pytest.mark.parametrize("seed", range(6))
def test_the_closed_loop_is_what_is_said(seed: int) -> None:
    """D11, D22 not zero; γ near its least, and no higher by an independent response."""
    plant = random_plant(seed, 3 + seed, 1 + seed % 2, 2 - seed % 2)
    controls, measurements = 1 + seed % 2, 2 - seed % 2
    found = hinf_synthesis(plant, controls, measurements)
    loop = lower_lft(plant, found.controller)
    assert loop.is_stable
    assert_allclose(hinf_norm(loop).value, found.gamma, rtol=1e-9)
    assert norm_by_sampling(loop) <= found.gamma * (1 + 1e-9)
    assert found.least * (1 - 1e-3) <= found.gamma <= 1.02 * found.least


@pytest.mark.parametrize("seed", range(6))
def test_slicot_finds_the_same_bound(seed: int) -> None:
    """SB10AD, by bisection."""
    slycot = pytest.importorskip("slycot")
    order, controls, measurements = 1 + seed, 1 + seed % 3, 1 + seed % 2
    plant = random_plant(50 + seed, order, controls, measurements)
    p, m = plant.shape
    theirs = slycot.sb10ad(
        order, m, p, controls, measurements, 1e4, plant.a, plant.b, plant.c, plant.d, job=1
    )
    found = hinf_synthesis(plant, controls, measurements, tolerance=1e-6)
    assert_allclose(found.least, theirs[0], rtol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_units_change_nothing(seed: int) -> None:
    """Of the states, of time, of controls and measurements, over ten decades."""
    random = np.random.default_rng(seed)
    plant = random_plant(30 + seed, 6, 2, 1)
    p, m = plant.shape
    x = 10.0 ** random.uniform(-5.0, 5.0, size=6)
    u = np.concatenate([np.ones(m - 2), 10.0 ** random.uniform(-5.0, 5.0, size=2)])
    y = np.concatenate([np.ones(p - 1), 10.0 ** random.uniform(-5.0, 5.0, size=1)])[:, None]
    scaled = LtiSystem(
        1e-4 * plant.a / x[:, None] * x, 1e-4 * plant.b / x[:, None] * u, y * plant.c * x,
        y * plant.d * u,
    )  # fmt: skip
    one, other = (hinf_synthesis(made, 2, 1, tolerance=1e-6) for made in (plant, scaled))
    assert_allclose([other.gamma, other.least], [one.gamma, one.least], rtol=1e-5)
    assert_allclose(1e-4 * one.norm.frequency_rad_s, other.norm.frequency_rad_s, rtol=1e-2)


def test_a_regularisation_is_in_the_units_given() -> None:
    """Of a control in other units: a weight as large on the same number."""
    plant = scalar_plant(1.0)
    free = changed(plant, d=plant.d * [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])
    weak = changed(free, b=plant.b * [[1.0, 1.0, 1e-3]])
    cheap = hinf_synthesis(free, 1, 1, regularisation=1e-3)
    dear = hinf_synthesis(weak, 1, 1, regularisation=1e-6)
    # u is a thousand times as large and weighs as much; the noise is a thousandth of the former
    assert_allclose(dear.gamma, cheap.gamma, rtol=1e-2)


def test_what_is_neither_reached_nor_seen_is_no_hindrance() -> None:
    """A plant that is not minimal: stable modes that the controls do not reach, or y not show."""
    plant = scalar_plant(1.0)
    more = LtiSystem(
        np.diag([1.0, -3.0, -4.0]),
        np.vstack([plant.b, [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]]),
        np.hstack([plant.c, [[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]]),
        plant.d,
    )
    found = hinf_synthesis(more, 1, 1, tolerance=1e-6)
    assert_allclose(found.least, hinf_synthesis(plant, 1, 1, tolerance=1e-6).least, rtol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_no_controller_found_by_search_does_better(seed: int) -> None:
    """A random search over controllers of first order, from the static ones."""
    plant = random_plant(70 + seed, 3, 1, 1)
    plant = changed(plant, a=plant.a - 1.5 * np.eye(3))
    least = hinf_synthesis(plant, 1, 1).least
    random, best = np.random.default_rng(seed), np.inf
    centre, width = np.array([-1.0, 0.0, 0.0, 0.0]), 2.0
    for _ in range(100):
        tried = centre + width * random.normal(size=4)
        a, b, c, d = tried[:, None, None]
        controller = LtiSystem(a, b, c, d)
        norm = hinf_norm(lower_lft(plant, controller)).value
        assert norm >= least * (1.0 - 1e-9)
        if norm < best:
            best, centre = norm, tried
        elif np.isfinite(best):
            width *= 0.97
    assert best < 5.0 * least


def test_no_static_controller_does_better() -> None:
    """Over a dense grid of gains that stabilise."""
    plant = scalar_plant(0.5)
    least = hinf_synthesis(plant, 1, 1, tolerance=1e-6).least
    loops = [lower_lft(plant, gain(np.array([[k]]))) for k in np.linspace(-10.0, 2.0, 121)]
    norms = [hinf_norm(loop).value for loop in loops if loop.is_stable]
    assert norms
    assert min(norms) >= least * (1 - 1e-9)


def test_discrete_time_has_the_norm_of_its_image() -> None:
    plant = random_plant(20, 4, 1, 1)
    image = discrete(plant, 0.1)
    found = hinf_synthesis(image, 1, 1)
    assert found.controller.dt_s == 0.1
    assert_allclose(found.least, hinf_synthesis(plant, 1, 1).least, rtol=1e-3)
    assert found.closed_loop.is_stable


def changed(plant: LtiSystem, **matrices: Array) -> LtiSystem:
    given = {name: matrices.get(name, getattr(plant, name)) for name in "abcd"}
    return LtiSystem(**given)


def test_what_cannot_be_stabilised_is_named() -> None:
    plant = scalar_plant(1.0)
    deaf = changed(plant, b=np.array([[1.0, 0.0, 0.0]]))
    with pytest.raises(NotStabilisableError, match="controls do not reach the mode at s = 1"):
        hinf_synthesis(deaf, 1, 1)
    blind = changed(plant, c=np.array([[1.0], [0.0], [0.0]]))
    with pytest.raises(NotStabilisableError, match="measurements do not show"):
        hinf_synthesis(blind, 1, 1)


def test_singular_problems_are_named_and_regularised() -> None:
    plant = scalar_plant(1.0)
    cheap = changed(plant, d=plant.d * [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])
    with pytest.raises(SingularProblemError, match="D12 lacks full rank"):
        hinf_synthesis(cheap, 1, 1, regularisation=0.0)
    found = hinf_synthesis(cheap, 1, 1, regularisation=1e-3)
    # without cost of control only the noise counts: z = x = y − w₂ can be held no smaller than w₂
    assert 1.0 - 1e-6 <= found.gamma <= 1.05
    with pytest.raises(InputError, match="2 controls and 1 measurements do not fit"):
        hinf_synthesis(gain(np.ones((1, 1))), 2, 1)


def test_zero_on_the_axis_is_named() -> None:
    """An integrator weight outside of the loop: ẋ₂ = w cannot be moved by u nor seen."""
    plant = LtiSystem(
        np.diag([-1.0, 0.0]),
        np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
        np.array([[1.0, 1.0], [0.0, 0.0], [1.0, 0.0]]),
        scalar_plant(0.0).d,
    )
    with pytest.raises(NotStabilisableError):
        hinf_synthesis(plant, 1, 1)


def test_riccati_solution_with_an_indefinite_term() -> None:
    """Scalar: 2ax + sx² + q = 0 with a + sx < 0."""
    for a, s, q in ((1.0, -1.0, 3.0), (-2.0, 1.0, 3.0), (0.0, -2.0, 0.5)):
        x = stabilising_solution(np.array([[a]]), np.array([[s]]), np.array([[q]]))
        assert x is not None
        root = np.sqrt(a * a - s * q)
        assert_allclose(x[0, 0], (-a - root) / s, rtol=1e-12)
    none = stabilising_solution(np.array([[1.0]]), np.array([[1.0]]), np.array([[3.0]]))
    assert none is None  # a² < sq: eigenvalues on the axis


def ill_conditioned_plant(seed: int) -> LtiSystem:
    """Modes over eleven decades, weights and noise over six."""
    random = np.random.default_rng(seed)
    n = int(random.integers(2, 9))
    k = seed - 1000
    if k % 2:
        a = np.diag(np.where(random.random(n) < 0.3, 1, -1) * 10 ** random.uniform(-7, 4, n))
    else:
        a = np.diag(-(10 ** random.uniform(-7, 4, n)))
    if k % 3 == 0:
        a[0, 0] = abs(a[0, 0])
    b = random.normal(size=(n, 3)) * 10 ** random.uniform(-2, 2, (n, 1))
    c = random.normal(size=(3, n))
    if k % 4 == 1:
        a = a + np.triu(random.normal(size=(n, n)), 1)
    if k % 5 == 0:
        b[1, 2:] = 0.0
        a[1, 1] = -abs(a[1, 1])
    d = np.zeros((3, 3))
    d[0, 2], d[2, 0] = 10 ** random.uniform(-5, 1), 10 ** random.uniform(-5, 1)
    if k % 6 == 0:
        d[1, 1] = 5.0
    return LtiSystem(a, b, c, d)


@pytest.mark.parametrize(
    ("seed", "reached"),
    [(1000, 1295.93), (1002, 6209.84), (1070, 261058.0), (1086, 65942.5), (1130, 14665.8)],
)
def test_least_is_below_what_another_controller_reaches(seed: int, reached: float) -> None:
    """Norms of closed loops with controllers of SLICOT's SB10FD, rounded up."""
    found = hinf_synthesis(ill_conditioned_plant(seed), 1, 1)
    assert found.least <= min(reached, found.gamma)
    assert found.gamma <= 1.2 * reached


@pytest.mark.parametrize("seed", [1001, 1004, 1006, 1041, 1081, 1089])
def test_least_is_not_above_gamma_where_rounding_decides(seed: int) -> None:
    found = hinf_synthesis(ill_conditioned_plant(seed), 1, 1)
    assert 0.0 <= found.least <= found.gamma
    assert found.closed_loop.is_stable


@pytest.mark.parametrize(
    ("seed", "reached"),
    [(1020, 1.275e7), (1028, 24114.0), (1056, 148532.0), (1090, 215214.0), (1142, 225017.0)],
)
def test_uneven_plants_are_solved_by_the_pencil(seed: int, reached: float) -> None:
    """The Hamiltonian matrices of these show no solution; SB10FD's norms, rounded up."""
    found = hinf_synthesis(ill_conditioned_plant(seed), 1, 1)
    assert found.closed_loop.is_stable
    assert 0.0 < found.least <= found.gamma <= 1.01 * reached
    assert found.norm.upper <= 1.001 * found.gamma


def test_what_rounding_hinders_is_not_called_a_zero() -> None:
    with pytest.raises(SynthesisFailedError, match="no zero on the imaginary axis was found"):
        hinf_synthesis(ill_conditioned_plant(1084), 1, 1, regularisation=0.0)


def test_the_pencil_has_the_same_solution() -> None:
    random = np.random.default_rng(5)
    a, b, c = random.normal(size=(4, 4)), random.normal(size=(4, 2)), random.normal(size=(3, 4))
    r, cross = np.diag([-1e4, 1.0]), np.zeros((4, 2))
    formed = a, -b @ np.linalg.solve(r, b.T), c.T @ c
    x = stabilising_solution(*formed)
    assert x is not None
    same = solution_by_pencil((a, b, c.T @ c, r, cross), formed)
    assert same is not None
    assert_allclose(same, x, rtol=1e-9)
    one = np.ones((1, 1))  # eigenvalues on the axis
    assert solution_by_pencil((one, one, 3.0 * one, -one, 0.0 * one), (one, one, 3.0 * one)) is None


@pytest.mark.parametrize(
    "option",
    [{"tolerance": 0.0}, {"tolerance": np.nan}, {"back_off": -0.1}, {"back_off": np.nan},
     {"back_off": np.inf}, {"regularisation": np.nan}],
)  # fmt: skip
def test_options_out_of_range_are_refused(option: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(option)).replace("_", "-")):
        hinf_synthesis(scalar_plant(1.0), 1, 1, **option)


def test_a_zero_on_the_axis_is_named_with_its_frequency() -> None:
    """From u to z: 1 − 1/(s + 1) = s/(s + 1)."""
    plant = LtiSystem(
        np.array([[-1.0]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[-1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    )
    with pytest.raises(SingularProblemError, match=r"u to z has a zero .* at 0 rad/s"):
        hinf_synthesis(plant, 1, 1, regularisation=0.0)


def test_a_slow_mode_is_reached_however_fast_the_others() -> None:
    check_modes(np.diag([1e-7, -1e4]), np.array([[1e-6], [1.0]]), np.array([[1e-6, 1.0]]))
    with pytest.raises(NotStabilisableError, match="do not reach the mode at s = 1e-07"):
        check_modes(np.diag([1e-7, -1e4]), np.array([[0.0], [1.0]]), np.array([[1e-6, 1.0]]))


def test_the_bilinear_map_does_not_depend_on_units() -> None:
    random = np.random.default_rng(3)
    a = 0.3 * random.normal(size=(4, 4))
    scale = 2.0 ** np.array([-40.0, 0.0, 20.0, 40.0])
    b, c, d = random.normal(size=(4, 1)), random.normal(size=(1, 4)), np.zeros((1, 1))
    plain = continuous(LtiSystem(a, b, c, d, 0.1))
    other = continuous(LtiSystem(a / scale[:, None] * scale, b / scale[:, None], c * scale, d, 0.1))
    omega = np.array([0.0, 1.0, 30.0])
    assert_allclose(other.response(omega), plain.response(omega), rtol=1e-9)
    fast = np.array([[-1e15, 3.0], [0.0, -1e-6]])  # far from 2/dt, and well determined
    image = discrete(LtiSystem(fast, np.ones((2, 1)), np.ones((1, 2)), d), 1.0)
    assert_allclose(np.sort(image.poles.real), [-1.0, (1 - 5e-7) / (1 + 5e-7)], rtol=1e-9)
    turn = np.linalg.qr(np.array([[1.0, 2.0], [3.0, 4.0]]))[0]
    for near in (np.diag([2.0, -1e5]), turn @ np.diag([2.0 + 1e-12, -1e5]) @ turn.T):
        with pytest.raises(InputError, match="a pole at 2/dt = 2 1/s has no image"):
            discrete(LtiSystem(near, np.ones((2, 1)), np.ones((1, 2)), d), 1.0)
    with pytest.raises(InputError, match="a pole at z = −1"):
        continuous(LtiSystem(-np.eye(1), np.eye(1), np.eye(1), d, 0.1))
