"""Refinement of an asteroid's orbit: consistency over seeds, and what each sensor brings."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.testing import RecordingContext, check_presentation, example
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.orbit_refinement.gains import gains, rms
from hillsphere_estimators.orbit_refinement.products import OrbitRefinement

GOLDSTONE = {"station": "Goldstone", "latitude_deg": 35.4, "longitude_deg": -116.9}


def asteroid() -> Any:
    """Return one on the orbit of Table 1 of the formation navigation paper."""
    return create(
        "body", "asteroid", semi_major_axis_au=0.9224, eccentricity=0.1912,
        inclination_rad=0.05814, node_rad=3.5682, periapsis_rad=2.2061,
        rotation_rate_rad_s=5.8177e-5,
    )  # fmt: skip


def refinement(**keys: Any) -> Any:
    def telescope(longitude: float) -> Any:
        return create(
            "sensor", "deep_space_station", station="telescope", latitude_deg=25,
            longitude_deg=longitude, measures=["angles"], mask_elevation_deg=0,
        )  # fmt: skip

    def camera(craft: int) -> Any:
        return create("sensor", "inter_satellite", spacecraft=craft, partner=1, range=False)

    cameras = [camera(2), camera(3)]
    tracking = [create("sensor", "deep_space_station", spacecraft=k, **GOLDSTONE) for k in (2, 3)]
    paused = create("sensor", "deep_space_station", spacecraft=2, **GOLDSTONE, outages_d=[[10, 20]])
    doppler = create("sensor", "sun_doppler", spacecraft=2)
    given: dict[str, Any] = {
        "plant": create("plant", "heliocentric", bodies=[{}, {}, {}]),
        "asteroid": asteroid(),
        "earth": example("body", "solar_orbit"),
        "geometries": [
            {"name": "near", "epoch": "2029-03-01", "mean_anomaly_deg": 210},
            {"name": "far", "epoch": "2029-01-15", "mean_anomaly_deg": 180},
        ],
        "seeds": 10,
        "optical": [telescope(-16.0), telescope(-155.0)],
        "optical_duration_d": 10,
        "optical_interval_h": 8,
        "initial_error": 1e-3,
        "estimator": create("estimator", "information", iterations=5, tolerance_sigmas=1e-2),
        "spacecraft": [{"offset_km": [-7000, -7000, 500]}, {"offset_km": [7000, -6900, -1500]}],
        "acceleration_noise_m_s2": 1e-9,
        "duration_d": 1,
        "interval_h": 4,
        "arms": [
            {"name": "all", "sensors": [*cameras, *tracking, doppler]},
            {"name": "no Doppler", "sensors": [*cameras, *tracking]},
            {"name": "paused", "sensors": [*cameras, paused, tracking[1]]},
            {"name": "cameras", "sensors": cameras},
        ],
    }
    return create("stage", "orbit_refinement", **{**given, **keys})


@pytest.fixture(scope="module")
def product() -> OrbitRefinement:
    made = refinement().run(RecordingContext())
    assert isinstance(made, OrbitRefinement)
    return made


def test_errors_are_as_large_as_the_covariance_says(product: OrbitRefinement) -> None:
    assert product.settled.all()
    cases = product.settled.size
    low, high = chi_square_band(6, cases)
    assert low <= product.optical.nees[-1].mean() <= high
    for known in product.tracked[:3]:
        assert low <= known.nees[-1].mean() <= high
        ratio = np.mean(known.position_m[-1] ** 2) / np.mean(known.position_sigma_m[-1] ** 2)
        assert 0.4 < ratio < 2.5
    # of all states too, with every set of sensors: cameras alone, which say little of distances,
    # tempt a filter that linearises as it goes to believe too much
    assert product.tracked_settled.all()
    low, high = chi_square_band(product.states, cases)
    for joint in product.joint_nees:
        assert low <= joint.mean() <= high


def test_what_sensors_bring(product: OrbitRefinement) -> None:
    full, plain, paused, blind = (k.position_sigma_m[-1].mean(axis=1) for k in product.tracked)
    fast = [k.velocity_sigma_m_s[-1].mean(axis=1) for k in product.tracked]
    assert (full <= plain * 1.001).all()
    assert (fast[0] <= fast[1] * 1.001).all()
    # where a station is silent less is known, of the velocity too
    assert (plain < paused).all()
    assert (fast[1] < fast[2]).all()
    assert (paused < blind).all()
    # tracking is worth one to two orders of magnitude
    before = product.tracked[0].position_sigma_m[0].mean(axis=1)
    assert (before / full > 10.0).all()


def test_presentation(product: OrbitRefinement) -> None:
    shown = refinement().present(product)
    check_presentation(shown)
    assert any("The filter is consistent: mean NEES of all 18" in v for v in shown.verdict)
    assert any("after 1 d: position error smaller by a factor of" in line for line in shown.verdict)
    # where a spacecraft is not heard its velocity is forgotten, the asteroid's is not
    (silent,) = (line for line in shown.verdict if "are silent" in line)
    assert "A peak, of more than 10 %, has the spacecraft's" in silent
    assert "the asteroid's no times" in silent
    table = shown.tables["refinement_tracking"]
    assert len(table.rows) == 2 * 4
    (gain,) = (column for column in table.columns if column.name == "velocity_gain")
    assert (gain.interval, gain.confidence) == (("velocity_gain_p5", "velocity_gain_p95"), 0.9)


def test_overconfidence_and_lack_of_convergence_are_said(product: OrbitRefinement) -> None:
    joint, rested = product.joint_nees.copy(), product.tracked_settled.copy()
    joint[3] *= 2.0
    joint[1] *= 0.5
    rested[2, 0, 0] = 0.0
    shown = refinement().present(replace(product, joint_nees=joint, tracked_settled=rested))
    (line,) = (v for v in shown.verdict if "mean NEES" in v)
    assert line.startswith("The filter is not consistent with 'no Doppler', 'cameras")
    rows = shown.tables["refinement_arms"].rows
    assert [row["judged"] for row in rows] == [
        "consistent", "cautious", "consistent", "overconfident",
    ]  # fmt: skip
    assert any("1 of 80 during tracking did not" in v for v in shown.verdict)


def test_refusals() -> None:
    with pytest.raises(InputError, match="offset_km: is zero"):
        refinement(spacecraft=[{"offset_km": [0, 0, 0]}, {"offset_km": [1e4, 0, 0]}])
    with pytest.raises(InputError, match="needs 12 states, the asteroid's six first; it has 18"):
        refinement(spacecraft=[{"offset_km": [1e4, 0, 0]}])
    with pytest.raises(InputError, match="lacks mean_anomaly_deg"):
        refinement(geometries=[{"name": "one", "epoch": "2029-01-15"}])
    with pytest.raises(InputError, match="names repeat"):
        refinement(geometries=[{"name": "one", "epoch": "2029-01-15", "mean_anomaly_deg": 1}] * 2)
    with pytest.raises(InputError, match="longer than"):
        refinement(interval_h=72)


@pytest.fixture(scope="module")
def half_seen() -> OrbitRefinement:
    """One geometry is by day or too low for both telescopes: nothing is observed there."""
    dark = [
        create(
            "sensor", "deep_space_station", station="telescope", measures=["angles"],
            latitude_deg=latitude, longitude_deg=longitude, mask_elevation_deg=20, sun_below_deg=12,
        )
        for latitude, longitude in ((28.3, -16.5), (19.8, -155.5))
    ]  # fmt: skip
    made = refinement(
        optical=dark, initial_error=0.01, seeds=4, passes=1, optical_interval_h=4,
        geometries=[
            {"name": "seen", "epoch": "2029-03-01", "mean_anomaly_deg": 210},
            {"name": "hidden", "epoch": "2029-06-01", "mean_anomaly_deg": 30},
        ],
    ).run(RecordingContext())  # fmt: skip
    assert isinstance(made, OrbitRefinement)
    return made


def test_geometry_without_an_observation_is_a_row_and_no_lost_run(
    half_seen: OrbitRefinement,
) -> None:
    shown = refinement().present(half_seen)
    check_presentation(shown)
    states = [row["state"] for row in shown.tables["refinement_optical"].rows]
    assert states == ["converged", "not observed"]
    assert any("No telescope sees the asteroid in 'hidden'" in line for line in shown.verdict)
    (line,) = (line for line in shown.verdict if line.startswith("Optical angles alone"))
    seen = rms(half_seen.optical.position_m[-1])[0] / 1e3
    assert f"{seen:.3g} to {seen:.3g} km" in line


def test_diverged_tracking_is_a_row_and_no_statement(product: OrbitRefinement) -> None:
    rested, joint = product.tracked_settled.copy(), product.joint_nees.copy()
    rested[0, 1], joint[1, 1, 0] = 0.0, np.nan
    lost = replace(product, tracked_settled=rested, joint_nees=joint)
    shown = refinement().present(lost)
    check_presentation(shown)
    rows = {
        (str(row["geometry"]), str(row["arm"])): row
        for row in shown.tables["refinement_tracking"].rows
    }
    assert rows["far", "all"]["state"] == rows["far", "no Doppler"]["state"] == "diverged"
    assert rows["near", "all"]["state"] == rows["far", "cameras"]["state"] == "converged"
    said = " ".join(shown.verdict)
    assert "Tracking diverged, converging in no case, in 'far' with 'all'; 'far' with " in said
    assert "10 or 20 cases" in said
    assert "nan" not in said
    arms = shown.tables["refinement_arms"].rows
    near, _ = gains(product, 0)
    assert arms[0]["position_gain_least"] == arms[0]["position_gain_greatest"] == near[0]
    # with nothing left nothing is said of it
    none = replace(product, tracked_settled=np.zeros_like(rested))
    shown = refinement().present(none)
    check_presentation(shown)
    assert "tracking diverged in all geometries" in " ".join(shown.verdict)
    assert {row["judged"] for row in shown.tables["refinement_arms"].rows} == {"diverged"}
