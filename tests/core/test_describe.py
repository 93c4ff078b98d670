"""`hillsphere describe`: every key of every component, from its Spec alone."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from typing import Any

import pytest

from hillsphere.cli.describing import KIND_MEANINGS, describe_component, describe_kind
from hillsphere.cli.endings import run
from hillsphere.cli.spec_description import describe_keys, format_example, toml_value
from hillsphere.plugins import Registry, default_registry
from hillsphere.plugins.registry import DEFAULT_TYPES, KINDS, Registered
from hillsphere.spec import Spec
from hillsphere.testing.plugins import nested_specs

COMPONENTS = [record for record in default_registry() if record.component.kind != "command"]


def _name(record: Registered) -> str:
    return f"{record.component.kind} {record.component.type}"


def call(*arguments: str) -> tuple[int, str, str]:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = run(arguments)
    return int(code), out.getvalue(), err.getvalue()


def written_keys(table: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Keys of an example as `describe` writes them, but for free names, whose tables are whole."""
    for key, value in table.items():
        yield prefix + key
        if isinstance(value, Mapping):
            yield from written_keys(value, f"{prefix}{key}.")
        elif isinstance(value, list | tuple):
            for item in value:
                if isinstance(item, Mapping):
                    yield from written_keys(item, f"{prefix}{key}[].")


@pytest.mark.parametrize(
    "record", COMPONENTS, ids=lambda r: f"{r.component.kind} {r.component.type}"
)
def test_every_key_is_described_and_the_example_is_a_table(record: Registered) -> None:
    spec = record.load_spec()
    described = describe_keys(spec)
    assert all(key.meaning and key.value for key in described)
    fields = {name for part in (spec, *nested_specs(spec)) for name in part.model_fields}
    assert {key.key.rpartition(".")[2] for key in described} == fields
    spelt = set()
    free = []
    for key in described:
        stem = key.key.removesuffix(key.units[0]) if key.units else key.key
        spelt |= {stem + unit for unit in key.units} or {stem}
        if key.value.startswith("a table of"):
            free.append(key.key + ".")
    kind, type_ = record.component.kind, record.component.type
    for example in spec.examples:
        written = {key for key in written_keys(example) if not key.startswith(tuple(free))}
        assert written <= spelt
        parsed = tomllib.loads(format_example(kind, type_, example))[kind]["NAME"]
        expected = json.loads(json.dumps(example))
        if DEFAULT_TYPES.get(kind) != type_:
            expected["type"] = type_
        assert parsed == expected


def test_a_quantity_with_its_units_bounds_and_default(toys: Registry) -> None:
    record = toys.get("gravity", "brick")
    axes, density, convention = describe_keys(record.load_spec())
    assert (axes.key, axes.value, axes.bounds) == ("axes_m", "three numbers", "> 0")
    assert axes.units == ("m", "km", "cm", "mm", "au")
    assert axes.example == "axes_km = [3, 2, 1]"
    assert (density.bounds, density.is_required) == ("> 0", True)  # 30 000 is the largest of all
    assert (convention.value, convention.default) == ("one of 'full', 'none'", "full")
    assert not convention.is_required


def test_keys_of_inner_tables_follow_their_table(toys: Registry) -> None:
    keys = describe_keys(toys.get("gravity", "heap").load_spec())
    assert [key.key for key in keys] == [
        "parts", "parts[].model", "parts[].position_m", "parts[].name",
    ]  # fmt: skip
    assert keys[1].value == "the name of a [gravity.NAME]"
    assert keys[1].example == 'model = "ball"'
    assert keys[3].bounds == "at most 8 characters"
    assert (keys[2].is_required, keys[2].default) == (False, (0.0, 0.0, 0.0))


def test_what_a_stage_needs_is_named_by_its_product(toys: Registry) -> None:
    keys = {key.key: key for key in describe_keys(toys.get("stage", "resonances").load_spec())}
    assert keys["needs.family"].value == "the name of a stage that yields Family"
    assert keys["needs.family"].is_required
    assert keys["needs.earlier"].default is None
    assert list(keys)[-1] == "figures"  # inherited by all stages


def test_a_spec_that_contains_itself_ends() -> None:
    class Node(Spec):
        """A node."""

        children: tuple[Node, ...] = ()

    Node.model_rebuild(_types_namespace={"Node": Node})
    assert [key.key for key in describe_keys(Node)] == ["children"]


def test_text_of_a_component_of_a_third_party(
    toys: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    describe_component(toys, "gravity", "brick", json=False)
    text = capsys.readouterr().out
    assert "  axes_m  (or …_km, …_cm, …_mm, …_au)\n      three numbers, > 0; required\n" in text
    assert "  convention\n      one of 'full', 'none'; default \"full\"\n" in text
    assert text.endswith(
        '  [gravity.NAME]\n  type = "brick"\n  axes_km = [3, 2, 1]\n  density_g_cm3 = 2\n'
    )
    describe_kind(toys, "gravity", json=True)
    listed = json.loads(capsys.readouterr().out)
    assert {"brick", "heap"} <= {entry["type"] for entry in listed["types"]}


def test_kinds_types_and_keys_as_json() -> None:
    code, out, err = call("describe", "--json")
    assert (code, err) == (0, "")
    assert [entry["kind"] for entry in json.loads(out)] == list(KINDS) == list(KIND_MEANINGS)
    keys = json.loads(call("describe", "stage", "qso_family", "--json")[1])["keys"]
    (amplitudes,) = (key for key in keys if key["key"] == "x_amplitudes_m")
    assert amplitudes["units"][:2] == ["m", "km"]
    assert json.loads(call("describe", "command", "export", "--json")[1])["usage"]


def test_every_kind_can_be_listed() -> None:
    for kind in KINDS:
        code, out, _ = call("describe", kind)
        assert code == 0
        assert out.startswith(f"{kind}: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sensr"], "no kind 'sensr'; did you mean 'sensor'?"),
        (
            ["stage", "qso_famly"],
            "no stage of type 'qso_famly'; did you mean 'qso_family'? "
            "(one of a plugin file is found with --plugin FILE)",
        ),
        (["lidar"], "'lidar' is a type, no kind; use hillsphere describe sensor lidar"),
        (["sensr", "lidar"], "no kind 'sensr'; did you mean 'sensor'?"),
    ],
)
def test_unknown_names_get_a_hint(arguments: list[str], message: str) -> None:
    assert call("describe", *arguments) == (2, "", message + "\n")


def test_values_are_written_as_toml() -> None:
    values = {"a": 'quote " and \\ and \x7f', "b": True, "c": {"odd key": [1, 2.5e-9]}, "d": {}}
    assert tomllib.loads(f"x = {toml_value(values)}")["x"] == values
    long = {"names": ["a" * 30, "b" * 30, "c" * 30, "d" * 30]}
    text = format_example("stage", "t", long)
    assert max(map(len, text.splitlines())) < 100
    assert tomllib.loads(text)["stage"]["NAME"]["names"] == long["names"]


def test_results_of_a_stage_are_listed() -> None:
    text = call("describe", "stage", "qso_family")[1]
    assert "metrics: closure_max, jacobi_drift_max, " in text
    assert "table table_1: name, x0_km, " in text
    assert "_LABEL" in text
    told = json.loads(call("describe", "stage", "qso_family", "--json")[1])
    assert told["tables"]["table_1"][:2] == ["name", "x0_km"]
    assert "validate cannot check these" in call("describe", "stage", "closed_loop")[1]


def test_a_stage_that_does_not_say_its_results(
    toys: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    describe_component(toys, "stage", "resonances", json=False)
    assert "known only after a run" in capsys.readouterr().out
