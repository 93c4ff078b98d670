"""First beliefs from sensors alone."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.testing import RecordingContext, check_presentation
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.initialisation.presentation import judge_consistency
from hillsphere_estimators.initialisation.products import StartingBelief

BODY = create(
    "body", "asteroid", semi_major_axis_au=0.9224, eccentricity=0.1912,
    rotation_rate_rad_s=5.8177e-5, semi_axes_m=[191, 135, 95], mean_anomaly_rad=0.0,
)  # fmt: skip
SC_1, SC_2 = [29.0, -1503.0, 407.0], [-1.2, -2126.0, 550.0]


def two_spacecraft(noise_m_s2: float = 0.0) -> Any:
    return create(
        "plant", "proximity", body=BODY, gravity=create("gravity", "point_mass", gm_m3_s2=1.8016),
        spacecraft=[{}, {}], acceleration_noise_m_s2=noise_m_s2,
    )  # fmt: skip


def beginning(sensors: str, **keys: Any) -> Any:
    cameras = [create("sensor", "camera", body=BODY, spacecraft=k, target="centre") for k in (1, 2)]
    link = create("sensor", "inter_satellite", spacecraft=1, partner=2)
    lidars = [create("sensor", "lidar", body=BODY, spacecraft=k) for k in (1, 2)]
    sets = {"lidar": [*cameras, *lidars], "link": [*cameras, link]}
    given: dict[str, Any] = {
        "plant": two_spacecraft(), "sensors": sets[sensors], "duration_h": 3, "interval_min": 45,
        "spacecraft": [{"position_m": SC_1, "velocity_mm_s": [1, -2, 3]}, {"position_m": SC_2}],
        "seeds": 40, "depths_m": [700, 2000, 6000], "tries": 2, "step_min": 10,
    }  # fmt: skip
    return create("stage", "initialisation", **{**given, **keys})


@pytest.mark.parametrize("sensors", ["lidar", "link"])
def test_covariances_fit_the_truth(sensors: str) -> None:
    """Also where only a link's range says how far everything is."""
    stage = beginning(sensors)
    found = stage.run(RecordingContext())
    assert isinstance(found, StartingBelief)
    assert found.settled.mean() > 0.95
    low, high = chi_square_band(12, 40)
    assert low <= found.nees.mean() <= high
    assert kstest(found.nees, chi2(12).cdf).pvalue > 1e-3
    # of a good fit the residuals are χ² with as many degrees of freedom as rows beyond the states
    low, high = chi_square_band(found.rows[0] - 12, 40)
    assert low <= found.squares.mean() <= high
    sigma = np.sqrt(np.diagonal(found.covariances, axis1=1, axis2=2))
    assert (sigma[:, [0, 1, 2, 6, 7, 8]] < 100.0).all()
    check_presentation(stage.present(found))
    assert found.mean.shape == (12,)
    assert found.covariance.shape == (12, 12)


def test_random_accelerations_are_flown_and_reckoned_with() -> None:
    """Pushes that carry spacecraft by many standard deviations of what sensors show."""
    quiet = beginning("lidar", seeds=20).run(RecordingContext())
    found = beginning("lidar", seeds=20, plant=two_spacecraft(3e-6)).run(RecordingContext())
    assert np.ptp(quiet.truths, axis=1).max() < 0.1
    assert (np.std(found.truths[:3], axis=1) > 1.0).all()
    low, high = chi_square_band(12, 20)
    assert low <= found.nees.mean() <= high
    speed = [np.sqrt(np.diagonal(f.covariances, axis1=1, axis2=2)[:, 3:6]) for f in (quiet, found)]
    assert speed[1].mean() > 2.0 * speed[0].mean()


def test_verdict_says_what_the_numbers_are() -> None:
    assert judge_consistency(12.0, 11.0, 13.0, 0.3) == "consistent"
    assert judge_consistency(12.0, 11.0, 13.0, 1e-3) == "not consistent"
    assert judge_consistency(14.0, 11.0, 13.0, 0.3) == "overconfident"
    assert judge_consistency(10.0, 11.0, 13.0, 0.3).startswith("cautious")


def test_navigation_begins_with_it() -> None:
    """At its time, in its states, with the fits that converged."""
    stage = beginning("lidar", seeds=12)
    found = stage.run(RecordingContext())
    settled = found.settled.copy()
    settled[::2] = 0.0
    found = replace(found, settled=settled)

    def flight(**keys: Any) -> Any:
        return create(
            "stage", "navigation", plant=stage.spec.plant.get(),
            sensors=[ref.get() for ref in stage.spec.sensors], interval_min=30, duration_h=1,
            estimator=create("estimator", "unscented", update="iterated", iterations=40),
            needs={"belief": "beginning"}, **keys,
        )  # fmt: skip

    made = flight()
    batch = CaseBatch(
        np.arange(64), np.arange(64), np.zeros(64, bool), (), np.zeros((0, 64)), 1, "navigation"
    )
    told = made.run_cases(batch, ["t"], belief=found)
    assert not told.failed.any()
    plan = made._plan(belief=found).plan
    assert plan.begin_s == found.t_s == 10_800.0
    truth, begun = made._begin(plan, batch, found, np.full(64, plan.begin_s))
    np.testing.assert_array_equal(truth[:, :8], found.truths[:, [1, 3, 5, 7, 9, 11, 1, 3]])
    np.testing.assert_array_equal(begun.x[:, 0], found.means[:, 1])
    with pytest.raises(InputError, match=r"leave start\.time_s out"):
        flight(start={"time_h": 1})._plan(belief=found)
    with pytest.raises(InputError, match="leave start out"):
        flight(start={"position_m": [*SC_1, *SC_2]})
    with pytest.raises(
        InputError, match=r"needs\.belief: it is of 2 states a, b; the plant has 12"
    ):
        made._plan(belief=replace(found, names=("a", "b")))
    with pytest.raises(InputError, match="none of its 12 fits converged"):
        made._plan(belief=replace(found, settled=np.zeros(12)))


def test_refusals() -> None:
    with pytest.raises(InputError, match="list as many spacecraft as the plant"):
        beginning("link", spacecraft=[{"position_m": SC_1}])
    with pytest.raises(InputError, match="combinations"):
        beginning("link", spacecraft=[{"position_m": SC_1}] * 6, depths_m=list(range(1, 15)))
