"""ZEM/ZEV guidance: exact where it should be, and flown over Phobos."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, GuidanceTask
from hillsphere.simulation import Cases, SampledReference, Simulator
from hillsphere_guidance.law_specs import ZemZevSpec


def fly(plant: Any, law: Any, reference: Any, x0: Array, samples: int) -> Any:
    return Simulator(plant, law, reference=reference).fly(Cases(x0), samples, history=True)


def test_held_commands_arrive_exactly_at_the_least_effort(uniform: Any) -> None:
    law = create("compensator", "zem_zev", plant=uniform, period_s=20.0, duration_s=200.0)
    start = np.array([500.0, -200.0, 900.0, -1.0, 0.5, 2.0])
    goal = np.array([0.0, 100.0, 0.0, 0.0, 0.0, -1.0])
    flights = fly(uniform, law, goal, start[:, None], 10)
    np.testing.assert_allclose(flights.x[:, 0], goal, rtol=0, atol=1e-9)
    # minimum-norm solution of the same two conditions, all steps at once
    c = 20.0 * (10.0 - np.arange(10) - 0.5)
    miss = goal[:3] - start[:3] - 200.0 * start[3:] - 0.5 * 200.0**2 * np.array(uniform.field)
    slow = goal[3:] - start[3:] - 200.0 * np.array(uniform.field)
    wanted = np.linalg.pinv(20.0 * np.array([c, np.ones(10)])) @ np.array([miss, slow])
    np.testing.assert_allclose(flights.history.u[:, :, 0], wanted.T, rtol=0, atol=1e-10)


def test_many_periods_are_the_continuous_law(line: Any) -> None:
    law = create("compensator", "zem_zev", plant=line, period_s=1.0, duration_s=1000.0)
    y, goal = np.array([[300.0], [2.0]]), np.zeros((2, 1))
    u, _ = law.step(0, np.zeros(1), y, goal, law.initial(1))
    miss, slow = -300.0 - 2.0 * 1000.0, -2.0
    assert u[0, 0] == pytest.approx(6.0 * miss / 1000.0**2 - 2.0 * slow / 1000.0, rel=2e-3)


def test_limit_keeps_the_direction(uniform: Any) -> None:
    keys = {"plant": uniform, "period_s": 20.0, "duration_s": 200.0}
    free, bound = (
        create("compensator", "zem_zev", **keys, **more) for more in ({}, {"maximum_m_s2": 1e-2})
    )
    y = np.random.default_rng(3).normal(size=(6, 64)) * 1e3
    u, v = (law.step(0, np.zeros(64), y, np.zeros((6, 64)), law.initial(64))[0]
            for law in (free, bound))  # fmt: skip
    np.testing.assert_allclose(np.linalg.norm(v, axis=0), 1e-2, rtol=1e-12)
    np.testing.assert_allclose(v * np.linalg.norm(u, axis=0), u * 1e-2, rtol=1e-9)


def test_nothing_is_commanded_after_the_arrival(line: Any) -> None:
    law = create("compensator", "zem_zev", plant=line, period_s=1.0, duration_s=10.0)
    u, _ = law.step(10, np.zeros(1), np.ones((2, 1)), np.zeros((2, 1)), law.initial(1))
    assert not u.any()


@pytest.mark.parametrize(("prediction", "most"), [("constant", 13.0), ("field", 8.06)])
def test_landing_on_phobos(
    phobos: Any, landing: GuidanceTask, prediction: str, most: float
) -> None:
    """Without any reference, at 60 s: to the site, planned in the field near the least effort."""
    law = create(
        "compensator", "zem_zev", plant=phobos, period_s=60.0, duration_s=7980.0,
        prediction=prediction, towards="site", touchdown_speed_m_s=0.5,
        site={"latitude_deg": 12.0, "longitude_deg": 25.0},
    )  # fmt: skip
    goal = np.concatenate([landing.end_position_m, landing.end_velocity_m_s, [0.0]])
    spread = np.array([200.0] * 3 + [0.1] * 3 + [0.0])[:, None]
    off = spread * np.random.default_rng(1).normal(size=(7, 6))
    off[:, 0] = 0.0
    flights = fly(phobos, law, None, landing.start[:, None] + off, 133)
    # the last period is too short for the position: what is left of it stays
    assert np.linalg.norm(flights.x[:3] - goal[:3, None], axis=0).max() < 0.5
    assert np.linalg.norm(flights.x[3:6] - goal[3:6, None], axis=0).max() < 0.01
    assert flights.time_s.min() > 7979.0
    u = flights.history.u[:, :, 0]
    assert np.nansum(np.linalg.norm(u, axis=0)) * 60.0 < most


def test_back_to_a_reference(phobos: Any, landing: GuidanceTask) -> None:
    """Starts 100 m and 5 cm/s off end on the reference, whose own command does the rest."""
    stage = create(
        "stage",
        "reference_trajectories",
        plant=phobos,
        guidance=create("guidance", "minimum_energy"),
        step_s=60.0,
        descents=[
            {
                "name": "rt1",
                "start": {"position_m": list(landing.start[:3]), "others": {"true_anomaly": 0.0}},
                "end_position_m": list(landing.end_position_m),
                "end_velocity_m_s": list(landing.end_velocity_m_s),
                "duration_s": 7980.0,
            }
        ],
    )
    from hillsphere.testing import RecordingContext

    flights = stage.run(RecordingContext()).flights
    assert flights.u is not None
    reference = SampledReference(flights.x[:, :, 0], flights.u[:, :-1, 0])
    law = create(
        "compensator", "zem_zev", plant=phobos, period_s=60.0, duration_s=7980.0,
        towards="reference",
    )  # fmt: skip
    spread = np.array([100.0] * 3 + [0.05] * 3 + [0.0])[:, None]
    off = spread * np.random.default_rng(2).normal(size=(7, 4))
    found = fly(phobos, law, reference, flights.x[:, 0] + off, 133)
    assert np.linalg.norm(found.x[:3] - flights.x[:3, -1], axis=0).max() < 0.5
    # the open loop is lost
    lost = create("compensator", "open_loop", period_s=60.0)
    fate = fly(phobos, lost, reference, flights.x[:, 0] + off, 133)
    ends = np.linalg.norm(fate.x[:3] - flights.x[:3, -1], axis=0)
    early = np.array(fate.status) == "impact"
    assert (early | (ends > 1e3)).all()


def test_all_states_must_be_seen(phobos: Any) -> None:
    law = create("compensator", "zem_zev", plant=phobos, period_s=60.0, duration_s=7980.0)
    with pytest.raises(InputError, match=r"sees = .*true_anomaly"):
        law.step(0, np.zeros(1), np.ones((6, 1)), np.ones((6, 1)), law.initial(1))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"duration_s": 100}, "multiple of period_s"),
        ({"duration_s": 60}, "multiple of period_s"),
        (
            {"duration_s": 600, "towards": "reference", "prediction": "field"},
            "does not go with a reference",
        ),
        ({"duration_s": 600, "towards": "site"}, "belong together"),
        (
            {
                "duration_s": 600,
                "site": {"latitude_deg": 1, "longitude_deg": 2},
                "touchdown_speed_m_s": 0.1,
            },
            "belong together",
        ),
    ],
)
def test_rules(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ZemZevSpec.model_validate({"plant": "p", "period_s": 60, **keys})
