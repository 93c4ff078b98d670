"""The covariance of ``start.message``: dispersed starts of a campaign, and beliefs of filters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators import tracking_simulation as sim

from hillsphere import create
from hillsphere.cases.repeated import Repeated
from hillsphere.engine.start_messages import start_of_message
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemCovariance, OemSegment, write_oem
from hillsphere.formats.opm import Opm, write_opm
from hillsphere.interfaces import Array
from hillsphere.mission import load_mission
from hillsphere.model.frame_motion import frame_motion
from hillsphere.runs.assembly import Assembly
from hillsphere.time import Epoch
from hillsphere.uncertainty.copula import covariance_factor
from hillsphere.uncertainty.dispersed import Dispersed, resolve

EPOCH = Epoch.parse("2027-06-01T00:00:00")
X = np.array([3e4, -5e4, 2e4, 3.0, 8.0, -2.0])
SIGMAS = np.array([100.0, 20.0, 30.0, 1e-3, 2e-3, 3e-3])
CASES = 4000
MISSION = """
format = 1
name = "hover"
title = "A start with a covariance"
seed = 1

[body.phobos]
type = "moon"
name = "phobos"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
pole_right_ascension_deg = 317.67
pole_declination_deg = 52.88
prime_meridian_deg = 35.18

[gravity.phobos]
type = "point_mass"
gm_m3_s2 = 7e5

[plant.hill]
type = "hill"
body = "phobos"
gravity = "phobos"

[compensator.axes]
type = "pid"
period_s = 60
proportional = [2.5e-5, 2.5e-5, 2.5e-5]
integral = [0, 0, 0]
derivative = [0.0075, 0.0075, 0.0075]

[stage.hover]
type = "closed_loop"
plant = "hill"
law = "axes"
samples = 2
start = { START }

[dispersions.start]
type = "start_covariance"
of = "stage.hover"
KEYS
"""


def correlated() -> Array:
    """Return a covariance in the axes of a message, of strong correlation."""
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(6, 6)))[0]
    correlation = turn @ np.diag([3.0, 1.5, 0.8, 0.4, 0.2, 0.1]) @ turn.T
    scale = np.sqrt(np.diag(correlation))
    covariance = correlation / np.outer(scale, scale) * np.outer(SIGMAS, SIGMAS)
    return np.asarray(0.5 * (covariance + covariance.T))


def axes_of(frame: str, inertial: Array) -> Array:
    """Return the axes of a covariance (3, 3) as columns, by their definitions."""
    r, v = inertial[:3], inertial[3:]
    if frame not in ("RTN", "TNW"):
        return np.eye(3)
    first = r if frame == "RTN" else v
    first, third = first / np.linalg.norm(first), np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    return np.column_stack([first, np.cross(third, first), third])


def covariance_in_frame(plant: Any, epoch: Epoch, x: Array, frame: str) -> Array:
    """Return the covariance in the plant's frame: every column of a root turned as a state is."""
    motion = frame_motion(plant, epoch, np.zeros(1), {})
    inertial = motion.to_inertial(x[:, None])[:, 0]
    axes = np.kron(np.eye(2), axes_of(frame, inertial))
    root = axes @ np.linalg.cholesky(correlated())
    moved = motion_of_columns(motion, inertial, root) - x[:, None]
    return np.asarray(moved @ moved.T)


def motion_of_columns(motion: Any, inertial: Array, root: Array) -> Array:
    states = [motion.from_inertial((inertial + c)[:, None])[:, 0] for c in root.T]
    return np.array(states).T


def check_samples(off: Array, covariance: Array) -> None:
    """Check a sample covariance by the spread of its whitened eigenvalues (Wishart).

    Of N = 4000 samples in six dimensions the extreme ones are (1 ± √(6/N))², 0.92 and 1.08
    (Marchenko and Pastur, 1967), with a standard deviation of some 0.01.
    """
    white = np.linalg.solve(np.linalg.cholesky(covariance), off)
    values = np.linalg.eigvalsh(np.cov(white))
    assert values.min() > 0.88
    assert values.max() < 1.12
    assert np.abs(white.mean(axis=1)).max() < 4.5 / np.sqrt(off.shape[1])


def message(path: Path, plant: Any, epoch: Epoch, x: Array, centre: str, frame: str) -> None:
    """Write a start with its covariance; ``own`` is an OEM whose covariance has its own frame."""
    inertial = frame_motion(plant, epoch, np.zeros(1), {}).to_inertial(x[:, None])[:, 0]
    if frame != "own":
        one = Opm("A", "1", centre, "ICRF", epoch, inertial, covariance=correlated(),
                  covariance_frame=frame)  # fmt: skip
        path.write_text(write_opm(one), "utf-8")
        return
    t = np.arange(0.0, 601.0, 60.0)
    states = np.repeat(inertial[:, None], t.size, axis=1)
    states[:3] += states[3:] * t
    segment = OemSegment("A", "1", centre, "ICRF", epoch, t, states,
                         covariances=(OemCovariance(0.0, correlated(), "TNW"),))  # fmt: skip
    path.write_text(write_oem([segment]), "utf-8")


def mission(directory: Path, keys: str = "", start: str = "") -> tuple[Any, Repeated]:
    start = start or "message = { file = 'a.opm' }"
    path = directory / "hover.toml"
    path.write_text(MISSION.replace("START", start).replace("KEYS", keys), "utf-8")
    repeated = Repeated(load_mission(path), "hover")
    return Assembly(repeated.mission).get("dispersions", "start"), repeated


def hill() -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377,
        pole_right_ascension_deg=317.67, pole_declination_deg=52.88, prime_meridian_deg=35.18,
    )  # fmt: skip
    return create("plant", "hill", body=body, gravity=create("gravity", "point_mass", gm_m3_s2=7e5))


@pytest.mark.parametrize("frame", ["", "RTN", "TNW", "own"])
def test_dispersed_starts_have_the_covariance_of_the_message(frame: str, tmp_path: Path) -> None:
    """4000 starts in a frame that turns; twice the spread with ``scale``."""
    plant = hill()
    message(tmp_path / "a.opm", plant, EPOCH, X, "PHOBOS", frame)
    expected = covariance_in_frame(plant, EPOCH, X, "TNW" if frame == "own" else frame)
    dispersion, repeated = mission(tmp_path)
    dispersed: Dispersed = resolve({"start": dispersion}, repeated)
    names = [f"offset.{name}" for name in ("x", "y", "z", "vx", "vy", "vz")]
    assert [q.name for q in dispersed.quantities] == names
    u = np.random.default_rng(5).random((6, CASES))
    values = dispersed.values(u)
    check_samples(values, expected)
    # the velocities in the turning frame hold −ω × r: without it they would be far too small
    still = start_of_message(tmp_path / "a.opm", plant).covariance
    assert still is not None
    np.testing.assert_allclose(dispersed.moments()[1], still, rtol=1e-12, atol=0)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(still / scale, expected / scale, atol=1e-6)
    # a case does not depend on others
    np.testing.assert_array_equal(dispersed.values(u[:, 7:8])[:, 0], values[:, 7])
    wide, repeated = mission(tmp_path, "scale = 2")
    twice = resolve({"start": wide}, repeated).values(u)
    np.testing.assert_allclose(twice, 2.0 * values, rtol=1e-12)


def test_a_start_without_covariance_is_named(tmp_path: Path) -> None:
    plant = hill()
    inertial = frame_motion(plant, EPOCH, np.zeros(1), {}).to_inertial(X[:, None])[:, 0]
    bare = write_opm(Opm("A", "1", "PHOBOS", "ICRF", EPOCH, inertial))
    (tmp_path / "a.opm").write_text(bare, "utf-8")
    for start, expected in (
        ("", r"dispersions.start: start.message: a.opm states no covariance"),
        ("position_km = [30, 0, 0]", r"dispersions.start: start.message: expected a message"),
    ):
        dispersion, repeated = mission(tmp_path, start=start)
        with pytest.raises(InputError, match=expected):
            resolve({"start": dispersion}, repeated)
    with pytest.raises(InputError, match=r"parameters: .*six states"):
        create("dispersions", "start_covariance", of="stage.hover", parameters=["offset.x"])
    with pytest.raises(InputError, match="above zero"):
        covariance_factor(np.diag([1.0, -1.0]))


def navigation(file: Path, **keys: Any) -> Any:
    plant = sim.small_body_plant()
    return create(
        "stage", "navigation", plant=plant,
        sensors=[create("sensor", "camera", body=plant.body)],
        estimator=create("estimator", "unscented"), start={"message": {"file": str(file)}},
        interval_min=10, duration_min=20, step_s=600, **keys,
    )  # fmt: skip


def test_beliefs_of_a_navigation_are_those_of_the_message(tmp_path: Path) -> None:
    """The belief equals the covariance in the plant's frame, and 4000 true starts have it."""
    path, zero = tmp_path / "a.opm", Epoch.parse(sim.DATE, "TDB")
    plant, x = sim.small_body_plant(), np.array([4e3, -3e3, 2e3, 0.03, 0.05, -0.02])
    message(path, plant, zero, x, "STONE", "RTN")
    expected = covariance_in_frame(plant, zero, x, "RTN")
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    for keys in ({}, {"belief": {"source": "message", "off": "estimate"}}):
        one = navigation(path, **keys)
        plan = one._make_plan().plan
        numbers = np.arange(CASES)
        batch = replace(one._own_batch(1, CASES), numbers=numbers, draws=numbers)
        truth, belief = one._begin(plan, batch, None, np.zeros(CASES))
        np.testing.assert_allclose(belief.covariance[7] / scale, expected / scale, atol=1e-6)
        off = truth - plan.start[:, None] if not keys else belief.x - plan.start[:, None]
        check_samples(off, expected)
        still = belief.x if not keys else truth
        np.testing.assert_allclose(still, np.tile(x[:, None], CASES), rtol=1e-8)
    stated = navigation(path, belief={"position_m": 50, "velocity_mm_s": 2})
    root = stated._make_plan().plan.root
    np.testing.assert_array_equal(root, np.diag([50.0] * 3 + [2e-3] * 3))
    path.write_text(
        "\n".join(line for line in path.read_text("utf-8").splitlines() if line[:2] != "CX"
                  and line[:2] != "CY" and line[:2] != "CZ" and line[:3] != "COV"), "utf-8"
    )  # fmt: skip
    with pytest.raises(InputError, match=r"a.opm states no covariance.*or give belief"):
        navigation(path)
