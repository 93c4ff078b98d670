"""Two-line element sets: what is torn is refused, with its line and column."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.errors import InputError
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
