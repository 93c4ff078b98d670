"""Trajectories of spacecraft from SPK kernels made here, wherever an ephemeris is taken."""

from __future__ import annotations

import importlib.util
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from hillsphere import create
from hillsphere.cli.endings import run
from hillsphere.engine.start_messages import start_of_message
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment, write_oem
from hillsphere.formats.oem_interpolation import interpolant_of
from hillsphere.interfaces import Array
from hillsphere.model.frame_motion import frame_motion
from hillsphere.model.spk import read_spk, tdb_after_j2000
from hillsphere.model.spk_process import own_spans
from hillsphere.testing import RecordingContext
from hillsphere.time import J2000, Epoch

spice = pytest.importorskip("spiceypy")

EPOCH = Epoch.parse("2027-06-01T00:00:00")
START = EPOCH.seconds_since(J2000)
SPAN_S = 21600.0
RADIUS_M, RATE = 7e6, 1.078e-3
TILT = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])


def circle(t_s: Array, kick: float = 0.0) -> Array:
    """Return a circle about the Earth; after a kick the radius is another, (1 + kick) as large."""
    radius, rate = RADIUS_M * (1 + kick), RATE
    cos, sin, zero = np.cos(rate * t_s), np.sin(rate * t_s), np.zeros_like(t_s)
    return np.concatenate(
        [TILT @ (radius * np.stack([cos, sin, zero])),
         TILT @ (radius * rate * np.stack([-sin, cos, zero]))]
    )  # fmt: skip


class Part(NamedTuple):
    """A segment of a kernel to write."""

    begin_s: float
    end_s: float
    body: int = -999
    centre: int = 399
    frame: str = "J2000"
    kick: float = 0.0
    still: bool = False


def kernel(path: Path, *parts: Part, kind: int = 13) -> Path:
    handle = spice.spkopn(str(path), "test", 0)
    for part in parts:
        t = np.arange(part.begin_s, part.end_s + 1.0, 60.0)
        x = circle(t, part.kick) / 1e3
        if part.still:
            x[3:] = 0.0  # as kernels that give positions only
        if part.frame != "J2000":
            x = np.array(spice.sxform("J2000", part.frame, 0.0)) @ x
        write = spice.spkw13 if kind == 13 else spice.spkw09
        write(handle, part.body, part.centre, part.frame, START + t[0], START + t[-1], "part", 7,
              t.size, np.ascontiguousarray(x.T), START + t)  # fmt: skip
    spice.spkcls(handle)
    return path


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return kernel(tmp_path_factory.mktemp("spk") / "craft.bsp", Part(0.0, SPAN_S))


def off_by(segment: OemSegment, truth: Callable[[Array], Array]) -> tuple[float, float]:
    """Return the largest differences of positions, m, and velocities, m/s, within a segment."""
    first, last = interpolant_of(segment).span_s
    t = np.linspace(first, last, 2001)
    apart = interpolant_of(segment)(t) - truth(t + segment.epoch.seconds_since(EPOCH))
    return float(np.abs(apart[:3]).max()), float(np.abs(apart[3:]).max())


def test_states_are_those_of_the_kernel(sound: Path) -> None:
    """To 1 mm, on fewer nodes than the kernel's own; the rest is SPICE's interpolation."""
    (segment,) = read_spk(sound, centres=("EARTH",))
    assert (segment.object_id, segment.center_name, segment.ref_frame) == ("-999", "EARTH", "ICRF")
    place, speed = off_by(segment, circle)
    assert place < 1e-3
    assert speed < 1e-4
    assert segment.t_s.size < SPAN_S / 60.0
    assert segment.warnings == ()


def test_inertial_frames_are_turned(tmp_path: Path) -> None:
    path = kernel(tmp_path / "ecliptic.bsp", Part(0.0, 3600.0, frame="ECLIPJ2000"))
    (segment,) = read_spk(path, centres=("EARTH",))
    assert off_by(segment, circle)[0] < 1e-3


def test_velocities_that_are_no_derivatives_are_kept(tmp_path: Path) -> None:
    """Type 9 interpolates both by themselves: positions move, velocities are zero as stated."""
    path = kernel(tmp_path / "still.bsp", Part(0.0, 600.0, still=True), kind=9)
    (segment,) = read_spk(path, centres=("EARTH",))
    assert segment.interpolation == "LAGRANGE"

    def truth(t_s: Array) -> Array:
        x = circle(t_s)
        x[3:] = 0.0
        return x

    place, speed = off_by(segment, truth)
    assert place < 1e-3
    assert speed < 1e-6


def test_segments_are_not_mixed_at_a_manoeuvre(tmp_path: Path) -> None:
    """At the common time SPICE itself gives the later segment only; gaps stay gaps."""
    path = kernel(tmp_path / "kick.bsp", Part(0.0, 3600.0), Part(3600.0, 7200.0, kick=1e-4),
                  Part(9000.0, 10800.0))  # fmt: skip
    first, second, third = read_spk(path, centres=("EARTH",))
    assert off_by(first, circle)[0] < 1e-3
    assert off_by(second, lambda t_s: circle(t_s, 1e-4))[0] < 1e-3
    assert third.epoch.seconds_since(EPOCH) + third.t_s[0] == pytest.approx(9000.0, abs=1e-6)


def test_the_later_of_overlapping_segments_holds() -> None:
    class Span(NamedTuple):
        begin: float
        end: float

    a, b, c = Span(0, 10), Span(5, 7), Span(6, 12)
    assert own_spans([a, b, c]) == [(a, 0, 5), (b, 5, 6), (c, 6, 12)]
    assert own_spans([b, a]) == [(a, 0, 10)]
    assert own_spans([a, b]) == [(a, 0, 5), (b, 5, 7), (a, 7, 10)]


def test_a_centre_that_kernels_lead_to(tmp_path: Path) -> None:
    """A craft about 398, which another kernel places about the Earth: vectors are summed."""
    craft = kernel(tmp_path / "craft.bsp", Part(0.0, 3600.0, centre=398))
    with pytest.raises(InputError, match=r"craft.bsp: it is about 398, and no kernel leads from"):
        read_spk(craft, centres=("EARTH",))
    between = kernel(tmp_path / "between.bsp", Part(0.0, 3600.0, body=398, kick=0.5))
    (segment,) = read_spk(craft, centres=("EARTH",), kernels=[str(between)])
    assert off_by(segment, lambda t: circle(t) + circle(t, 0.5))[0] < 1e-3


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("", r"two.bsp: expected one spacecraft; it holds -999, -998; choose one by its name or"),
        ("-31", r"two.bsp: it does not hold '-31'; it holds -999, -998"),
        ("GO", r"two.bsp: SPICE knows no 'GO'; it holds -999, -998"),
    ],
)
def test_the_spacecraft_is_chosen(name: str, message: str, tmp_path: Path) -> None:
    path = kernel(tmp_path / "two.bsp", Part(0.0, 600.0), Part(0.0, 600.0, body=-998, kick=0.1))
    with pytest.raises(InputError, match=message):
        read_spk(path, name, centres=("EARTH",))
    (segment,) = read_spk(path, "-998", centres=("EARTH",))
    assert off_by(segment, lambda t_s: circle(t_s, 0.1))[0] < 1e-3


def test_names_and_frames_come_from_text_kernels(sound: Path, tmp_path: Path) -> None:
    names = tmp_path / "names.tf"
    names.write_text("KPL/FK\n\\begindata\nNAIF_BODY_NAME += ('GO')\nNAIF_BODY_CODE += (-999)\n")
    (segment,) = read_spk(sound, "GO", centres=("EARTH",), kernels=[str(names)])
    assert segment.object_name == "GO"
    names.write_text(f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD = ('{sound}')\n")
    with pytest.raises(InputError, match=r"'names.tf' is a meta-kernel, which names other files"):
        read_spk(sound, centres=("EARTH",), kernels=[str(names)])


def test_times_after_j2000() -> None:
    """A double of seconds in this decade is 0.1 µs coarse; the epoch must add nothing to that."""
    at = tdb_after_j2000(865080000.0)
    assert at.isot(np.zeros(1), 9) == ["2027-06-01T00:00:00.000000000"]
    assert at.seconds_since(EPOCH) == 0.0


# --- where an ephemeris is taken


PLACES = [{"name": str(east), "latitude_deg": 40.0, "longitude_deg": east, "height_m": 580}
          for east in (11, 101, 191, 281)]  # fmt: skip


def test_passes_are_those_of_the_message(sound: Path, tmp_path: Path, capsys: Any) -> None:
    t = np.arange(0.0, SPAN_S + 1.0, 60.0)
    message = tmp_path / "craft.oem"
    message.write_text(write_oem([OemSegment("A", "1", "EARTH", "ICRF", EPOCH, t, circle(t))]))
    lists = [
        create("stage", "passes", satellites=[{"file": str(file)}], stations=PLACES,
               duration_d=0.25).run(RecordingContext())
        for file in (message, sound)
    ]  # fmt: skip
    assert lists[0].rise_s.size > 1
    for key in ("rise_s", "culmination_s", "set_s"):
        # times count from the beginning of each, which is told in microseconds
        np.testing.assert_allclose(
            getattr(lists[1], key), getattr(lists[0], key), rtol=0, atol=1e-4
        )
    assert run(["passes", str(sound), "--station", "48.08,11.28,580", "--days", "0.2"]) == 0
    assert "-999: Hermite interpolation" in capsys.readouterr().err
    kernels = {"file": str(message), "kernels": [str(sound)]}
    with pytest.raises(InputError, match=r"craft.oem: kernels: expected none"):
        create("stage", "passes", satellites=[kernels], stations=PLACES)


def test_track_follows_a_kernel(sound: Path, tmp_path: Path, capsys: Any) -> None:
    """The predictions of a pass without signal are those along a message of the same orbit."""
    message = tmp_path / "craft.oem"
    t = np.arange(0.0, SPAN_S + 1.0, 60.0)
    message.write_text(write_oem([OemSegment("A", "1", "EARTH", "ICRF", EPOCH, t, circle(t))]))
    (begin,) = EPOCH.after(600.0).to("UTC").isot(np.zeros(1), 3)
    (tmp_path / "m.csv").write_text(f"{begin},10,20\n")
    said = []
    for file in (message, sound):
        run(["track", str(tmp_path / "m.csv"), "--latitude", "40", "--longitude", "101", "--replay",
             "--speed", "0", "--ut1-minus-utc", "0", "--elements", str(file)])  # fmt: skip
        said.append(capsys.readouterr().out)
    assert len(said[0].splitlines()) > 1000
    assert said[0] == said[1]


def test_a_missing_extra_is_named(sound: Path, monkeypatch: Any, capsys: Any) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "spiceypy" else find(name, *a)
    )
    assert run(["passes", str(sound), "--station", "48,11,0", "--days", "0.1"]) == 2
    said = capsys.readouterr().err.strip()
    assert "pip install 'hillsphere[spice]'" in said
    assert len(said.splitlines()) == 1


def plant() -> Any:
    gravity = create("gravity", "point_mass", gm_m3_s2=RATE**2 * RADIUS_M**3)
    return create("plant", "earth_orbit", body=create("body", "planet"), gravity=gravity,
                  epoch=EPOCH.to("UTC").isot(np.zeros(1), 9)[0], frame="gcrs")  # fmt: skip


def test_a_kernel_is_a_reference(sound: Path) -> None:
    reader = create("stage", "ephemeris_reference", plant=plant(), file=str(sound), interval_s=60)
    flights = reader.run(RecordingContext()).flights
    assert np.abs(flights.x[:3, :, 0] - circle(flights.t_s[:, 0])[:3]).max() < 1e-3
    assert np.abs(flights.x[3:, :, 0] - circle(flights.t_s[:, 0])[3:]).max() < 1e-4


def test_a_kernel_is_a_start(sound: Path) -> None:
    one = plant()
    got = start_of_message(sound, one, epoch="2027-06-01T00:10:00", time_s=600.0)
    want = circle(np.array([600.0]))
    motion = frame_motion(one, EPOCH, np.array([600.0]), {})
    np.testing.assert_allclose(got.x, motion.from_inertial(want)[:, 0], rtol=0, atol=1e-3)
    assert got.covariance is None
    with pytest.raises(InputError, match=r"no segment of the ephemeris has useable states at"):
        start_of_message(sound, one, epoch="2027-06-02T00:10:00", time_s=87000.0)


def test_lenient_reading_of_references_and_starts(tmp_path: Path) -> None:
    """An unknown keyword is refused, and with lenient = true told."""
    t = np.arange(0.0, 601.0, 60.0)
    path = tmp_path / "craft.oem"
    text = write_oem([OemSegment("A", "1", "EARTH", "ICRF", EPOCH, t, circle(t))])
    path.write_text(text.replace("CENTER_NAME", "COLOUR = RED\nCENTER_NAME"))
    one = plant()
    with pytest.raises(InputError, match="no keyword 'COLOUR'"):
        start_of_message(path, one)
    with pytest.warns(UserWarning, match="no keyword 'COLOUR'"):
        start_of_message(path, one, lenient=True)
    stage = create("stage", "ephemeris_reference", plant=one, file=str(path))
    with pytest.raises(InputError, match="no keyword 'COLOUR'"):
        stage.run(RecordingContext())
    stage = create("stage", "ephemeris_reference", plant=one, file=str(path), lenient=True)
    product = stage.run(RecordingContext())
    assert "no keyword 'COLOUR'" in stage.present(product).verdict[0]


# --- files that are none


def test_bad_files_are_refused_in_one_line(sound: Path, tmp_path: Path, capsys: Any) -> None:
    content = sound.read_bytes()
    cases = {
        "cut.bsp": content[:1500], "head.bsp": content[:700], "half.bsp": content[: -2048],
        "ck.bsp": b"DAF/CK  " + content[8:], "binary.bsp": bytes(range(256)) * 8,
        "text.bsp": b"no kernel\n", "empty.bsp": b"",
    }  # fmt: skip
    for name, bad in cases.items():
        path = tmp_path / name
        path.write_bytes(bad)
        assert run(["passes", str(path), "--station", "48,11,0", "--days", "0.1"]) == 2
        said = capsys.readouterr().err.strip()
        assert name in said
        assert len(said.splitlines()) == 1


def flip_and_read(sound: Path, tmp_path: Path, seeds: range) -> None:
    content = sound.read_bytes()
    path = tmp_path / "flipped.bsp"
    for seed in seeds:
        chance, changed = random.Random(seed), bytearray(content)
        for _ in range(chance.choice([1, 4, 32])):
            changed[chance.randrange(len(content))] ^= 1 << chance.randrange(8)
        path.write_bytes(changed)
        said, segments = "", []
        try:
            segments = read_spk(path, centres=("EARTH",))
        except InputError as error:
            said = str(error)
        assert ("flipped.bsp" in said and "\n" not in said) or segments, seed
        assert all(np.isfinite(one.x).all() for one in segments), seed


def test_flipped_bits(sound: Path, tmp_path: Path) -> None:
    flip_and_read(sound, tmp_path, range(4))


@pytest.mark.slow
def test_many_flipped_bits(sound: Path, tmp_path: Path) -> None:
    flip_and_read(sound, tmp_path, range(2000))
