"""The stage ``orbit_family``: families of every kind, orbits asked for, parameters that change."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
import pytest

import hillsphere as hs
from hillsphere import create
from hillsphere.errors import HillsphereError, InputError
from hillsphere.mission import MissionError
from hillsphere.runs.mission_check import check_mission
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_orbits.orbit_family.products import FollowedFamily
from hillsphere_orbits.orbit_family.specs import VarySpec
from hillsphere_orbits.orbit_family.stage import OrbitFamilyStage

GM = 7.0875e-4  # km³/s²
AXES_M = (13030.0, 11400.0, 9140.0)


@cache
def hill(*axes_m: float, gm: float = GM) -> Any:
    """Return Hill's problem about an ellipsoid, or a point mass without axes."""
    moon = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    if axes_m:
        gravity = create("gravity", "ellipsoid", axes_m=list(axes_m), gm_km3_s2=gm)
    else:
        gravity = create("gravity", "point_mass", gm_km3_s2=gm)
    return create("plant", "hill", body=moon, gravity=gravity)


def stage(**keys: Any) -> OrbitFamilyStage:
    made = create("stage", "orbit_family", curve_members=21, **keys)
    assert isinstance(made, OrbitFamilyStage)
    return made


def run(**keys: Any) -> FollowedFamily:
    return stage(**keys).run(RecordingContext())


def family(type_: str, plant: Any, **keys: Any) -> Any:
    return create("orbit_family", type_, plant=plant, **keys)


def test_any_family_by_its_name() -> None:
    """The same orbits as the family's own stage finds, by all three ways to ask for them."""
    found = run(
        family=family("qso", hill()), amplitudes_km=[30, 60], periods_h=[7.0],
        jacobi_constants=[-2.0],
    )  # fmt: skip
    own = create(
        "stage", "qso_family", plant=hill(), x_amplitudes_km=[30, 60], periods_h=[7.0],
        jacobi_constants=[-2.0], drift_revolutions=1,
    ).run(RecordingContext())  # fmt: skip
    np.testing.assert_allclose(found.members.x0, own.members.x0, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found.members.period_s, own.members.period_s, rtol=1e-11)
    assert found.members.labels == (
        "amplitude = 30 km", "amplitude = 60 km", "T = 7 h", "C = -2",
    )  # fmt: skip
    np.testing.assert_allclose(found.member_indices, own.member_indices, rtol=0, atol=1e-8)
    assert found.status == ("reached",) * 4
    assert found.parameters == () == found.held


def test_an_orbit_near_a_guess() -> None:
    """A guess within a few per cent leads to the family of quasi-satellite orbits."""
    guess = {"x": 2.0, "vy": -4.1, "period": 5.8}
    found = run(plant=hill(), guess=guess, amplitudes_km=[40, 60])
    own = run(family=family("qso", hill()), amplitudes_km=[40, 60])
    np.testing.assert_allclose(found.members.x0, own.members.x0, rtol=0, atol=1e-7)
    x = found.curve_amplitude_m / found.members.length_m
    assert x[0] < 40e3 / found.members.length_m
    assert x[-1] == pytest.approx(4.0)


def test_guess_in_space() -> None:
    """With z the orbits leave the plane: a halo orbit of Hill's problem and its neighbours."""
    halo = run(family=family("halo", hill(), point="L2"), amplitudes_km=[8])
    unit = halo.members.length_m
    x0 = halo.members.x0[:, 0]
    guess = {
        "x": round(x0[0] / unit, 3), "z": round(x0[2] / unit, 3),
        "vy": round(x0[4] / unit * halo.members.time_s, 3),
        "period": round(halo.members.period_s[0] / halo.members.time_s, 3),
    }  # fmt: skip
    found = run(
        plant=hill(), guess=guess, amplitudes_m=[x0[0]], amplitude_min_m=0.98 * x0[0],
        amplitude_max_m=1.01 * x0[0],
    )  # fmt: skip
    np.testing.assert_allclose(found.members.x0[:, 0], x0, rtol=0, atol=1e-5)


@pytest.fixture(scope="module")
def carried() -> FollowedFamily:
    return run(
        family=family("qso", hill()), amplitudes_km=[30], periods_h=[7.0],
        jacobi_constants=[-2.0],
        vary=[{"parameter": "gravity.gm", "start": 0.9e9 * GM, "to": 1.1e9 * GM}],
    )  # fmt: skip


def test_parameters_that_change(carried: FollowedFamily) -> None:
    """By way of a lighter moon to a heavier one: each orbit keeps what it was asked for by."""
    # natural units are those of the plant as it is: the square of its unit of speed in the other's
    jacobi = -2.0 * 1.1 ** (-2 / 3)
    own = run(
        family=family("qso", hill(gm=1.1 * GM)), amplitudes_km=[30], periods_h=[7.0],
        jacobi_constants=[jacobi],
    )  # fmt: skip
    assert carried.held == ("amplitude", "period", "jacobi")
    assert carried.status == ("reached",) * 3
    np.testing.assert_allclose(carried.parameter_start, 0.9e9 * GM)
    np.testing.assert_allclose(carried.parameter_end, 1.1e9 * GM)
    np.testing.assert_allclose(carried.members.x0, own.members.x0, rtol=0, atol=1e-7)
    np.testing.assert_allclose(carried.members.period_s, own.members.period_s, rtol=1e-11)
    np.testing.assert_allclose(carried.member_indices, own.member_indices, rtol=0, atol=1e-8)
    np.testing.assert_allclose(carried.tracks_m[:, 0], own.members.x0[:3], rtol=0, atol=1e-6)
    assert carried.members.residual.max() < 1e-11
    np.testing.assert_allclose(carried.tracks_m[:, -1], own.members.x0[:3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(own.tracks_m[:, -1], own.tracks_m[:, 0], rtol=0, atol=1e-6)
    for k, values in enumerate((carried.way_x0[0], carried.way_period_s, carried.way_integral)):
        along = values[carried.way_orbit == k]
        np.testing.assert_allclose(along, along[0], rtol=1e-11)
        fraction = carried.way_fraction[carried.way_orbit == k]
        assert fraction[0] == 0.0
        assert fraction[-1] == 1.0


def test_what_is_handed_on_and_shown(carried: FollowedFamily) -> None:
    check_product(carried)
    shown = stage(family=family("qso", hill()), amplitudes_km=[30], label="two").present(carried)
    check_presentation(shown)
    assert set(shown.figures) == {
        "orbit_family_indices_two", "orbit_family_orbits_two", "orbit_family_ways_two",
    }  # fmt: skip
    rows = shown.tables["orbit_family_two"].rows
    assert [row["status"] for row in rows] == ["reached"] * 3


@pytest.mark.parametrize(
    "method, words",
    [("arclength", "the parameters turn back and return"), ("natural", "not_converged: no orbit")],
)
def test_orbits_that_do_not_arrive(method: str, words: str) -> None:
    """Halo orbits are quicker than the planar one they branch off, counted in the moon's periods.

    So as the frame turns faster and the period is held, a halo orbit falls to the plane.
    """
    plant = hill()
    own = {q.name: q.value for q in plant.parameters()}["mean_motion"]
    keys: dict[str, Any] = {
        "family": family("halo", plant, point="L2"), "amplitudes_km": [3], "hold": "period",
        "vary": [{"parameter": "mean_motion", "to": 1.01 * own}], "method": method,
    }  # fmt: skip
    lost = run(**keys)
    assert lost.status[0].startswith(words)
    assert lost.members.labels == ()
    assert lost.members.x0.shape == (6, 0)
    z = lost.way_x0[2]
    assert z[0] == pytest.approx(3e3)
    assert z.min() < 1e3
    check_product(lost)
    shown = stage(**keys).present(lost)
    check_presentation(shown)
    assert any(words in sentence for sentence in shown.verdict)


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys, words",
    [
        ({"amplitudes_km": [500], "amplitude_max_km": 600}, "amplitude = 500 km .it has"),
        ({"amplitude_max_km": 40, "periods_h": [9]}, "T = 9 h: the family has no such member"),
    ],
)
def test_orbits_that_the_family_lacks(keys: Mapping[str, Any], words: str) -> None:
    kind = "lyapunov" if "amplitudes_km" in keys else "qso"
    given = {"point": "L1"} if kind == "lyapunov" else {}
    with pytest.raises(InputError, match=words):
        run(family=family(kind, hill(*AXES_M), **given), **keys)


def test_an_orbit_that_the_family_lacks_is_named_beside_the_others() -> None:
    keys: dict[str, Any] = {
        "family": family("halo", hill(), point="L2"), "amplitudes_km": [3], "periods_h": [9],
        "amplitude_max_km": 4,
    }  # fmt: skip
    found = run(**keys)
    assert found.members.labels == ("amplitude = 3 km",)
    assert found.asked == ("amplitude = 3 km", "T = 9 h")
    assert found.status[0] == "reached"
    assert found.status[1].startswith("the family has no such member; it has ")
    check_product(found)
    shown = stage(**keys).present(found)
    check_presentation(shown)
    assert any(line.startswith("T = 9 h: the family has no") for line in shown.verdict)


class NoStart:
    """A family that cannot be followed by itself."""

    plant = None
    problem = None


@pytest.mark.parametrize(
    "keys, words",
    [
        ({}, "missing: family, or plant with a guess"),
        ({"plant": 1, "family": 1}, "both name the equations"),
        ({"plant": 1}, "missing beside plant"),
        ({"plant": 1, "guess": {"x": 2.0}}, "a period > 0 is missing"),
        ({"family": 1, "guess": {"x": 2.0}}, "goes with plant"),
        ({"family": 1, "amplitudes_km": []}, "no orbit is asked for"),
        ({"family": 1, "amplitudes_km": [3, 3]}, "a value is listed twice"),
        ({"family": 1, "amplitude_min_km": 5, "amplitude_max_km": 4}, "must be below the largest"),
        ({"family": 1, "amplitude_max_km": 4}, "outside the range .* 30 km"),
        ({"family": 1, "hold": "period"}, "name some in vary"),
        ({"family": 1, "vary": [{"parameter": "gravity.gm", "to": 1.0}] * 2}, "is listed twice"),
        ({"family": 1, "vary": [{"parameter": "gravity.mass", "to": 1.0}]}, "no parameter 'gra"),
        ({"family": 2}, "does not say where it begins"),
        ({"plant": 1, "guess": {"x": 2.0, "w": 1.0, "period": 1.0}}, "there is no state 'w'"),
        ({"plant": 1, "guess": {"x": 0.0, "period": 1.0}}, "starts at y = 0 with x ≠ 0"),
    ],
)
def test_bad_keys(keys: Mapping[str, Any], words: str) -> None:
    given: dict[str, Any] = {"amplitudes_km": [30], **keys}
    if "plant" in given:
        given["plant"] = hill()
    if "family" in given:
        given["family"] = family("qso", hill()) if given["family"] == 1 else NoStart()
    with pytest.raises(HillsphereError, match=words):
        stage(**given)


def test_the_examples_vary_parameters_that_the_ellipsoid_of_a_packaged_mission_has() -> None:
    plant = hs.build("phobos-qso", "plant", "hill")
    names = {parameter.name for parameter in plant.parameters()}
    assert {example["parameter"] for example in VarySpec.examples} <= names


def test_a_sweep_of_a_family_names_what_varies_it_instead() -> None:
    loaded = hs.Mission.load("phobos-qso")
    tables = tomllib.loads(loaded.text)
    tables["stage"]["densities"] = {
        "type": "sweep", "repeat": "family",
        "over": {"gravity.ellipsoid.density_g_cm3": [1.8, 1.9]},
    }  # fmt: skip
    mission = hs.Mission.from_dict(tables, directory=loaded.directory)
    with pytest.raises(MissionError) as caught:
        check_mission(mission)
    told = str(caught.value)
    assert "stage 'family' (qso_family) cannot be repeated" in told
    assert "instead, carry its orbits along" in told
    assert "the key vary of a stage of type orbit_family" in told
    assert 'hs.Motion(plant, {"gravity.density": value})' in told
