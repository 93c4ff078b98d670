"""Specs: units, bounds, references, and faults in the user's words."""

from __future__ import annotations

import datetime
from typing import Annotated, Any, Literal, Self

import pytest
from pydantic import Field, ValidationError, model_validator

from hillsphere.base.problems import did_you_mean, format_key, format_value
from hillsphere.errors import InputError
from hillsphere.mission.faults import MOST_FAULTS, faults_of
from hillsphere.model.bodies import MoonSpec
from hillsphere.plugins import validate
from hillsphere.spec import (
    DataPath,
    Ref,
    Spec,
    Vector3,
    data_path,
    need,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere.spec.annotations import describe_annotation
from hillsphere.spec.units import UNITS, unit_keys, unit_text


class Inner(Spec):
    """A nested table."""

    height_m: float = quantity("length", "how high", gt=0, le=100)
    label: str = option("a name", default="", max_length=4)


class Other(Spec):
    """Another nested table."""

    turn_rad: float = quantity("angle", "how far it turns")


class Outer(Spec):
    """Everything that a Spec may hold."""

    axes_m: Vector3 = quantity("length", "semi-axes", gt=0)
    period_s: float | None = quantity("time", "period", default=None, ge=1)
    rates_rad_s: tuple[float, ...] = quantity("angular_rate", "rates", default=(), max_length=3)
    grid_m: tuple[tuple[float, float], ...] = quantity("length", "pairs", default=(), ge=0)
    count: int = option("how many", default=1, ge=1, lt=10)
    flag: bool = option("on or off", default=False)
    mode: Literal["full", "none"] = option("how", default="full")
    inner: Inner | None = option("one table", default=None)
    parts: tuple[Inner, ...] = option("several tables", default=())
    named: dict[str, Inner] = option("tables by name", default={})
    table: dict[str, Vector3] = option("vectors by name", default={})
    either: float | Vector3 = option("one or three numbers", default=0.0)
    one_of: Inner | Other | float = option("a table or a number", default=0.0)
    model: Ref | None = reference("gravity", "a model", default=None)
    models: tuple[Ref, ...] = reference("gravity", "models", default=())
    file: DataPath | None = data_path("a file", default=None)
    start: datetime.datetime | None = option("epoch", default=None)
    code: Annotated[str, Field(pattern="^[A-Z]+$")] = option("capital letters", default="A")
    even: Annotated[int, Field(multiple_of=2, gt=-5, le=8)] = option("even number", default=0)

    @model_validator(mode="after")
    def _rule(self) -> Self:
        if self.count == 7:
            raise ValueError("seven is not allowed")
        if self.count == 8:
            raise rule("period_s", "too long for eight")
        return self


def _faults(**keys: Any) -> list[tuple[str, str]]:
    made, faults = faults_of(Outer, {"axes_km": [3, 2, 1], **keys})
    assert (made is None) == bool(faults)
    return [(format_key(fault.key), fault.message) for fault in faults]


# --- units ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dimension", "suffix", "factor"),
    [
        ("length", "km", 1000.0),
        ("length", "au", 149597870700.0),  # IAU 2012 Resolution B2
        ("time", "d", 86400.0),
        ("angle", "deg", 3.141592653589793 / 180),
        ("angle", "arcsec", 3.141592653589793 / 648000),
        ("angular_rate", "deg_h", 3.141592653589793 / 180 / 3600),
        ("specific_energy", "km2_s2", 1e6),
        ("gravitational_parameter", "km3_s2", 1e9),
        ("density", "g_cm3", 1000.0),
        ("mass", "t", 1000.0),
    ],
)
def test_factor_to_si(dimension: str, suffix: str, factor: float) -> None:
    assert UNITS[dimension][suffix] == pytest.approx(factor, rel=1e-15)


def test_first_unit_of_every_dimension_is_si() -> None:
    assert [next(iter(units.values())) for units in UNITS.values()] == [1.0] * len(UNITS)


def test_every_unit_is_converted_before_validation() -> None:
    for key, factor in unit_keys("period_s", "time").items():
        made, _ = faults_of(Outer, {"axes_m": [1, 1, 1], key: 7})
        assert made is not None
        assert made.period_s == 7 * factor


def test_arrays_of_any_depth_are_converted() -> None:
    made = Outer.model_validate({"axes_km": [3, 2, 1], "grid_km": [[1, 2], [3, 4]]})
    assert made.axes_m == (3000.0, 2000.0, 1000.0)
    assert made.grid_m == ((1000.0, 2000.0), (3000.0, 4000.0))


def test_unit_text() -> None:
    assert [unit_text(unit) for unit in ("km3_s2", "m_s", "g_cm3", "hz")] == [
        "km³/s²", "m/s", "g/cm³", "hz",
    ]  # fmt: skip


def test_unknown_dimension_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match=r"^unknown dimension 'lenght'; did you mean 'length'\?$"):
        quantity("lenght", "how far")
    with pytest.raises(InputError, match=r"^unknown dimension 'x'; valid: length, time, angle, "):
        unit_keys("axis_m", "x")


def test_quantity_must_be_named_by_its_si_suffix() -> None:
    with pytest.raises(TypeError, match=r"Bad\.axis_km: a length must be named \*_m"):

        class Bad(Spec):
            axis_km: float = quantity("length", "wrong")


# --- faults ---------------------------------------------------------------------------------

FAULTS: list[tuple[dict[str, Any], list[tuple[str, str]]]] = [
    ({"period_h": 1e-5}, [("period_h", "must be ≥ 0.000277777777778 h, got 1e-05 h")]),
    ({"period_s": 1, "period_d": 1},
     [("period_d", "period_s and period_d say the same thing; keep one")]),
    ({"period": 1}, [("period", "needs a unit; write period_s, period_min, period_h or period_d")]),
    ({"period_days": 1},
     [("period_days", "unknown unit 'days'; write period_s, period_min, period_h or period_d")]),
    ({"peroid_s": 1}, [("peroid_s", "unknown key 'peroid_s'; did you mean 'period_s'?")]),
    ({"period_s": "1"}, [("period_s", "expected a number, got a string '1'")]),
    ({"period_s": True}, [("period_s", "expected a number, got true")]),
    ({"period_s": float("nan")}, [("period_s", "must be a finite number, got nan")]),
    ({"period_s": float("-inf")}, [("period_s", "must be a finite number, got -inf")]),
    ({"period_d": 1e308}, [("period_d", "too large a number: 1e+308")]),
    ({"period_d": 10**400}, [("period_d", "too large a number: a very large whole number")]),
    ({"rates_deg_s": [1, 2, 3, 4]}, [("rates_deg_s", "must have at most 3 items, got 4")]),
    ({"rates_deg_s": 1}, [("rates_deg_s", "expected an array of numbers, got 1")]),
    ({"rates_deg_s": {}}, [("rates_deg_s", "expected an array of numbers, got an empty table")]),
    ({"grid_km": [[1, 2], [3, -4]]}, [("grid_km[1][1]", "must be ≥ 0 km, got -4 km")]),
    ({"grid_km": [[1, 2], [3]]}, [("grid_km[1]", "expected two numbers, got [3]")]),
    ({"grid_km": [[1, 2], [3, "x"]]}, [("grid_km[1][1]", "expected a number, got a string 'x'")]),
    ({"count": 0}, [("count", "must be ≥ 1, got 0")]),
    ({"count": 10}, [("count", "must be < 10, got 10")]),
    ({"count": 2.0}, [("count", "expected a whole number, got 2.0")]),
    ({"flag": 1}, [("flag", "expected true or false, got 1")]),
    ({"mode": "ful"},
     [("mode", "must be one of 'full', 'none', got a string 'ful'; did you mean 'full'?")]),
    ({"mode": 1}, [("mode", "must be one of 'full', 'none', got 1")]),
    ({"inner": 3}, [("inner", "expected a table, got 3")]),
    ({"inner": {}},
     [("inner.height_m", "missing: height_m (or _km, _cm, _mm, _au): how high")]),
    ({"inner": {"height": 1}},
     [("inner.height",
     "needs a unit; write height_m, height_km, height_cm, height_mm or height_au")]),
    ({"inner": {"height_km": 0.2}}, [("inner.height_km", "must be ≤ 0.1 km, got 0.2 km")]),
    ({"inner": {"height_m": 1, "label": "abcde"}},
     [("inner.label", "must have at most 4 characters, got 5")]),
    ({"parts": [{"height_m": 1}, {"height_cm": -1}]},
     [("parts[1].height_cm", "must be > 0 cm, got -1 cm")]),
    ({"parts": [{"height_m": 1, "height_km": 1}]},
     [("parts[0].height_km", "height_m and height_km say the same thing; keep one")]),
    ({"parts": {"height_m": 1}}, [("parts", "expected an array of tables, got a table")]),
    ({"named": {"a b": {"height_mm": -1}}}, [('named."a b".height_mm',
    "must be > 0 mm, got -1 mm")]),
    ({"named": {"a": 1}}, [("named.a", "expected a table, got 1")]),
    ({"named": [1]}, [("named", "expected a table of tables, got [1]")]),
    ({"table": {"a": [1, 2]}}, [("table.a", "expected three numbers, got [1, 2]")]),
    ({"either": "x"}, [("either", "expected a number or three numbers, got a string 'x'")]),
    ({"either": [1, "x", 3]}, [("either[1]", "expected a number, got a string 'x'")]),
    ({"one_of": "x"}, [("one_of", "expected a table or a number, got a string 'x'")]),
    ({"one_of": {"turn_deg": "x"}},
     [("one_of.turn_deg", "expected a number, got a string 'x'")]),
    ({"one_of": {"height_km": -1}}, [("one_of.height_km", "must be > 0 km, got -1 km")]),
    ({"model": 3}, [("model", "must be the name of another table, got 3")]),
    ({"models": ["a", ""]}, [("models[1]", "must be the name of another table, got a string ''")]),
    ({"file": ""}, [("file", "must not be empty")]),
    ({"start": "2027"},
     [("start", "expected a date and time with zone, got a string '2027'")]),
    ({"code": "abc"}, [("code", "'abc' does not match the pattern ^[A-Z]+$")]),
    ({"even": 3}, [("even", "must be a multiple of 2, got 3")]),
    ({"even": -6}, [("even", "must be > -5, got -6")]),
    ({"even": 10}, [("even", "must be ≤ 8, got 10")]),
    ({"count": 7}, [("", "seven is not allowed")]),
    ({"count": 8, "period_min": 1}, [("period_min", "too long for eight")]),
    ({"axes_m": [1, 2, 3]}, [("axes_m", "axes_m and axes_km say the same thing; keep one")]),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "expected"), FAULTS, ids=[str(f[0])[:40] for f in FAULTS])
def test_fault(keys: dict[str, Any], expected: list[tuple[str, str]]) -> None:
    found = _faults(**keys)
    assert [message for _, message in found] == [message for _, message in expected]
    if "axes_m" not in keys:
        assert found == expected


def test_no_fault_hides_another() -> None:
    found = _faults(
        period_s=1, period_h=1, rates_deg_s="x", grid_km=[[-1, 1]], count=0, mode="x", zzz=1,
        parts=[{"height_m": -1}, {"height": 1}], model=3,
    )  # fmt: skip
    assert [key for key, _ in found] == [
        "period_h", "rates_deg_s", "grid_km[0][0]", "count", "mode", "zzz",
        "parts[0].height_m", "parts[1].height", "model",
    ]  # fmt: skip


def test_misspelt_required_key_is_one_fault() -> None:
    for word in ("axs_km", "axes", "axes_miles", "Axes_km"):
        _, faults = faults_of(Outer, {word: [3, 2, 1]})
        assert [fault.key for fault in faults] == [(word,)]


def test_list_of_faults_ends() -> None:
    _, faults = faults_of(Outer, {"axes_km": [1, 1, 1], **{f"z{i}": 1 for i in range(3000)}})
    assert len(faults) == MOST_FAULTS + 1
    assert faults[-1].message == f"{3000 - MOST_FAULTS} more faults are not listed"


def test_fault_in_python_names_what_was_made() -> None:
    with pytest.raises(InputError) as caught:
        validate(MoonSpec, {"semi_major_axis_km": -1}, where="body 'moon'")
    assert str(caught.value).splitlines() == [
        "body 'moon': semi_major_axis_km: must be > 0 km, got -1 km",
        "body 'moon': primary_gm_m3_s2: missing: primary_gm_m3_s2 (or _km3_s2): "
        "gravitational parameter of the primary",
    ]


def test_spec_is_frozen_and_holds_no_list() -> None:
    made = Outer.model_validate({"axes_km": [3, 2, 1], "table": {"a": [1, 2, 3]}})
    assert made.table["a"] == (1, 2, 3)
    with pytest.raises(ValidationError, match="frozen"):
        made.count = 3  # type: ignore[misc]


# --- references and files -------------------------------------------------------------------


class Tree(Spec):
    """References at every depth."""

    model: Ref = reference("gravity", "one")
    models: tuple[Ref, ...] = reference("plant", "several", default=())
    leaves: tuple[Leaf, ...] = option("tables", default=())
    by_name: dict[str, Leaf] = option("tables by name", default={})


class Leaf(Spec):
    """A nested table with a reference and a file."""

    sensor: Ref = reference("sensor", "one")
    file: DataPath = data_path("a file", default="none")


Tree.model_rebuild()


def test_references_are_found_and_bound_at_every_depth() -> None:
    made = Tree.model_validate(
        {
            "model": "g",
            "models": ["p", "q"],
            "leaves": [{"sensor": "s", "file": "f"}],
            "by_name": {"x": {"sensor": "t"}},
        }
    )
    assert [(where, kind, ref.name) for where, kind, ref in made.references()] == [
        (("model",), "gravity", "g"),
        (("models", 0), "plant", "p"),
        (("models", 1), "plant", "q"),
        (("leaves", 0, "sensor"), "sensor", "s"),
        (("by_name", "x", "sensor"), "sensor", "t"),
    ]
    bound = made.bound(lambda kind, name: f"{kind} {name}")
    assert bound.models[1].get() == "plant q"
    assert bound.by_name["x"].sensor.get() == "sensor t"
    with pytest.raises(RuntimeError, match="reference 'g' is not bound"):
        made.model.get()
    assert list(made.data_paths()) == [
        (("leaves", 0, "file"), "f"), (("by_name", "x", "file"), "none"),
    ]  # fmt: skip
    moved = made.with_data_paths({"f": "/f"})
    assert moved.leaves[0].file == "/f"
    assert moved.by_name["x"].file == "none"
    assert moved.model is made.model


def test_object_given_in_python_stands_for_a_reference() -> None:
    component = object()
    made = Tree(model=component)  # type: ignore[arg-type]
    assert made.model.get() is component
    assert made.bound(lambda kind, name: pytest.fail("bound twice")).model.get() is component


# --- words ----------------------------------------------------------------------------------


def test_described() -> None:
    expected = {
        float: "a number",
        Vector3: "three numbers",
        tuple[tuple[float, float], ...]: "an array of arrays of two numbers",
        dict[str, float]: "a table of numbers",
        tuple[str, float]: "(a string, a number)",
        Literal["a", "b"]: "one of 'a', 'b'",
        tuple[Literal["a", "b"], ...]: "an array of some of 'a', 'b'",
        float | None: "a number",
        bytes: "a value of type bytes",
        tuple[bytes, ...]: "an array of values of type bytes",
    }
    assert {annotation: describe_annotation(annotation) for annotation in expected} == expected


def test_shown_is_one_short_line() -> None:
    values: list[Any] = [
        "x" * 10_000, "a\nb\x1b[2J", [1] * 1000, ["x" * 50, "y" * 50], [[1], [2]], 10**5000, {},
        {"a": 1},
        None, object(), [], 1e-300, datetime.time(12),
    ]  # fmt: skip
    for value in values:
        text = format_value(value)
        assert len(text) < 100
        assert text.isprintable()


def test_format_key_escapes_what_cannot_be_printed() -> None:
    assert format_key(("a", 0, "b c", "\x1b")) == r'a[0]."b c"."\u001b"'
    assert len(format_key(("x y" * 1000,))) < 100


def test_did_you_mean() -> None:
    assert did_you_mean("axs", ["axes", "mode"]) == "; did you mean 'axes'?"
    assert did_you_mean("zzz", ["axes", "mode"], otherwise="keys") == "; keys: axes, mode"
    assert did_you_mean("zzz", []) == ""
    assert did_you_mean("z", [f"a{i}" for i in range(1000)]).endswith(", …")


@pytest.mark.parametrize("bounds", [{"gtt": 0}, {"minimum": 1}])
def test_a_misspelt_bound_is_refused_where_the_field_is_declared(bounds: dict[str, Any]) -> None:
    (name,) = bounds
    with pytest.raises(TypeError, match=f"a field has no bound '{name}'"):
        quantity("length", "an edge", **bounds)
    with pytest.raises(TypeError, match=f"a field has no bound '{name}'"):
        option("a count", **bounds)
    with pytest.raises(TypeError, match="did you mean 'gt'"):
        need("package.module:Class", "a product", gtt=1)
