"""Sample orbit messages, written after CCSDS 502.0-B-3 and 505.0-B-3, sound and broken."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.base.errors import InputError
from hillsphere.formats.ccsds_entries import split_unit
from hillsphere.formats.ndm import read_ndm, split_ndm
from hillsphere.formats.ocm import ephemeris_segments, read_ocm
from hillsphere.formats.oem import read_oem, write_oem
from hillsphere.formats.oem_segments import hint_of_frame
from hillsphere.formats.opm import Manoeuvre, Opm, OsculatingElements, read_opm, write_opm
from hillsphere.formats.opm_content import state_of_elements
from hillsphere.model.ephemeris import states_of_elements
from hillsphere.time import Epoch
from hillsphere_tracking.omm import read_omms

DATA = Path(__file__).parents[1] / "data"
OEM = Path(__file__).parents[1] / "plugins" / "orbits" / "data" / "oem" / "valid"


def _read_all(text: str, where: str = "NDM", **options: Any) -> Any:
    return read_ndm(text, where, readers={"omm": read_omms}, **options)


READERS: dict[str, Callable[..., Any]] = {"opm": read_opm, "ocm": read_ocm, "ndm": _read_all}
VALID = [(kind, path) for kind in READERS for path in sorted((DATA / kind / "valid").iterdir())]
BROKEN = [
    (kind, *row.split(" | "))
    for kind in READERS
    for row in (DATA / kind / "broken.txt").read_text("utf-8").splitlines()[1:]
]
SOUND = np.array([9376.5e3, -1.5e3, 0.25e3, 1.0, 2138.0, -500.0])
"""The state of most samples, m and m/s."""


def sample(kind: str, name: str, folder: str = "valid") -> str:
    return (DATA / kind / folder / name).read_bytes().decode("utf-8")


def opm(name: str) -> Opm:
    return read_opm(sample("opm", name), name)


def assert_same(first: Any, second: Any) -> None:
    """Compare two frozen dataclasses, to the last bit, without what only a reader notes."""
    for entry in fields(first):
        if not entry.compare:
            continue
        a, b = getattr(first, entry.name), getattr(second, entry.name)
        if entry.name == "manoeuvres":
            for one, other in zip(a, b, strict=True):
                assert_same(one, other)
        elif isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b)
        else:
            assert a == b, entry.name


@pytest.mark.parametrize(("kind", "path"), VALID, ids=lambda one: getattr(one, "name", one))
def test_a_sound_message_is_read(kind: str, path: Path) -> None:
    read = READERS[kind](path.read_bytes().decode("utf-8"), path.name)
    assert read
    if kind == "opm":
        assert read.warnings == ()
        for encoding in ("kvn", "xml"):
            text = write_opm(read, originator="TEST", encoding=encoding)
            assert_same(read_opm(text, encoding), read)


def test_every_broken_sample_is_in_the_tables() -> None:
    for kind in READERS:
        assert sorted(row[1] for row in BROKEN if row[0] == kind) == sorted(
            path.name for path in (DATA / kind / "broken").iterdir()
        )


@pytest.mark.parametrize(
    ("kind", "name", "line", "words"), BROKEN, ids=[f"{row[0]}-{row[1]}" for row in BROKEN]
)
def test_a_broken_message_is_refused_at_its_line(
    kind: str, name: str, line: str, words: str
) -> None:
    with pytest.raises(InputError) as caught:
        READERS[kind](sample(kind, name, "broken"), name)
    message = str(caught.value)
    assert words in message
    assert "\n" not in message
    assert re.match(rf"{re.escape(name)}:{line if line != '0' else r'[0-9]+'}: ", message)


def test_what_the_samples_of_one_state_say() -> None:
    np.testing.assert_array_equal(opm("plain.opm").x, SOUND)
    assert_same(opm("plain.opm"), opm("plain.xml"))
    assert_same(replace(opm("spaces.opm"), comments=()), opm("plain.opm"))
    assert opm("plain.opm").epoch == Epoch.parse("2027-03-01", "TDB")
    gps = opm("gps-time.opm").epoch
    assert abs(gps.seconds_since(Epoch.parse("2027-03-01T00:00:19", "TAI"))) < 1e-10
    one = opm("covariance.opm")
    assert one.covariance is not None
    assert (one.covariance_frame, one.covariance[0, 1]) == ("RTN", 10.0)
    np.testing.assert_allclose(
        np.diag(one.covariance), [100.0, 400.0, 900.0, 1e-4, 1e-4, 4e-4], rtol=1e-15
    )
    impulse, burn = opm("manoeuvres.opm").manoeuvres
    assert (impulse.duration_s, impulse.mass_change_kg, impulse.frame) == (0.0, -1.25, "RTN")
    np.testing.assert_array_equal(impulse.dv, [1.0, 0.0, -2.0])
    assert impulse.comments == ("the first is an impulse",)
    assert burn.epoch.seconds_since(impulse.epoch) == pytest.approx(64800.5, abs=1e-9)
    craft = opm("spacecraft.opm")
    assert (craft.mass_kg, craft.drag_area_m2, craft.drag_coefficient) == (850.5, 10.5, 2.2)
    assert (craft.solar_radiation_area_m2, craft.solar_radiation_coefficient) == (12.0, 1.3)
    full = opm("full.opm")
    assert full.comments == ("of the header", "of the metadata", "of the state")
    assert (full.classification, full.message_id, full.originator) == ("public", "OPM 7", "TEST")
    assert full.user_defined == {"GRAVITY": "degree 8", "CASE_2": "A-1"}
    elements = OsculatingElements(9e6, 0.25, 0.0, 0.0, 0.0, 60.0, 4.2828e13)
    assert full.elements == elements


def test_elements_agree_with_another_formula_and_a_difference_is_told() -> None:
    given = OsculatingElements(9e6, 0.25, 40.0, 70.0, 110.0, 200.0, 4.2828e13, mean=True)
    angles = np.radians([40.0, 70.0, 110.0, 200.0])
    other = states_of_elements(np.array([[9e6], [0.25], *angles[:, None]]), 4.2828e13)
    np.testing.assert_allclose(state_of_elements(given, 4.2828e13), other[:, 0], rtol=1e-13)
    # the hyperbola's mean anomaly: M = e sinh H − H at H = 0.7
    h, e = 0.7, 1.5
    true = 2.0 * np.arctan(np.sqrt((e + 1) / (e - 1)) * np.tanh(h / 2))
    by_mean = replace(
        given, semi_major_axis_m=-9e6, eccentricity=e, anomaly_deg=np.degrees(e * np.sinh(h) - h)
    )
    by_true = replace(by_mean, anomaly_deg=float(np.degrees(true)), mean=False)
    np.testing.assert_allclose(
        state_of_elements(by_mean, 4.2828e13), state_of_elements(by_true, 4.2828e13), rtol=1e-12
    )
    text = sample("opm", "elements.opm")
    # three angles of one decimal explain 0.15 deg, e = 0.25 half a per cent of the distance
    off = read_opm(text.replace("ANOMALY = 60.0 ", "ANOMALY = 56.0 "), "f")
    (warning,) = off.warnings
    assert warning.startswith("f:16: the elements differ from the state by ")
    assert read_opm(text.replace("ANOMALY = 60.0 ", "ANOMALY = 60.1 "), "f").warnings == ()
    exact = re.sub(r"= (0|60)\.0 ", r"= \1.00000 ", text).replace("= 0.25\n", "= 0.2500000\n")
    assert read_opm(exact, "f").warnings == ()
    near = exact.replace("ANOMALY = 60.00000", "ANOMALY = 60.00500")  # 0.7 km along the orbit
    assert re.search(r"by 0\.[67][0-9]+ km", read_opm(near, "f").warnings[0])


def test_a_message_returns_to_the_last_bit() -> None:
    rng = np.random.default_rng(11)
    root = rng.normal(size=(6, 6)) * np.array([9.0, 8.0, 7.0, 1e-3, 2e-3, 3e-3])
    covariance = root.T @ root
    covariance = 0.5 * (covariance + covariance.T)
    epoch = Epoch.parse("2027-03-01T12:34:56.123456789", "UTC")
    for _ in range(20):
        made = Opm(
            object_name="QSO-H é",
            object_id="2024-999A",
            center_name="MARS",
            frame="ICRF",
            epoch=epoch,
            x=rng.normal(size=6) * 10.0 ** rng.integers(-9, 9, 6),
            elements=OsculatingElements(
                9e6,
                float(rng.uniform(0.1, 0.9)),
                40.1,
                float(rng.uniform(0, 360)),
                20.3,
                30.2,
                4.2828e13,
            ),
            mass_kg=float(rng.uniform(1, 1e4)),
            covariance=covariance,
            covariance_frame="TNW",
            manoeuvres=(Manoeuvre(epoch, 0.0, 0.0, "RTN", rng.normal(size=3), ("a < b",)),),
            user_defined={"NOTE": "x & y"},
            comments=("first", "second"),
        )
        for encoding in ("kvn", "xml"):
            text = write_opm(made, originator="A & B", encoding=encoding)
            assert_same(read_opm(text, encoding), made)
    stamp = datetime(2027, 1, 2, 3, 4, 5, tzinfo=UTC)
    assert "CREATION_DATE = 2027-01-02T03:04:05\n" in write_opm(made, created=stamp)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"x": np.full(6, np.nan)}, "x must be finite numbers of shape"),
        ({"x": np.ones(5)}, "x must be finite numbers of shape"),
        ({"frame": "SUNSET"}, "no reference frame 'SUNSET'"),
        ({"object_name": "a = b"}, "OBJECT_NAME must be printable text without '='"),
        ({"object_name": "a\nX = 4"}, "one line each"),
        ({"object_id": ""}, "OBJECT_ID has no value"),
        ({"mass_kg": np.inf}, "mass_kg must be a finite number"),
        ({"mass_kg": -1.0}, "MASS must be at least 0"),
        ({"covariance": -np.eye(6)}, "CX_X must be a variance of at least 0"),
        ({"covariance": np.triu(np.ones((6, 6)))}, "covariance must be symmetric"),
        ({"comments": ("a\nb",)}, "one line each"),
        ({"user_defined": {"a b": "c"}}, "expected KEYWORD = value"),
        ({"user_defined": {"é": "c"}}, "expected KEYWORD = value"),
    ],
)
def test_what_no_message_can_hold_is_not_written(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)):
        write_opm(replace(opm("plain.opm"), **change))
    with pytest.raises(InputError, match="encoding must be"):
        write_opm(opm("plain.opm"), encoding="json")


def test_what_the_comprehensive_samples_say() -> None:
    one = read_ocm(sample("ocm", "plain.ocm"))
    (history,) = one.trajectories
    assert history.x is not None
    np.testing.assert_array_equal(history.x[:, 0], SOUND)
    np.testing.assert_array_equal(history.t_s, [0.0, 60.0])
    (segment,) = ephemeris_segments(one)
    again = read_oem(write_oem([segment]))[0]
    np.testing.assert_array_equal(again.x, history.x)
    assert again.epoch == one.epoch
    positions = read_ocm(sample("ocm", "positions.ocm")).trajectories[0]
    assert positions.x is not None
    assert positions.x.shape == (3, 2)
    np.testing.assert_allclose(positions.t_s, [0.0, 60.0], atol=1e-9)
    with pytest.raises(InputError, match="no history of positions with velocities"):
        ephemeris_segments(read_ocm(sample("ocm", "positions.ocm")))
    fast = read_ocm(sample("ocm", "accelerations.ocm")).trajectories[0]
    assert fast.accelerations_m_s2 is not None
    np.testing.assert_allclose(fast.accelerations_m_s2[:, 0], [-0.4, 1e-3, -2.5e-3], rtol=1e-15)
    elements = read_ocm(sample("ocm", "elements.ocm")).trajectories[0].elements
    assert elements is not None
    np.testing.assert_allclose(
        elements[:, 0], [9e6, 0.25, *np.radians([30, 10, 20, 60])], rtol=1e-15
    )
    expected = np.diag([100.0, 400.0, 900.0, 1e-4, 1e-4, 4e-4])
    for block in read_ocm(sample("ocm", "covariances.ocm")).covariances:
        assert (block.frame, block.t_s[0]) == ("RTN", 60.0)
        np.testing.assert_allclose(block.matrices[:, :, 0], expected, rtol=1e-15)
    message = read_ocm(sample("ocm", "manoeuvres.ocm"))
    first, second = (block.manoeuvres[0] for block in message.manoeuvres)
    assert first.epoch.seconds_since(message.epoch) == pytest.approx(3600.0, abs=1e-9)
    assert second.epoch == Epoch.parse("2027-03-01T02:00:00", "UTC")
    assert (first.duration_s, first.mass_change_kg) == (0.0, -1.25)
    np.testing.assert_array_equal(second.dv, [1.0, 0.0, -2.0])
    assert np.isnan(second.mass_change_kg)
    assert any("taken as impulses" in text for text in message.warnings)


def test_what_is_not_read_of_a_comprehensive_message_is_kept() -> None:
    one = read_ocm(sample("ocm", "kept-as-text.ocm"), "f")
    assert [text.kind for text in one.texts] == ["TRAJ", "PHYS", "COV", "MAN", "PERT", "USER"]
    physical = one.texts[1]
    assert physical.entries == (
        ("COMMENT", "after separation"), ("WET_MASS", "850.5 [kg]"), ("DRAG_COEFF_NOM", "2.2"),
    )  # fmt: skip
    assert one.texts[0].lines == ("0.0 1 2 3 4 5 6",)
    assert "EQUINOCTIAL" in one.texts[0].reason
    assert sum("is kept as text" in text or "kept as text" in text for text in one.warnings) == 3
    (mean,) = read_ocm(sample("ocm", "mean-elements.ocm")).texts
    assert "(BROUWER)" in mean.reason
    full = read_ocm(sample("ocm", "full.ocm"))
    assert full.orbit_determination["OD_METHOD"] == "BATCH"
    assert full.metadata["TAIMUTC_AT_TZERO"] == "37 [s]"
    assert len(full.trajectories) == len(full.covariances) == len(full.manoeuvres) == 1


def test_the_parts_of_a_combined_message_are_read_by_kind() -> None:
    text = sample("ndm", "all-kinds.xml")
    parts = split_ndm(text, "f")
    kinds = ["cdm", "opm", "oem", "oem", "omm", "ocm", "tdm", "aem"]
    assert [part.kind for part in parts] == kinds
    lines = text.splitlines()
    for part in parts:
        assert f"<{part.kind} " in lines[int(part.place.removeprefix("f:")) - 1]
    messages = _read_all(text, "f")
    assert [one.kind for one in messages if one.content is None] == ["cdm", "aem"]
    assert "CDM are not read" in messages[0].reason
    np.testing.assert_array_equal(messages[1].content.x, SOUND)
    assert len(messages[2].content) == len(messages[6].content) == 1
    assert messages[4].content[0].name == "PROBE"
    # a reader alone takes an <ndm> of its kind only
    oem = "".join(f"{part.text.strip()}\n" for part in parts if part.kind == "oem")
    assert len(read_oem(f"<ndm>\n{oem}</ndm>")) == 2
    with pytest.raises(InputError, match=r"f:\d+: <ndm> holds <cdm>, expected <oem> only"):
        read_oem(text, "f")
    with pytest.raises(InputError, match=r"f:5: no orbit mean-elements message: <cdm>"):
        read_omms(text, "f")


def test_parts_end_where_their_elements_end() -> None:
    text = '<ndm><opm/><oem a="/>"></oem>\n<omm>/></omm><tdm><x/></tdm><ocm\n/></ndm>'
    parts = split_ndm(text, "f")
    assert [part.text.strip() for part in parts] == [
        "<opm/>", '<oem a="/>"></oem>', "<omm>/></omm>", "<tdm><x/></tdm>", "<ocm\n/>",
    ]  # fmt: skip
    assert [part.place for part in parts] == ["f:1", "f:1", "f:2", "f:2", "f:2"]


def test_ephemerides_in_earth_rotation_time_come_back_and_end_with_the_table() -> None:
    text = (
        (OEM / "plain.oem").read_text("utf-8").replace("= TDB", "= UT1").replace("2027-", "2020-")
    )
    (segment,) = read_oem(text, "f")
    assert segment.epoch.scale == "UT1"
    # a minute of UT1 in 2020: the day is some 0.1 ms to 1 ms longer than 86400 s or shorter
    assert 0.0 < abs(segment.t_s[1] - 60.0) < 1e-6
    (again,) = read_oem(write_oem([segment]))
    np.testing.assert_allclose(again.t_s, segment.t_s, rtol=0, atol=1e-6)
    with pytest.raises(InputError, match=r"^f:\d+: \w+: UT1 is known from 1973-01-02 to"):
        read_oem(text.replace("2020-", "2060-"), "f")
    state = sample("opm", "plain.opm").replace("= TDB", "= UT1").replace("2027-", "2060-")
    with pytest.raises(InputError, match=r"^f:9: EPOCH: UT1 is known from"):
        read_opm(state, "f")


def test_concatenated_text_is_refused_at_the_second_message() -> None:
    text = (OEM / "plain.oem").read_text("utf-8")
    line = len(text.splitlines()) + 1
    with pytest.raises(InputError, match=f"^f:{line}: a second message begins here"):
        read_oem(text + text, "f")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("ORIGINATOR = .*\n", "", "the header lacks ORIGINATOR"),
        ("CREATION_DATE = .*\n", "", "the header lacks CREATION_DATE"),
        ("= ICRF", "= ICRS", "customary name of ICRF"),
        ("OBJECT_ID", "COLOUR = red\nOBJECT_ID", "no keyword 'COLOUR'"),
        ("(OBJECT_NAME.*\n)(OBJECT_ID.*\n)", "\\2\\1", "OBJECT_NAME must stand before OBJECT_ID"),
    ],
)
def test_harmless_departures_are_warnings_for_a_lenient_reader(
    old: str, new: str, said: str
) -> None:
    ephemeris = (OEM / "plain.oem").read_text("utf-8")
    for name, text, read in (
        ("f", sample("opm", "plain.opm"), read_opm),
        ("g", ephemeris, lambda *a, **k: read_oem(*a, **k)[0]),
    ):
        changed = re.sub(old, new, text, count=1)
        assert changed != text
        with pytest.raises(InputError, match=said):
            read(changed, name)
        tolerant = read(changed, name, lenient=True)
        np.testing.assert_array_equal(tolerant.x, read(text, name).x)
        assert len(tolerant.warnings) == 1
        assert re.match(rf"{name}:\d+: .*{said}", tolerant.warnings[0])


def test_a_lenient_reader_still_refuses_what_would_change_a_state() -> None:
    for name in ("not-a-number.opm", "unit.opm", "doubled-keyword.opm", "missing-keyword.opm",
                 "frame.opm", "clock.opm", "second-message.opm"):  # fmt: skip
        with pytest.raises(InputError):
            read_opm(sample("opm", name, "broken"), name, lenient=True)
    for name in ("units.ocm", "falling-times.ocm", "few-numbers.ocm", "composition.ocm"):
        with pytest.raises(InputError):
            read_ocm(sample("ocm", name, "broken"), name, lenient=True)
    kept = read_ocm(sample("ocm", "type.ocm", "broken"), lenient=True)
    assert [text.kind for text in kept.texts] == ["TRAJ"]
    moved = read_ocm(sample("ocm", "block-order.ocm", "broken"), lenient=True)
    assert len(moved.trajectories) == len(moved.covariances) == 1


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("ECI", "different frames bear this name: say EME2000, GCRF, TEME or TOD_EARTH"),
        ("ECEF", "different frames bear this name: say ITRF, WGS84, TDR or EFG"),
        ("ITRS", "did you mean 'ITRF'"),
        ("MEME2000", "did you mean 'EME2000'"),
        ("ICFR", "did you mean 'ICRF'"),
        ("MOD_ERTH", "did you mean 'MOD_EARTH'"),
        ("MODMOON", "did you mean 'MOD_MOON'"),
        ("MICI", "did you mean 'MCI'"),
        ("LCI", "known: ICRF, EME2000"),
        ("MOD_MARS", "known: ICRF, EME2000"),
        ("MOD_VENUS", "known: ICRF, EME2000"),
        ("TOD_SUN", "known: ICRF, EME2000"),
    ],
)
def test_a_hint_of_a_frame_never_changes_the_body(name: str, hint: str) -> None:
    assert hint_of_frame(name).startswith(f"; {hint}")


def test_a_unit_follows_a_value() -> None:
    """What begins with a bracket is the value, as the list of units of a history is."""
    assert split_unit("7000.5 [km]") == ("7000.5", "km")
    assert split_unit("7000.5[km]") == ("7000.5", "km")
    assert split_unit("7000.5") == ("7000.5", "")
    assert split_unit("[km, km/s]") == ("[km, km/s]", "")
    text = re.sub(r"(?m)^X\b.*$", "X = [km]", sample("opm", "plain.opm"))
    with pytest.raises(InputError, match=r"X must be a finite number, got '\[km\]'"):
        read_opm(text)
