"""``hillsphere convert``: round trips, what is not kept, what is refused."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run
from hillsphere.plugins import default_registry

FIELDS = ("phobos-gravity-degree4.gfc", "eros-gravity-degree4.gfc", "earth-gravity-degree6.gfc")
# Vallado et al. (2006), Revisiting Spacetrack Report #3, first of the verification sets.
VANGUARD = """VANGUARD 1
1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753
2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667
"""
# The International Space Station, 2008 (the example of the element set's description in textbooks).
STATION = """ISS (ZARYA)
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
"""
OEM = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-01-01T00:00:00
ORIGINATOR = TEST

META_START
OBJECT_NAME = PROBE
OBJECT_ID = 2026-001A
CENTER_NAME = MARS
REF_FRAME = ICRF
TIME_SYSTEM = TDB
START_TIME = 2026-01-01T00:00:00
STOP_TIME = 2026-01-01T00:01:00
META_STOP
2026-01-01T00:00:00.000000 9376.123456789 -1.5 0.25 0.001234567891 2.138 -0.5
2026-01-01T00:01:00.000000 9375.000000001 128.25 -29.75 -0.041 2.1375 -0.499999999999
"""


@pytest.fixture(autouse=True)
def _fresh() -> Iterator[None]:
    default_registry.cache_clear()
    yield
    default_registry.cache_clear()


def convert(place: Path, *words: str) -> tuple[int, str, str]:
    out, err = StringIO(), StringIO()
    with chdir(place), redirect_stdout(out), redirect_stderr(err):
        code = run(("convert", *words))
    return int(code), out.getvalue(), err.getvalue()


def read(format_: str, path: Path) -> Any:
    record = default_registry().get("format", format_)
    return record.load_target()(record.load_spec()()).read(path)[0]


@pytest.mark.parametrize("name", FIELDS)
def test_gravity_fields_keep_every_digit(name: str, tmp_path: Path) -> None:
    source = missions_directory() / "data" / name
    code, out, err = convert(tmp_path, str(source), "field.shadr")
    assert (code, err) == (0, "")
    first, *lost = out.splitlines()
    assert first == "field.shadr: gravity field, icgem -> shadr"
    lost = [line for line in lost if "comment" not in line and "deviations" not in line]
    there = read("icgem", source)
    assert lost[0] == f"  not kept: name of the model ({there.name})"
    assert [line for line in lost if "tide system" in line] == (
        [f"  not kept: tide system ({there.tide_system})"] if there.tide_system else []
    )
    assert convert(tmp_path, "field.shadr", "back.gfc")[1].count("\n") == 1
    back = read("icgem", tmp_path / "back.gfc")
    assert back.rows == there.rows
    assert (back.gm_m3_s2, back.reference_radius_m) == (there.gm_m3_s2, there.reference_radius_m)
    assert (back.max_degree, back.normalisation) == (there.max_degree, there.normalisation)
    assert back.tide_system is None


def test_fields_of_any_numbers_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    for number in range(20):
        gm, radius = (repr(float(x)) for x in 10.0 ** rng.uniform(3, 16, 2))
        c, s, sc, ss = (repr(float(x)) for x in rng.normal(size=4) * 10.0 ** rng.uniform(-20, 0))
        (tmp_path / "a.gfc").write_text(
            f"product_type gravity_field\nearth_gravity_constant {gm}\nradius {radius}\n"
            f"max_degree 2\nerrors formal\nnorm unnormalized\nend_of_head\n"
            f"gfc 2 0 {c} 0 {sc} 0\ngfc 2 2 {c} {s} {sc} {ss}\n", "utf-8",
        )  # fmt: skip
        assert convert(tmp_path, "a.gfc", "b.tab", "--force")[0] == 0
        one, other = read("icgem", tmp_path / "a.gfc"), read("shadr", tmp_path / "b.tab")
        assert other.rows == one.rows, number
        # km for m: within one rounding where no decimal number gives the same double
        assert other.gm_m3_s2 == pytest.approx(one.gm_m3_s2, rel=2.3e-16)
        assert other.reference_radius_m == pytest.approx(one.reference_radius_m, rel=2.3e-16)


@pytest.mark.parametrize("text", [VANGUARD, STATION])
def test_element_sets_become_messages_and_come_back(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.tle").write_text(text, "utf-8")
    assert convert(tmp_path, "a.tle", "a.omm")[:2] == (
        0, "a.omm: set of mean elements, tle -> omm\n"
    )  # fmt: skip
    message = (tmp_path / "a.omm").read_text("utf-8")
    if text is STATION:
        assert "OBJECT_ID = 1998-067A\n" in message
        assert "EPOCH = 2008-09-20T12:25:40.104192\n" in message
        assert "ECCENTRICITY = 0.0006703\n" in message
        assert "BSTAR = -1.1606e-05\n" in message
        assert "MEAN_MOTION_DOT = -2.182e-05\n" in message
    assert convert(tmp_path, "a.omm", "b.tle")[:2] == (
        0, "b.tle: set of mean elements, omm -> tle\n"
    )  # fmt: skip
    assert read("tle", tmp_path / "b.tle") == read("tle", tmp_path / "a.tle")
    assert read("omm", tmp_path / "a.omm") == read("tle", tmp_path / "a.tle")
    # character by character, but for the sign of a zero's exponent
    zero = str.maketrans({"+": "-"})
    lines = (tmp_path / "b.tle").read_text("utf-8").translate(zero).splitlines()
    assert [line[:-1] for line in lines] == [line[:-1] for line in text.splitlines()]


@pytest.mark.parametrize("between", ["b.omm", "b.xml", "b.json", "b.csv"])
def test_all_encodings_hold_the_same(between: str, tmp_path: Path) -> None:
    (tmp_path / "a.tle").write_text(VANGUARD + STATION, "utf-8")
    code, out, err = convert(tmp_path, "a.tle", between)
    assert (code, out.count("\n"), err) == (0, 1, "")
    there = read("tle", tmp_path / "a.tle")
    assert read("omm", tmp_path / between) == there
    # each is recognised by its beginning, and becomes each other one
    (tmp_path / "anything").write_bytes((tmp_path / between).read_bytes())
    for target in {"c.tle", "c.omm", "c.xml", "c.json", "c.csv"} - {between.replace("b.", "c.")}:
        assert convert(tmp_path, "anything", target)[0] == 0, target
        encoding = "tle" if target == "c.tle" else "omm"
        assert read(encoding, tmp_path / target) == there


def test_what_an_element_set_cannot_hold_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.tle").write_text(STATION, "utf-8")
    assert convert(tmp_path, "a.tle", "a.omm")[0] == 0
    message = (tmp_path / "a.omm").read_text("utf-8")
    (tmp_path / "fine.omm").write_text(
        message.replace("INCLINATION = 51.6416", "INCLINATION = 51.64163")
    )
    code, out, _ = convert(tmp_path, "fine.omm", "b.tle")
    assert code == 0
    assert out.endswith("  not kept: ISS (ZARYA): digits of INCLINATION\n")
    for old, new in (
        ("= 25544", "= 340000"),
        ("= 0.0006703", "= 0.99999997"),
        ("2008-09-20T12:25:40.104192", "2016-12-31T23:59:60.5"),
        ("2008-09-20T", "2057-09-20T"),
        ("TYPE = U", "TYPE = UNKNOWN"),
    ):
        assert old in message
        (tmp_path / "bad.omm").write_text(message.replace(old, new))
        code, _, err = convert(tmp_path, "bad.omm", "c.tle")
        assert code == 2
        assert "bad.omm: ISS (ZARYA): " in err
        assert "does not fit into an element set" in err
        assert not (tmp_path / "c.tle").exists()


def changed(tmp_path: Path, old: str, new: str, written: str = "b.tle") -> tuple[int, str, str]:
    """Convert the station's message after one change."""
    (tmp_path / "a.tle").write_text(STATION, "utf-8")
    assert convert(tmp_path, "a.tle", "a.omm", "--force")[0] == 0
    message = (tmp_path / "a.omm").read_text("utf-8")
    assert old in message
    (tmp_path / "b.omm").write_text(message.replace(old, new), "utf-8")
    return convert(tmp_path, "b.omm", written, "--force")


@pytest.mark.parametrize(
    ("identifier", "columns", "lost"),
    [
        ("98067A", "98067A  ", ""),
        ("1998-067A", "98067A  ", ""),
        ("", "        ", ""),
        ("1998-67", "        ", "OBJECT_ID (1998-67)"),
        ("2060-001A", "        ", "OBJECT_ID (2060-001A)"),
    ],
)
def test_a_designator_that_does_not_fit_is_left_blank(
    identifier: str, columns: str, lost: str, tmp_path: Path
) -> None:
    code, out, _ = changed(tmp_path, "OBJECT_ID = 1998-067A", f"OBJECT_ID = {identifier}")
    assert code == 0
    assert out.partition("not kept: ISS (ZARYA): ")[2].strip() == lost
    assert (tmp_path / "b.tle").read_text("utf-8").splitlines()[1][9:17] == columns


@pytest.mark.parametrize("name", ["ISS (ZARYA) [+]", "0 GRAVITY", "1 ST", "2 ND", "ÉTOILE [B] [C]"])
@pytest.mark.parametrize("between", ["b.tle", "b.xml", "b.json", "b.csv"])
def test_names_are_kept(name: str, between: str, tmp_path: Path) -> None:
    to = {"b.csv": ("--to", "omm_csv")}.get(between, ())
    (tmp_path / "a.tle").write_text(STATION, "utf-8")
    assert convert(tmp_path, "a.tle", "a.omm")[0] == 0
    message = (tmp_path / "a.omm").read_text("utf-8").replace("ISS (ZARYA)", name)
    (tmp_path / "b.omm").write_text(message, "utf-8")
    code, out, _ = convert(tmp_path, "b.omm", between, *to)
    assert (code, "not kept" in out) == (0, False)
    assert convert(tmp_path, between, "c.omm")[0] == 0
    (there,), (back,) = read("omm", tmp_path / "b.omm"), read("omm", tmp_path / "c.omm")
    assert there.name == name
    assert there == back


def test_a_name_cannot_bring_further_elements(tmp_path: Path) -> None:
    (tmp_path / "a.tle").write_text(STATION, "utf-8")
    assert convert(tmp_path, "a.tle", "a.xml")[0] == 0
    text = (tmp_path / "a.xml").read_text("utf-8")
    lines = STATION.split("\n", 1)[1]
    for old, new, key in (
        (">ISS (ZARYA)<", f">X\n{lines}Y<", "OBJECT_NAME"),
        (">1998-067A<", ">X\nEPOCH = 2000-01-01<", "OBJECT_ID"),
        (">U<", ">U\nX<", "CLASSIFICATION_TYPE"),
    ):
        assert old in text
        (tmp_path / "b.xml").write_text(text.replace(old, new), "utf-8")
        for to in ("tle", "omm"):
            code, _, err = convert(tmp_path, "b.xml", "b.out", "--to", to)
            assert code == 2
            assert f"{key} must be one line of printable text" in err
            assert not (tmp_path / "b.out").exists()


def test_elements_for_another_theory_are_refused(tmp_path: Path) -> None:
    other = STATION.replace(" 0  2927", " 4  2921")
    (tmp_path / "xp.tle").write_text(other, "utf-8")
    code, _, err = convert(tmp_path, "xp.tle", "xp.omm")
    assert code == 2
    assert "xp.tle:2: column 63 (ephemeris type) must be blank, 0 or 2" in err
    place = ("--station", "48.08,11.28,580", "--start", "2008-09-21", "--days", "1")
    err_stream, out_stream = StringIO(), StringIO()
    with chdir(tmp_path), redirect_stderr(err_stream), redirect_stdout(out_stream):
        assert run(("passes", "xp.tle", *place)) == 2
    assert "column 63 (ephemeris type)" in err_stream.getvalue()


def test_what_readers_of_messages_pass_over_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.tle").write_text(STATION, "utf-8")
    assert convert(tmp_path, "a.tle", "a.omm")[0] == 0
    message = (tmp_path / "a.omm").read_text("utf-8")
    message = message.replace("EPHEMERIS_TYPE", "COMMENT why\nMASS = 400\nEPHEMERIS_TYPE")
    further = "CX_X = 1\nCY_X = 2\nUSER_DEFINED_FOO = 3\n"
    (tmp_path / "b.omm").write_text(message + further, "utf-8")
    code, out, _ = convert(tmp_path, "b.omm", "b.json")
    assert code == 0
    assert [line.strip() for line in out.splitlines()[1:]] == [
        "not kept: comments", "not kept: MASS", "not kept: covariance",
        "not kept: USER_DEFINED_FOO",
    ]  # fmt: skip
    code, out, _ = changed(tmp_path, ".104192", ".1041923", "b.json")
    assert out.endswith("  not kept: last digits of EPOCH\n")


def test_faults_of_element_sets_are_told_with_their_lines(tmp_path: Path) -> None:
    name, one, two = STATION.splitlines()
    two = with_checksum(two.replace(" 51.6416", "251.6416"))
    (tmp_path / "a.tle").write_text(f"\n\n{name}\n{one}\n{two}\n", "utf-8")
    code, _, err = convert(tmp_path, "a.tle", "a.omm")
    assert code == 2
    assert "a.tle:5: columns 9 to 16 (inclination) must be between 0 and 180" in err
    one = with_checksum(one[:64] + " 2X2" + one[68:])
    (tmp_path / "a.tle").write_text(f"\n\n{name}\n{one}\n{STATION.splitlines()[2]}\n", "utf-8")
    code, _, err = convert(tmp_path, "a.tle", "a.omm")
    assert code == 2
    assert "a.tle:4 (ISS (ZARYA)): ELEMENT_SET_NO must be a whole number" in err


def with_checksum(line: str) -> str:
    return line[:68] + str(sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10)


@pytest.mark.parametrize(
    ("columns", "number"),
    [("00005", 5), ("99999", 99999), ("A0000", 100000), ("H9999", 179999), ("J0000", 180000),
     ("P0000", 230000), ("T0001", 270001), ("Z9999", 339999)],
)  # fmt: skip
def test_catalogue_numbers_with_a_letter(columns: str, number: int, tmp_path: Path) -> None:
    lines = [line[:2] + columns + line[7:] for line in STATION.splitlines()[1:]]
    text = "ISS (ZARYA)\n" + "".join(with_checksum(line) + "\n" for line in lines)
    (tmp_path / "a.tle").write_text(text, "utf-8")
    assert convert(tmp_path, "a.tle", "a.omm")[0] == 0
    assert f"NORAD_CAT_ID = {number}\n" in (tmp_path / "a.omm").read_text("utf-8")
    assert convert(tmp_path, "a.omm", "b.tle")[0] == 0
    back = (tmp_path / "b.tle").read_text("utf-8").splitlines()
    assert [line[2:7] for line in back[1:]] == [columns, columns]


def test_an_epoch_that_rounds_up_to_the_new_year(tmp_path: Path) -> None:
    code, out, _ = changed(tmp_path, "2008-09-20T12:25:40.104192", "2007-12-31T23:59:59.999999")
    assert code == 0
    assert "digits of EPOCH" in out
    assert (tmp_path / "b.tle").read_text("utf-8").splitlines()[1][18:32] == "08001.00000000"


def test_angles_beyond_one_turn_are_written_within_it(tmp_path: Path) -> None:
    for value, columns in (("-10", "350.0000"), ("359.99999", "  0.0000"), ("725.5", "  5.5000")):
        assert changed(tmp_path, "MEAN_ANOMALY = 325.0288", f"MEAN_ANOMALY = {value}")[0] == 0
        assert (tmp_path / "b.tle").read_text("utf-8").splitlines()[2][43:51] == columns


def test_an_ephemeris_becomes_a_table(tmp_path: Path) -> None:
    (tmp_path / "a.oem").write_text(OEM, "utf-8")
    code, out, _ = convert(tmp_path, "a.oem", "a.csv", "--json")
    assert code == 0
    (lost,) = json.loads(out)["not_kept"]
    assert lost == (
        "object (PROBE, 2026-001A), centre (MARS), frame (ICRF), time system (TDB)"
    )  # fmt: skip
    head, *rows = (tmp_path / "a.csv").read_text("utf-8").splitlines()
    assert head == "time,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s"
    data = [line.split() for line in OEM.splitlines() if line.startswith("2026")]
    for row, printed in zip(rows, data, strict=True):
        when, *numbers = row.split(",")
        assert when == printed[0]
        for number, text in zip(numbers, printed[1:], strict=True):
            assert float(number) == pytest.approx(float(text), rel=3e-16)
    assert convert(tmp_path, "a.csv", "b.oem", "--from", "states_csv")[0] == 2


def test_what_is_refused(tmp_path: Path) -> None:
    field = missions_directory() / "data" / FIELDS[0]
    (tmp_path / "a.gfc").write_bytes(field.read_bytes())
    (tmp_path / "a.tle").write_text(STATION, "utf-8")
    (tmp_path / "b.shadr").write_text("mine", "utf-8")
    (tmp_path / "text.txt").write_text("hello", "utf-8")
    os.mkfifo(tmp_path / "pipe.gfc")
    before = {path.name for path in tmp_path.iterdir()}
    for words, message in (
        (("a.gfc", "b.shadr"), "b.shadr: exists already"),
        (("a.gfc", "a.gfc", "--force"), "is in the format icgem already"),
        (
            ("a.tle", "c.shadr"),
            "a set of mean elements (tle) cannot become a gravity field (shadr)",
        ),
        (("a.gfc", "c.xyz"), "c.xyz: it is none of the known formats; choose with --to: "),
        (("text.txt", "c.gfc"), "text.txt: it is none of the known formats; choose with --from: "),
        (("a.gfc", "c.shadr", "--from", "tle"), "(tle) cannot become"),
        (("a.tle", "c.omm", "--to", "ommm"), "no file format 'ommm'; did you mean 'omm'"),
        (("none.gfc", "c.shadr"), "none.gfc: cannot be read: No such file"),
        (("pipe.gfc", "c.shadr"), "it is a FIFO"),
        (("a.gfc", "no/c.shadr"), "no/c.shadr: cannot be written: No such file"),
    ):
        code, out, err = convert(tmp_path, *words)
        assert (code, out, err.count("\n")) == (2, "", 1), words
        assert message in err
    assert {path.name for path in tmp_path.iterdir()} == before
    assert (tmp_path / "b.shadr").read_text("utf-8") == "mine"
    assert convert(tmp_path, "a.gfc", "b.shadr", "--force")[0] == 0
    (tmp_path / "a.data").write_bytes((tmp_path / "b.shadr").read_bytes())
    assert "shadr -> icgem" in convert(tmp_path, "a.data", "c.gfc")[1]  # told from its content


def other_segment(**changes: str) -> str:
    """Return the example's segment an hour later, with other metadata."""
    text = OEM.split("\n\n", 1)[1].replace("T00:", "T01:")
    for key, value in changes.items():
        text = re.sub(rf"{key} = .*", f"{key} = {value}", text)
    return "\n" + text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"OBJECT_NAME": "OTHER"}, "object (PROBE, OTHER)"),
        ({"CENTER_NAME": "EARTH"}, "centre (MARS, EARTH)"),
        ({"REF_FRAME": "TEME"}, "frame (ICRF, TEME)"),
        ({"TIME_SYSTEM": "UTC"}, "time system (TDB, UTC)"),
    ],
)
def test_a_table_of_unlike_segments_is_refused(
    changes: dict[str, str], message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.oem").write_text(OEM + other_segment() + other_segment(**changes), "utf-8")
    code, out, err = convert(tmp_path, "a.oem", "a.csv")
    assert (code, out) == (2, "")
    assert f"a.oem: segments 1 and 3 differ in {message}" in err
    assert not (tmp_path / "a.csv").exists()
    (tmp_path / "b.oem").write_text(OEM + other_segment(), "utf-8")
    assert "not kept: limits of the 2 segments" in convert(tmp_path, "b.oem", "b.csv")[1]


def test_what_a_table_of_states_cannot_hold_is_said(tmp_path: Path) -> None:
    text = OEM.replace(
        "STOP_TIME = 2026-01-01T00:01:00\n",
        "USEABLE_START_TIME = 2026-01-01T00:00:00\nSTOP_TIME = 2026-01-01T00:02:00\n"
        "INTERPOLATION = LAGRANGE\nINTERPOLATION_DEGREE = 1\n",
    )
    text = text.replace("00:00:00.000000 9376", "00:00:00.0000000001 9376")
    text = re.sub(r"(?m)^2026.*", r"\g<0> 0.1 0.2 0.3", text)
    text += "COMMENT why\nCOVARIANCE_START\nEPOCH = 2026-01-01T00:01:00\n"
    text += "1\n0 1\n0 0 1\n0 0 0 1\n0 0 0 0 1\n0 0 0 0 0 1\nCOVARIANCE_STOP\n"
    (tmp_path / "a.oem").write_text("\ufeff" + text, "utf-8")
    code, out, _ = convert(tmp_path, "a.oem", "a.csv", "--json")
    assert code == 0
    lost = json.loads(out)["not_kept"]
    assert lost[:2] == ["comments", "digits of the times below 1 ns"]
    assert lost[3:] == [
        "accelerations", "covariances", "useable span",
        "START_TIME and STOP_TIME, which differ from the first and last state",
        "recommended interpolation",
    ]  # fmt: skip
    code, out, _ = convert(tmp_path, "a.oem", "a.xml", "--json")
    assert (code, json.loads(out)["not_kept"]) == (0, lost[:2])
    assert convert(tmp_path, "a.xml", "b.oem")[0] == 0  # told from its content
    once = (tmp_path / "b.oem").read_text("utf-8")
    assert convert(tmp_path, "b.oem", "c.xml")[0] == 0
    assert convert(tmp_path, "c.xml", "d.oem")[0] == 0
    again = (tmp_path / "d.oem").read_text("utf-8")
    assert re.sub("CREATION.*", "", once) == re.sub("CREATION.*", "", again)


GFC = """free words
begin_of_head
product_type gravity_field
earth_gravity_constant 3.986e14
radius 6378136.3
max_degree 2
errors calibrated_and_formal
norm fully_normalized
end_of_head
gfc 2 0 -4.8e-4 0 1e-10 1e-11 2e-10 2e-11
"""


def test_what_readers_of_gravity_fields_pass_over_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.gfc").write_text(GFC, "utf-8")
    code, out, _ = convert(tmp_path, "a.gfc", "a.shadr", "--json")
    assert code == 0
    assert json.loads(out)["not_kept"] == [
        "kind of the standard deviations (calibrated_and_formal)",
        "second pair of standard deviations (formal)",
        "comments or further keys before the coefficients",
        "name of the model (a)",
    ]
    sound = (tmp_path / "a.shadr").read_text("utf-8")
    head = sound.split(",")
    head[2] = " 1.5E-06"
    (tmp_path / "b.shadr").write_text(",".join(head), "utf-8")
    code, out, _ = convert(tmp_path, "b.shadr", "b.gfc")
    assert out.endswith("  not kept: uncertainty of GM (1.5E-06 km³/s²)\n")


def test_a_field_without_rows_becomes_a_table(tmp_path: Path) -> None:
    text = GFC.replace("max_degree 2", "max_degree 0")
    (tmp_path / "e.gfc").write_text("\n".join(text.splitlines()[:-1]) + "\n", "utf-8")
    assert convert(tmp_path, "e.gfc", "e.shadr")[0] == 0
    assert read("shadr", tmp_path / "e.shadr").rows == ()


def test_the_input_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "a.gfc").write_text(GFC, "utf-8")
    (tmp_path / "link.shadr").symlink_to(tmp_path / "a.gfc")
    os.link(tmp_path / "a.gfc", tmp_path / "hard.shadr")
    for words in (("a.gfc", "--to", "shadr"), ("link.shadr",), ("hard.shadr",)):
        code, out, err = convert(tmp_path, "a.gfc", *words, "--force")
        assert (code, out) == (2, "")
        assert f"{words[0]}: is the file that is read" in err
    assert (tmp_path / "a.gfc").read_text("utf-8") == GFC
    code, _, err = convert(tmp_path, "a.gfc", "-", "--to", "shadr")
    assert code == 2
    assert "OUT must be a file" in err
    assert not (tmp_path / "-").exists()


def test_messages_of_writers_name_the_file(tmp_path: Path) -> None:
    (tmp_path / "a.gfc").write_text(GFC.replace("norm fully_normalized\n", ""), "utf-8")
    code, _, err = convert(tmp_path, "a.gfc", "a.shadr")
    assert code == 2
    assert "a.gfc: a: does not say its normalisation" in err


BROKEN = """
from hillsphere.plugins import Component, hookimpl


class Bad:
    content = "gravity field"
    suffixes = (".bad",)

    def __init__(self, spec):
        pass

    def recognises(self, beginning):
        raise RuntimeError("it has\\nno eyes")

    def read(self, path):
        raise KeyError("name")

    def write(self, content):
        return 1 / 0


@hookimpl
def hillsphere_components():
    spec = "hillsphere.formats.specs:FileFormatSpec"
    return [
        Component("format", "bad", f"{__name__}:Bad", spec, "x"),
        Component("format", "missing", f"{__name__}:Missing", spec, "x"),
    ]
"""


def test_a_broken_format_of_a_plugin_is_blamed_on_it_and_stops_no_other(tmp_path: Path) -> None:
    plugin = tmp_path / "broken_formats.py"
    plugin.write_text(BROKEN, "utf-8")
    (tmp_path / "a.gfc").write_text(GFC, "utf-8")
    given = ("--plugin", str(plugin))
    code, out, err = convert(tmp_path, "a.gfc", "a.shadr", *given)
    assert code == 0
    assert out.startswith("a.shadr: gravity field, icgem -> shadr\n")
    assert "note: left out: plugin 'broken_formats.py': format 'missing'" in err
    assert (
        "note: left out: plugin 'broken_formats.py': file format 'bad' failed in looking at the "
        "beginning of a file: RuntimeError: it has no eyes\n"
    ) in err
    for words, message in (
        (("a.gfc", "b.bad"), "file format 'bad' failed in writing: ZeroDivisionError"),
        (("a.gfc", "b.shadr", "--from", "bad"), "file format 'bad' failed in reading: KeyError"),
        (("a.gfc", "b.bad", "--to", "missing"), "format 'missing'"),
    ):
        code, out, err = convert(tmp_path, *words, *given)
        assert (code, out) == (2, "")
        assert err.splitlines()[-1].startswith("plugin 'broken_formats.py': ")
        assert message in err.splitlines()[-1]
