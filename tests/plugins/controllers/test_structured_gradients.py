"""Closed loops, and the gradients of what is minimised, against differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.structured.closed_loop import Closed, OpenLoop
from hillsphere_controllers.structured.gradients import gain_slopes, h2, h2_slope, pole_slopes
from hillsphere_controllers.structured.objective import Objective
from hillsphere_controllers.structured.plant_norms import PlantNorms, closed_loop_part
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.structure import controller_of, free_state_space
from hillsphere_controllers.systems.algebra import lower_lft

ORDER, CONTROLS, MEASUREMENTS = 2, 2, 1
STRUCTURE = free_state_space(ORDER, CONTROLS, MEASUREMENTS)
ROWS, COLUMNS = np.array([0, 2]), np.array([0, 1])


def plant(seed: int, *, direct: float = 1.0) -> LtiSystem:
    """Make a stable plant with 3 z, 2 w, D22 not zero."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(4, 4))
    return LtiSystem(
        a - (np.linalg.eigvals(a).real.max() + 1.0) * np.eye(4),
        random.normal(size=(4, 2 + CONTROLS)),
        random.normal(size=(3 + MEASUREMENTS, 4)),
        direct * random.normal(size=(3 + MEASUREMENTS, 2 + CONTROLS)),
    )


def loop_of(seed: int, *, direct: float = 1.0) -> tuple[OpenLoop, Array]:
    """Make an open loop, and gains that keep it stable."""
    open_loop = OpenLoop(DesignPlant(plant(seed, direct=direct)), STRUCTURE)
    gains = 0.1 * np.random.default_rng(seed + 50).normal(size=(4, 3))
    gains[:ORDER, :ORDER] -= np.eye(ORDER)
    return open_loop, gains


def closed_by(open_loop: OpenLoop, gains: Array) -> Closed:
    closed = open_loop.close(gains)
    assert closed is not None
    return closed


def differences(
    value: Callable[[Closed], complex], open_loop: OpenLoop, gains: Array, step: float = 1e-5
) -> Array:
    """Fourth-order central differences by every entry of K."""
    made = np.zeros(gains.shape, dtype=complex)
    for place in np.ndindex(*gains.shape):
        move = np.zeros(gains.shape)
        move[place] = step

        def at(share: float, move: Array = move) -> complex:
            return value(closed_by(open_loop, gains + share * move))

        made[place] = (8.0 * (at(1.0) - at(-1.0)) - at(2.0) + at(-2.0)) / (12.0 * step)
    return np.asarray(made)


@pytest.mark.parametrize("seed", range(4))
def test_closed_loop_is_that_of_the_interconnection(seed: int) -> None:
    open_loop, gains = loop_of(seed)
    theta = gains[np.isfinite(gains)]
    wanted = lower_lft(plant(seed), controller_of(STRUCTURE, theta))
    closed = closed_by(open_loop, gains)
    omega = np.array([0.0, 0.3, 2.0, 50.0])
    found = LtiSystem(closed.a, closed.b, closed.c, closed.d)
    assert_allclose(found.response(omega), wanted.response(omega), rtol=1e-11)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("omega", [0.0, 0.8, np.inf])
def test_singular_values(seed: int, omega: float) -> None:
    open_loop, gains = loop_of(seed)
    for i in range(2):

        def sigma(closed: Closed, i: int = i) -> complex:
            return complex(gain_slopes(closed, ROWS, COLUMNS, np.array([omega]))[0][0, i])

        many = gain_slopes(closed_by(open_loop, gains), ROWS, COLUMNS, np.array([0.1, omega]))
        found = many[1][1, i]
        wanted = differences(sigma, open_loop, gains)
        assert_allclose(found, wanted.real, rtol=0, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(4))
def test_h2_norm(seed: int) -> None:
    open_loop, gains = loop_of(seed, direct=0.0)
    found = h2_slope(closed_by(open_loop, gains), ROWS, COLUMNS)
    wanted = differences(
        lambda closed: complex(np.log(h2(closed, ROWS, COLUMNS))), open_loop, gains
    )
    assert_allclose(found, wanted.real, rtol=0, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("seed", range(4))
def test_poles(seed: int) -> None:
    open_loop, gains = loop_of(seed)
    poles, slopes = pole_slopes(closed_by(open_loop, gains))
    for pole, slope in zip(poles, slopes, strict=True):

        def nearest(closed: Closed, pole: complex = pole) -> complex:
            there = np.linalg.eigvals(closed.a)
            return complex(there[np.argmin(np.abs(there - pole))])

        wanted = differences(nearest, open_loop, gains)
        assert_allclose(slope, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max())


def test_pole_region() -> None:
    """Each excess is zero on its border, and has the slope that is said."""
    region = PoleRegion(decay_1_s=0.5, damping=0.6, fastest_rad_s=5.0)
    border = np.array([-0.5 + 0.2j, -3.0 * 0.6 + 3.0 * 0.8j, 5.0 * np.exp(2.5j)])
    assert_allclose(np.diagonal(region.excess(border)[0]), 0.0, rtol=0, atol=1e-14)
    poles = np.array([-1.0 + 0.7j, -2.0 + 0.0j, 0.3 - 2.0j])
    _, slopes = region.excess(poles)
    for move in (1e-6, 1e-6j):
        change = region.excess(poles + move)[0] - region.excess(poles - move)[0]
        assert_allclose(np.real(slopes * move), 0.5 * change, rtol=1e-7, atol=1e-14)
    assert np.isneginf(PoleRegion().excess(poles)[0]).all()


@pytest.mark.parametrize(
    "channels", [(Channel(),), (Channel((0, 2), (1,)), Channel((1,), limit=0.1))]
)
def test_objective_along_a_line(channels: tuple[Channel, ...]) -> None:
    """Value and slope with a penalty, a region and two plants, in scaled parameters."""
    loops = [OpenLoop(DesignPlant(plant(s), channels, 1.0 + s), STRUCTURE) for s in (1, 2)]
    gains = loop_of(1)[1]
    middle, spread = STRUCTURE.typical(loops[0].sizes)
    x = (gains.ravel() - middle) / spread
    made = Objective(loops, STRUCTURE, middle, spread, PoleRegion(decay_1_s=3.0), 1e-1)
    point = made.evaluate(x)
    assert point.excess > 0.0
    slope = made.slope(point)
    random = np.random.default_rng(0)
    for _ in range(3):
        move = 1e-5 * random.normal(size=x.size)
        change = made.evaluate(x + move).value - made.evaluate(x - move).value
        assert_allclose(slope @ move, 0.5 * change, rtol=1e-5)
    assert made.evaluate(x, point.objective - 1e-9).value == np.inf


def test_what_does_not_fit_is_refused() -> None:
    one = plant(1)
    with pytest.raises(InputError, match="discrete"):
        OpenLoop(DesignPlant(LtiSystem(one.a, one.b, one.c, one.d, 0.1)), STRUCTURE)
    with pytest.raises(InputError, match="no w or no z"):
        OpenLoop(DesignPlant(one), free_state_space(0, 4, 1))
    with pytest.raises(InputError, match="3 outputs z"):
        OpenLoop(DesignPlant(one, (Channel(outputs=(3,)),), name="a"), STRUCTURE)
    with pytest.raises(InputError, match="H2"):
        OpenLoop(DesignPlant(one, (Channel(norm="h2"),)), STRUCTURE)
    with pytest.raises(InputError, match="no channel"):
        OpenLoop(DesignPlant(one, ()), STRUCTURE)
    loops = [OpenLoop(DesignPlant(one, (Channel(limit=1.0),)), STRUCTURE)]
    with pytest.raises(InputError, match="nothing is left"):
        Objective(loops, STRUCTURE, np.zeros(12), np.ones(12))
    with pytest.raises(InputError, match="weight"):
        Channel(weight=0.0)
    with pytest.raises(InputError, match="pole region"):
        PoleRegion(damping=1.0)
    with pytest.raises(InputError, match="fastest"):
        PoleRegion(decay_1_s=2.0, fastest_rad_s=1.0)


@pytest.mark.parametrize("seed", range(4))
def test_peak_that_was_missed_is_found(seed: int) -> None:
    # without direct terms the norm is at a finite frequency, with some seeds at zero
    open_loop, gains = loop_of(seed, direct=0.0)
    norms = PlantNorms([open_loop])
    loops = norms.close_loop(gains)
    assert loops is not None
    [loop] = loops
    norms.measure(loops)
    rough = norms.highest(loops)
    norms.refine(loops, -np.inf)
    level = norms.highest(loops)
    p, m = loop.closed.d.shape
    exact = hinf_norm(closed_loop_part(loop.closed, np.arange(p), np.arange(m)))
    assert rough <= level + 1e-14  # but for rounding
    assert_allclose(np.exp(level), exact.value, rtol=1e-7)
    assert not norms.finds_higher_gain(loops, level + 1e-6)
    # as if a peak had been overlooked
    loop.levels[0] -= 0.05
    assert not norms.finds_higher_gain(loops, level + 1e-6)
    assert norms.finds_higher_gain(loops, level - 0.05)
    assert norms.seen_above(loops, level - 0.05)


def test_plants_together_are_as_each_by_itself() -> None:
    """Three of one size, and one that is larger."""
    random = np.random.default_rng(3)
    more = plant(7)
    more = LtiSystem(
        np.block([[more.a, np.zeros((more.order, 1))], [np.zeros((1, more.order)), -3.0]]),
        np.vstack([more.b, random.normal(size=(1, more.shape[1]))]),
        np.hstack([more.c, random.normal(size=(more.shape[0], 1))]),
        more.d,
    )
    plants = [plant(1), more, plant(1), plant(1)]
    channels = [(Channel(), Channel((0,), limit=2.0))] * 4
    weights = [1.0, 2.0, 3.0, 0.5]
    loops = [
        OpenLoop(DesignPlant(one, some, weight), STRUCTURE)
        for one, some, weight in zip(plants, channels, weights, strict=True)
    ]
    gains = 1e-3 * loop_of(1)[1]
    together = PlantNorms(loops)
    found = together.close_loop(gains)
    alone = [PlantNorms([loop]) for loop in loops]
    each = [one.close_loop(gains) for one in alone]
    assert found is not None
    for norms, one in zip([together, *alone], [found, *each], strict=True):
        assert one is not None
        norms.measure(one)
        norms.refine(one, -np.inf)
    for j, one in enumerate(each):
        assert one is not None
        assert one[0].levels == pytest.approx(found[j].levels, rel=0, abs=1e-9)
    assert together.highest(found) == max(
        norms.highest(one) for norms, one in zip(alone, each, strict=True) if one is not None
    )
