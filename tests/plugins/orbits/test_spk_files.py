"""SPK kernels that the stage ``ephemeris`` writes, read by SPICE itself, against the flights."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import Motion, create
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment
from hillsphere.formats.oem_interpolation import interpolant_of
from hillsphere.interfaces import Array
from hillsphere.model.frame_motion import frame_motion
from hillsphere.presentation import Presentation
from hillsphere.products import FlightSet, Trajectories
from hillsphere.testing import RecordingContext
from hillsphere.time import J2000, Epoch
from hillsphere_orbits.ephemeris.spk_files import choose_degree, spk_times

spice = pytest.importorskip("spiceypy")

EPOCH = Epoch.parse("2027-06-01T00:00:00")
POLE: dict[str, Any] = {"pole_right_ascension_deg": 317.67, "pole_declination_deg": 52.88,
        "prime_meridian_deg": 35.18}  # fmt: skip
GRAVITY = create("gravity", "point_mass", gm_m3_s2=7.06e5)
STATES = ("x", "y", "z", "vx", "vy", "vz")
ID = -999


def moon(name: str = "phobos", **keys: Any) -> Any:
    return create("body", "moon", name=name, primary_name="mars", primary_gm_km3_s2=42828.37,
                  semi_major_axis_km=9376, **keys)  # fmt: skip


def hill(**keys: Any) -> Any:
    return create("plant", "hill", body=moon(**{**POLE, **keys}), gravity=GRAVITY)


def earth() -> Any:
    gravity = create("gravity", "point_mass", gm_m3_s2=3.986004418e14)
    return create("plant", "earth_orbit", body=create("body", "planet"), gravity=gravity,
                  epoch="2027-06-01T00:00:00", frame="gcrs")  # fmt: skip


ABOUT_MOON = np.array([3e4, -5e4, 2e4, 3.0, 8.0, -2.0])
ABOUT_EARTH = np.array([6.9e6, 0.0, 0.0, 0.0, 3.0e3, 7.0e3])


def coasts(plant: Any, *parts: tuple[Array, Array]) -> FlightSet:
    """Return a flight of several coasts, each of times (K,) and states (6, K)."""
    most = max(t.size for t, _ in parts)
    t_s, x = np.full((most, len(parts)), np.nan), np.full((6, most, len(parts)), np.nan)
    for k, (t, of) in enumerate(parts):
        t_s[: t.size, k], x[:, : t.size, k] = t, of
    labels = tuple(f"coast {k}" for k in range(len(parts)))
    return FlightSet(Trajectories(plant.frame, STATES, ("go",) * len(parts), labels, t_s, x))


def written(plant: Any, given: FlightSet, **keys: Any) -> Presentation:
    keys = {"epoch": "2027-06-01T00:00:00", "spacecraft_id": ID, "format": "spk", **keys}
    stage = create("stage", "ephemeris", plant=plant, needs={"flights": ["a"]}, **keys)
    product = stage.run(RecordingContext(), flights=(given,))
    shown: Presentation = stage.present(product, flights=(given,))
    return shown


@pytest.fixture
def kernels(tmp_path: Path) -> Any:
    """Return a function that loads the files of a presentation; all are unloaded again."""

    def load(shown: Presentation) -> Presentation:
        for name, content in shown.files.items():
            path = tmp_path / name
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
            spice.furnsh(str(path))
        return shown

    yield load
    spice.kclear()


def read(target: str, t_s: Array, centre: str, frame: str = "J2000") -> tuple[Array, Array]:
    """Return SPICE's states, SI, at the doubles nearest to the times, and these times exactly."""
    start = EPOCH.seconds_since(J2000)
    et = start + t_s
    states, _ = spice.spkezr(target, et, frame, "NONE", centre)
    return 1e3 * states.T, et - start


@pytest.mark.parametrize("kind", [13, pytest.param(9, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("make", "start", "step_s", "target", "keys"),
    [
        (earth, ABOUT_EARTH, 60.0, "399", {}),
        (hill, ABOUT_MOON, 100.0, "401", {}),
        pytest.param(
            lambda: create("plant", "three_body", body=moon(**POLE), gravity=GRAVITY), ABOUT_MOON,
            100.0, "499", {"centre": "primary"}, marks=pytest.mark.slow,
        ),
        pytest.param(
            lambda: hill(name="stone"), ABOUT_MOON, 100.0, "20000999", {"body_id": 20000999},
            marks=pytest.mark.slow,
        ),
    ],
    ids=["earth", "hill", "three_body", "small_body"],
)  # fmt: skip
def test_positions_are_those_of_the_flight(
    make: Any, start: Array, step_s: float, target: str, keys: dict[str, Any], kind: int,
    kernels: Any,
) -> None:  # fmt: skip
    """At the states and between them, to 1 mm, by the plant's own equations flown once more."""
    plant = make()
    motion = Motion(plant)
    t = np.arange(0.0, 6001.0, step_s)
    flown = motion.propagate(start, t[-1], times_s=t)
    shown = kernels(written(plant, coasts(plant, (t, flown.x)), spk_type=kind, **keys))
    assert not shown.verdict
    (row,) = shown.tables["ephemerides"].rows
    assert (row["spacecraft_id"], row["segments"]) == (ID, 1)
    for times in (t, np.linspace(0.0, t[-1], 1001)):
        got, at = read("GO", np.clip(times, 1e-6, t[-1] - 1e-6), target)
        want = motion.propagate(start, at[-1], times_s=at).x
        centre = "mars" if keys.get("centre") == "primary" else None
        want = frame_motion(plant, EPOCH, at, {}).to_inertial(want, centre)
        assert np.abs(got[:3] - want[:3]).max() < 1e-3
        assert np.abs(got[3:] - want[3:]).max() < 1e-5
    estimate = row["between_m"]
    assert isinstance(estimate, float)
    assert estimate < 1e-3


def test_the_frame_kernel_has_the_frame_of_the_plant(kernels: Any) -> None:
    """SPICE's own rotation leads back to the states in the turning frame, velocities too."""
    plant = hill()
    t = np.arange(0.0, 6001.0, 100.0)
    flown = Motion(plant).propagate(ABOUT_MOON, t[-1], times_s=t)
    kernels(written(plant, coasts(plant, (t, flown.x))))
    inside = t[1:-1]
    got, _ = read("GO", inside, "401", "HILL_PHOBOS")
    np.testing.assert_allclose(got[:3], flown.x[:3, 1:-1], rtol=0, atol=1e-3)
    np.testing.assert_allclose(got[3:], flown.x[3:, 1:-1], rtol=0, atol=1e-6)
    assert spice.bods2c("GO") == ID


def test_a_small_body_and_a_spacecraft_have_names(kernels: Any) -> None:
    plant = hill(name="stone")
    t = np.arange(0.0, 1001.0, 100.0)
    x = Motion(plant).propagate(ABOUT_MOON, t[-1], times_s=t).x
    kernels(written(plant, coasts(plant, (t, x)), body_id=20000999))
    assert spice.bods2c("STONE") == 20000999
    read("GO", t[1:-1], "STONE", "HILL_STONE")


@pytest.mark.parametrize("kind", [13, 9])
def test_segments_end_at_impulses(kind: int, kernels: Any, tmp_path: Path) -> None:
    """Nothing is interpolated across: 1 µs before and after, positions lie on their own coast."""
    plant = hill()
    motion = Motion(plant)
    t = np.arange(0.0, 3001.0, 100.0)
    first = motion.propagate(ABOUT_MOON, 3000.0, times_s=t).x
    after = first[:, -1] + np.array([0.0, 0.0, 0.0, 0.5, -0.25, 0.1])
    second = motion.propagate(after, 3000.0, times_s=t, t_s=3000.0).x
    flight = coasts(plant, (t, first), (3000.0 + t, second), (np.array([6000.0]), second[:, -1:]))
    shown = kernels(written(plant, flight, spk_type=kind))
    notes = shown.tables["ephemerides"].notes
    assert any("1 coasts of a single state are not in the kernels" in note for note in notes)
    cover = spice.spkcov(str(tmp_path / "go.bsp"), ID)
    span = EPOCH.seconds_since(J2000) + np.array([0.0, 6000.0])
    np.testing.assert_allclose(spice.wnfetd(cover, 0), span, rtol=0, atol=2e-7)
    for times, begin, start in (
        (np.linspace(1.0, 2999.999, 777), 0.0, ABOUT_MOON),
        (np.linspace(3000.001, 5999.0, 777), 3000.0, after),
    ):
        got, at = read("GO", times, "401")
        want = motion.propagate(start, at[-1] - begin, times_s=at - begin, t_s=begin).x
        want = frame_motion(plant, EPOCH, at, {}).to_inertial(want)
        assert np.abs(got[:3] - want[:3]).max() < 1e-3
        assert np.abs(got[3:] - want[3:]).max() < 1e-5


@pytest.mark.parametrize("scale", ["UTC", "TAI", "TT"])
def test_times_are_tdb(scale: str) -> None:
    """As single epochs are converted: also half a year on, where TDB − TT has changed by 3 ms."""
    epoch = Epoch.parse("2027-01-04T01:02:03.25", scale)
    t = np.array([0.0, 100.0, 86400.0 * 91])
    et, shift = spk_times(epoch, t)
    for k, at in enumerate(t):
        later = epoch.after(float(at)).to("TDB")
        days, rest = later.day - J2000.day - J2000.fraction, later.fraction * 86400.0
        assert days * 86400.0 + rest - et[k] == pytest.approx(0.0, abs=1.3e-7)
        exact = (et[k] - days * 86400.0) - rest
        assert exact == pytest.approx(shift[k], abs=5e-9)


def test_an_interval_that_is_too_long_is_told(kernels: Any) -> None:
    """The estimate from states left out, against the error itself: the same to a factor of 4."""
    plant = earth()
    t = np.arange(0.0, 30001.0, 1000.0)
    motion = Motion(plant)
    x = motion.propagate(ABOUT_EARTH, t[-1], times_s=t).x
    shown = kernels(written(plant, coasts(plant, (t, x))))
    (sentence,) = shown.verdict
    assert "go.bsp: its states are so far apart" in sentence
    got, at = read("GO", np.linspace(1.0, t[-1] - 1.0, 2001), "399")
    want = motion.propagate(ABOUT_EARTH, at[-1], times_s=at).x
    error = np.linalg.norm(got[:3] - want[:3], axis=0).max()
    (row,) = shown.tables["ephemerides"].rows
    assert isinstance(row["between_m"], float)
    assert error > 1e-3
    assert 0.25 < row["between_m"] / error < 4.0


@pytest.mark.parametrize("kind", [13, 9])
def test_a_flight_whose_acceleration_jumps_is_not_said_to_be_smooth(kind: int) -> None:
    """A push that is on in every third interval: Hermite's cubics are exact, Lagrange's are not.

    The error of the latter does not fall with the degree, and the estimate must not say so.
    """
    step = 10.0
    t = np.arange(0.0, 601.0, step)
    push = np.where(np.arange(t.size - 1) % 3 == 0, 1.0, 0.0)
    v = np.concatenate([[0.0], np.cumsum(step * push)])
    r = np.concatenate([[0.0], np.cumsum(step * v[:-1] + 0.5 * step**2 * push)])
    x = np.zeros((6, t.size))
    x[0], x[3] = r, v
    flown = OemSegment("A", "1", "EARTH", "ICRF", J2000, t, x)
    degree, estimate = choose_degree(flown, kind)
    k = np.arange(20, 40)
    half = r[k] + v[k] * step / 2 + push[k] * step**2 / 8
    got = interpolant_of(flown, "HERMITE" if kind == 13 else "LAGRANGE", degree)(t[k] + step / 2)
    error = np.abs(got[0] - half).max()
    if kind == 13:
        assert degree == 3
        assert error < 1e-9
    else:
        assert 0.25 < estimate / error < 8.0


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"spacecraft_id": None}, "spacecraft_id.*needs the NAIF number"),
        ({"spacecraft_id": 5}, "spacecraft_id.* < 0"),
        ({"format": "oem"}, "spacecraft_id.*only a kernel has it"),
        ({"spk_type": 5}, "spk_type"),
    ],
)
def test_keys_that_do_not_fit(keys: dict[str, Any], message: str) -> None:
    plant = hill()
    with pytest.raises(InputError, match=message):
        written(plant, coasts(plant, (np.zeros(1), ABOUT_MOON[:, None])), **keys)


@pytest.mark.parametrize(
    ("plant", "keys", "message"),
    [
        (lambda: hill(name="stone"), {}, "^body_id: SPICE knows no body 'stone'; give"),
        (hill, {"body_id": 402}, "^body_id: expected 401, by which SPICE knows 'phobos', got 402"),
        (lambda: create("plant", "hill", body=moon(), gravity=GRAVITY), {},
         "pole_right_ascension_deg"),
        (hill, {"epoch": None}, "^epoch: .* give it"),
    ],
)  # fmt: skip
def test_what_is_missing_is_named(plant: Any, keys: dict[str, Any], message: str) -> None:
    one = plant()
    with pytest.raises(InputError, match=message):
        written(one, coasts(one, (np.arange(3.0), np.zeros((6, 3)))), **keys)


def test_axes_that_spice_has_not_are_refused() -> None:
    gravity = create("gravity", "point_mass", gm_m3_s2=3.986004418e14)
    plant = create("plant", "earth_orbit", body=create("body", "planet"), gravity=gravity,
                   epoch="2027-06-01T00:00:00", frame="teme")  # fmt: skip
    with pytest.raises(InputError, match=r"^format: SPICE has no axes TEME"):
        written(plant, coasts(plant, (np.arange(3.0), np.zeros((6, 3)))))
