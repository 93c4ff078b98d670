"""The compiled flow of a plant, and how another process gets it."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.interfaces import Array, Parameter
from hillsphere_orbits import flow as module
from hillsphere_orbits.flow import Compiled, flow_of

GM = 7.059650784871513e5


class TabulatedPointMass:
    """A point mass that hides its formula, as a table or a polyhedron would."""

    frame = "body"
    gm_m3_s2 = GM

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM, "m3/s2"),)

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(p[0] / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-p[0] * r / np.linalg.norm(r, axis=0) ** 3)


def sent(plant: Any) -> Any:
    """Return a plant as another process would get it."""
    return pickle.loads(pickle.dumps(Compiled(plant))).plant


def hill(gravity: Any) -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0
    )
    return create("plant", "hill", body=body, gravity=gravity)


def test_a_plant_takes_its_compiled_flow_along(plant: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    here = flow_of(plant)
    x = np.array([[1.9, 2.3], [0.0, 0.4], [0.1, 0.0], [0.1, 0.0], [-4.0, -4.5], [0.0, 0.2]])
    expected = here.with_matrix(x, np.array([1.0, 2.0]), 100)
    received = sent(plant)
    assert received is not plant

    def compiled_again(*args: object, **keys: object) -> None:
        raise AssertionError("it was compiled again")

    monkeypatch.setattr(module, "system", compiled_again)
    there = flow_of(received)
    assert there is not here
    assert flow_of(plant) is here
    found = there.with_matrix(x, np.array([1.0, 2.0]), 100)
    for one, other in zip(found, expected, strict=True):
        assert one.tobytes() == other.tobytes()


def test_what_is_not_compiled_yet_is_not_compiled_to_be_sent() -> None:
    fresh = hill(create("gravity", "point_mass", gm_m3_s2=GM))
    received = sent(fresh)
    for plant in (fresh, received):
        assert plant not in module._FLOWS


def test_functions_of_arrays_stay_behind() -> None:
    """They need not be picklable, even if the plant that makes them is."""
    opaque = hill(TabulatedPointMass())
    assert flow_of(opaque).system.external is not None
    _, (plant, flow) = Compiled(opaque).__reduce__()
    assert plant is opaque
    assert flow is None
