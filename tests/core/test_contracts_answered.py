"""A contract is checked by what an object answers: wrappers pass on every version of Python."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from typing import Any

import pytest

from hillsphere.contracts import Contract
from hillsphere.interfaces import (
    CaseStage,
    Compensator,
    Estimator,
    Guidance,
    OrbitFamily,
    Sensor,
    StationSensor,
    Surface,
    SynthesisedLaw,
)
from hillsphere.plugins import KINDS, default_registry
from hillsphere.testing import example

PACKAGES = ("hillsphere", *(f"hillsphere_{name}" for name in (
    "controllers", "estimators", "gravity", "guidance", "orbits", "plants", "sensors", "tracking",
)))  # fmt: skip


class Wrapper:
    """What a plugin author writes to record calls: everything is answered by what is inside."""

    def __init__(self, inside: Any) -> None:
        self._inside = inside

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inside, name)


def _modules() -> list[str]:
    names = []
    for package in PACKAGES:
        path = importlib.import_module(package).__path__
        names += [m.name for m in pkgutil.walk_packages(path, package + ".")]
    return [name for name in names if not name.endswith("__main__")]


def _protocols() -> list[type]:
    found: dict[str, type] = {}
    for name in _modules():
        for value in vars(importlib.import_module(name)).values():
            if isinstance(value, type) and value.__dict__.get("_is_runtime_protocol"):
                found[f"{value.__module__}.{value.__qualname__}"] = value
    return [found[name] for name in sorted(found) if name.startswith("hillsphere")]


def test_every_protocol_that_is_checked_at_run_time_is_a_contract() -> None:
    protocols = _protocols()
    assert len(protocols) > 40
    plain = [p.__qualname__ for p in protocols if not issubclass(type(p), type(Contract))]
    assert not plain, "derive them from hillsphere.contracts.Contract"


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "command"])
def test_a_wrapped_component_satisfies_the_contracts_of_the_component(kind: str) -> None:
    """Every component of the kind, under every contract that any module declares."""
    protocols = _protocols()
    met = 0
    for record in default_registry().of_kind(kind):
        component = example(kind, record.component.type)
        for protocol in protocols:
            direct = isinstance(component, protocol)
            assert isinstance(Wrapper(component), protocol) == direct, (record, protocol)
            met += direct
    # of these kinds every component meets a contract that is checked where it is used
    has_contract = kind not in {"executor", "dispersions", "tracker", "stage", "plant", "body"}
    assert met or not has_contract


@pytest.mark.parametrize(
    ("contract", "kind", "type_"),
    [
        (Sensor, "sensor", "lidar"),
        (StationSensor, "sensor", "antenna"),
        (Compensator, "compensator", "lqr"),
        (SynthesisedLaw, "compensator", "lti"),
        (Estimator, "estimator", "unscented"),
        (Guidance, "guidance", "minimum_energy"),
        (OrbitFamily, "orbit_family", "qso"),
        (Surface, "shape", "ellipsoid"),
        (CaseStage, "stage", "closed_loop"),
    ],
)
def test_a_wrapper_is_what_it_wraps(contract: Any, kind: str, type_: str) -> None:
    component = example(kind, type_)
    assert isinstance(component, contract)
    assert isinstance(Wrapper(component), contract)
    assert isinstance(Wrapper(Wrapper(component)), contract)


class _Lacking:
    """Has all methods of a sensor but one."""

    channels = ()
    draws = (0, 0)

    def _method(self, *arguments: Any) -> Any:
        return None

    observe: Callable[..., Any] = _method
    visible: Callable[..., Any] = _method
    sigma: Callable[..., Any] = _method


class _Blocked(_Lacking):
    measure = None


class _Whole(_Lacking):
    measure = _Lacking._method


def test_a_missing_member_and_one_that_is_none_fail_the_contract() -> None:
    assert not isinstance(_Lacking(), Sensor)
    assert not isinstance(_Blocked(), Sensor)
    assert isinstance(_Whole(), Sensor)
    assert not isinstance(_Whole(), StationSensor)  # it extends Sensor by `station` and others
    assert not isinstance(object(), Sensor | Guidance)
    assert isinstance(Wrapper(_Whole()), Sensor | Guidance)


def test_a_member_that_raises_anything_but_attribute_error_tells_so() -> None:
    class Broken:
        @property
        def channels(self) -> Any:
            raise ZeroDivisionError("a fault of the sensor, not of its shape")

        draws = (0, 0)
        observe = visible = sigma = measure = _Lacking._method

    with pytest.raises(ZeroDivisionError):
        isinstance(Broken(), Sensor)


def test_a_class_that_derives_from_a_contract_is_checked_as_a_class() -> None:
    class Mine(_Whole, Sensor):
        pass

    assert not isinstance(_Whole(), Mine)
    assert isinstance(Mine(), Mine)
