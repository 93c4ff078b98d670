"""First beliefs from sensors alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.testing import RecordingContext, check_presentation
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.initialisation.products import StartingBelief

SC_1, SC_2 = [29.0, -1503.0, 407.0], [-1.2, -2126.0, 550.0]


def beginning(sensors: str, **keys: Any) -> Any:
    body = create(
        "body", "asteroid", semi_major_axis_au=0.9224, eccentricity=0.1912,
        rotation_rate_rad_s=5.8177e-5, semi_axes_m=[191, 135, 95], mean_anomaly_rad=0.0,
    )  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=1.8016)
    plant = create("plant", "proximity", body=body, gravity=gravity, spacecraft=[{}, {}])
    cameras = [create("sensor", "camera", body=body, spacecraft=k, target="centre") for k in (1, 2)]
    link = create("sensor", "inter_satellite", spacecraft=1, partner=2)
    lidars = [create("sensor", "lidar", body=body, spacecraft=k) for k in (1, 2)]
    sets = {"lidar": [*cameras, *lidars], "link": [*cameras, link]}
    given: dict[str, Any] = {
        "plant": plant, "sensors": sets[sensors], "duration_h": 3, "interval_min": 45,
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


def test_refusals() -> None:
    with pytest.raises(InputError, match="list as many spacecraft as the plant"):
        beginning("link", spacecraft=[{"position_m": SC_1}])
    with pytest.raises(InputError, match="combinations"):
        beginning("link", spacecraft=[{"position_m": SC_1}] * 6, depths_m=list(range(1, 15)))
