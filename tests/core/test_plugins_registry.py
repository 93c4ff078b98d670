"""The registry: discovery, broken and competing plugins, unknown types."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import metadata
from types import ModuleType
from typing import Any

import pytest

from hillsphere.errors import InputError, PluginError, UnknownComponentError
from hillsphere.mission.schema import mission_schema
from hillsphere.plugins import (
    API_VERSION,
    ENTRY_POINT_GROUP,
    Component,
    Registry,
    create,
    discover,
    hookimpl,
    load_object,
)

MOON = ("hillsphere.model.bodies:Moon", "hillsphere.model.bodies:MoonSpec")


class Plugin:
    """Offers what it is given."""

    def __init__(self, offered: Any) -> None:
        self.offered = offered

    @hookimpl
    def hillsphere_components(self) -> Iterable[Component]:
        """Return it, or call it."""
        return self.offered() if callable(self.offered) else self.offered  # type: ignore[no-any-return]


def _moon(type_: str = "moon", kind: str = "body", **options: Any) -> Component:
    return Component(kind, type_, *MOON, "a moon", **options)


def _quit() -> None:
    sys.exit(3)


def _fail_in_lines() -> None:
    raise RuntimeError("first\n  second\r\n\tthird\n")


BROKEN = [
    (lambda: 1 / 0, "ZeroDivisionError: division by zero"),
    (_quit, "SystemExit: 3"),
    ([], "offers no component"),
    (None, "offers no component"),
    (3, "TypeError"),
    (["moon"], "must return Component records, got str"),
    ([_moon(api=API_VERSION + 1)], f"written for plugin API {API_VERSION + 1}"),
    ([_moon(api=API_VERSION - 1)], f"written for plugin API {API_VERSION - 1}"),
    ([_moon(api="1")], "a Component's api must be an int, got str"),
    ([_moon(kind=["body"])], "a Component's kind must be a str, got list"),  # type: ignore[arg-type]
    ([_moon(type_=3)], "a Component's type must be a str, got int"),  # type: ignore[arg-type]
    (
        [Component("body", "moon", MOON[0], None, "")],  # type: ignore[arg-type]
        "a Component's spec must be a str, got NoneType",
    ),
    (_fail_in_lines, "RuntimeError: first second third"),
    ([_moon(kind="gravty")], "unknown kind 'gravty'; did you mean 'gravity'?"),
    ([_moon(kind="zzz")], "kinds: body, gravity"),
    ([_moon(type_="Big Moon")], "a type is named with small letters"),
    ([_moon(), _moon()], "offers body 'moon' twice"),
    ([Component("body", "moon", "no colon", MOON[1], "")], "'no colon' is not 'package"),
    ([Component("body", "moon", MOON[0], "", "")], "'' is not 'package.module:Class'"),
]


@pytest.mark.parametrize(("offered", "reason"), BROKEN)
def test_broken_plugin_is_set_aside(offered: Any, reason: str) -> None:
    registry = Registry()
    registry.add_plugin("good", Plugin([_moon()]))
    registry.add_plugin("bad", Plugin(offered))
    assert reason in registry.broken["bad"]
    assert [record.plugin for record in registry] == ["good"]
    with pytest.raises(PluginError, match="plugin 'bad' is broken"):
        Registry(strict=True).add_plugin("bad", Plugin(offered))


def test_module_without_the_hook_is_broken() -> None:
    registry = Registry()
    registry.add_plugin("empty", ModuleType("empty"))
    assert "is hillsphere_components marked?" in registry.broken["empty"]


def test_same_type_of_two_plugins_names_both() -> None:
    registry = Registry()
    registry.add_plugin("one", Plugin([_moon(), _moon("other")]))
    registry.add_plugin("two", Plugin([_moon()]))
    assert registry.get("body", "other").plugin == "one"
    with pytest.raises(PluginError, match="'one' and 'two'; disable one with HILLSPHERE_DISABLE"):
        registry.get("body", "moon")
    # Neither side is shown as if it could be had.
    assert dict(registry.contested) == {
        ("body", "moon"): (
            "body 'moon' is offered by two plugins, 'one' and 'two'; disable one with "
            "HILLSPHERE_DISABLE_PLUGINS"
        )
    }
    assert [record.component.type for record in registry] == ["other"]
    assert [record.component.type for record in registry.of_kind("body")] == ["other"]
    schema = mission_schema(registry)
    assert "body.moon" not in schema["$defs"]
    assert "'one' and 'two'" in schema["x-broken"]["body.moon"]
    registry.add_plugin("three", Plugin([_moon()]))
    with pytest.raises(PluginError, match="by 3 plugins, 'one', 'two' and 'three'; disable all"):
        registry.get("body", "moon")
    with pytest.raises(UnknownComponentError, match="did you mean 'moon'"):
        registry.get("body", "mooon")
    strict = Registry(strict=True)
    strict.add_plugin("one", Plugin([_moon()]))
    with pytest.raises(PluginError, match="offered by two plugins"):
        strict.add_plugin("two", Plugin([_moon()]))


@pytest.mark.parametrize(
    ("kind", "type_", "message"),
    [
        ("body", "mon", "no body of type 'mon'; did you mean 'moon'?"),
        ("body", "zzz", "no body of type 'zzz'; installed: comet, moon"),
        ("orbit_family", "qso", "no orbit family of type 'qso'; no plugin brings an orbit family"),
        ("body", "z" * 1000, "no body of type '" + "z" * 60 + "'; installed"),
    ],
)
def test_unknown_type(kind: str, type_: str, message: str) -> None:
    registry = Registry()
    registry.add_plugin("one", Plugin([_moon(), _moon("comet")]))
    with pytest.raises(UnknownComponentError) as caught:
        registry.get(kind, type_)
    assert str(caught.value).startswith(message)
    registry.add_plugin("bad", Plugin([]))
    with pytest.raises(UnknownComponentError, match=r"\(set aside as broken: bad\)"):
        registry.get(kind, type_)


@pytest.mark.parametrize(
    ("target", "spec", "reason"),
    [
        ("no_such_module:X", MOON[1], "ModuleNotFoundError"),
        ("hillsphere.model.bodies:Sun", MOON[1], "AttributeError"),
        (MOON[0], "hillsphere.model.bodies:Nothing", "AttributeError"),
        (MOON[0], "hillsphere.model.bodies:Moon", "is not a subclass of hillsphere.spec.Spec"),
    ],
)
def test_component_that_cannot_be_imported_names_its_plugin(
    target: str, spec: str, reason: str
) -> None:
    registry = Registry()
    registry.add_plugin("one", Plugin([Component("body", "sun", target, spec, "a sun")]))
    record = registry.get("body", "sun")
    with pytest.raises(PluginError, match=f"plugin 'one': body 'sun'.*{reason}"):
        record.load_spec() if spec != MOON[1] else record.load_target()


def test_component_loads() -> None:
    registry = Registry()
    registry.add_plugin("one", Plugin([_moon()]), "dist 1.0")
    record = registry.get("body", "moon")
    assert record.distribution == "dist 1.0"
    assert record.load_target() is load_object(MOON[0])
    assert record.load_spec() is load_object(MOON[1])


# --- discovery ------------------------------------------------------------------------------


class _Point:
    """An entry point that loads what it is given."""

    dist = None

    def __init__(self, name: str, loaded: Any) -> None:
        self.name = name
        self.loaded = loaded

    def load(self) -> Any:
        """Load it."""
        if isinstance(self.loaded, BaseException):
            raise self.loaded
        return self.loaded


def _install(monkeypatch: pytest.MonkeyPatch, *points: _Point) -> None:
    def entry_points(*, group: str) -> list[_Point]:
        assert group == ENTRY_POINT_GROUP
        return list(points)

    monkeypatch.setattr(metadata, "entry_points", entry_points)


def test_plugin_that_cannot_be_imported_stops_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    _install(
        monkeypatch,
        _Point("a-broken", ImportError("no module named 'gone'")),
        _Point("b-exits", SystemExit(1)),
        _Point("c-good", Plugin([_moon("comet")])),
    )
    registry = discover(disabled=())
    assert registry.get("body", "comet").plugin == "c-good"
    assert registry.get("body", "moon").plugin == "hillsphere"
    assert registry.broken == {
        "a-broken": "ImportError: no module named 'gone'", "b-exits": "SystemExit: 1",
    }  # fmt: skip
    with pytest.raises(PluginError, match="'a-broken' is broken: ImportError"):
        discover(strict=True, disabled=())


def test_disabled_plugin_is_not_even_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    _install(monkeypatch, _Point("bad", ImportError("x")), _Point("good", Plugin([_moon("comet")])))
    monkeypatch.setenv("HILLSPHERE_DISABLE_PLUGINS", " bad , other")
    registry = discover(strict=True)
    assert registry.disabled == ("bad", "other")
    assert registry.unknown_disabled == ("other",)
    assert registry.get("body", "comet").plugin == "good"
    # What is not there may be in a plugin that was left out, but not in one that is not installed.
    with pytest.raises(UnknownComponentError) as caught:
        registry.get("gravity", "ellipsoid")
    assert str(caught.value).endswith(
        "no plugin brings a gravity (one of a plugin file is found with --plugin FILE) "
        "(disabled: bad)"
    )


def test_installed_plugins_are_sound() -> None:
    registry = discover(strict=True)
    assert {record.plugin for record in registry} >= {"hillsphere", "hillsphere_gravity"}
    for record in registry:
        if record.component.kind != "command":
            record.load_spec()
        assert record.component.summary


# --- creation from Python -------------------------------------------------------------------


def test_create() -> None:
    moon = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    assert moon.semi_major_axis_m == 9377e3


def test_create_names_every_fault() -> None:
    with pytest.raises(InputError) as caught:
        create("body", "moon", primary_gm_km3_s2=-1, semi_major_axis=3, name=3)
    assert len(str(caught.value).splitlines()) == 3
    with pytest.raises(UnknownComponentError, match="did you mean 'moon'"):
        create("body", "mooon")


@pytest.mark.parametrize(
    ("target", "fault"),
    [
        ("hillsphere.model.bodies:Mooon", "has no attribute 'Mooon'"),
        ("hillsphere.model.no_bodies:Moon", "No module named 'hillsphere.model.no_bodies'"),
        ("wave_like:Missing", "has no attribute 'Missing'"),  # not loaded: its source is read
        ("wave_like:Wave", ""),
        ("wave_like:Taken", ""),
    ],
)
def test_a_class_that_is_not_there(
    target: str, fault: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = "from math import sin as Taken\nclass Wave: pass\n"
    (tmp_path / "wave_like.py").write_text(source, "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    registry = Registry()
    registry.add_plugin("mine", Plugin([Component("body", "moon", target, MOON[1], "a moon")]))
    record = registry.get("body", "moon")
    assert fault in record.missing()
    assert bool(record.missing()) == bool(fault)
    assert "wave_like" not in sys.modules
    assert fault in record.fault()
    sys.modules.pop("wave_like", None)
