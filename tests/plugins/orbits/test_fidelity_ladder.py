"""The stage ``fidelity_ladder``: quasi-satellite orbits of Phobos on truer equations.

The orbits are those of the Phobos QSO bifurcation paper, Table 1, to the digits of two independent
integrators.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import Taylor
from hillsphere.errors import InputError, StageError
from hillsphere.presentation import Area
from hillsphere.products import OrbitSet, PeriodicOrbits, load_product, save_product
from hillsphere.testing import RecordingContext
from hillsphere_orbits.fidelity_ladder.presentation import present_ladder
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.fidelity_ladder.stage import FidelityLadderStage
from hillsphere_orbits.flow import flow_of

pytestmark = pytest.mark.slow  # 40 s; the mission phobos-transfers climbs one besides

# x0 km: ẏ0, T, planar index; natural units
TABLE_1 = {
    100: (-8.40921768351853, 6.22507185085014),
    30: (-2.81471632617670, 4.73057690305042),
    22: (-2.35132133112351, 3.61248835499843),
    20: (-2.26316654014995, 3.25671279975914),
}
DAY = 86400.0


@cache
def body() -> Any:
    return create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0,
        eccentricity=0.0151, libration_amplitude_deg=-1.09,
    )  # fmt: skip


@cache
def ellipsoid() -> Any:
    return create(
        "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], density_g_cm3=1.86,
        gravitational_constant=6.674e-11,
    )  # fmt: skip


@cache
def plant(name: str) -> Any:
    keys: dict[str, Any] = {"body": body(), "gravity": ellipsoid()}
    if name == "hill":
        return create("plant", "hill", **keys)
    if name == "elliptic":
        keys |= {"orbit": "elliptic", "rotation": "libration"}
    return create("plant", "three_body", **keys)


def family(*x_km: int) -> OrbitSet:
    flow = flow_of(plant("hill"))
    scales = plant("hill").scales
    x0 = np.zeros((6, len(x_km)))
    x0[0] = np.array(x_km) * 1e3
    x0[4] = [TABLE_1[x][0] * scales.length_m / scales.time_s for x in x_km]
    period = np.array([TABLE_1[x][1] for x in x_km])
    end, phi = flow.with_matrix(x0 / flow.system.unit[:, None], period, 200)
    return OrbitSet(
        PeriodicOrbits(
            frame="hill:phobos",
            states=flow.names,
            x0=x0,
            period_s=period * scales.time_s,
            integral=np.full(len(x_km), np.nan),
            monodromy=phi,
            residual=np.linalg.norm(end - x0 / flow.system.unit[:, None], axis=0),
            labels=tuple(f"x = {x} km" for x in x_km),
            length_m=scales.length_m,
            time_s=scales.time_s,
        )
    )


def climb(orbits: OrbitSet, *rungs: Any, **keys: Any) -> FidelityLadder:
    stage = create(
        "stage", "fidelity_ladder", needs={"orbits": ["family"]}, rungs=list(rungs), **keys
    )
    assert isinstance(stage, FidelityLadderStage)
    found = stage.run(RecordingContext(), orbits=(orbits,))
    stage.present(found, orbits=(orbits,))
    return found


@pytest.fixture(scope="module")
def ladder() -> FidelityLadder:
    """Three days on three rungs."""
    rungs = [plant("hill"), plant("circular"), plant("elliptic")]
    return climb(family(100, 30, 20), *rungs, duration_d=3, start_true_anomaly_deg=30)


def test_every_flight_converges(ladder: FidelityLadder) -> None:
    assert ladder.converged.all()
    assert set(ladder.status) == {"converged"}
    assert np.max(ladder.gap) < 5e-10
    assert ladder.rungs == ("Hill", "CircularThreeBody", "EllipticThreeBody")
    assert ladder.state_counts == (6, 6, 7)


def test_departures(ladder: FidelityLadder) -> None:
    """Hill's orbits stay; the next term of the tide moves them by about x²/a, the ellipse more."""
    assert np.max(ladder.departure_max_m[:, 0]) < 1e-3
    x = np.array([100e3, 30e3, 20e3])
    ratio = ladder.departure_max_m[:, 1] / (x**2 / 9377e3)
    assert np.all((ratio > 0.2) & (ratio < 2.0))
    assert np.all(ladder.departure_max_m[:, 2] > 1.5 * ladder.departure_max_m[:, 1])
    assert np.all(ladder.departure_max_m[:, 2] < 0.05 * x)
    assert np.all(ladder.departure_rms_m < ladder.departure_max_m)
    # nodes are among the points of the flight
    assert np.all(np.max(ladder.departure_m, axis=0) <= ladder.departure_max_m * (1 + 1e-12))


def test_heights(ladder: FidelityLadder) -> None:
    """Nearest on the x axis, where the surface is at 13.03 km, without departures."""
    np.testing.assert_allclose(
        ladder.min_altitude_m[:, 0], np.array([100, 30, 20]) * 1e3 - 13030.0, rtol=0, atol=1e-2
    )
    change = np.abs(ladder.min_altitude_m - ladder.min_altitude_m[:, :1])
    assert np.all(change <= ladder.departure_max_m + 1e-2)


def test_stable_orbits_survive(ladder: FidelityLadder) -> None:
    np.testing.assert_allclose(ladder.survival_s, 3 * DAY, rtol=1e-15)
    assert set(ladder.fate) == {""}


def test_reference_is_a_flight_of_the_rung(ladder: FidelityLadder) -> None:
    made = flow_of(plant("elliptic")).system
    t, x = ladder.reference("EllipticThreeBody", "x = 30 km")
    assert x.shape == (7, len(t))
    assert x[6, 0] == pytest.approx(np.radians(30), abs=1e-14)
    scaled = x / made.unit[:, None]
    flown = Taylor(made).propagate(scaled[:, :-1], np.diff(t) / made.time_unit_s)
    np.testing.assert_allclose(flown, scaled[:, 1:], rtol=0, atol=1e-9)
    with pytest.raises(InputError, match="no rung 'hill'; it has Hill, CircularThreeBody"):
        ladder.reference("hill", "x = 30 km")


def test_flights_are_those_of_the_last_rung(ladder: FidelityLadder) -> None:
    flights = ladder.flights
    assert flights.frame == plant("elliptic").frame
    assert flights.states == ("x", "y", "z", "vx", "vy", "vz", "true_anomaly")
    assert flights.plans == flights.labels == ladder.members
    for m in range(3):
        np.testing.assert_array_equal(flights.x[:, :, m], ladder.x[:, :, m, 2])
        np.testing.assert_array_equal(flights.t_s[:, m], ladder.times_s)


def test_flights_are_held_on_their_own_plant() -> None:
    """Corrected every 6 h; real gravity moves the planar orbit metres off the plane."""
    file = Path(__file__).parents[3] / "missions" / "data" / "phobos-gravity-degree4.gfc"
    gravity = create("gravity", "harmonics", file=str(file))
    truest = create(
        "plant", "three_body", body=body(), gravity=gravity, orbit="elliptic", rotation="libration"
    )
    found = climb(family(30), plant("hill"), truest, duration_d=4)
    reach = np.max(np.abs(found.flights.x[:3, :, 0]), axis=1)
    assert 1.0 < reach[2] < 1e-2 * reach[1]
    stage = create(
        "stage", "station_keeping_flown", plant=truest, needs={"flights": ["ladder"]},
        intervals_h=[6], once_per_period=False, strategies=["periodic_lqr"], cases=16,
        duration_d=4,
    )  # fmt: skip
    held = stage.run(RecordingContext(), flights=(found,))
    assert held.labels == ("x = 30 km",)
    assert held.counts[held.statuses.index("completed"), 0, 0, 0] == 16
    assert 0.1 < held.cost_m_s[0, 0, 0] < 1.0
    assert held.deviation_m[0, 0, 0] < 3e3


def test_periodic_orbits_of_autonomous_rungs(ladder: FidelityLadder) -> None:
    """The same orbits on the first rung; neighbours of the same amplitude on the circle."""
    np.testing.assert_allclose(ladder.periodic_s[:, 0], ladder.period_s, rtol=1e-11)
    assert ladder.periodic_status[:6] == ("periodic",) * 6
    assert set(ladder.periodic_status[6:]) == {"the equations are not autonomous"}
    assert np.max(ladder.periodic_closure[:, :2]) < 5e-12
    np.testing.assert_allclose(ladder.periodic_x0_m[0, :, 1], [100e3, 30e3, 20e3], rtol=1e-14)
    change = np.abs(ladder.periodic_s[:, 1] / ladder.period_s - 1.0)
    assert np.all((change > 1e-6) & (change < 1e-2))
    assert np.isnan(ladder.periodic_s[:, 2]).all()


def test_flights_are_drawn_with_the_body(ladder: FidelityLadder) -> None:
    """The semi-axes 13.03 km along x and 11.4 km along y."""
    shown = present_ladder(ladder, "")
    chart: Any = shown.figures["fidelity_flights"]
    (panel,) = chart.panels
    outline: Any = next(mark for mark in panel.marks if isinstance(mark, Area))
    np.testing.assert_allclose([outline.x.max(), outline.y.max()], [13.03, 11.4], rtol=1e-3)
    assert outline.label == "Phobos"
    assert panel.y.text == "y, along the orbital velocity (km)"
    rows = [
        shown.tables[chart.table].rows[mark.rows] for mark in panel.marks if mark is not outline
    ]
    assert [row["member"] for row in rows] == [*ladder.members] * 2
    assert {row["rung"] for row in rows} == {ladder.rungs[-1]}


def test_product_is_written_and_read(ladder: FidelityLadder, tmp_path: Path) -> None:
    save_product(tmp_path / "ladder.npz", ladder)
    again = load_product(tmp_path / "ladder.npz")
    assert isinstance(again, FidelityLadder)
    assert np.array_equal(again.x, ladder.x, equal_nan=True)
    assert again.status == ladder.status


def test_orbits_near_a_resonance_with_the_ellipse() -> None:
    """30 days at 22 and 20 km, two revolutions of which take about one of Phobos.

    Steps from the orbits themselves lead astray there: their linear response to the ellipse is
    several times their size. The flights found begin from free ones and keep to a kilometre or two.
    """
    found = climb(family(22, 20), plant("hill"), plant("elliptic"), duration_d=30)
    assert found.converged.all()
    assert np.max(found.gap) < 5e-10
    assert np.all(found.departure_max_m[:, 1] < 2e3)
    assert np.all(found.iterations[:, 1] > 15)
    assert set(found.fate) == {""}


def test_lost_flights_tell_when() -> None:
    """Limits hardly beyond the orbit itself: the flight on the ellipse passes them."""
    found = climb(family(20), plant("hill"), plant("elliptic"), duration_d=2, limit=1.0001)
    assert found.fate == ("", "limit")
    assert found.survival_s[0, 0] == pytest.approx(2 * DAY)
    assert 0 < found.survival_s[0, 1] < 2 * DAY


def test_a_flight_that_fails_is_a_row() -> None:
    """Two arcs of twenty days are too long for the sub-steps that are tried at 20 km."""
    found = climb(family(100, 20), plant("hill"), plant("elliptic"), duration_d=40, segments=2)
    assert found.converged[0, 0]
    assert not found.converged[1].any()
    assert found.status[1].startswith("not converged: an arc passes too near")
    assert np.isnan(found.departure_max_m[1]).all()
    assert np.isnan(found.x[:, :, 1]).all()
    with pytest.raises(InputError, match="has no flight: not converged"):
        found.reference("EllipticThreeBody", "x = 20 km")


def test_bad_input_is_named() -> None:
    orbits = family(100)
    with pytest.raises(InputError, match="no orbit is called 'x = 99 km'; there are: x = 100 km"):
        climb(orbits, plant("hill"), members=["x = 99 km"])
    with pytest.raises(StageError, match="do not solve the equations of the first rung"):
        climb(orbits, plant("circular"), duration_d=1)
    with pytest.raises(StageError, match="do not solve the equations of the first rung"):
        climb(orbits, plant("elliptic"), duration_d=1)
    with pytest.raises(InputError, match="no plant is given"):
        climb(orbits)
    with pytest.raises(InputError, match="rungs: a plant is listed twice"):
        climb(orbits, plant("hill"), plant("circular"), plant("hill"))
    empty = OrbitSet(
        replace(
            orbits.members, x0=np.zeros((6, 0)), period_s=np.zeros(0), integral=np.zeros(0),
            monodromy=np.zeros((6, 6, 0)), residual=np.zeros(0), labels=(),
        )
    )  # fmt: skip
    with pytest.raises(InputError, match="no members"):
        climb(empty, plant("hill"))
