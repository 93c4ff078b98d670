"""The stage ``ephemeris``: orbits and flights as files in inertial axes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hillsphere.errors import InputError, StageError
from hillsphere.formats.oem import read_oem
from hillsphere.model.frame_motion import frame_motion
from hillsphere.plugins import default_registry, validate
from hillsphere.products import FlightSet, OrbitSet, PeriodicOrbits, Trajectories
from hillsphere.testing import RecordingContext
from hillsphere_orbits.ephemeris.specs import EphemerisSpec
from hillsphere_orbits.ephemeris.stage import EphemerisStage

GM, A, MU = 42828.37e9, 9.377e6, 7.059650784871513e5
N = np.sqrt(GM / A**3)
ORIENTED = {
    "pole_right_ascension_deg": 317.67071657,
    "pole_declination_deg": 52.88627266,
    "prime_meridian_deg": 35.18774440,
}


def _component(kind: str, type_: str, **keys: Any) -> Any:
    record = default_registry().get(kind, type_)
    return record.load_target()(validate(record.load_spec(), keys, where=type_))


def _plant(**body: Any) -> Any:
    moon = _component(
        "body", "moon", name="phobos", primary_name="mars", primary_gm_m3_s2=GM,
        semi_major_axis_m=A, **body,
    )  # fmt: skip
    return _component("plant", "hill", body=moon, gravity=_component(
        "gravity", "point_mass", gm_m3_s2=MU))  # fmt: skip


def _orbits(frame: str = "hill:phobos") -> OrbitSet:
    length = (MU / N**2) ** (1 / 3)
    speed = length * N
    # point mass: x0 = 100 km and 20 km (computed from the same equations by another integrator)
    x0 = np.array(
        [[1e5, 0, 0, 0, -8.409174939475 * speed, 0], [2e4, 0, 0, 0, -2.238228797055 * speed, 0]]
    ).T
    return OrbitSet(
        PeriodicOrbits(
            frame=frame,
            states=("x", "y", "z", "vx", "vy", "vz"),
            x0=x0,
            period_s=np.array([6.225146165976, 3.317797109272]) / N,
            integral=np.zeros(2),
            monodromy=np.zeros((6, 6, 2)),
            residual=np.zeros(2),
            labels=("x = 100 km", "x = 20 km"),
            length_m=length,
            time_s=1 / N,
        )
    )


def _stage(plant: Any, **keys: Any) -> EphemerisStage:
    given = {"plant": plant, "needs": {"orbits": ["a"]}, "epoch": "2027-06-01", **keys}
    spec = validate(EphemerisSpec, given, where="ephemeris")
    assert isinstance(spec, EphemerisSpec)
    return EphemerisStage(spec)


def _text(content: str | bytes) -> str:
    assert isinstance(content, str)
    return content


def test_the_files_solve_newtons_equations_in_inertial_axes() -> None:
    """Against SciPy in axes centred on the primary: its pull, the moon's, and the tide's error.

    Hill's equations are those of Newton but for terms of relative order r/a, so the inertial
    flight is compared over a short while with that order as tolerance.
    """
    stage = _stage(_plant(**ORIENTED), step_s=100.0, duration_s=2000.0)
    product = stage.run(RecordingContext(), orbits=(_orbits(),))
    shown = stage.present(product, orbits=(_orbits(),))
    (segment,) = read_oem(_text(shown.files["x-20-km.oem"]))
    assert (segment.center_name, segment.ref_frame) == ("PHOBOS", "ICRF")
    assert segment.t_s.size == 21

    motion = frame_motion(stage.plant, stage.epoch, np.zeros(1), {})
    origin = motion.to_inertial(np.zeros((6, 1)), "mars")[:, 0]
    moon0, moon1 = origin[:3], origin[3:] / N

    def rate(t: float, x: Any) -> Any:
        moon = moon0 * np.cos(N * t) + moon1 * np.sin(N * t)
        r = moon + x[:3]
        pull = GM * (moon / A**3 - r / np.linalg.norm(r) ** 3)
        return np.concatenate([x[3:], pull - MU * x[:3] / np.linalg.norm(x[:3]) ** 3])

    flown = solve_ivp(
        rate, (0.0, 2000.0), segment.x[:, 0], rtol=1e-11, atol=1e-6, t_eval=segment.t_s
    ).y
    moved = np.linalg.norm(segment.x[:3, -1] - segment.x[:3, 0])
    error = np.max(np.linalg.norm(flown[:3] - segment.x[:3], axis=0))
    # next term of the tide, 3 n² r²/a, as if it always pulled the same way
    tide_error = 0.5 * 3.0 * N**2 * (2.1e4) ** 2 / A * 2000.0**2
    assert error < tide_error
    assert tide_error < 2e-3 * moved


def test_one_period_is_the_default_and_the_csv_says_the_same() -> None:
    stage = _stage(_plant(**ORIENTED), centre="primary")
    product = stage.run(RecordingContext(), orbits=(_orbits(),))
    shown = stage.present(product, orbits=(_orbits(),))
    assert set(shown.files) == {"x-100-km.oem", "x-100-km.csv", "x-20-km.oem", "x-20-km.csv"}
    (segment,) = read_oem(_text(shown.files["x-100-km.oem"]))
    assert segment.t_s[-1] == pytest.approx(6.225146165976 / N, abs=1e-5)
    lines = _text(shown.files["x-100-km.csv"]).splitlines()
    assert len(lines) == segment.t_s.size + 1
    last = np.array([float(v) for v in lines[-1].split(",")[1:]]) * 1e3
    np.testing.assert_allclose(last, segment.x[:, -1], rtol=0, atol=1e-6)
    assert segment.center_name == "MARS"
    assert np.linalg.norm(segment.x[:3, 0]) == pytest.approx(A + 1e5, abs=1e-3)


def test_flights_become_a_segment_for_each_coast() -> None:
    t = np.array([[0.0, 100.0], [50.0, 200.0], [100.0, np.nan]])
    x = np.where(np.isnan(t), np.nan, 1.0) * np.arange(1.0, 7.0)[:, None, None] * 1e3
    states = ("x", "y", "z", "vx", "vy", "vz")
    flights = FlightSet(
        Trajectories("hill:phobos", states, ("H to La",) * 2, ("first", "second"), t, x)
    )
    stage = _stage(_plant(**ORIENTED), needs={"flights": ["a"]})
    product = stage.run(RecordingContext(), flights=(flights,))
    shown = stage.present(product, flights=(flights,))
    first, second = read_oem(_text(shown.files["h-to-la.oem"]))
    assert (first.t_s.size, second.t_s.size) == (3, 2)
    assert second.epoch.seconds_since(first.epoch) == pytest.approx(100.0, abs=1e-6)


def test_a_body_without_orientation_is_refused() -> None:
    with pytest.raises(InputError, match="pole_right_ascension_deg"):
        _stage(_plant())


def test_orbits_of_another_frame_are_refused() -> None:
    stage = _stage(_plant(**ORIENTED))
    with pytest.raises(StageError, match="hill:deimos"):
        stage.run(RecordingContext(), orbits=(_orbits("hill:deimos"),))


def test_wrong_keys_are_refused() -> None:
    plant = _plant(**ORIENTED)
    with pytest.raises(InputError, match="epoch: '2027-06-31' is no date"):
        _stage(plant, epoch="2027-06-31")
    with pytest.raises(InputError, match="nothing to write"):
        _stage(plant, needs={})
    with pytest.raises(InputError, match="step_s"):
        _stage(plant, step_s=1e-6).run(RecordingContext(), orbits=(_orbits(),))


def test_a_heavy_moon_turns_its_frame_as_its_plant_says() -> None:
    """Mass ratio 0.1: the frame turns with √((GM + Gm)/a³), 5 % faster than a massless moon's."""
    gm, mu, a = 9.0, 1.0, 2000.0
    moon = _component(
        "body", "moon", name="small", primary_gm_m3_s2=gm, semi_major_axis_m=a, **ORIENTED
    )
    gravity = _component("gravity", "point_mass", gm_m3_s2=mu)
    plant = _component("plant", "three_body", body=moon, gravity=gravity)
    n = np.sqrt((gm + mu) / a**3)
    x0 = np.array([[500.0, 0.0, 60.0, 0.0, -1000.0 * n, 0.0]]).T
    orbit = OrbitSet(
        PeriodicOrbits(
            "hill:small", ("x", "y", "z", "vx", "vy", "vz"), x0, np.array([3e4]), np.zeros(1),
            np.zeros((6, 6, 1)), np.zeros(1), ("one",), plant.scales.length_m, 1.0 / n,
        )
    )  # fmt: skip
    stage = _stage(plant, step_s=1000.0, duration_s=3e4, centre="primary")
    product = stage.run(RecordingContext(), orbits=(orbit,))
    (segment,) = read_oem(_text(stage.present(product, orbits=(orbit,)).files["one.oem"]))
    axes = frame_motion(plant, stage.epoch, np.zeros(1), {}).axes[:, :, 0]

    def rate(t: float, x: Any) -> Any:
        """Newton's equations in axes that move with the primary, which the moon pulls."""
        to_moon = a * axes @ np.array([np.cos(n * t), np.sin(n * t), 0.0])
        r = x[:3] - to_moon
        pull = gm * x[:3] / np.linalg.norm(x[:3]) ** 3 + mu * r / np.linalg.norm(r) ** 3
        return np.concatenate([x[3:], -pull - mu * to_moon / a**3])

    start = axes @ np.array([a + 500.0, 0.0, 60.0])
    speed = axes @ np.array([0.0, n * (a + 500.0) - 1000.0 * n, 0.0])
    flown = solve_ivp(
        rate, (0.0, 3e4), np.concatenate([start, speed]), rtol=1e-12, atol=1e-9,
        t_eval=segment.t_s,
    ).y  # fmt: skip
    # the file holds micrometres and nanometres per second
    np.testing.assert_allclose(segment.x[:3], flown[:3], rtol=0, atol=2e-5)


def test_orbits_and_plans_of_one_name_get_files_of_their_own() -> None:
    stage = _stage(_plant(**ORIENTED), needs={"orbits": ["a", "b"]})
    given = (_orbits(), _orbits())
    shown = stage.present(stage.run(RecordingContext(), orbits=given), orbits=given)
    assert [name for name in shown.files if name.endswith(".oem")] == [
        "x-100-km.oem", "x-20-km.oem", "x-100-km-2.oem", "x-20-km-2.oem",
    ]  # fmt: skip
    assert all(
        len(read_oem(_text(shown.files[name]))) == 1 for name in shown.files if ".oem" in name
    )
