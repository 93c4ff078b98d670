"""One revolution as a station sees it, and turning the Earth for a highest elevation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere import create
from hillsphere.base.orientation import UT1_IS_UTC, ConstantOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_angle, earth_fixed
from hillsphere.time import Epoch
from hillsphere_sensors.antenna import Antenna
from hillsphere_tracking.assisted_tracking.sight import Sight, shift_for
from hillsphere_tracking.assisted_tracking.turned_earth import TurnedEarth
from hillsphere_tracking.satellites import MeanElementsOrbit

EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
PAPER = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
ORBIT = MeanElementsOrbit("SCD", EPOCH, PAPER)
SENSOR = create("sensor", "antenna", Antenna, station="A", latitude_deg=-2.18, longitude_deg=-44.26)
BEGIN, END = 4500.0, 10500.0  # about one revolution


def sight() -> Sight:
    return Sight(SENSOR, ORBIT, UT1_IS_UTC, BEGIN, END)


def elevations(t: Array, angle_rad: float) -> Array:
    turned = earth_fixed("teme", EPOCH, t, TurnedEarth(UT1_IS_UTC, angle_rad))
    return np.asarray(SENSOR.observe(ORBIT.states(t), t, {"earth_fixed": turned})[1])


def test_the_earth_is_turned_eastwards() -> None:
    base = ConstantOrientation(0.3)
    t = np.array([0.0, 5e4])
    angles = [earth_angle("teme", EPOCH, t, q) for q in (base, TurnedEarth(base, 0.2))]
    assert_allclose(angles[1] - angles[0], 0.2, rtol=0, atol=1e-9)
    assert TurnedEarth(base, 0.2).lapse(EPOCH, t) is None


@pytest.mark.parametrize("angle", [0.0, 0.05, -0.4])
def test_highest_point_and_pass_as_by_looking_at_every_second(angle: float) -> None:
    t = np.arange(BEGIN, END, 0.5)
    height = elevations(t, angle)
    when, top = sight().highest(angle)
    assert abs(when - t[np.argmax(height)]) <= 0.5
    assert top == pytest.approx(height.max(), abs=1e-5)
    found = sight().visit(angle, 1.0, (BEGIN - 1e3, END + 1e3))
    second = np.arange(BEGIN, END)
    above = second[elevations(second, angle) >= np.radians(5.0)]
    if above.size == 0:
        assert found is None
    else:
        assert found is not None
        assert (found.first_s, found.last_s) == (above[0], above[-1])
        edges = np.array([found.rise_s, found.set_s])
        assert_allclose(elevations(edges, angle), np.radians(5.0), rtol=0, atol=2e-9)


def test_a_pass_that_does_not_begin_or_end_in_sight() -> None:
    with pytest.raises(InputError, match="begins before 6100 s"):
        sight().visit(0.0, 1.0, (6100.0, END))
    with pytest.raises(InputError, match="lasts beyond 6300 s"):
        sight().visit(0.0, 1.0, (BEGIN, 6300.0))


@pytest.mark.parametrize("wanted_deg", [5.0, 15.9, 46.8, 80.0, 89.5])
def test_least_angle_for_an_elevation(wanted_deg: float) -> None:
    wanted, seen = np.radians(wanted_deg), sight()
    angle, same = shift_for(wanted, seen)
    assert same is seen
    assert seen.highest(angle)[1] == pytest.approx(wanted, abs=1e-8)
    # on the way there the elevation is always on the same side
    between = np.linspace(0.0, angle, 41)[1:-1]
    sides = {bool(seen.highest(a)[1] < wanted) for a in between}
    assert sides == {seen.highest(0.0)[1] < wanted}


def test_a_flight_that_turns_with_the_earth() -> None:
    flown: list[float] = []

    def other(angle: float) -> Sight:
        # tesserals shift a satellite along its track by some 100 m
        flown.append(angle)
        moved = PAPER.copy()
        moved[5] += 2e-5 * np.sin(2.0 * angle)
        return Sight(SENSOR, MeanElementsOrbit("SCD", EPOCH, moved), UT1_IS_UTC, BEGIN, END)

    angle, seen = shift_for(np.radians(30.0), sight(), other)
    assert seen.highest(angle)[1] == pytest.approx(np.radians(30.0), abs=1e-8)
    assert 2 <= len(flown) <= 5
    assert other(angle).highest(angle)[1] == pytest.approx(np.radians(30.0), abs=1e-8)
    assert abs(angle - flown[0]) > 1e-8


def test_an_elevation_that_cannot_be_reached() -> None:
    north = create("sensor", "antenna", Antenna, station="N", latitude_deg=38, longitude_deg=-44.26)
    seen = Sight(north, ORBIT, UT1_IS_UTC, BEGIN, END)
    with pytest.raises(InputError, match=r"however the Earth is turned; 60° cannot be reached"):
        shift_for(np.radians(60.0), seen)
