from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.lower_bound import LowerBound
from hillsphere_controllers.mu.robustness import (
    Robustness,
    complexify,
    mu_bounds_on_grid,
    robust_performance,
    robust_stability,
)
from hillsphere_controllers.mu.worst_case_gain import worst_case_gain
from hillsphere_controllers.systems.algebra import append, gain, series, upper_lft
from hillsphere_controllers.systems.bilinear import discrete
from hillsphere_controllers.systems.interconnection import connect, with_names

CHANNELS = BlockStructure([full(1, name="reflux"), full(1, name="boilup")])


@cache
def distillation_column() -> LtiSystem:
    """Return the loop of a column with its inverse as the controller, in M-Δ form.

    Plant, weights and controller of S. Skogestad, M. Morari, J. C. Doyle (1988), Robust control of
    ill-conditioned plants: high-purity distillation, IEEE Transactions on Automatic Control 33(12);
    the integrator of the performance weight is moved to −1e-6.
    """
    static, one = np.array([[0.878, -0.864], [1.082, -1.096]]), np.ones((1, 1))

    def twice(pole: float, residue: float, direct: float) -> LtiSystem:
        part = LtiSystem(pole * one, one, residue * one, direct * one)
        return append(part, part)

    plant = series(twice(-1.0 / 75.0, 1.0 / 75.0, 0.0), gain(static))
    control = series(gain(np.linalg.inv(static)), twice(0.0, 0.7, 0.7 * 75.0))
    uncertain = twice(-2.0, -3.6, 2.0)  # (s + 0.2)/(0.5 s + 1)
    performance = twice(-1e-6, 0.05, 0.5)  # 0.5 (10 s + 1)/(10 s)
    return connect(
        [
            with_names(plant, "into", "y"),
            with_names(control, "e", "u"),
            with_names(uncertain, "u", "z"),
            with_names(performance, "seen", "p"),
        ],
        ["into = u + d", "seen = y + w", "e = -seen"],
        ["d", "w"],
        ["z", "p"],
    )


def test_distillation_column_is_robustly_stable() -> None:
    """Robust stability 0.5261 and nominal performance 0.5000: known values of this design."""
    m = distillation_column()
    found = robust_stability(m, CHANNELS, gap=1e-3)
    assert_allclose(found.lower, 0.5261, rtol=0.0, atol=1e-4)
    assert found.lower <= found.upper <= found.lower * (1.0 + 1e-3)
    assert_allclose(found.margin, (1.0 / found.upper, 1.0 / found.lower))
    nominal = LtiSystem(m.a, m.b[:, 2:], m.c[2:], m.d[2:, 2:])
    assert_allclose(hinf_norm(nominal).value, 0.5, rtol=0.0, atol=1e-6)


def test_distillation_column_lacks_robust_performance() -> None:
    """The known peak 5.7811, of a frequency grid, is 1.3e-4 below the one proved here."""
    found = robust_performance(distillation_column(), CHANNELS, gap=5e-4)
    assert_allclose(found.lower, 5.7811, rtol=3e-4)
    assert 5.7811 < found.lower <= found.upper <= found.lower * (1.0 + 6e-4)
    assert_allclose(found.frequency_rad_s, 1.4635, rtol=1e-3)
    assert_poles_on_the_border(found, distillation_column())


def assert_poles_on_the_border(found: Robustness, system: LtiSystem) -> None:
    """Check the worst case: Δ(s) is stable, no larger than claimed, and takes a pole to jω."""
    worst = found.worst
    assert worst is not None
    assert worst.system.is_stable
    assert hinf_norm(worst.system).value <= (1.0 + 1e-6) / found.lower
    poles = upper_lft(system, worst.system).poles
    border = 1j * worst.frequency_rad_s
    if system.dt_s is not None:
        border = np.exp(border * system.dt_s)
    assert np.abs(poles - border).min() <= 1e-6 * max(abs(border), 1e-3)
    assert abs(worst.pole - border) <= 1e-6 * max(abs(border), 1e-3)


def cubic(a2: float, a1: float, a0: float) -> LtiSystem:
    """Return s³ + (a₂ + δ₁) s² + (a₁ + δ₂) s + a₀ + δ₃ as M of the three δ."""
    a = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-a0, -a1, -a2]])
    b = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-1.0, -1.0, -1.0]])
    return LtiSystem(a, b, np.eye(3)[::-1], np.zeros((3, 3)))


REAL = BlockStructure(
    [repeated_real(name="a2"), repeated_real(name="a1"), repeated_real(name="a0")]
)


def test_purely_real_example() -> None:
    """By Hurwitz, (2 − k)(3 − k) = 2 + k is the border: k = 3 − √5 at ω = √(3 − k)."""
    system = cubic(2.0, 3.0, 2.0)
    found = robust_stability(system, REAL, gap=2e-3, complex_shares=(0.01, 0.05))
    k = 3.0 - np.sqrt(5.0)
    assert_allclose(found.lower, 1.0 / k, rtol=1e-7)
    assert 1.0 / k * (1.0 - 1e-6) <= found.upper <= 1.003 / k
    assert_allclose(found.frequency_rad_s, np.sqrt(3.0 - k), rtol=1e-4)
    assert found.worst is not None
    assert found.worst.system.order == 0
    values = found.worst.values
    assert_allclose([values["a2"], values["a1"], values["a0"]], [-k, -k, k], rtol=1e-4)
    assert_poles_on_the_border(found, system)
    less, more = found.complexified
    assert (less.share, more.share) == (0.01, 0.05)
    assert found.lower < less.lower <= less.upper < more.upper
    assert less.upper <= 1.03 * found.upper  # this example is a mild one


def test_complex_parts_show_a_jump() -> None:
    """s³ + 2 s² + 3 s + 5 + δ: a little complex, δ matters over a band and not at one frequency."""
    whole = cubic(2.0, 3.0, 5.0)
    one = LtiSystem(whole.a, whole.b[:, 2:], whole.c[2:], whole.d[2:, 2:])
    structure = BlockStructure([repeated_real()])
    found = robust_stability(one, structure)
    assert_allclose(found.lower, 1.0, rtol=1e-6)
    assert found.lower <= found.upper <= 1.02
    omega = np.array([1.5, 1.6, 1.9])
    lower, upper = mu_bounds_on_grid(one, structure, omega)
    assert not lower.any()
    assert upper.max() <= 1e-4
    wider, blocks = complexify(one, structure, 0.05)
    assert mu_bounds_on_grid(wider, blocks, omega)[1].min() >= 0.02


def test_grid_lies_between_the_bounds() -> None:
    system = distillation_column()
    structure = BlockStructure([*CHANNELS.blocks, full(2)])
    lower, upper = mu_bounds_on_grid(system, structure, np.logspace(-2, 2, 15))
    assert np.all(lower <= upper * (1.0 + 1e-9))
    assert_allclose(lower, upper, rtol=1e-3)  # three blocks leave no gap
    assert upper.max() <= 5.783


def test_mixed_problem_with_repeated_and_rectangular_blocks() -> None:
    structure = BlockStructure([repeated_real(2, "mass"), repeated_complex(1), full(1, 2)])
    random = np.random.default_rng(3)
    a = (
        np.diag([-1.0, -0.2, -0.5, -2.0])
        + np.diag([2.0, 3.0, 1.0], 1)
        - np.diag([2.0, 3.0, 1.0], -1)
    )
    p, m = structure.shape
    system = LtiSystem(
        a, random.normal(size=(4, m)), random.normal(size=(p, 4)), 0.1 * random.normal(size=(p, m))
    )
    found = robust_stability(system, structure)
    assert 0.5 * found.upper <= found.lower <= found.upper
    assert_poles_on_the_border(found, system)
    sampled = discrete(system, 0.05)
    image = robust_stability(sampled, structure)
    assert_allclose(image.lower, found.lower, rtol=1e-4)
    assert_poles_on_the_border(image, sampled)


def test_constant_loop() -> None:
    """Without states the phase that a complex scalar needs is taken at some frequency."""
    none = np.zeros((0, 0))
    d = np.array([[0.0, -4.0], [1.0, 0.0]])
    constant = LtiSystem(none, np.zeros((0, 2)), np.zeros((2, 0)), d)
    found = robust_stability(constant, BlockStructure([repeated_complex(), repeated_complex()]))
    assert_allclose([found.lower, found.upper], 2.0, rtol=1e-6)


def test_nothing_destabilises_a_loop_that_is_open() -> None:
    silent = LtiSystem(-np.eye(2), np.ones((2, 1)), np.zeros((1, 2)), np.zeros((1, 1)))
    found = robust_stability(silent, BlockStructure([full(1)]))
    assert found.upper == found.lower == 0.0
    assert found.worst is None
    assert found.margin == (np.inf, np.inf)


@pytest.mark.parametrize("dt_s", [None, 0.02])
def test_robust_performance_is_no_better_than_nominal(dt_s: float | None) -> None:
    """µ peaks where one mode lets a stiffness matter, nominal performance at another mode."""
    random = np.random.default_rng(7)
    for _ in range(2):
        a = np.zeros((6, 6))
        for k, omega in enumerate(random.uniform(0.3, 3.0, 3)):
            damping = random.uniform(0.01, 0.1)
            a[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = [[0.0, omega], [-omega, -damping]]
        b, c = random.normal(size=(6, 4)), random.normal(size=(4, 6))
        system = LtiSystem(a, b, c, np.zeros((4, 4)))
        system = system if dt_s is None else discrete(system, dt_s)
        blocks = BlockStructure([repeated_real(1, "k"), full(1)])
        nominal = hinf_norm(
            LtiSystem(system.a, system.b[:, 2:], system.c[2:], system.d[2:, 2:], dt_s)
        )
        found = robust_performance(system, blocks)
        assert nominal.value * (1.0 - 1e-9) <= found.lower <= found.upper
        assert_poles_on_the_border(found, system)


@pytest.mark.parametrize("dt_s", [None, 0.02])
def test_nominal_performance_is_known_where_the_search_finds_nothing(
    monkeypatch: pytest.MonkeyPatch, dt_s: float | None
) -> None:
    def nothing(_: LtiSystem, structure: BlockStructure, *__: object, **___: object) -> LowerBound:
        p, m = structure.shape
        return LowerBound(0.0, np.zeros((m, p), dtype=complex), 1.0)

    monkeypatch.setattr("hillsphere_controllers.mu.robustness.lower_bound_near", nothing)
    a, b = np.array([[0.0, 1.0], [-4.0, -0.1]]), np.array([[0.0, 0.0], [0.0, 1.0]])
    system = LtiSystem(a, b, np.array([[0.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)))
    system = system if dt_s is None else discrete(system, dt_s)
    found = robust_performance(system, BlockStructure([repeated_real(1, "k")]))
    assert_allclose(found.lower, 1.0 / (0.1 * np.sqrt(4.0 - 0.0025)), rtol=1e-8)
    assert_poles_on_the_border(found, system)


def test_mu_is_no_smaller_than_what_the_worst_gain_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Δ of size one that leaves the gain g < 1 shows µ ≥ g, whatever the search finds."""

    def nothing(_: LtiSystem, structure: BlockStructure, *__: object, **___: object) -> LowerBound:
        p, m = structure.shape
        return LowerBound(0.0, np.zeros((m, p), dtype=complex), 1.0)

    monkeypatch.setattr("hillsphere_controllers.mu.robustness.lower_bound_near", nothing)
    # at rest the gain is 0.5/((1 + 0.3 δ₁)(1 + 0.2 δ₂)): largest at zero frequency
    first = LtiSystem(
        np.diag([-1.0, -2.0]), np.array([[-0.3, 0.0, 0.5], [0.0, -0.4, 0.0]]),
        np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]), np.zeros((3, 3)),
    )  # fmt: skip
    system = LtiSystem(first.a + np.array([[0.0, 0.0], [2.0, 0.0]]), first.b, first.c, first.d)
    blocks = BlockStructure([repeated_real(1, "a"), repeated_real(1, "b")])
    found = robust_performance(system, blocks, gap=1e-3)
    worst = worst_case_gain(system, blocks, gap=1e-3)
    assert worst.lower == pytest.approx(0.5 / (0.7 * 0.8), rel=1e-6)
    # on the border (1 − 0.3/µ)(1 − 0.2/µ) µ = 0.5
    exact = max(np.roots([1.0, -1.0, 0.06]))
    assert found.lower == pytest.approx(exact, rel=2e-3)
    assert found.lower <= found.upper
    assert_poles_on_the_border(found, system)


def test_worst_gain_of_the_column() -> None:
    """Between the bounds, and reached by a Δ(s) that is checked here once more."""
    m = distillation_column()
    found = worst_case_gain(m, CHANNELS, gap=0.05)
    assert found.lower <= found.upper <= 1.06 * found.lower
    assert found.delta.is_stable
    assert hinf_norm(found.delta).value <= 1.0
    assert_allclose(hinf_norm(upper_lft(m, found.delta)).value, found.lower, rtol=1e-6)
    # robust performance of 5.782 means: with 1/5.782 of the uncertainty the gain is 5.782 at most
    small = worst_case_gain(m, CHANNELS, size=1.0 / 5.782, gap=0.05)
    assert_allclose(small.lower, 5.782, rtol=0.01)
    assert small.lower <= small.upper <= 1.06 * 5.782


def test_worst_gain_is_infinite_beyond_the_stability_margin() -> None:
    found = worst_case_gain(distillation_column(), CHANNELS, size=2.5)
    assert found.upper == np.inf
    assert found.lower == np.inf


def test_worst_gain_of_one_uncertain_stiffness() -> None:
    """1/(s² + 0.2 s + 1 + 0.5 δ) peaks at 1/(0.2 √(k − 0.01)), the largest for δ = −1."""
    a = np.array([[0.0, 1.0], [-1.0, -0.2]])
    b = np.array([[0.0, 0.0], [-0.5, 1.0]])
    system = LtiSystem(a, b, np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)))
    found = worst_case_gain(system, BlockStructure([repeated_real(name="stiffness")]), gap=1e-3)
    exact = 1.0 / (0.2 * np.sqrt(0.5 - 0.01))
    assert_allclose(found.lower, exact, rtol=1e-6)
    assert exact <= found.upper <= 1.002 * exact
    assert_allclose(found.values["stiffness"], -1.0, rtol=1e-6)
    sampled = worst_case_gain(discrete(system, 0.1), BlockStructure([repeated_real()]))
    assert_allclose(sampled.lower, exact, rtol=1e-6)


def test_a_gain_that_grows_without_end_is_infinite() -> None:
    """A spring of unit mass that is allowed to become as soft as nothing, and a little more."""
    a = np.array([[0.0, 1.0], [-1.0, -0.2]])
    b = np.array([[0.0, 0.0], [-1.0, 1.0]])
    system = LtiSystem(a, b, np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)))
    spring = BlockStructure([repeated_real(name="stiffness")])
    for size in (1.0, 1.0 + 1e-7, 1.5):
        found = worst_case_gain(system, spring, size=size)
        assert found.upper == found.lower == np.inf
        assert found.values["stiffness"] <= -1.0 + 1e-6
        assert abs(found.values["stiffness"]) <= size
    assert not upper_lft(system, found.delta).is_stable
    assert found.certified.intervals == ()
    just = worst_case_gain(system, spring, size=0.999)
    assert_allclose([just.lower, just.upper], 1000.0, rtol=0.02)


def test_a_repeated_parameter_just_beyond_its_margin_ends() -> None:
    """Skewed bounds near 1.4518 rad/s went to infinity by ever smaller intervals."""
    a = [[0.291303717451812, -0.9451165811625704], [2.2200284510139974, -0.891303717451812]]
    b = [
        [0.04374373730763478, -0.08134533701125894, -1.0141990573706041, -0.40196737756487977],
        [0.5437091481920681, 0.07517606779847247, -0.840002344803521, -0.9270105425018005],
    ]
    c = [
        [-0.11081225358887416, -1.4131231647029436],
        [0.7382357381447398, -1.8008171011084055],
        [0.08455887137071662, 0.767322687547113],
        [0.5090342485752677, 1.8308545525569033],
    ]
    d = np.zeros((4, 4))
    d[2:, 2:] = [
        [0.23837689696866074, 1.0576467208633515],
        [-0.5624753251457391, 1.8793001918776162],
    ]
    system = LtiSystem(np.array(a), np.array(b), np.array(c), d)
    twice = BlockStructure([repeated_real(2, "k")])
    found = worst_case_gain(system, twice, size=2.0)
    assert found.upper == found.lower == np.inf
    assert abs(found.values["k"]) <= 2.0
    assert not upper_lft(system, found.delta).is_stable


def test_a_gain_of_a_million_beside_an_unstable_corner_is_infinite() -> None:
    """The lower bound of µ misses δ = (0.5, −0.5), but the gain is raised up to the border."""
    random = np.random.default_rng(128)
    random.integers(1, 3, 6)
    a = random.normal(size=(4, 4))
    a -= (np.linalg.eigvals(a).real.max() + 0.3) * np.eye(4)
    b = np.hstack([0.25 * random.normal(size=(4, 3)), random.normal(size=(4, 1))])
    c = np.vstack([random.normal(size=(3, 4)), random.normal(size=(2, 4))])
    system = LtiSystem(a, b, c, np.zeros((5, 4)))
    corner = gain(np.diag([0.5, 0.5, -0.5]))
    assert not upper_lft(system, corner).is_stable
    found = worst_case_gain(system, BlockStructure([repeated_real(2), repeated_real()]), size=0.5)
    assert found.upper == found.lower == np.inf
    assert not upper_lft(system, found.delta).is_stable


def test_worst_gain_of_an_algebraic_loop_and_of_nothing() -> None:
    single = BlockStructure([repeated_real(name="k")])
    closed = worst_case_gain(gain(np.array([[1.0, 1.0], [1.0, 0.2]])), single)
    assert closed.upper == closed.lower == np.inf
    assert_allclose(closed.values["k"], 1.0, rtol=1e-9)
    silent = LtiSystem(-np.eye(1), np.zeros((1, 2)), np.zeros((2, 1)), np.zeros((2, 2)))
    nothing = worst_case_gain(silent, single)
    assert nothing.upper == nothing.lower == 0.0


def test_errors_say_what_to_do() -> None:
    m = distillation_column()
    with pytest.raises(InputError, match="need 5 outputs and 5 inputs, got 4 and 4"):
        robust_stability(m, BlockStructure([full(5)]))
    with pytest.raises(InputError, match="none is left for performance"):
        robust_performance(m, BlockStructure([full(4)]))
    with pytest.raises(InputError, match="size of Δ must be positive"):
        worst_case_gain(m, CHANNELS, size=-1.0)
    with pytest.raises(InputError, match="only purely real"):
        complexify(m, BlockStructure([full(4)]), 0.1)
    with pytest.raises(InputError, match="between 0 and 1"):
        complexify(cubic(2.0, 3.0, 2.0), REAL, 1.0)
    with pytest.raises(InputError, match="leave those of performance out"):
        complexify(m, BlockStructure([repeated_real()]), 0.1)


@pytest.mark.parametrize("unit", [1.0, 1e6, 1e-8])
def test_units_of_performance_do_not_matter(unit: float) -> None:
    """A mass on a weak damper, its disturbance in newtons, meganewtons and so on."""
    loop = LtiSystem(
        np.array([[0.0, 1.0], [-1.0, -0.02]]), np.array([[0.0, 0.0], [1e-3, unit]]),
        np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)),
    )  # fmt: skip
    found = worst_case_gain(loop, BlockStructure([repeated_complex()]))
    # |G| = g at its peak, and δ adds what closes (1 − 1e-3 g)
    peak = 1.0 / (0.02 * np.sqrt(1.0 - 1e-4))
    assert_allclose(found.lower / unit, peak / (1.0 - 1e-3 * peak), rtol=1e-6)
    assert found.lower <= found.upper <= 1.0101 * found.lower
    (first, *_) = found.certified.intervals
    assert first.bound == pytest.approx(found.upper, rel=1e-12)
    # the scalings prove it for the loop as it was given
    d, g = first.scalings.d, first.scalings.g
    m = loop.response(np.array([first.frequency_rad_s]))[0]
    level = np.diag([1.0, first.bound**2])
    form = level @ d - m.conj().T @ d @ m - 1j * (g @ m - m.conj().T @ g)
    assert np.linalg.eigvalsh(form)[0] > 0.0


def test_a_peak_of_direct_terms_has_no_pole() -> None:
    loop = LtiSystem(
        -np.eye(1), np.array([[0.5, 0.0]]), np.array([[1.0], [0.0]]), np.diag([0.0, 2.0])
    )
    found = robust_performance(loop, BlockStructure([repeated_real(1, "k")]))
    assert_allclose(found.lower, 2.0, rtol=1e-9)
    assert found.upper <= 2.0 * 1.0101
    assert found.worst is not None
    assert np.isinf(found.worst.pole)
