from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.dk.absorption import absorb_scalings, factors
from hillsphere_controllers.dk.fitting import (
    Goal,
    fit_multipliers,
    lift_multiplier,
    negative_frequencies,
    relative_levels,
)
from hillsphere_controllers.dk.goals import core_size, mu_upper_bounds, reference_block
from hillsphere_controllers.dk.initial_scalings import constant_multipliers
from hillsphere_controllers.dk.joint import descend_jointly
from hillsphere_controllers.dk.multipliers import Multiplier
from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.mu.blocks import (
    Block,
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.systems.algebra import lower_lft
from hillsphere_controllers.systems.bilinear import discrete
from hillsphere_controllers.systems.truncation import balanced_truncation

Complex = NDArray[np.complex128]

OMEGA = np.array([0.0, 0.05, 0.3, 1.0, 2.0, 7.0, 40.0, np.inf])
BLOCKS = [full(1), full(2, 3), repeated_complex(2), repeated_real(1), repeated_real(2)]


def multiplier(block: Block, seed: int = 0) -> Multiplier:
    """Of the third order, and D positive."""
    random = np.random.default_rng(seed)
    made = Multiplier.constant(block, 2.0 * np.eye(core_size(block)))
    for omega in (1.0, 10.0, 0.3):
        made = made.add_pole(omega)
    return made.step(0.15 * random.normal(size=made.size), -6.0, 6.0)


def conjugate(x: Complex) -> Complex:
    return x.conj().swapaxes(-1, -2)


def stable_system(seed: int, order: int, p: int, m: int) -> LtiSystem:
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order))
    a -= (np.linalg.eigvals(a).real.max() + 0.3) * np.eye(order)
    return LtiSystem(
        a, random.normal(size=(order, m)), random.normal(size=(p, order)),
        0.2 * random.normal(size=(p, m)),
    )  # fmt: skip


@pytest.mark.parametrize("block", BLOCKS)
def test_scalings_belong_to_the_structure_and_to_a_real_system(block: Block) -> None:
    d, g = multiplier(block).values(OMEGA)
    assert_allclose(d, conjugate(d), rtol=0.0, atol=1e-14)
    assert_allclose(g, -conjugate(g), rtol=0.0, atol=1e-14)
    assert np.linalg.eigvalsh(d).min() > 0.0
    assert not d[[0, -1]].imag.any()
    assert not g[[0, -1]].imag.any()
    if block.kind == "full":
        assert_allclose(d, d[:, :1, :1] * np.eye(max(block.rows, block.columns)), rtol=1e-15)
    assert bool(np.any(g)) == (block.kind == "real")


@pytest.mark.parametrize("block", BLOCKS)
def test_derivatives_are_those_of_differences(block: Block) -> None:
    one = multiplier(block)
    d, g = one.tangents(OMEGA)
    for k, unit in enumerate(np.eye(one.size)):
        (d1, g1), (d0, g0) = (
            one.step(step * unit, -20.0, 20.0).values(OMEGA) for step in (1e-6, -1e-6)
        )
        assert_allclose((d1 - d0) / 2e-6, d[:, k], rtol=0.0, atol=3e-9)
        assert_allclose((g1 - g0) / 2e-6, g[:, k], rtol=0.0, atol=3e-9)


@pytest.mark.parametrize("block", BLOCKS)
def test_a_new_pole_changes_nothing(block: Block) -> None:
    one = multiplier(block)
    more = one.add_pole(0.7).add_pole(3.0)
    assert more.order == one.order + 2
    for before, after in zip(one.values(OMEGA), more.values(OMEGA), strict=True):
        assert_allclose(after, before, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("block", BLOCKS)
def test_factors_are_stable_and_have_their_product(block: Block) -> None:
    """LᴴL = D; NᴴN + VᴴV = I and N V⁻¹ = L⁻ᴴ jG L⁻¹/β, V = L·(first rows on the right)."""
    beta, one = 1.3, multiplier(block)
    found = factors(one, beta)
    r = core_size(block)
    d, g = (x[:, :r, :r] for x in one.values(OMEGA))
    left, right = found.left.response(OMEGA), found.right.response(OMEGA)
    assert found.left.is_stable
    assert found.right.is_stable
    assert_allclose(conjugate(left) @ left, d, rtol=0.0, atol=1e-12)
    v, n = left @ right[:, :r], right[:, r:]
    if block.kind != "real":
        assert not found.has_g
        assert_allclose(v, np.broadcast_to(np.eye(r), v.shape), rtol=0.0, atol=1e-12)
        return
    assert_allclose(
        conjugate(n) @ n + conjugate(v) @ v, np.broadcast_to(np.eye(r), v.shape), rtol=0.0,
        atol=2e-10,
    )  # fmt: skip
    inverse: Complex = np.linalg.inv(left).astype(complex)
    assert_allclose(
        beta * n @ np.linalg.inv(v), conjugate(inverse) @ g @ inverse, rtol=0.0, atol=1e-11
    )


def test_a_scaling_that_is_not_positive_has_no_factors() -> None:
    one = Multiplier.constant(full(1), np.eye(1)).add_pole(1.0)
    with pytest.raises(SynthesisFailedError, match="not positive at all"):
        factors(one.step(np.array([0.0, -2.0, 0.0]), -3.0, 3.0), 1.0)
    with pytest.raises(SynthesisFailedError, match="not positive at infinity"):
        factors(one.step(np.array([-2.0, 3.0, 0.0]), -3.0, 3.0), 1.0)


def test_where_a_scaling_dips_below_zero_is_found_and_mended() -> None:
    """D = 1 − 0.5·2 Re φ of a lag with a resonance at 3 rad/s."""
    one = Multiplier(full(1), np.log([[3.0, 0.1]]), None, np.array([1.0, 0.5, 0.0])[:, None, None],
                     None)  # fmt: skip
    coarse = np.array([0.0, 0.1, 1.0, 10.0, np.inf])
    assert one.values(coarse)[0].real.min() > 0.0
    (dip,) = negative_frequencies([one], coarse)
    assert 3.0 < dip < 4.0
    mended = lift_multiplier(one, coarse)
    assert not negative_frequencies([mended], coarse).size
    assert factors(mended, 1.0).right.is_stable
    assert lift_multiplier(mended, coarse) is mended


STRUCTURES = [
    BlockStructure([full(1), full(2, 3)]),
    BlockStructure([repeated_real(1), full(2, 1), full(2)]),
    BlockStructure([repeated_real(2), repeated_complex(2), full(1)]),
]


@pytest.mark.parametrize("structure", STRUCTURES)
def test_the_norm_of_the_scaled_loop_is_the_level_that_is_proved(structure: BlockStructure) -> None:
    """‖L M L⁻¹V − βN‖ is β just where F is singular, at one frequency, for a β."""
    loop = stable_system(3, 4, *structure.shape)
    chosen = [multiplier(b, seed=k) for k, b in enumerate(structure.blocks)]
    m = structure.pad_to_square(loop.response(OMEGA))
    goal = Goal(OMEGA, m, np.ones(OMEGA.size), np.zeros_like(m))
    for omega, beta in zip(
        OMEGA, np.sqrt(np.maximum(relative_levels(goal, chosen), 1e-6)), strict=True
    ):
        scaled = absorb_scalings(loop, [factors(one, beta) for one in chosen], float(beta))
        assert scaled.is_stable
        gain = np.linalg.norm(scaled.response(np.array([omega]))[0], 2)
        assert_allclose(gain, beta, rtol=1e-8)


def test_scaling_a_plant_and_closing_it_commute() -> None:
    """Controls and measurements stay what they are."""
    structure = STRUCTURES[1]
    p, m = structure.shape
    plant = stable_system(1, 5, p + 2, m + 1)
    controller = LtiSystem(-np.eye(1), np.ones((1, 2)), 0.01 * np.ones((1, 1)), np.zeros((1, 2)))
    made = [factors(multiplier(b, seed=k), 0.7) for k, b in enumerate(structure.blocks)]
    closed_last = lower_lft(absorb_scalings(plant, made, 0.7), controller)
    closed_first = absorb_scalings(lower_lft(plant, controller), made, 0.7)
    assert_allclose(closed_last.response(OMEGA), closed_first.response(OMEGA), rtol=0.0, atol=1e-11)


def orders_until_met(goal: Goal, start: tuple[Multiplier, ...], highest: int) -> list[Array]:
    found, ratios = fit_multipliers(goal, start), []
    while True:
        ratios.append(np.sqrt(found.ratios.max()))
        if found.ratios.max() <= 1.01**2 or found.multipliers[0].order >= highest:
            return ratios
        place = float(np.clip(goal.omega_rad_s[np.argmax(found.ratios)], *np.exp(goal.range)))
        found = fit_multipliers(
            goal, [o if o.fixed else o.add_pole(place) for o in found.multipliers]
        )


@pytest.mark.parametrize("structure", STRUCTURES)
def test_fits_of_rising_order_come_near_the_pointwise_bounds(structure: BlockStructure) -> None:
    loop = stable_system(5, 4, *structure.shape)
    goal = mu_upper_bounds(loop, structure, np.zeros(0)).goal(0.8)
    ratios = orders_until_met(goal, constant_multipliers(structure, goal.sizes), 2)
    assert all(after <= before * (1.0 + 1e-9) for before, after in pairwise(ratios))
    assert ratios[-1] <= 1.1


def test_a_goal_is_met_between_its_frequencies_too() -> None:
    """The norm over all frequencies of the loop with its scalings is about the peak of µ."""
    structure = STRUCTURES[0]
    loop = stable_system(5, 4, *structure.shape)
    bounds = mu_upper_bounds(loop, structure, np.zeros(0))
    goal = bounds.goal(0.5)
    start = [
        o if o.fixed else o.add_pole(1.0).add_pole(3.0)
        for o in constant_multipliers(structure, goal.sizes)
    ]
    found = fit_multipliers(goal, start)
    norm = hinf_norm(absorb_scalings(loop, [factors(o, 1.0) for o in found.multipliers], 1.0)).value
    assert bounds.values.max() * (1.0 - 1e-3) <= norm <= 1.05 * bounds.values.max()


def test_the_block_divided_out_is_the_largest_with_a_number_for_d() -> None:
    assert reference_block(STRUCTURES[0]) == 1
    assert reference_block(STRUCTURES[2]) == 2
    assert reference_block(BlockStructure([repeated_complex(2)])) is None


def test_joint_steps_go_down_to_a_known_minimum() -> None:
    """A cost that is least where D is 3 at infinity and 5 at zero frequency."""
    start = [Multiplier.constant(full(1), np.eye(1)).add_pole(1.0)]

    def cost(x: object) -> float:
        assert isinstance(x, list)
        d = x[0].values(np.array([0.0, np.inf]))[0][:, 0, 0].real
        return float(np.exp(np.sum(np.log(d / np.array([5.0, 3.0])) ** 2)))

    found = descend_jointly(cost, start, np.logspace(-1, 1, 9), 40)
    assert cost(list(found)) < 1.01 < cost(start)


def test_truncation_of_a_nearly_unreachable_state_keeps_the_response() -> None:
    a = np.diag([-1.0, -3.0, 0.5, -10.0])
    b, c = np.array([[1.0], [2.0], [1.0], [1e-6]]), np.array([[1.0, -1.0, 2.0, 1e-6]])
    system = LtiSystem(a, b, c, np.ones((1, 1)))
    short = balanced_truncation(system, 3)
    assert short.order == 3
    assert_allclose(short.response(OMEGA), system.response(OMEGA), rtol=0.0, atol=1e-10)
    assert_allclose(short.poles.real.max(), 0.5, rtol=1e-12)
    assert balanced_truncation(system, 0).order == 1  # the unstable state stays


def test_truncation_keeps_the_bound_of_twice_the_values_left_out() -> None:
    system = stable_system(2, 6, 2, 2)
    for order in (2, 4):
        short = balanced_truncation(system, order)
        error = hinf_norm(
            LtiSystem(
                np.block([[system.a, np.zeros((6, order))], [np.zeros((order, 6)), short.a]]),
                np.vstack([system.b, short.b]), np.hstack([system.c, -short.c]),
                system.d - short.d,
            )
        ).value  # fmt: skip
        assert error <= 2.0 * hankel_values(system)[order:].sum() * (1.0 + 1e-6)
        turned = balanced_truncation(discrete(system, 0.1), order)
        omega = np.array([0.0, 3.0])
        assert_allclose(
            turned.response(omega), discrete(short, 0.1).response(omega),
            rtol=0.0, atol=1e-8,
        )  # fmt: skip


def hankel_values(system: LtiSystem) -> Array:
    """By the Gramians as integrals' equations, Kronecker products and all."""
    n = system.order
    one = np.eye(n)
    both = np.kron(system.a, one) + np.kron(one, system.a)
    reach = np.linalg.solve(both, -(system.b @ system.b.T).ravel()).reshape(n, n)
    turned = np.kron(system.a.T, one) + np.kron(one, system.a.T)
    see = np.linalg.solve(turned, -(system.c.T @ system.c).ravel()).reshape(n, n)
    values = np.linalg.eigvals(reach @ see).real
    return np.asarray(np.sort(np.sqrt(np.maximum(values, 0.0)))[::-1])
