from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import hillsphere_controllers as hc
from hillsphere.errors import InputError, Interrupted
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere.testing import RecordingContext
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import NotStabilisableError, SynthesisFailedError
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.structured.objective import Objective, Point
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.search_runs import Progress
from hillsphere_controllers.structured.single_loop import Pid
from hillsphere_controllers.structured.structure import controller_of, free_state_space, static
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.systems.algebra import lower_lft


def lag(a: float) -> DesignPlant:
    """Make ẋ = a x + w + u, z = (x, u), y = x."""
    return DesignPlant(
        LtiSystem(
            np.array([[a]]),
            np.array([[1.0, 1.0]]),
            np.array([[1.0], [0.0], [1.0]]),
            np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
        )
    )


def oscillator(frequency: float = 1.0, damping: float = 0.02) -> LtiSystem:
    """Make q̈ + 2ζω q̇ + ω² q = w₁ + u, z = (q, u), y = q + 0.1 w₂."""
    return LtiSystem(
        np.array([[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]]),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.1, 0.0]]),
    )


@pytest.mark.parametrize("a", [-0.3, -1.0, -4.0])
def test_static_feedback_in_closed_form(a: float) -> None:
    """√(1 + k²)/(k − a) is least at k = −1/a, where it is 1/√(1 + a²)."""
    found = synthesise(lag(a), static(1, 1), starts=3, effort="quick")
    assert_allclose(found.gamma, 1.0 / np.sqrt(1.0 + a * a), rtol=1e-9)
    assert_allclose(found.theta, [1.0 / a], rtol=1e-3)
    assert_allclose(found.starts, found.gamma, rtol=1e-6)
    assert found.converged
    assert found.residual < 1e-3


def test_infimum_at_infinite_gain() -> None:
    """For a > 0 the norm falls to 1 as k grows; a limit of the gain is reached and kept."""
    free = synthesise(lag(2.0), static(1, 1), starts=2, effort="quick")
    assert 1.0 <= free.gamma < 1.0001
    bound = synthesise(lag(2.0), static(1, 1), starts=2, effort="quick", largest_gain=10.0)
    assert_allclose(bound.theta, [-10.0], rtol=1e-5)
    assert_allclose(bound.gamma, np.sqrt(101.0) / 8.0, rtol=1e-5)
    assert abs(bound.theta[0]) <= 10.0 * (1 + 1e-6)
    assert -1 in [a.plant for a in bound.active]


def pd_norms(theta: Array) -> Array:
    """Return the norms of `oscillator` with kp + kd s/(1 + s/ω) for (K, 3) parameters, by formulas.

    With S = 1/(1 − kg) it is [g S, 0.1 k g S; k g S, 0.1 k S].
    """
    kp, kd, rate = theta[:, 0], theta[:, 1], np.exp(theta[:, 2])
    s = 1j * np.concatenate([[0.0], np.logspace(-2, 2.5, 400)])
    g = 1.0 / (s**2 + 0.04 * s + 1.0)
    k = kp[:, None] + kd[:, None] * s / (1.0 + s / rate[:, None])
    sensitivity = 1.0 / (1.0 - k * g)
    t = sensitivity * np.array([[g + 0.0 * k, 0.1 * k * g], [k * g, 0.1 * k]])
    row, column = np.sum(np.abs(t) ** 2, axis=1), t[0] * t[1].conj()
    cross = np.abs(column.sum(axis=0))
    top = 0.5 * (row[0] + row[1]) + np.hypot(0.5 * (row[0] - row[1]), cross)
    # (s² + 0.04s + 1)(s + ω) − kp(s + ω) − kd ω s = s³ + …, by Routh
    first, last = 0.04 + rate, rate * (1.0 - kp)
    middle = 1.0 + 0.04 * rate - kp - kd * rate
    stable = (last > 0.0) & (first * middle > last)
    return np.where(stable, np.sqrt(top.max(axis=1)), np.inf)


def test_pd_against_a_grid() -> None:
    """No triple of a coarse grid is better, and none of a fine one about what was found."""
    found = synthesise(DesignPlant(oscillator()), Pid(integral=False), starts=2, effort="quick")
    assert_allclose(pd_norms(found.theta[None]), [found.gamma], rtol=1e-3)
    axes = np.linspace(-6.0, 0.9, 16), np.linspace(-6.0, 0.0, 16), np.linspace(-1.0, 5.0, 13)
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    assert found.gamma <= pd_norms(grid).min() * 1.001
    near = np.stack(np.meshgrid(*3 * [np.linspace(-0.1, 0.1, 11)]), axis=-1).reshape(-1, 3)
    assert pd_norms(found.theta + near).min() >= found.gamma * (1.0 - 1e-3)


def random_plant(seed: int, order: int = 2) -> LtiSystem:
    """Make an unstable plant to which the Riccati equations apply, D11 and D22 not zero."""
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(order, order)),
        random.normal(size=(order, 3)),
        random.normal(size=(3, order)),
        random.normal(size=(3, 3)),
    )


@pytest.mark.parametrize("seed", range(2))
def test_as_good_as_full_order_with_its_order(seed: int) -> None:
    """Neither below the bound of all controllers, nor much above it; γ is that of the loop."""
    system = random_plant(seed)
    found = synthesise(DesignPlant(system), free_state_space(2, 1, 1), starts=1, effort="quick")
    best = hinf_synthesis(system, 1, 1)
    assert_allclose(found.lower_bound, best.least, rtol=1e-12)
    assert best.least * (1.0 - 1e-9) <= found.gamma <= best.least * 1.01
    loop = lower_lft(system, found.controller)
    assert loop.is_stable
    assert_allclose(found.gamma, hinf_norm(loop).value, rtol=1e-9)
    low = synthesise(DesignPlant(system), free_state_space(1, 1, 1), starts=1, effort="quick")
    assert low.gamma >= found.lower_bound * (1.0 - 1e-9)


def test_seed_decides_and_starts_differ() -> None:
    plant = DesignPlant(oscillator())
    one, again = (
        synthesise(plant, free_state_space(1, 1, 1), starts=2, effort="quick", seed=5)
        for _ in range(2)
    )
    assert_allclose(again.theta, one.theta, rtol=0, atol=0)
    assert_allclose(again.starts, one.starts, rtol=0, atol=0)
    for gamma, theta in zip(one.starts, one.ends, strict=True):
        loop = lower_lft(plant.system, controller_of(free_state_space(1, 1, 1), theta))
        assert_allclose(gamma, hinf_norm(loop).value, rtol=1e-6)
    other = synthesise(plant, free_state_space(1, 1, 1), starts=1, effort="quick", seed=6)
    assert np.abs(other.theta - one.theta).max() > 1e-9
    better = synthesise(
        plant, free_state_space(1, 1, 1), starts=1, effort="quick", initial=[one.theta]
    )
    assert better.starts.size == 2
    assert better.gamma <= one.gamma * (1.0 + 1e-7)


def test_same_with_the_workers_of_a_run() -> None:
    here = synthesise(lag(-1.0), static(1, 1), starts=2)
    there = synthesise(lag(-1.0), static(1, 1), starts=2, ctx=RecordingContext())
    assert_allclose(there.theta, here.theta, rtol=0, atol=0)
    assert_allclose(there.starts, here.starts, rtol=0, atol=0)


def test_one_controller_for_many_plants() -> None:
    """The largest norm of all is what counts, with weights; both plants hold it."""
    plants = [
        DesignPlant(oscillator(0.8), weight=1.0, name="slow"),
        DesignPlant(oscillator(1.5), weight=3.0, name="fast"),
    ]
    found = synthesise(plants, free_state_space(1, 1, 1), starts=2, effort="quick")
    weighted = [
        plant.weight * hinf_norm(lower_lft(plant.system, found.controller)).value
        for plant in plants
    ]
    assert_allclose(found.gamma, max(weighted), rtol=1e-12)
    assert_allclose(weighted, found.gamma, rtol=1e-3)
    assert {a.plant for a in found.active} == {0, 1}
    assert_allclose(sum(a.multiplier for a in found.active), 1.0, rtol=1e-5)
    assert found.gamma >= found.lower_bound
    # both peaks hold it, though rounding leaves one of them a little higher
    assert found.converged
    assert found.residual < 1e-2


def test_pole_region_is_kept() -> None:
    """With a decay and a damping asked for, the norm is higher, and the region's border reached."""
    plant = DesignPlant(oscillator())
    free = synthesise(plant, free_state_space(1, 1, 1), starts=2, effort="quick")
    region = PoleRegion(decay_1_s=0.6, damping=0.8, fastest_rad_s=8.0)
    found = synthesise(plant, free_state_space(1, 1, 1), starts=2, region=region)
    poles = found.verified.closed_loops[0].poles
    assert poles.real.max() <= -0.6 * (1.0 - 1e-4)
    assert (poles.real <= -(0.8 - 1e-4) * np.abs(poles)).all()
    assert np.abs(poles).max() <= 8.0 * (1.0 + 1e-4)
    assert found.gamma > free.gamma * 1.001
    assert any(a.channel == -1 for a in found.active)


def test_limit_on_one_channel_and_h2_on_the_other() -> None:
    """The H2 norm from w₁ to q under a limit of the H∞ norm from w₂ to u, which is reached."""
    system = oscillator()
    quiet = LtiSystem(system.a, system.b, system.c, system.d * (np.abs(system.d) == 1.0))
    noisy = LtiSystem(system.a, system.b[:, [0, 2]], system.c, system.d[:, [0, 2]])
    assert quiet.shape == system.shape
    channels = (Channel((0,), (0,), "h2"), Channel((1,), (0,), limit=0.9))
    found = synthesise(DesignPlant(noisy, channels), static(1, 1), starts=2, effort="quick")
    loop = lower_lft(noisy, found.controller)
    first = LtiSystem(loop.a, loop.b, loop.c[:1], loop.d[:1])
    second = LtiSystem(loop.a, loop.b, loop.c[1:], loop.d[1:])
    assert_allclose(found.gamma, h2_norm(first), rtol=1e-9)
    assert_allclose(found.verified.limits, hinf_norm(second).value / 0.9, rtol=1e-9)
    assert found.verified.limits <= 1.0 + 1e-5
    assert found.lower_bound == 0.0


def test_progress_and_interruption() -> None:
    """What was found until then is returned, and marked; nothing found: the interruption rises."""
    told: list[Progress] = []
    plant = DesignPlant(oscillator())

    def stop(progress: Progress) -> None:
        told.append(progress)
        if progress.done == 2:
            raise KeyboardInterrupt

    found = synthesise(plant, free_state_space(1, 1, 1), starts=5, progress=stop)
    assert found.interrupted
    assert found.starts.size == 2
    assert found.shaken.size == 0
    assert [(p.done, p.total) for p in told if p.latest is not None] == [(1, 5), (2, 5)]
    assert_allclose(found.gamma, told[-1].gamma, rtol=1e-6)
    # the γ of a search that goes on is told as it falls
    second = [p.current for p in told if p.done == 1 and p.latest is None]
    assert len(second) >= 3
    assert second == sorted(second, reverse=True)

    def at_once(progress: Progress) -> None:
        raise KeyboardInterrupt

    with pytest.raises(NotStabilisableError):
        synthesise(double_integrator(), static(1, 1), starts=1)
    with pytest.raises(KeyboardInterrupt):
        synthesise(double_integrator(), static(1, 1), starts=3, progress=at_once)


def test_an_interrupted_synthesis_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    plant, structure = DesignPlant(oscillator()), free_state_space(1, 1, 1)
    whole = synthesise(plant, structure, starts=3, ctx=RecordingContext())
    ended: list[int] = []

    def synthesised(last: int) -> StructuredDesign:
        def tell(progress: Progress) -> None:
            if progress.latest is not None:
                ended.append(progress.latest.start.number)
            elif len(ended) == last:  # while the next one goes on
                raise Interrupted("stopped")

        ctx = RecordingContext(workspace=tmp_path)
        return synthesise(plant, structure, starts=3, progress=tell, ctx=ctx)

    stopped = synthesised(2)
    assert stopped.interrupted
    assert stopped.starts.size == 3  # the one that was stopped counts, but is not kept
    assert len(list(tmp_path.glob("*/search-*.npz"))) == 2
    begun, ended = ended, []
    found = synthesised(99)
    assert ended[:2] == sorted(begun[:2])
    assert not found.interrupted
    for one, other in ((found.theta, whole.theta), (found.starts, whole.starts),
                       (found.shaken, whole.shaken)):  # fmt: skip
        assert one.tobytes() == other.tobytes()
    assert (found.gamma, found.evaluations) == (whole.gamma, whole.evaluations)


def test_kept_searches_that_cannot_be_used_are_done_once_more(tmp_path: Path) -> None:
    plant, structure = DesignPlant(oscillator()), free_state_space(0, 1, 1)
    first = synthesise(
        plant, structure, starts=2, effort="quick", ctx=RecordingContext(workspace=tmp_path)
    )
    path = next(tmp_path.glob("*/search-00001.npz"))
    path.write_bytes(path.read_bytes()[:-100])
    ctx = RecordingContext(workspace=tmp_path)
    again = synthesise(plant, structure, starts=2, effort="quick", ctx=ctx)
    assert again.theta.tobytes() == first.theta.tobytes()
    assert any("search-00001.npz" in message for message in ctx.messages)
    ctx = RecordingContext(workspace=tmp_path)
    other = synthesise(
        plant, structure, starts=2, effort="quick", seed=2, ctx=ctx
    )  # of other seeds
    assert np.isfinite(other.gamma)
    assert any("another search" in message for message in ctx.messages)


def test_interruption_within_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The best point of the search that is under way counts too."""
    count, seen = 0, Objective.evaluate

    def impatient(self: Objective, x: Array, above: float = np.inf) -> Point:
        nonlocal count
        count += 1
        if count == 12:
            raise KeyboardInterrupt
        return seen(self, x, above)

    monkeypatch.setattr(Objective, "evaluate", impatient)
    found = synthesise(DesignPlant(oscillator()), free_state_space(1, 1, 1), starts=5)
    assert found.interrupted
    assert not found.converged
    assert found.starts.size == 1
    assert np.isfinite(found.gamma)


def double_integrator() -> DesignPlant:
    """Make q̈ = w + u, of which only q is measured: no constant gain stabilises it."""
    return DesignPlant(
        LtiSystem(
            np.array([[0.0, 1.0], [0.0, 0.0]]),
            np.array([[0.0, 0.0], [1.0, 1.0]]),
            np.array([[1.0, 0.0], [1.0, 0.0]]),
            np.zeros((2, 2)),
        )
    )


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(NotStabilisableError, match="of this structure"):
        synthesise(double_integrator(), static(1, 1), starts=2, effort="quick")
    apart = LtiSystem(
        np.diag([1.0, -1.0]), np.array([[1.0, 0.0], [1.0, 1.0]]), np.eye(2), np.zeros((2, 2))
    )
    with pytest.raises(NotStabilisableError, match="plant 'apart'"):
        synthesise(DesignPlant(apart, name="apart"), static(1, 1), starts=2)
    channels = (Channel((0,)), Channel((1,), limit=1e-6))
    with pytest.raises(SynthesisFailedError, match="constraints"):
        synthesise(DesignPlant(random_plant(0), (*channels,)), static(1, 1), starts=2)
    with pytest.raises(InputError, match="a plant and a start"):
        synthesise([], static(1, 1))
    with pytest.raises(InputError, match="initial"):
        synthesise(lag(-1.0), static(1, 1), initial=[np.zeros(2)])
    with pytest.raises(InputError, match="initial"):
        synthesise(lag(-1.0), static(1, 1), initial=[np.array([np.nan])])
    with pytest.raises(InputError, match="finite"):
        Channel(weight=np.inf)
    with pytest.raises(InputError, match="finite"):
        Channel(limit=np.inf)
    with pytest.raises(InputError, match="gain"):
        synthesise(lag(-1.0), static(1, 1), largest_gain=0.0)


def test_poles_that_only_reach_the_axis_are_named() -> None:
    """PI control of 1/s²: s³ + Kp s + Ki has roots of sum zero, so that none is stable."""
    plant = LtiSystem(
        np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0, 0.0], [1.0, 1.0]]),
        np.array([[1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]]),
        np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]]),
    )  # fmt: skip
    with pytest.raises(NotStabilisableError, match="on the imaginary axis"):
        hc.hinfstruct(plant, hc.tunablePID("pi"), starts=4)
