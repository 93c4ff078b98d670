"""Published values beside computed ones, compared at the digits that were printed."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.presentation import Cell, Column, Printed
from hillsphere.show.reference import ReferenceTable, beside, difference_notes, with_paper

CSV = """\
# source: A. Author, An imagined table, 2020, Table 1
# url: https://example.org/table
name,x0_km,y_max_km,period_h,jacobi

far,100,39.4,7.10,−8.78
near,20,,4.0e1,-0.27
"""


def read(tmp_path: Path, text: str | bytes) -> ReferenceTable:
    path = tmp_path / "table.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ReferenceTable.read(path)


@pytest.mark.parametrize(
    ("text", "digit", "same", "apart"),
    [
        ("39.4", 0.1, (39.43, 39.35, 39.45, 39.4), (39.34, 39.46, math.nan, math.inf)),
        ("7.10", 0.01, (7.1, 7.104, 7.095), (7.106, 7.09)),
        ("100", 1.0, (99.6, 100.5), (99.4,)),
        ("-8.78", 0.01, (-8.7797,), (-8.753, 8.78)),
        ("4.0e1", 1.0, (40.3,), (41.0,)),
        ("1.5E-7", 1e-8, (1.46e-7,), (1.4e-7,)),
        (".5", 0.1, (0.54,), (0.56,)),
    ],
)
def test_printed_numbers_know_their_digits(
    text: str, digit: float, same: tuple[float, ...], apart: tuple[float, ...]
) -> None:
    printed = Printed(text)
    assert printed == float(text)
    assert printed.last_digit == digit
    assert [value for value in same if not printed.agrees(value)] == []
    assert [value for value in apart if printed.agrees(value)] == []


@given(st.floats(-1e6, 1e6), st.integers(0, 6))
def test_a_value_agrees_with_its_own_print(value: float, decimals: int) -> None:
    printed = Printed(f"{value:.{decimals}f}")
    assert printed.agrees(value)
    assert abs(printed.difference(value)) <= 0.5
    assert not printed.agrees(value + 1.1 * printed.last_digit)


def test_printed_is_a_float_that_survives_copies() -> None:
    printed = Printed(" −7.10")
    assert (printed.text, float(printed), printed + 1) == ("-7.10", -7.1, -6.1)
    for twin in (copy.deepcopy(printed), pickle.loads(pickle.dumps(printed))):
        assert (type(twin), twin.text, twin) == (Printed, "-7.10", -7.1)


@pytest.mark.parametrize("text", ["", "seven", "nan", "inf", "1_0", "1e", "0x1", "1e999", "--1"])
def test_what_is_no_printed_number(text: str) -> None:
    with pytest.raises(ValueError, match=r"not a decimal|too large"):
        Printed(text)


def test_table_is_read_with_its_source(tmp_path: Path) -> None:
    table = read(tmp_path, CSV)
    assert table.source == "A. Author, An imagined table, 2020, Table 1"
    assert table.about == {"url": "https://example.org/table"}
    assert table.columns == ("name", "x0_km", "y_max_km", "period_h", "jacobi")
    far, near = table.rows
    assert far == {"name": "far", "x0_km": 100, "y_max_km": 39.4, "period_h": 7.1, "jacobi": -8.78}
    assert isinstance(far["period_h"], Printed)
    assert far["period_h"].text == "7.10"
    assert near["y_max_km"] is None


def test_byte_order_mark_crlf_and_quotes_are_read(tmp_path: Path) -> None:
    table = read(tmp_path, b'\xef\xbb\xbf# source: S\r\nname,a\r\n"x, y", 1 \r\n')
    assert table.rows == ({"name": "x, y", "a": 1.0},)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", r"table\.csv:1: no citation"),
        ("# source:\na,b\n1,2\n", "no citation"),
        ("# source: S\n", "no line of column names"),
        ("# source: S\na,a\n1,2\n", r"table\.csv:2: column names"),
        ("# source: S\na,\n1,2\n", r"table\.csv:2: column names"),
        ("# source: S\na,b\n1,2\n\n1,2,3\n", r"table\.csv:5: 2 cells expected, got 3"),
        ("# source: S\na,b\n1,2\none,2\n", r"table\.csv:4: a: not a number: 'one'"),
        ('# source: S\na,b\n1,"2\n', "not a CSV table"),
        (b"# source: \xff\n", "not UTF-8"),
        ("# source: S\na\n" + "1\n" * 600_000, "larger than 1 MiB"),
    ],
)
def test_bad_tables_say_what_and_where(tmp_path: Path, text: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(tmp_path, text)


def test_missing_table(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv: cannot be read: No such file"):
        ReferenceTable.read(tmp_path / "none.csv")


ROWS: list[dict[str, Cell]] = [
    {"name": "near", "x0_km": 20.0 + 1e-13, "y_max_km": 26.7, "period_h": 41.2, "jacobi": -0.2736},
    {"name": "far", "x0_km": 100.0, "y_max_km": 39.43, "period_h": 7.1, "jacobi": math.nan},
    {"name": "other", "x0_km": 50.0, "y_max_km": 94.4, "period_h": 7.13, "jacobi": -2.2},
]


def test_twins_stand_beside_their_columns(tmp_path: Path) -> None:
    table = read(tmp_path, CSV)
    near, far, other = beside(ROWS, table, on="x0_km", tol=1e-9)
    assert list(far) == [
        "name", "x0_km", "y_max_km", "y_max_km_paper",
        "period_h", "period_h_paper", "jacobi", "jacobi_paper",
    ]  # fmt: skip
    assert far["y_max_km_paper"] == 39.4
    assert "y_max_km_paper" not in near
    assert near["jacobi_paper"] == -0.27
    assert other == ROWS[2]
    columns = with_paper(
        [Column("name", ""), Column("x0_km", "km"), Column("period_h", "h", "T", 5)], [near, other]
    )
    assert columns == [
        Column("name", ""),
        Column("x0_km", "km"),
        Column("period_h", "h", "T", 5),
        Column("period_h_paper", "h", "", 5),
    ]


def test_rows_are_matched_within_the_tolerance_to_the_nearest(tmp_path: Path) -> None:
    table = read(tmp_path, CSV)
    rows: list[dict[str, Cell]] = [{"x0_km": x, "period_h": 1.0} for x in (20.4, 61.0, 19.0, None)]
    found = [row.get("period_h_paper") for row in beside(rows, table, on="x0_km", tol=0.5)]
    assert found == [40.0, None, None, None]
    assert [r.get("period_h_paper") for r in beside(rows, table, on="x0_km", tol=50)] == [
        40.0, 7.1, 40.0, None,
    ]  # fmt: skip
    by_name = beside([{"name": "far", "x0_km": 7.0}], table, on="name")
    assert by_name == [{"name": "far", "x0_km": 7.0, "x0_km_paper": 100.0}]


def test_column_to_match_by_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no column 'z'.*name, x0_km"):
        beside(ROWS, read(tmp_path, CSV), on="z")


def test_notes_count_agreements_and_name_the_others(tmp_path: Path) -> None:
    table = read(tmp_path, CSV)
    rows = beside(ROWS, table, on="x0_km", tol=1e-9)
    notes = difference_notes(rows, table)
    assert notes == [
        "3 of 5 values agree to the printed digit with "
        "A. Author, An imagined table, 2020, Table 1.",
        "near, period_h: 41.2 against the printed 4.0e1, +1.20 units of its last digit.",
        "far, jacobi: nan against the printed -8.78.",
    ]
    assert difference_notes(ROWS, table) == []
