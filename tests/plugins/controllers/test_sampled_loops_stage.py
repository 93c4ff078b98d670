"""The stage ``sampled_loops``: margins at sample rates, and where stability is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import HillsphereError, InputError
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.products import ControlDesign
from hillsphere.testing import RecordingContext, check_presentation, check_product, example
from hillsphere_controllers.analysis.sampled_loop import SampledLoop, sampled_margins
from hillsphere_controllers.law_specs import LtiSpec
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.lti import LinearLaw, lti
from hillsphere_controllers.stages.sampled_loops.products import SampledLoops
from hillsphere_controllers.stages.sampled_loops.specs import SampledLoopsSpec
from hillsphere_controllers.stages.sampled_loops.stage import SampledLoopsStage
from hillsphere_controllers.systems.algebra import series
from hillsphere_controllers.systems.holding import mean_output_hold

PERIOD, KP, KD, KI = 60.0, 3e-4, 0.03, 1e-6
ONE, ZERO = np.eye(3), np.zeros((3, 3))


def models(pulls: tuple[float, ...] = (2e-7, 8e-7)) -> LinearModels:
    """Double integrators with a gravity gradient; a disturbance beside the controls."""
    inputs = tuple(f"{name}[{i}]" for name in "da" for i in range(3))
    outputs = tuple(f"{name}[{i}]" for name in "rv" for i in range(3))
    systems = tuple(
        LtiSystem(
            np.block([[ZERO, ONE], [pull * ONE, ZERO]]), np.block([[ZERO, ZERO], [ONE, ONE]]),
            np.eye(6), np.zeros((6, 6)), None, inputs, outputs,
        )
        for pull in pulls
    )  # fmt: skip
    labels = tuple(f"point={i}" for i in range(1, len(pulls) + 1))
    values = np.arange(1.0, len(pulls) + 1.0)[None]
    return LinearModels(systems, labels, ("point",), ("-",), values, values[:, 0], 0, 0, ())


def pid(factor: float = 1.0) -> LtiSystem:
    d = -factor * np.hstack([KP * ONE, KD * ONE])
    names = tuple(f"{name}_hat[{i}]" for name in "rv" for i in range(3))
    return LtiSystem(ZERO, np.hstack([ONE, ZERO]), -factor * KI * ONE, d, None, names)


def law(**keys: Any) -> Any:
    table = {"period_s": PERIOD, "sees": "deviation", "low_pass_hz": 0.05, **keys}
    spec = validate(LtiSpec, table, where="test")
    assert isinstance(spec, LtiSpec)
    return lti(spec)


def stage(**keys: Any) -> SampledLoopsStage:
    table = {
        "needs": {"models": "models", "controllers": ["one"]}, "controls": ["a"],
        "sees": ["r", "v"], **keys,
    }  # fmt: skip
    spec = validate(SampledLoopsSpec, table, where="test")
    assert isinstance(spec, SampledLoopsSpec)
    return SampledLoopsStage(spec)


def filtered(k: LtiSystem) -> LtiSystem:
    w, six = 2 * np.pi * 0.05, np.eye(6)
    return series(LtiSystem(-w * six, w * six, six, 0 * six), k)


@pytest.mark.parametrize("states", ["continuous", "sampled"])
def test_loops_of_a_law_at_some_periods(states: str) -> None:
    method = {} if states == "continuous" else {"method": "mean"}
    made = stage(
        needs={"models": "models", "controllers": ["one", "two"]},
        law=law(states=states, **method), periods_s=[30, PERIOD], longest_s=200,
    )  # fmt: skip
    designs = ControlDesign(pid()), ControlDesign(pid(0.3))
    given = models() if states == "continuous" else models((5e-7,))
    found = made.run(RecordingContext(), given, designs)
    assert isinstance(found, SampledLoops)
    assert found.controllers == ("one", "two")
    assert found.controls == ("a[0]", "a[1]", "a[2]")
    for c, k in enumerate((pid(), pid(0.3))):
        for j, period in enumerate((30.0, PERIOD)):
            flown = filtered(k) if states == "continuous" else mean_output_hold(filtered(k), period)
            for m, whole in enumerate(given.systems):
                plant = LtiSystem(whole.a, whole.b[:, 3:], whole.c, whole.d[:, 3:])
                wanted = sampled_margins(SampledLoop(plant, flown, period))
                assert_allclose(found.spectral_radius[c, j, m], wanted.spectral_radius, rtol=1e-9)
                assert_allclose(found.peak[c, j, m], wanted.peak, rtol=1e-7)
                assert_allclose(found.gain_upper[:, c, j, m], wanted.gain_upper, rtol=1e-7)
                assert_allclose(found.peaks[:, c, j, m], wanted.peaks, rtol=1e-7)
    # less gain bears a longer period; on either side of where it is lost the radius is
    assert found.lost_s[0] < found.lost_s[1]
    assert 60 < found.lost_s[0] < 120
    for radius, lost in zip(found.radius, found.lost_s, strict=True):
        assert (radius[(found.looked_s < lost) & (found.looked_s > 10)] < 1.0).all()
        assert (radius[(found.looked_s > lost)][:3] > 1.0).all()
    check_product(found)
    shown = made.present(found, given, designs)
    check_presentation(shown)
    assert shown.verdict[0].startswith("one loses stability at periods of")


def test_a_law_with_its_own_controller_and_one_model() -> None:
    own = law(
        sees="error", states="continuous", a=ZERO.tolist(), b=np.hstack([ONE, ZERO]).tolist(),
        c=(KI * ONE).tolist(), d=np.hstack([KP * ONE, KD * ONE]).tolist(),
    )  # fmt: skip
    assert isinstance(own, LinearLaw)
    made = stage(needs={"models": "models"}, law=own, models=["*2"], longest_s=70)
    found = made.run(RecordingContext(), models(), ())
    assert found.models == ("point=2",)
    assert found.period_s.tolist() == [PERIOD]
    other = stage(law=law(states="continuous"), models=["point=2"], longest_s=70)
    wanted = other.run(RecordingContext(), models(), (ControlDesign(pid()),))
    assert_allclose(found.peak, wanted.peak, rtol=1e-9)
    assert_allclose(found.gain_lower, wanted.gain_lower, rtol=1e-9)
    assert found.lost_s[0] == np.inf
    shown = made.present(found, models(), ())
    check_presentation(shown)
    assert shown.verdict == ["law is stable for all periods up to 70 s."]


def test_a_controller_in_discrete_time_is_judged_at_its_own_period() -> None:
    discrete = mean_output_hold(filtered(pid()), PERIOD)
    made = stage(law=law(states="sampled", low_pass_hz=None), periods_s=[PERIOD])
    found = made.run(RecordingContext(), models(), (ControlDesign(discrete),))
    plant = models((8e-7,)).systems[0]
    wanted = sampled_margins(
        SampledLoop(LtiSystem(plant.a, plant.b[:, 3:], plant.c, plant.d[:, 3:]), discrete, PERIOD)
    )
    assert found.peak[0, 0, 1] == pytest.approx(wanted.peak, rel=1e-7)
    assert np.isnan(found.radius).all()
    assert np.isnan(found.lost_s).all()
    check_product(found)
    shown = made.present(found, models(), (ControlDesign(discrete),))
    check_presentation(shown)
    assert shown.verdict == ["one is stable, sampled every 60 s."]
    assert not shown.figures


def test_a_loop_that_is_not_stable_is_shown_as_such() -> None:
    made = stage(law=law(states="continuous"), periods_s=[PERIOD, 150], delay_s=5)
    found = made.run(RecordingContext(), models(), (ControlDesign(pid()),))
    assert found.delay_s == 5.0
    assert found.peak[0, 1, 0] == np.inf
    assert (found.gain_upper[:, 0, 1] == 1.0).all()
    shown = made.present(found, models(), (ControlDesign(pid()),))
    check_presentation(shown)
    assert shown.tables["sampled_loops"].rows[1]["peak"] is None
    early = stage(law=law(states="continuous")).run(
        RecordingContext(), models(), (ControlDesign(pid()),)
    )
    # it swings from sample to sample, where a delay of a part of the period takes gain away
    assert found.lost_s[0] > early.lost_s[0] + 1.0


def test_what_does_not_go_together() -> None:
    with pytest.raises(InputError, match=r"needs a linear law .* got Pid"):
        stage(law=example("compensator", "pid"))
    with pytest.raises(InputError, match=r"no model 'point=9'"):
        stage(law=law(states="continuous"), models=["point=9"]).run(
            RecordingContext(), models(), (ControlDesign(pid()),)
        )
    with pytest.raises(InputError, match="signals do not fit"):
        stage(law=law(states="continuous"), controls=["a[0]"]).run(
            RecordingContext(), models(), (ControlDesign(pid()),)
        )
    for keys, message in (
        ({}, "no law says it"),
        ({"needs": {"models": "models"}, "periods_s": [1]}, "name some"),
        ({"periods_s": [1, 1]}, "stands twice"),
        ({"periods_s": [1, 2], "delay_s": 1.5}, "at most the shortest"),
    ):
        with pytest.raises(HillsphereError, match=message):
            stage(**keys)


def test_a_controller_in_discrete_time_has_no_other_period() -> None:
    discrete = mean_output_hold(filtered(pid()), PERIOD)
    sampled = law(states="sampled", low_pass_hz=None)
    made = stage(law=sampled, periods_s=[PERIOD, 30])
    with pytest.raises(InputError, match=r"periods_s: one at 30 s: .*60"):
        made.run(RecordingContext(), models(), (ControlDesign(discrete),))
    alone = stage(periods_s=[30])
    with pytest.raises(InputError, match=r"periods_s: one is a controller in discrete time.* 60 s"):
        alone.run(RecordingContext(), models(), (ControlDesign(discrete),))
    # One of the law's own is known before anything runs; its own period is as good as named.
    own = sampled.flying(discrete)
    with pytest.raises(InputError, match=r"periods_s: law at 30 s"):
        stage(needs={"models": "models"}, law=own, periods_s=[30])
    found = stage(needs={"models": "models"}, law=own).run(RecordingContext(), models(), ())
    assert np.isnan(found.lost_s).all()
