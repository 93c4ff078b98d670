"""Records of metrics: the Spec, the judgement and the tables that follow from them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from pydantic import ValidationError

from hillsphere.engine.flight_metrics import (
    FlightMetric,
    Requirement,
    limit_shown,
    requirements_spec,
)
from hillsphere.engine.flying_stage import metric_errors, metric_values
from hillsphere.engine.requirements import judge_flights
from hillsphere.simulation import Flights

Block = dict[str, np.ndarray[Any, np.dtype[np.float64]]]

SPEED = FlightMetric[Block](
    "end_speed", "m/s", lambda of: of["speed"], lambda of: 0.1 + 0.0 * of["speed"],
    (
        Requirement("end_speed_m_s", "speed", "speed at the end"),
        Requirement("impact_speed_m_s", "speed", "speed of an impact", cause="impact_speed",
                    status="impact", rank=1),
    ),
)  # fmt: skip
EARLY = FlightMetric[Block](
    "early", "s", lambda of: of["early"],
    requirements=(
        Requirement("early_s", "time", "how early", rank=0),
        Requirement("late_s", "time", "how late", sign=-1.0, cause="late", rank=0,
                    allows_zero=True),
    ),
)  # fmt: skip
METRICS = (SPEED, EARLY)
CLEARANCE = FlightMetric[Block](
    "clearance", "m", lambda of: of["clearance"], lambda of: 5.0 + 0.0 * of["clearance"],
    (Requirement("least_clearance_m", "length", "smallest height", is_least=True),),
)  # fmt: skip
Limits: Any = requirements_spec("Limits", __name__, METRICS)


def flights(*status: str) -> Flights:
    zero = np.zeros(len(status))
    return Flights(
        "toy:frame", ("x",), status, tuple("" if s == "completed" else s for s in status), zero,
        zero[None], zero, zero.astype(int), zero.astype(int) + 1, zero,
    )  # fmt: skip


def judged(require: dict[str, float], speed: list[float], early: list[float], *status: str) -> Any:
    block = {"speed": np.array(speed), "early": np.array(early)}
    return judge_flights(
        flights(*status), METRICS, metric_values(METRICS, block), metric_errors(METRICS, block),
        Limits(**require), ("completed", "impact"), 1.0,
    )  # fmt: skip


def test_each_requirement_is_an_optional_key_of_the_spec() -> None:
    assert list(Limits.model_fields) == ["end_speed_m_s", "impact_speed_m_s", "early_s", "late_s"]
    assert Limits(early_min=2).limit("early_s") == 120.0
    assert Limits().limit("early_s") is None
    assert Limits(late_s=0).limit("late_s") == 0.0
    with pytest.raises(ValidationError, match="early_s"):
        Limits(early_s=0)
    assert Limits.model_fields["late_s"].description == "how late"


def test_a_record_without_an_error_has_none() -> None:
    errors = metric_errors(METRICS, {"speed": np.array([1.0, 2.0]), "early": np.array([3.0, 4.0])})
    assert_array_equal(errors, [[0.1, 0.1], [0.0, 0.0]])


def test_the_lowest_rank_is_reported() -> None:
    require = {"end_speed_m_s": 1.0, "impact_speed_m_s": 2.0, "early_s": 60.0}
    status, cause, failed = judged(
        require, [3.0, 3.0, 3.0, 0.5], [90.0, 0.0, 0.0, 0.0],
        "impact", "impact", "completed", "completed",
    )  # fmt: skip
    assert status == ("requirement", "requirement", "requirement", "completed")
    assert cause == ("early", "impact_speed", "end_speed", "")
    assert_array_equal(failed, [True, True, True, False])


def test_a_negative_sign_limits_the_negative_value() -> None:
    _, cause, failed = judged({"late_s": 10.0}, [0.0, 0.0], [-20.0, 20.0], *["completed"] * 2)
    assert cause == ("late", "")
    assert_array_equal(failed, [True, False])


def test_a_smallest_value_fails_flights_below_it() -> None:
    block = {"clearance": np.array([90.0, 98.0, 103.0, 120.0, np.nan])}
    require: Any = requirements_spec("Least", __name__, (CLEARANCE,))
    status, cause, failed = judge_flights(
        flights(*["completed"] * 5), (CLEARANCE,), metric_values((CLEARANCE,), block),
        np.array([[5.0, 5.0, 5.0, 5.0, 0.0]]), require(least_clearance_m=100.0), ("completed",),
        1.0,
    )  # fmt: skip
    assert status == ("requirement", "step_error", "step_error", "completed", "requirement")
    assert cause == ("clearance", "clearance", "clearance", "", "clearance")
    assert_array_equal(failed, [True, False, False, False, True])
    assert limit_shown(CLEARANCE, require(least_clearance_m=100.0)) is None


def test_within_its_error_a_limit_leaves_a_flight_undecided() -> None:
    status, cause, failed = judged(
        {"end_speed_m_s": 1.0}, [0.95, 1.05, 1.2], [0.0] * 3, *["completed"] * 3
    )
    assert status == ("step_error", "step_error", "requirement")
    assert cause == ("end_speed",) * 3
    assert_array_equal(failed, [False, False, True])


def test_a_table_shows_the_first_largest_value_that_is_set() -> None:
    assert limit_shown(SPEED, Limits(impact_speed_m_s=2)) == 2.0
    assert limit_shown(SPEED, Limits(impact_speed_m_s=2, end_speed_m_s=1)) == 1.0
    assert limit_shown(EARLY, Limits(late_s=5)) is None
    assert EARLY.label == "early"
    assert SPEED.label == "end speed"
