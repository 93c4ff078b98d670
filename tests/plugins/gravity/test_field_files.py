"""Gravity files as one meets them: spellings, versions, columns, terms that change with time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.formats.coefficients import Coefficient
from hillsphere_gravity.coefficient_rows import read_coefficient_rows
from hillsphere_gravity.cof import read_cof
from hillsphere_gravity.icgem import read_icgem
from hillsphere_gravity.shadr import read_shadr

DATA = Path(__file__).parents[2] / "data" / "gravity"
GM, RADIUS = 4e14, 6e6
C20 = Coefficient(2, 0, -4e-4, 0.0)
C22 = Coefficient(2, 2, 2.5e-6, -1.5e-6)
STATIC = (Coefficient(0, 0, 1.0, 0.0), C20, C22)


@pytest.mark.parametrize(
    ("name", "tide"),
    [
        ("tide-blank", "zero_tide"),
        ("tide-hyphen", "tide_free"),
        ("tide-low-line", "mean_tide"),
        ("tide-joined", "tide_free"),
        ("tide-unknown", "unknown"),
        ("bom", "zero_tide"),
        ("errors-none", "zero_tide"),
    ],
)
def test_spellings_of_the_head(name: str, tide: str) -> None:
    table = read_icgem(DATA / f"{name}.gfc")
    assert (table.tide_system, table.normalisation) == (tide, "full")
    assert (table.gm_m3_s2, table.reference_radius_m, table.max_degree) == (GM, RADIUS, 2)
    assert table.rows == STATIC
    assert table.passed_over == ()


@pytest.mark.parametrize(
    ("name", "sigma", "kind"),
    [
        ("errors-formal", 2e-9, "formal"),
        ("errors-both", 0.0, "calibrated_and_formal"),
        ("errors-unstated", 0.0, "not stated"),
    ],
)
def test_columns_of_standard_deviations(name: str, sigma: float, kind: str) -> None:
    table = read_icgem(DATA / f"{name}.gfc")
    assert table.rows[2] == Coefficient(2, 2, 2.5e-6, -1.5e-6, 1e-9, sigma)
    assert table.passed_over[0] == f"kind of the standard deviations ({kind})"


def test_unknown_keys_are_named() -> None:
    table = read_icgem(DATA / "unknown-keys.gfc")
    assert table.passed_over == ("unknown keys of the head (generating_institute, url)",)
    assert table.rows == STATIC


@pytest.mark.parametrize(
    ("epoch", "c20", "c21"),
    [
        # 1461 days are four years: the cosines are 1, the sine is 0.
        ("2014-01-01", -4e-4 + 4e-11 + 2e-11 + 8e-11, 1e-10 + 4e-12 * (4.0 - 0.5 / 365.25)),
        # a quarter of a year: cos(π/2) = 0, sin(π/2) = 1, cos π = −1
        (
            "2010-04-02T07:30:00",
            -4e-4 + 0.25e-11 + 3e-11 - 8e-11,
            1e-10 + 4e-12 * (0.25 - 0.5 / 365.25),
        ),
        # before the reference epoch, by 1461 days
        ("2005-12-31T00:00:00", -4e-4 - 4e-11 + 2e-11 + 8e-11, 1e-10 - 4e-12 * 1461.5 / 365.25),
    ],
)
def test_terms_of_version_1(epoch: str, c20: float, c21: float) -> None:
    rows = {(row.n, row.m): row for row in read_icgem(DATA / "time-1.gfc", epoch).rows}
    assert rows[2, 0].c == pytest.approx(c20, rel=1e-15)
    assert rows[2, 0].s == 0.0
    assert rows[2, 1].c == pytest.approx(c21, rel=1e-13)
    assert rows[2, 1].s == pytest.approx(2.0 * c21, rel=1e-13)


@pytest.mark.parametrize(
    ("epoch", "c20", "sigma"),
    [
        ("2004-01-01", -4e-4 + 4e-11, 1e-12),
        ("2010-01-01", -5e-4 + 3e-11, 2e-12),  # the end of an interval belongs to the next
        ("2014-01-01", -5e-4 + 8e-11 + 3e-11, 2e-12),
    ],
)
def test_intervals_of_version_2(epoch: str, c20: float, sigma: float) -> None:
    row = read_icgem(DATA / "time-2.gfc", epoch).rows[1]
    assert row.c == pytest.approx(c20, rel=1e-15)
    assert row.sigma_c == sigma


@pytest.mark.parametrize(
    ("name", "epoch", "fault"),
    [
        ("bad-format", None, ":2: format: expected icgem1.0 | icgem2.0, got 'icgem3.0'"),
        ("bad-product", None, ":2: product_type must be gravity_field, got 'gravity_field_2'"),
        ("bad-tide", None, ":9: tide_system: expected tide_free"),
        ("bad-row", None, ":14: expected 4 columns after 'gfc' (errors: no), got 3"),
        ("bad-doubled", None, ":14: degree 2, order 2 is already given in line 13"),
        ("bad-nan", None, ":13: C: expected a finite number, got 'nan'"),
        ("bad-order", None, ":14: order m must be ≤ degree n, got n = 1, m = 2"),
        ("bad-degree", None, ":14: degree 3 is beyond the 2 of the head"),
        ("time-1", None, ":12: 'gfct' is a time-variable term; give the key epoch"),
        ("bom", "2020-01-01", ": no time-variable term; leave the key epoch out"),
        ("time-1-no-constant", "2020-01-01", ":17: 'trnd' of degree 2, order 1 has no row 'gfct'"),
        ("time-1-doubled", "2020-01-01", ":19: degree 2, order 1 is already given in line 18"),
        ("time-1-static-too", "2020-01-01", ":17: degree 2, order 1 is given by a row 'gfc', too"),
        ("time-1-no-date", "2020-01-01", ":17: expected a date yyyymmdd or yyyymmdd.hhmm, got"),
        ("time-1-no-period", "2020-01-01", ":15: expected 5 columns after 'asin', got 4"),
        ("time-2", "2020-01-01", ":13: no interval of degree 2, order 0 holds at the epoch"),
        ("time-2-overlap", "2005-01-01", ":15: this 'gfct' of degree 2, order 0 holds at the same"),
        ("time-2-backward", "2005-01-01", ":14: the interval must end after it begins"),
        ("time-2-no-end", "2005-01-01", ":13: expected 8 columns after 'gfct', got 7"),
    ],
)
def test_faults_of_icgem(name: str, epoch: str | None, fault: str) -> None:
    path = DATA / f"{name}.gfc"
    with pytest.raises(InputError) as caught:
        read_icgem(path, epoch)
    assert str(caught.value).startswith(f"{path}{fault}")


@pytest.mark.parametrize(
    ("name", "normalisation"),
    [
        ("commas", "full"),
        ("blanks", "full"),
        ("header-6", "full"),
        ("header-5", None),
        ("header-4", None),
    ],
)
def test_tables_with_a_header(name: str, normalisation: str | None) -> None:
    table = read_shadr(DATA / f"{name}.tab")
    assert (table.gm_m3_s2, table.reference_radius_m, table.max_degree) == (GM, RADIUS, 2)
    assert table.normalisation == normalisation
    assert table.rows == (C20, C22)


def test_rows_without_a_head() -> None:
    rows, degree = read_coefficient_rows(DATA / "rows.txt")
    assert degree == 2
    assert rows == (C20._replace(sigma_c=1e-12), C22._replace(sigma_c=1e-12, sigma_s=2e-12))


def test_cof() -> None:
    table = read_cof(DATA / "small.cof")
    assert (table.gm_m3_s2, table.reference_radius_m, table.max_degree) == (GM, RADIUS, 2)
    assert (table.normalisation, table.tide_system) == (None, None)
    assert table.rows == (C20, C22)
    assert table.passed_over == ("comments",)


def test_cof_with_columns_that_touch() -> None:
    table = read_cof(DATA / "columns.cof")
    assert table.max_degree == 100
    assert table.rows[-1] == Coefficient(100, 100, 1e-9, 2e-9)


@pytest.mark.parametrize(
    ("read", "name", "fault"),
    [
        (read_shadr, "bad-header-3.tab", ":1: expected a header of 8 columns"),
        (read_shadr, "bad-empty-column.tab", ":2: expected degree, order, C, S and perhaps two"),
        (read_shadr, "bad-doubled.tab", ":4: degree 2, order 2 is already given in line 3"),
        (read_coefficient_rows, "bad-rows-torn.txt", ":2: expected 6 columns, got 4"),
        (read_coefficient_rows, "bad-rows-gap.txt", ": no row of degree 3"),
        (read_coefficient_rows, "bad-rows-none.txt", ": no row of degree, order, C and S"),
        (read_cof, "bad-no-end.cof", ": no line END"),
        (read_cof, "bad-no-head.cof", ":1: RECOEF before POTFIELD"),
        (read_cof, "bad-factor.cof", ":3: the number after the radius must be 1, got 2.0E+00"),
        (read_cof, "bad-keyword.cof", ":5: expected POTFIELD or RECOEF"),
        (read_cof, "bad-order.cof", ":5: order 2 is beyond the 1 of POTFIELD"),
    ],
)
def test_faults_of_tables(read: Any, name: str, fault: str) -> None:
    with pytest.raises(InputError) as caught:
        read(DATA / name)
    assert str(caught.value).startswith(f"{DATA / name}{fault}")


STATED = {"normalisation": "full", "tide_system": "zero_tide"}


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("rows.txt", {"file_format": "table", "gm_m3_s2": GM, "reference_radius_m": RADIUS}),
        ("small.cof", {}),
        ("header-4.tab", {}),
    ],
)
def test_the_mission_states_what_the_file_does_not(name: str, keys: dict[str, Any]) -> None:
    model: Any = create("gravity", "harmonics", file=str(DATA / name), **STATED, **keys)
    assert (model.gm_m3_s2, model.reference_radius_m, model.normalisation) == (GM, RADIUS, "full")
    values = {parameter.name: parameter.value for parameter in model.parameters()}
    assert values == {"gm": GM, "C2,0": -4e-4, "C2,2": 2.5e-6, "S2,2": -1.5e-6}
    for key in (*STATED, *(k for k in keys if k != "file_format")):
        less = {k: v for k, v in (STATED | keys).items() if k != key}
        with pytest.raises(InputError, match=f"does not state {key}"):
            create("gravity", "harmonics", file=str(DATA / name), **less)


def test_the_mission_states_the_epoch() -> None:
    path = str(DATA / "time-2.gfc")
    model: Any = create("gravity", "harmonics", file=path, epoch="2004-01-01T00:00:00")
    assert {p.name: p.value for p in model.parameters()}["C2,0"] == pytest.approx(
        -4e-4 + 4e-11, rel=1e-15
    )
    for keys, message in (
        ({}, "give the key epoch"),
        ({"epoch": "2004-13-01"}, "epoch: "),
        ({"epoch": "2004-01-01", "file_format": "shadr"}, "goes with an ICGEM file"),
    ):
        with pytest.raises(InputError, match=message):
            create("gravity", "harmonics", file=path, **keys)


def test_columns_of_a_cof_file_without_blanks(tmp_path: Path) -> None:
    """C stands in columns 18 to 38 and S in 39 to 59, as GMAT reads them."""
    path = tmp_path / "tight.cof"
    path.write_text(
        "POTFIELD  2  2  3 4.0E+14 6.0E+06 1.0E+00\n"
        "RECOEF    2  0   -0.48416954845647E-03\n"
        "RECOEF    2  2    .24392607486563E-005-.14002663975880E-005\n"
        "END\n"
    )
    first, second = read_cof(path).rows
    assert (first.c, first.s) == (-0.48416954845647e-3, 0.0)
    assert (second.c, second.s) == (0.24392607486563e-5, -0.14002663975880e-5)


NUMERIC = st.from_regex(rb"[0-9 .,+DE\n-]{0,8}", fullmatch=True)
SEEDS = (
    ("time-1.gfc", lambda path: read_icgem(path, "2014-01-01").rows),
    ("time-2.gfc", lambda path: read_icgem(path, "2014-01-01").rows),
    ("errors-both.gfc", lambda path: read_icgem(path).rows),
    ("blanks.tab", lambda path: read_shadr(path).rows),
    ("rows.txt", lambda path: read_coefficient_rows(path)[0]),
    ("small.cof", lambda path: read_cof(path).rows),
)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_mutated_files_are_read_or_refused(tmp_path: Path, data: st.DataObject) -> None:
    name, read = data.draw(st.sampled_from(SEEDS))
    content = (DATA / name).read_bytes()
    start = data.draw(st.integers(0, len(content)))
    stop = data.draw(st.integers(start, min(len(content), start + 40)))
    patch = data.draw(
        st.binary(max_size=8) | st.from_regex(rb"[0-9 .,+DE\n-]{0,8}", fullmatch=True)
    )
    path = tmp_path / name
    path.write_bytes(content[:start] + patch + content[stop:])
    try:
        rows = read(path)
    except InputError as error:
        assert str(error).startswith(str(path))  # noqa: PT017
    else:
        assert all(0 <= row.m <= row.n for row in rows)
