"""Two-line element sets: what is torn is refused, with its line and column."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere_tracking.satellites import orbits_of
from hillsphere_tracking.tle import read_tles

ONE = "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991"
TWO = "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482"
OTHER = "2 08195  64.1586 279.0717 6877146 264.7651  20.2257  2.00491383225656"


def _tallied(line: str) -> str:
    return line[:68] + str(sum(int(c) if c.isdigit() else c == "-" for c in line[:68]) % 10)


def test_with_and_without_title() -> None:
    (plain,) = read_tles(f"{ONE}\n{TWO}\n")
    assert (plain.name, plain.line1, plain.line2) == ("25544", ONE, TWO)
    titled = read_tles(f"ISS (ZARYA)\n{ONE}  \n{TWO}\n\n0 AGAIN\r\n{ONE}\r\n{TWO}")
    assert [one.name for one in titled] == ["ISS (ZARYA)", "AGAIN"]


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "no two-line element set"),
        (ONE, "x:1: line 2 is missing"),
        (f"{ONE}\n{ONE}", "x:2: expected line 2"),
        (f"NAME\n{TWO}\n{ONE}", "x:2: expected line 1 of the element set 'NAME'"),
        (f"{ONE[:-1]}\n{TWO}", "x:1: line 1 must be 69 plain characters, got 68"),
        (f"{ONE}\n{TWO[:-1]}3", "x:2: the checksum in column 69 is '3', but the line adds up to 2"),
        (f"{ONE}\n{OTHER}", "x:2: line 2 is of satellite '08195', line 1 above it of '25544'"),
        (f"{ONE}\n{_tallied(TWO.replace('51.6439', '5x.6439'))}", r"columns 9 to 16 \(inclination"),
        (f"{_tallied(ONE.replace('38792-4', '38792 4'))}\n{TWO}", r"columns 54 to 61 \(drag term"),
        (f"{ONE}\n{TWO}\nLAST", "x:3: no element set after 'LAST'"),
        (f"{ONE[:-2]}٣{ONE[-1]}\n{TWO}", "plain characters"),
    ],
)
def test_faults_are_named(text: str, match: str) -> None:
    with pytest.raises(InputError, match=match):
        read_tles(text, "x")


def test_all_faults_of_a_file_are_reported_at_once() -> None:
    text = "\n".join(
        ["A", f"{ONE[:-1]}2", f"{TWO[:-1]}3", "B", ONE, TWO, "C", f"{ONE[:-1]}5", TWO, ONE, OTHER,
         "D", ONE, ONE, TWO, "E"]
    )  # fmt: skip
    with pytest.raises(InputError) as caught:
        read_tles(text, "x")
    faults = str(caught.value).splitlines()
    assert [fault.split(":")[1] for fault in faults] == ["2", "3", "8", "11", "14", "16"]
    assert "the checksum in column 69 is '2', but the line adds up to 1" in faults[0]
    assert faults[0].endswith("fetch the set again")
    with pytest.raises(InputError, match="x: 5 more lines are torn; fetch the file again"):
        read_tles(f"{ONE[:-1]}2\n{TWO}\n" * 25, "x")


@given(at=st.integers(0, 138), character=st.sampled_from("0123456789- .xU+"))
def test_a_changed_digit_never_passes(at: int, character: str) -> None:
    """A checksum modulo ten sees every change of one digit into another."""
    text = f"{ONE}\n{TWO}"
    changed = text[:at] + character + text[at + 1 :]
    if not (text[at].isdigit() and character.isdigit()) or changed == text:
        return
    with pytest.raises(InputError):
        read_tles(changed)


@given(st.text(max_size=300))
def test_any_text_is_read_or_refused(text: str) -> None:
    with suppress(InputError):
        assert read_tles(text)


def _dated(columns: str) -> str:
    return _tallied(ONE[:18] + columns + ONE[32:])


@pytest.mark.parametrize("columns", ["19001.00000000", "19365.99999999", "20366.99999999",
                                     "00366.00000000", "57  1.5       "])  # fmt: skip
def test_days_of_their_year(columns: str) -> None:
    assert read_tles(f"{_dated(columns)}\n{TWO}")


@pytest.mark.parametrize(
    ("columns", "year", "days"),
    [("19000.50000000", 2019, 365), ("19366.00000000", 2019, 365), ("20367.00000000", 2020, 366),
     ("19000.99999999", 2019, 365), ("58366.10000000", 1958, 365), ("19-12.00000000", 2019, 365)],
)  # fmt: skip
def test_days_that_the_year_does_not_have(columns: str, year: int, days: int) -> None:
    """SGP4's own reader takes them for days of the years before and after."""
    match = rf"x:1: columns 21 to 32 \(epoch day\) must be from 1 up to {days} for the year {year}"
    with pytest.raises(InputError, match=match):
        read_tles(f"{_dated(columns)}\n{TWO}", "x")


@pytest.mark.parametrize("value", ["180.0001", " -0.0001", "251.6439"])
def test_inclinations_beyond_a_half_turn(value: str) -> None:
    with pytest.raises(InputError, match=r"x:2: columns 9 to 16 \(inclination\) must be between"):
        read_tles(f"{ONE}\n{_tallied(TWO.replace(' 51.6439', value))}", "x")
    assert read_tles(f"{ONE}\n{_tallied(TWO.replace(' 51.6439', '180.0000'))}")


@pytest.mark.parametrize("kind", "1345")
def test_other_theories_are_refused(kind: str) -> None:
    xp = r" \(SGP4-XP\)" if kind == "4" else ""
    with pytest.raises(
        InputError,
        match=rf"x:1: column 63 \(ephemeris type\) must be blank, 0 or 2 .* got '{kind}'{xp}$",
    ):
        read_tles(f"{_tallied(ONE[:62] + kind + ONE[63:])}\n{TWO}", "x")


@pytest.mark.parametrize("number", ["I0001", "O0001", "a0001", "AA001", "2554 ", "     "])
def test_catalogue_numbers_that_are_none(number: str) -> None:
    lines = [_tallied(line[:2] + number + line[7:]) for line in (ONE, TWO)]
    with pytest.raises(InputError, match="x:1: columns 3 to 7 must be a catalogue number"):
        read_tles("\n".join(lines), "x")


def test_the_orbit_of_a_catalogue_number_with_a_letter() -> None:
    lines = [_tallied(f"{line[:2]}T0001{line[7:]}") for line in (ONE, TWO)]
    (orbit,) = orbits_of("\n".join(lines), "x")
    assert orbit.catalogue_number == "270001"
