"""A contract is checked by what an object answers: wrappers pass on every version of Python."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from hillsphere.base.contracts import Contract
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
from hillsphere.plugins import KINDS, create, default_registry
from hillsphere.spec import Ref
from hillsphere.testing import example, examples
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_refinement.scenes import orbit_of, starts
from hillsphere_estimators.orbit_refinement.specs import GeometrySpec
from hillsphere_sensors.body_surface import BodySurface
from hillsphere_sensors.heliocentric import heliocentric_scene
from hillsphere_tracking.live.calibration import _estimates

PACKAGES = ("hillsphere", *(f"hillsphere_{name}" for name in (
    "campaigns", "controllers", "dask", "estimators", "flight", "gravity", "guidance", "orbits",
    "plants", "sensors", "tracking",
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
    assert not plain, "derive them from hillsphere.base.contracts.Contract"


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
    elsewhere = {"executor", "format", "dispersions", "tracker", "stage", "plant", "body"}
    has_contract = kind not in elsewhere
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


def _with_references() -> list[tuple[str, str]]:
    found = []
    for record in default_registry():
        kind, type_ = record.component.kind, record.component.type
        if kind in ("command", "executor", "format"):
            continue
        (first, *_) = record.load_spec().examples
        spec = record.load_spec().model_validate(first)
        if any(other != "stage" for _, other, _ in spec.references()):
            found.append((kind, type_))
    return found


@pytest.mark.parametrize(("kind", "type_"), _with_references())
def test_a_component_takes_what_delegates_to_what_it_refers_to(
    kind: str, type_: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plugin author's wrapper was refused where a built-in class was asked for."""
    filling = examples._filling
    monkeypatch.setattr(examples, "_filling", lambda *of, **given: Wrapper(filling(*of, **given)))
    example(kind, type_)


@pytest.mark.parametrize(
    ("kind", "type_", "number", "wrapped"),
    [
        ("stage", "qso_family", 0, {"plant": None, "family": ("orbit_family", "qso")}),
        ("stage", "passes", 0, {"body": ("body", "planet")}),
        ("stage", "assisted_tracking", 0, {"body": ("body", "planet")}),
        ("stage", "formation_reference", 0, {"plant": ("plant", "proximity")}),
    ],
)
def test_a_stage_takes_a_wrapper_where_it_needs_a_certain_component(
    kind: str, type_: str, number: int, wrapped: dict[str, tuple[str, str] | None]
) -> None:
    spec = examples.bound_example(default_registry().get(kind, type_), default_registry(), number)
    given = {
        key: None if of is None else Ref("wrapped", Wrapper(example(*of)))
        for key, of in wrapped.items()
    }
    made = default_registry().get(kind, type_).load_target()(spec.model_copy(update=given))
    assert made.spec is not None


def test_bodies_with_a_place_in_the_solar_system_may_be_wrapped() -> None:
    planet = example("body", "solar_orbit")
    asteroid = example("body", "asteroid", 0)
    asteroid.mean_anomaly_rad = 0.3
    epoch, t = Epoch.parse("2029-01-01", "TDB"), np.array([0.0, 1e5])
    for body in (planet, asteroid):
        plain = heliocentric_scene(t, epoch, planet, body)
        there = heliocentric_scene(t, epoch, Wrapper(planet), Wrapper(body))
        np.testing.assert_array_equal(there["origin"], plain["origin"])
        states = orbit_of(Wrapper(body), "asteroid").states(t, epoch)
        np.testing.assert_array_equal(states, plain["origin"])
        geometry = GeometrySpec(name="near", epoch="2029-01-15", mean_anomaly_rad=0.1)
        np.testing.assert_array_equal(starts(Wrapper(body), (geometry,)), starts(body, (geometry,)))


def test_a_wrapped_ellipsoid_is_one_to_a_lidar_that_points() -> None:
    body = example("body", "moon")
    body.semi_axes_m, body.shape = (3.0, 2.0, 1.0), Wrapper(example("shape", "ellipsoid"))
    assert BodySurface(Ref("body", Wrapper(body)), "lidar").is_ellipsoid


def test_a_wrapped_tracker_that_estimates_biases_is_one() -> None:
    tracker = create("tracker", "least_squares", angle_biases=True)
    assert _estimates(tracker)
    assert _estimates(Wrapper(tracker))
