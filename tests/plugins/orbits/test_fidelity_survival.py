"""Flights under the surface between two looks, with gravity that is a function of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.plugins.orbits.test_flow import TabulatedPointMass

from hillsphere import create
from hillsphere.dynamics import Taylor, system
from hillsphere.symbolic import Expr, Params
from hillsphere_orbits.fidelity_ladder.rung import Rung
from hillsphere_orbits.fidelity_ladder.survival import survival


class BoundedPointMass(TabulatedPointMass):
    """It tells how strong it is."""

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        return p["gm"] / (distance * distance)


def hill(gravity: Any) -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0,
        semi_axes_km=[13.03, 11.40, 9.14],
    )  # fmt: skip
    return create("plant", "hill", body=body, gravity=gravity)


def chord(depth_m: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return a flight at 50 m/s along y, about so deep under the surface at y = 0, 30 s later."""
    return np.array([[13030.0 - depth_m], [-1500.0], [0.0], [0.0], [50.0], [0.0]])


LIMITS = np.full((3, 1), np.inf)
T_S = np.array([0.0, 60.0, 120.0])


@pytest.fixture(scope="module")
def exact() -> Taylor:
    """Return the same equations by Taylor series."""
    gravity = create("gravity", "point_mass", gm_m3_s2=TabulatedPointMass.gm_m3_s2)
    return Taylor(system(hill(gravity)), events=["impact"])


@pytest.fixture(scope="module")
def touching_m(exact: Taylor) -> float:
    """Return the depth at which a chord touches the surface, to a millimetre."""
    above, below = 0.0, 60.0
    while below - above > 1e-3:
        middle = 0.5 * (above + below)
        met = exact.fly(chord(middle), 120.0).ended_by[0] is not None
        above, below = (above, middle) if met else (middle, below)
    return below


@pytest.mark.parametrize("depth_m", [30.0, 1.0, 0.01])
def test_a_chord_under_the_surface_is_an_impact(
    depth_m: float, touching_m: float, exact: Taylor
) -> None:
    """It lasts 0.4 to 20 s of 120 s; the Taylor series tell when it begins."""
    x0 = chord(touching_m + depth_m)
    flight = exact.fly(x0, 120.0)
    assert flight.ended_by == ("impact",)
    time, fate = survival(Rung(hill(BoundedPointMass()), T_S, 0.0), x0, LIMITS)
    assert fate == ("impact",)
    np.testing.assert_allclose(time, flight.time, rtol=0, atol=1e-6)


def test_without_a_bound_a_flight_near_the_surface_is_not_decided(touching_m: float) -> None:
    time, fate = survival(
        Rung(hill(TabulatedPointMass()), T_S, 0.0), chord(touching_m - 1.0), LIMITS
    )
    assert fate == ("unresolved",)
    assert time[0] <= 30.0
    far = chord(-5000.0)
    _, fate = survival(Rung(hill(TabulatedPointMass()), T_S, 0.0), far, LIMITS)
    assert fate == ("",)
    _, fate = survival(Rung(hill(BoundedPointMass()), T_S, 0.0), chord(touching_m - 1.0), LIMITS)
    assert fate == ("",)


@pytest.mark.parametrize("gravity", ["formula", "arrays"])
def test_a_limit_is_passed_between_two_looks(gravity: str) -> None:
    """Its largest x lies within a half-arc, its ends are far inside."""
    formula = create("gravity", "point_mass", gm_m3_s2=TabulatedPointMass.gm_m3_s2)
    plant = hill(formula if gravity == "formula" else BoundedPointMass())
    x0 = np.array([[20000.0], [15000.0], [0.0], [6.0], [-50.0], [0.0]])
    t = np.linspace(0.0, 1200.0, 6001)
    x = Taylor(system(hill(formula))).sample(x0, t)[0, :, 0]
    largest, ends = x.max(), max(x[0], x[3000], x[6000])
    assert largest > ends + 100.0
    for limit, expected in ((0.999 * largest + 0.001 * ends, "limit"), (largest + 0.01, "")):
        limits = np.array([[limit], [np.inf], [np.inf]])
        _, fate = survival(Rung(plant, np.array([0.0, 1200.0]), 0.0), x0, limits)
        assert fate == (expected,)
