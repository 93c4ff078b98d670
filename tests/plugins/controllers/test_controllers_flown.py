"""Missions from end to end: a synthesis whose controller is flown and repeated, and other laws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from hillsphere.errors import InputError
from hillsphere.mission import load_mission
from hillsphere.runs.pipeline import RunResult, run_mission
from hillsphere_flight.products import ClosedLoopFlight

PLACE = """
format = 1
name = "flown"
title = "A controller flown above a moon"
seed = 1

[body.moon]
type = "moon"
name = "moon"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
semi_axes_km = [13.03, 11.40, 9.14]

[gravity.moon]
type = "point_mass"
gm_km3_s2 = 7.1e-4

[plant.hill]
type = "hill"
body = "moon"
gravity = "moon"
"""
FLIGHT = """
[stage.fly]
type = "closed_loop"
plant = "hill"
law = "law"
target = { position_km = [25, 0, 0] }
start = { position_km = [25.1, 0.05, 0], velocity_m_s = [0, 0, 0] }
"""
SYNTHESIS = """
[stage.models]
type = "linear_models"
systems = [
    { numerator = [1], denominator = [1, 0, 0], inputs = ["u"], outputs = ["y"], channels = 3 }
]
inputs = []
outputs = []
controls = ["u"]
measurements = ["y"]

[stage.design]
type = "synthesis"
needs = { models = "models" }
method = "mixed_sensitivity"
[stage.design.mixed_sensitivity]
w1 = { performance = { bandwidth_rad_s = 3e-3, steady_error = 0.01 } }
w2 = { gain = 3e3 }
disturbance = 1e-5

[compensator.law]
type = "lti"
period_s = 30

[dispersions.mass]
type = "normal"
of = "gravity.moon"
parameters = ["gm"]
sigma_relative = 0.01

[stage.verify]
type = "monte_carlo"
repeat = "fly"
dispersions = ["mass"]
cases = 8
"""


def flown(tmp_path: Path, text: str) -> RunResult:
    path = tmp_path / "mission.toml"
    path.write_text(PLACE + text, encoding="utf-8")
    return run_mission(load_mission(str(path)), out=tmp_path / "run", use_cache=False)


def flight(result: RunResult) -> ClosedLoopFlight:
    found: Any = result.products["fly"]
    assert isinstance(found, ClosedLoopFlight)
    return found


@pytest.mark.slow
def test_a_synthesis_is_flown_and_repeated(tmp_path: Path) -> None:
    """On each axis 1/s², from the position's error; gravity is what it must withstand."""
    keys = 'needs = { controller = "design" }\nsees = ["x", "y", "z"]\nduration_min = 200\n'
    result = flown(tmp_path, FLIGHT + keys + SYNTHESIS)
    assert result.state == "success"
    found = flight(result)
    assert found.position_error_m[0] > 100.0
    assert found.position_error_m[-1] < 5.0
    repeated: Any = result.products["verify"]
    assert (repeated.status == "completed").all()
    place = repeated.metrics.index("final_position_error")
    assert (repeated.values[place] < 5.0).all()


def test_a_flight_without_its_controller_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"law: it has no controller.*needs\.controller"):
        flown(tmp_path, FLIGHT + 'duration_min = 10\nsees = ["x", "y", "z"]\n' + SYNTHESIS)


REGULATOR = """
plant = "hill"
point = { position_km = [25, 0, 0] }
trim = true
state_sizes = [10, 10, 10, 0.1, 0.1, 0.1]
control_sizes = [1e-4, 1e-4, 1e-4]
"""
LAWS = {
    "lqr": REGULATOR + "integral_sizes = [3e4, 3e4, 3e4]",
    "lqg": REGULATOR
    + "control_noise = [3e-5, 3e-5, 3e-5]\nmeasurement_sizes = [5, 5, 5, 0.01, 0.01, 0.01]",
    "lyapunov": 'time_constant_min = 5\nplant = "hill"',
}


@pytest.mark.slow
@pytest.mark.parametrize("type_", LAWS)
def test_laws_of_a_model_hold_a_point(tmp_path: Path, type_: str) -> None:
    law = f'[compensator.law]\ntype = "{type_}"\nperiod_s = 60\n{LAWS[type_]}\n'
    found = flight(flown(tmp_path, law + FLIGHT + "duration_min = 200\n"))
    assert found.status == "completed"
    assert found.position_error_m[-1] < 1.0
