"""Tables by columns: rows, units and blanks follow from columns of SI values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.presentation import Column, Printed
from hillsphere.products.fields import Label, Shape
from hillsphere.runs.store import csv_text
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import (
    FieldColumns,
    column,
    set_beside,
    tabulate,
    take_or_blank,
    text_column,
)
from hillsphere.spec.units import UNITS


@dataclass(frozen=True)
class Light:
    """A product of two orbits and three seasons."""

    labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
    altitude_m: Annotated[Array, Shape(2, "orbits"), Label("altitude", 5, "km")]
    speed_m_s: Annotated[Array, Shape("orbits"), Label("speed", 4)]
    declination_rad: Annotated[Array, Shape("seasons"), Label("Sun", 3, "deg")]
    shadow: Annotated[Array, Shape("seasons", "orbits"), Label("eclipsed", 4)]
    inside: Annotated[tuple[bool, ...], Shape("orbits")]
    length_km: Annotated[Array, Shape("orbits")]
    year_s: float
    unknown: tuple[float, ...] = (1.0, 2.0)


@pytest.fixture
def light() -> Light:
    return Light(
        ("a", "b"),
        np.array([[1001.0, 2500.0], [np.nan, 4000.0]]),
        np.array([1.5, 2.5]),
        np.array([-0.5, 0.0, 0.5]) * np.pi,
        np.arange(6.0).reshape(3, 2),
        (True, False),
        np.ones(2),
        3600.0,
    )


@pytest.mark.parametrize(
    ("name", "unit", "si", "shown"),
    [
        ("altitude_km", "km", 1001.0, 1.001),  # 1001 * 0.001 is 1.0009999999999999
        ("sun_deg", "deg", np.pi / 6, float(np.degrees(np.pi / 6))),
        ("period_h", "h", 5400.0, 1.5),
        ("first_d", "d", 43200.0, 0.5),
        ("speed_m_s", "m/s", 2.0, 2.0),
        ("error_mm_s", "mm/s", 0.002, 2.0),
        ("error_cm_s", "cm/s", 0.07, 7.000000000000001),  # as 100 * 0.07
        ("push_mm_s2", "mm/s²", 0.003, 3.0),
        ("rate_deg_s", "deg/s", np.pi, 180.0),
        ("growth_1_s", "1/s", 2.0, 2.0),
        ("growth_1_h", "1/h", 2.0, 7200.0),
        ("x0", "-", 2.0, 2.0),
        ("eclipse_min", "-", 2.0, 2.0),  # the least, not minutes
        ("depth_t", "-", 2.0, 2.0),
    ],
)
def test_unit_follows_from_the_name(name: str, unit: str, si: float, shown: float) -> None:
    made = column(name, np.array([si]), "label", 3)
    assert (made.name, made.unit, made.label, made.digits) == (name, unit, "label", 3)
    assert made.cells == (shown,)
    assert column(name, [si]).cells == (shown,)


def test_unit_that_is_given() -> None:
    assert column("duration_min", [90.0], unit="min").cells == (1.5,)
    assert column("push_mm_s2", [0.003], unit="mm/s2").cells == (3.0,)
    assert column("gain_db", [3.0], unit="dB").cells == (3.0,)


@pytest.mark.parametrize("suffix", sorted({s for u in UNITS.values() for s in u} - {"min", "t"}))
def test_every_unit_of_missions_is_known_to_columns(suffix: str) -> None:
    factor = next(units[suffix] for units in UNITS.values() if suffix in units)
    (cell,) = column(f"x_{suffix}", np.array([factor])).cells
    assert cell == pytest.approx(1.0, rel=1e-15)


def test_cells() -> None:
    values = [
        1.5,
        np.float64(np.nan),
        None,
        np.inf,
        3,
        np.int64(4),
        np.bool_(True),
        Printed("7.10"),
    ]
    made = column("x", values).cells
    assert made == (1.5, None, None, np.inf, 3, 4, True, 7.1)
    assert [type(cell).__name__ for cell in made] == [
        "float", "NoneType", "NoneType", "float", "int", "int", "bool", "Printed",
    ]  # fmt: skip
    assert [type(cell) for cell in column("n", np.arange(2)).cells] == [int, int]
    assert [type(cell) for cell in column("n_km", np.arange(2)).cells] == [float, float]


def test_values_that_are_no_vector() -> None:
    with pytest.raises(ValueError, match="column 'x': values must be a vector, got 2 axes"):
        column("x", np.ones((2, 2)))


def test_text_columns_have_no_unit() -> None:
    assert text_column("state_s", ("a", None), "state") == replace(
        column("state_s", ["a", None], "state", unit="-"), unit=""
    )
    assert text_column("stable", np.array([True, False])).cells == (True, False)
    assert text_column("nothing", ()).unit == ""


def test_items_of_another_list() -> None:
    values = np.array([1.0, 2.0])
    assert column("x", take_or_blank(values, [1, -1, 0])).cells == (2.0, None, 1.0)
    assert column("x", take_or_blank(values[:0], [-1])).cells == (None,)
    assert take_or_blank(values, []).shape == (0,)


def test_rows_and_csv() -> None:
    table = tabulate(
        "T", [text_column("orbit", ["a", "b"]), column("x_km", np.array([1500.0, np.nan]), "x", 4)],
        ["note"],
    )  # fmt: skip
    assert table.columns == [Column("orbit", "", "", 8), Column("x_km", "km", "x", 4)]
    assert table.rows == [{"orbit": "a", "x_km": 1.5}, {"orbit": "b", "x_km": None}]
    assert (table.title, table.notes) == ("T", ["note"])
    assert csv_text(table) == "orbit,x_km\na,1.5\nb,\n"


def test_columns_of_two_lengths() -> None:
    with pytest.raises(ValueError, match=r"table 'T': .* a has 2, b has 1 cells"):
        tabulate("T", [column("a", [1, 2]), column("b", [1])])


def test_published_values_beside() -> None:
    table = tabulate("T", [text_column("name", ["a", "b"]), column("x_km", [1230.0, 2000.0])])
    paper: dict[str, Any] = {"name": "a", "x_km": Printed("1.2")}
    beside = set_beside(table, ReferenceTable("Book", ("name", "x_km"), (paper,), {}), on="name")
    assert [c.name for c in beside.columns] == ["name", "x_km", "x_km_paper"]
    assert beside.rows[0] == {"name": "a", "x_km": 1.23, "x_km_paper": 1.2}
    assert beside.notes == ["1 of 1 values agree to the printed digit with Book."]
    assert set_beside(table, None, on="name") is table


def test_columns_over_fields(light: Light) -> None:
    of = FieldColumns(light, "orbits")
    assert of("labels", "orbit") == text_column("orbit", ("a", "b"), "orbit")
    assert of("speed_m_s") == column("speed_m_s", [1.5, 2.5], "speed", 4)
    assert of("speed_m_s", "v_mm_s", "v", 2) == column("v_mm_s", [1.5, 2.5], "v", 2)
    assert of("inside") == text_column("inside", (True, False))
    assert of("year_s", "year_h", "year") == column("year_h", [3600.0, 3600.0], "year")
    assert of("length_km", "l_km") == column("l_km", [1.0, 1.0], is_si=False)
    assert column("l_km", [2.0], is_si=False).cells == (2.0,)
    low, high = of.split("altitude_m", min="least", max="largest")
    assert low == column("min_altitude_km", [1001.0, 2500.0], "least altitude", 5)
    assert high == column("max_altitude_km", [None, 4000.0], "largest altitude", 5)


def test_rows_over_two_dimensions(light: Light) -> None:
    of = FieldColumns(light, "orbits", "seasons")
    table = tabulate("T", [of("labels"), of("declination_rad"), of("shadow")])
    assert [c.name for c in table.columns] == ["labels", "declination_deg", "shadow"]
    assert [tuple(row.values()) for row in table.rows] == [
        ("a", -90.0, 0.0), ("a", 0.0, 2.0), ("a", 90.0, 4.0),
        ("b", -90.0, 1.0), ("b", 0.0, 3.0), ("b", 90.0, 5.0),
    ]  # fmt: skip
    assert of.spread(np.array([1.0, 2.0]), "orbits").tolist() == [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]
    seasons_first = FieldColumns(light, "seasons", "orbits")("shadow")
    assert seasons_first.cells == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)


def test_no_rows() -> None:
    none = np.zeros(0)
    empty = Light((), np.zeros((2, 0)), none, none, np.zeros((0, 0)), (), none, 1.0)
    table = tabulate("T", [FieldColumns(empty, "orbits")(f) for f in ("labels", "speed_m_s")])
    assert ([c.unit for c in table.columns], table.rows) == (["", "m/s"], [])


def test_faults_of_columns_over_fields(light: Light) -> None:
    of = FieldColumns(light, "orbits")
    with pytest.raises(ValueError, match="Light has no dimension 'moons'; it has orbits, seasons"):
        FieldColumns(light, "moons")
    with pytest.raises(ValueError, match="Light has no field 'height'"):
        of("height")
    with pytest.raises(ValueError, match=r"Light\.shadow with the shape \(seasons, orbits\) is no"):
        of("shadow")
    with pytest.raises(ValueError, match=r"'v' over Light\.speed_m_s: its name must end in a unit"):
        of("speed_m_s", "v")
    with pytest.raises(ValueError, match=r"'length_m' over Light\.length_km: a field that is not"):
        of("length_km", "length_m")
    with pytest.raises(ValueError, match="altitude_m has 2 entries, but 1 words are given"):
        of.split("altitude_m", min="least")
    with pytest.raises(ValueError, match="values have 2 axes, but orbits declared for them"):
        of.spread(light.shadow, "orbits")
    with pytest.raises(ValueError, match="values have 1 axes, but no dimension declared for them"):
        of("unknown")
    with pytest.raises(InputError, match=r"Light\.speed_m_s must have the shape"):
        FieldColumns(replace(light, speed_m_s=np.ones(3)), "orbits")
