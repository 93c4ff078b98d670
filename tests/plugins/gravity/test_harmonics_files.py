"""ICGEM and SHADR readers: values, and every fault with its line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.formats.coefficients import Coefficient, CoefficientTable
from hillsphere_gravity.icgem import read_icgem
from hillsphere_gravity.shadr import read_shadr

ICGEM = """Phobos, a test
radius of the Earth is not meant here, and
radius again is still free text
begin_of_head ==========================
product_type                gravity_field
modelname                   TEST-1
earth_gravity_constant      7.0875d+05
radius                      1.11E+04
max_degree                  3
errors                      formal
norm                        fully_normalized
tide_system                 zero_tide

key     L    M    C       S     sigma C sigma S
end_of_head ============================
gfc     0    0   1.0d+00  0.0d+00  0.0 0.0
gfc     2    0  -4.698D-02 0.0 1.0e-4 0.0

gfc     2    2   2.276e-02 -2.02e-04 2e-4 3e-4
gfc     3    1   -.309e-2 +1.81e-3 0. 0.
"""
SHADR = """ 1.11000000E+01, 7.08750000E-04, 1.0E-08,   3,   3,   1, 0.0, 0.0

    2,    0,-4.698E-02, 0.0, 1.0E-04, 0.0
    2,    2, 2.276E-02,-2.02E-04, 2.0E-04, 3.0E-04
    3,    1,-3.09E-03, 1.81E-03, 0.0, 0.0
"""
ROWS = (
    Coefficient(2, 0, -4.698e-2, 0.0, 1e-4, 0.0),
    Coefficient(2, 2, 2.276e-2, -2.02e-4, 2e-4, 3e-4),
    Coefficient(3, 1, -3.09e-3, 1.81e-3, 0.0, 0.0),
)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "field"
    path.write_text(text, encoding="latin-1")
    return path


def test_icgem_values(tmp_path: Path) -> None:
    table = read_icgem(write(tmp_path, ICGEM))
    assert table.name == "TEST-1"
    assert (table.gm_m3_s2, table.reference_radius_m, table.max_degree) == (7.0875e5, 1.11e4, 3)
    assert (table.normalisation, table.tide_system) == ("full", "zero_tide")
    assert table.rows == (Coefficient(0, 0, 1.0, 0.0), *ROWS)


def test_icgem_optional_keys(tmp_path: Path) -> None:
    text = ICGEM
    for key in (
        "begin_of_head",
        "radius of",
        "radius again",
        "norm",
        "tide_system",
        "errors",
        "modelname",
    ):
        text = "\n".join(line for line in text.splitlines() if not line.startswith(key))
    # Without `errors` there are no columns of standard deviations.
    text = "\n".join(
        " ".join(line.split()[:5]) if line.startswith("gfc") else line for line in text.splitlines()
    )
    table = read_icgem(write(tmp_path, text))
    assert (table.name, table.normalisation, table.tide_system) == ("field", None, None)
    assert table.rows[1] == Coefficient(2, 0, -4.698e-2, 0.0)


def test_icgem_accepts_crlf_and_latin_1(tmp_path: Path) -> None:
    text = ICGEM.replace("Phobos, a test", "Modèle d'essai").replace("\n", "\r\n")
    path = tmp_path / "field"
    path.write_bytes(text.encode("latin-1"))
    assert read_icgem(path).rows[1:] == ROWS


def test_line_numbers_survive_utf_8_comments(tmp_path: Path) -> None:
    # "Å" ends in byte 0x85 in UTF-8, a line end to Latin-1.
    path = tmp_path / "field"
    path.write_bytes(ICGEM.replace("Phobos, a test", "Å Å Å").replace("3    1", "3    4").encode())
    with pytest.raises(InputError, match=":20: order m must be"):
        read_icgem(path)


def test_icgem_body_other_than_the_earth_and_calibrated_errors_first(tmp_path: Path) -> None:
    text = ICGEM.replace("earth_gravity_constant", "gravity_constant")
    text = text.replace("formal", "calibrated_and_formal")
    text = "\n".join(
        line + " 9.0 9.0" if line.startswith("gfc") else line for line in text.splitlines()
    )
    table = read_icgem(write(tmp_path, text))
    assert table.gm_m3_s2 == 7.0875e5
    assert table.rows[1:] == ROWS


def test_shadr_values(tmp_path: Path) -> None:
    table = read_shadr(write(tmp_path, SHADR))
    assert table.gm_m3_s2 == pytest.approx(7.0875e5, rel=1e-15)
    assert (table.reference_radius_m, table.max_degree) == (1.11e4, 3)
    assert (table.normalisation, table.tide_system) == ("full", None)
    assert table.rows == ROWS
    plain = SHADR.replace("3,   1,", "3,   0,")
    assert read_shadr(write(tmp_path, plain)).normalisation == "none"


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("end_of_head", "end", ": no line 'end_of_head': is this an ICGEM file?"),
        ("gravity_field", "topography", ":5: product_type must be gravity_field"),
        ("product_type", "product", ": the head has no product_type"),
        ("earth_gravity_constant", "gm", ": the head has no earth_gravity_constant"),
        ("7.0875d+05", "-7.0", ":7: earth_gravity_constant: must be > 0, got -7.0"),
        ("1.11E+04", "nan", ":8: radius: expected a finite number, got 'nan'"),
        ("1.11E+04", "1e999", ":8: radius: expected a finite number, got '1e999'"),
        ("max_degree                  3", "max_degree x", ":9: max_degree: expected an integer"),
        ("max_degree                  3", "max_degree 2", ":20: degree 3 is beyond the 2 of the"),
        ("max_degree                  3", "max_degree 5", ": no row of degree 4 and 1 more"),
        ("fully_normalized", "half", ":11: norm: expected fully_normalized | unnormalized, got"),
        ("zero_tide", "high_tide", ":12: tide_system: expected tide_free | zero_tide"),
        ("formal", "some", ":10: errors: expected no | none | calibrated | formal"),
        ("errors                      formal", "radius 2", ":10: radius stands in line 8 already"),
        ("gfc     3", "gfct    3", ":20: 'gfct' is a time-variable term; give the key epoch"),
        ("gfc     3", "trnd    3", ":20: 'trnd' is a time-variable term"),
        ("gfc     3", "acos    3", ":20: 'acos' is a time-variable term"),
        ("gfc     3", "asin    3", ":20: 'asin' is a time-variable term"),
        ("gfc     3", "dot     3", ":20: 'dot' is a time-variable term"),
        ("gfc     3", "gcf     3", ":20: expected a row 'gfc', got 'gcf'"),
        ("+1.81e-3 0. 0.", "+1.81e-3", ":20: expected 6 columns after 'gfc' (errors: formal)"),
        ("-.309e-2", "1_000", ":20: C: expected a finite number, got '1_000'"),
        ("+1.81e-3", "x", ":20: S: expected a finite number, got 'x'"),
        ("gfc     3    1", "gfc     3    4", ":20: order m must be ≤ degree n, got n = 3, m = 4"),
        ("gfc     3    1", "gfc     2    2", ":20: degree 2, order 2 is already given in line 19"),
        ("gfc     3    1", "gfc     -3   1", ":20: degree: expected an integer ≥ 0, got '-3'"),
        ("-4.698D-02 0.0", "-4.698D-02 0.5", ":17: S of order 0 multiplies sin 0 and must be 0"),
        ("gfc     3    1", "gfc     1    1", ": no row of degree 3; the head says 3"),
    ],
)
def test_icgem_faults(tmp_path: Path, old: str, new: str, fault: str) -> None:
    assert old in ICGEM
    path = write(tmp_path, ICGEM.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_icgem(path)
    assert str(caught.value).startswith(f"{path}{fault}")


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (SHADR, "", ": the file is empty"),
        (
            "1.0E-08,   3,   3,   1, 0.0, 0.0\n\n",
            "1.0E-08\n\n",
            ":1: expected a header of 8 columns (reference radius, GM",
        ),
        ("1, 0.0, 0.0\n\n", "1, 0.0, 0.0, 0.0\n\n", ":1: expected a header of 8 columns"),
        ("1.11000000E+01", "0.0", ":1: reference radius: must be > 0, got 0.0"),
        (
            "7.08750000E-04, 1.0E-08",
            "1.0, 0.0",
            ":1: constant 1 with uncertainty 0 marks a topography, not a gravity field",
        ),
        ("7.08750000E-04", "x", ":1: GM: expected a finite number, got 'x'"),
        ("3,   1, 0.0", "3,   2, 0.0", ":1: normalisation state must be 0 (none) or 1 (full)"),
        ("1, 0.0, 0.0", "1, 90.0, 0.0", ":1: reference longitude must be 0, got 90.0; turn"),
        ("3,   3,   1", "3,   1,   1", ":4: order 2 is beyond the 1 of the header"),
        ("3,   3,   1", "2,   2,   1", ":5: degree 3 is beyond the 2 of the head"),
        ("3,   3,   1", "4,   4,   1", ": no row of degree 4; the head says 4"),
        ("    3,    1,-3.09E-03, 1.81E-03, 0.0, 0.0", "3 1 2", ":5: expected degree, order, C"),
        ("    3,    1,", "    2,    2,", ":5: degree 2, order 2 is already given in line 4"),
        ("-2.02E-04", "inf", ":4: S: expected a finite number, got 'inf'"),
    ],
)
def test_shadr_faults(tmp_path: Path, old: str, new: str, fault: str) -> None:
    assert old in SHADR
    path = write(tmp_path, SHADR.replace(old, new))
    with pytest.raises(InputError) as caught:
        read_shadr(path)
    assert str(caught.value).startswith(f"{path}{fault}")


@pytest.mark.parametrize("read", [read_icgem, read_shadr])
def test_unreadable(tmp_path: Path, read: object) -> None:
    assert callable(read)
    with pytest.raises(InputError, match="absent: cannot be read: No such file or directory"):
        read(tmp_path / "absent")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        read(tmp_path)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_damaged_files_give_a_table_or_one_error(tmp_path: Path, data: st.DataObject) -> None:
    readers: list[tuple[str, Callable[[Path], CoefficientTable]]] = [
        (ICGEM, read_icgem), (SHADR, read_shadr),
    ]  # fmt: skip
    text, read = data.draw(st.sampled_from(readers))
    start = data.draw(st.integers(0, len(text)))
    stop = data.draw(st.integers(start, min(len(text), start + 40)))
    patch = data.draw(st.text(st.characters(max_codepoint=255), max_size=12))
    path = write(tmp_path, text[:start] + patch + text[stop:])
    try:
        table = read(path)
    except InputError as error:
        message = str(error)
    else:
        message = str(path)
        assert table.gm_m3_s2 > 0.0
        assert table.reference_radius_m > 0.0
        assert all(0 <= row.m <= row.n <= table.max_degree for row in table.rows)
    assert message.startswith(str(path))
