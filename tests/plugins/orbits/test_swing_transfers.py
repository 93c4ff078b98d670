"""Transfers by way of swing orbits: 1:3 and 1:4 between the lower orbits of the Phobos QSO paper.

The published leg, from QSO-H to QSO-La, needs families of higher order: the slow tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.specs import PoolSpec
from hillsphere.dynamics import Taylor, system
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array
from hillsphere.products.product_codec import save_product
from hillsphere.runs import workers
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.swing_qso_families.curves import Swing
from hillsphere_orbits.swing_qso_families.products import SwingFamilies
from hillsphere_orbits.swing_transfers.products import SwingTransfers
from hillsphere_orbits.transfers.pareto import front

BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0, "name": "phobos"}
ROUTE = ["x = 50 km", "x = 30 km", "x = 22 km"]


def hill(gravity: Any) -> Any:
    return create("plant", "hill", body=create("body", "moon", **BODY), gravity=gravity)


@pytest.fixture(scope="module")
def family(plant: Any) -> QsoFamily:
    stage = create(
        "stage", "qso_family", plant=plant, x_amplitudes_km=[100, 50, 30, 22, 20],
        drift_revolutions=1,
    )  # fmt: skip
    found = stage.run(RecordingContext())
    assert isinstance(found, QsoFamily)
    return found


def swing_of(
    plant: Any,
    family: QsoFamily,
    resonances: Sequence[str],
    ctx: RecordingContext | None = None,
    **keys: Any,
) -> Any:
    bifurcations = create(
        "stage", "bifurcations", plant=plant, needs={"family": "family"}, planar=list(resonances)
    ).run(RecordingContext(), family=family)
    stage = create(
        "stage", "swing_qso_families", plant=plant, needs={"bifurcations": "bifurcations"},
        symmetries=["x", "y"], secondary=False, **keys,
    )  # fmt: skip
    return stage.run(ctx or RecordingContext(), bifurcations=bifurcations)


@pytest.fixture(scope="module")
def swing(plant: Any, family: QsoFamily) -> SwingFamilies:
    found = swing_of(plant, family, ["1:3", "1:4"], x_max_km=60)
    assert isinstance(found, SwingFamilies)
    return found


def stage(plant: Any, routes: Sequence[Sequence[str]], **keys: Any) -> Any:
    needs = {"family": "family", "swing": "swing"}
    return create("stage", "swing_transfers", plant=plant, needs=needs, routes=routes, **keys)


@pytest.fixture(scope="module")
def transfers(plant: Any, family: QsoFamily, swing: SwingFamilies) -> SwingTransfers:
    made = stage(plant, [ROUTE, ["x = 30 km", "x = 22 km"]])
    found = made.run(RecordingContext(), family=family, swing=swing)
    assert isinstance(found, SwingTransfers)
    return found


def least(transfers: SwingTransfers, leg: str, family: str) -> int:
    table = transfers.least
    for k in range(table.size):
        if (transfers.legs[table.leg[k]], transfers.families[table.family[k]]) == (leg, family):
            return k
    raise AssertionError(f"no transfer {leg} by way of {family}")


@pytest.mark.slow
def test_other_processes_find_the_same_bits(
    plant: Any,
    family: QsoFamily,
    swing: SwingFamilies,
    transfers: SwingTransfers,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(workers, "HERE_S", 0.0)
    ctx = RecordingContext(executor=Pool(PoolSpec(workers=2)))
    families = swing_of(plant, family, ["1:3", "1:4"], ctx, x_max_km=60)
    made = stage(plant, [ROUTE, ["x = 30 km", "x = 22 km"]])
    found = made.run(ctx, family=family, swing=families)
    for here, there in ((swing, families), (transfers, found)):
        save_product(tmp_path / "here", here)
        save_product(tmp_path / "there", there)
        assert (tmp_path / "here").read_bytes() == (tmp_path / "there").read_bytes()


def test_legs_of_the_routes(transfers: SwingTransfers) -> None:
    assert transfers.legs == ("x = 50 km to x = 30 km", "x = 30 km to x = 22 km")
    assert transfers.status == ("found", "found")
    assert transfers.orbits == tuple(ROUTE)
    assert transfers.routes.legs == ((0, 1), (1,))


def test_flown_from_end_to_end(transfers: SwingTransfers) -> None:
    """From the departure orbit's start to a revolution on the arrival orbit, by Taylor series."""
    for found in (transfers.least, transfers.front):
        assert found.closure_km.max() < 1e-8
        assert found.closure_m_s.max() < 1e-8
        assert found.altitude_m.min() > 0.0
    assert transfers.routes.closure_km.max() < 1e-8


def test_no_impulse_is_below_its_energy_bound(transfers: SwingTransfers) -> None:
    for found in (transfers.least, transfers.front):
        assert np.all(found.dv_m_s >= found.bound_m_s - 1e-9)
        assert np.all(found.total_m_s >= transfers.bound_m_s[found.leg])


def test_minimum_at_a_touching_member(
    transfers: SwingTransfers, plant: Any, family: QsoFamily, swing: SwingFamilies
) -> None:
    """1:3 touches the orbit of 50 km on the x axis: the member of that x, found by Newton.

    Both velocities are along y there, so that the impulse is the difference of two speeds.
    """
    k = least(transfers, "x = 50 km to x = 30 km", "1:3 x+")
    assert transfers.least.kind[k] == "touches x = 50 km"
    place = transfers.least.place_m[0, :, k]
    np.testing.assert_allclose(np.abs(place), [50e3, 0.0, 0.0], rtol=0, atol=1e-3)

    chains = Swing(swing, plant)
    number = transfers.families.index("1:3 x+")
    problem, branch = chains.problem(number), chains.branch(number)
    row = problem.unknowns.index("x")
    target = 50e3 / plant.scales.length_m
    # the orbit crosses the axis on both sides: at its start, or half a period later
    guess = branch.z[:, [int(np.argmin(np.abs(np.abs(branch.z[row]) - target)))]]
    if abs(abs(float(guess[row, 0])) - target) > 0.1:
        pytest.fail("no member of the chain starts near 50 km")
    z = correct(problem, guess, fix_component(row, np.sign(guess[row]) * target)).require_converged(
        "1:3"
    )
    x = problem.state(z)[:, 0]
    ours, theirs = abs(x[4]), abs(family.members.x0[4, 1]) / chains.flow.system.unit[4]
    expected = abs(ours - theirs) * chains.flow.system.unit[4]
    assert transfers.least.dv_m_s[0, k] == pytest.approx(expected, abs=1e-6)


def crossings(way: Array, radius: Array, angle: Array) -> Array:
    """Return positions in samples at which a way crosses a closed curve r(θ)."""
    order = np.argsort(angle)
    r = np.interp(np.arctan2(way[1], way[0]), angle[order], radius[order], period=2.0 * np.pi)
    g = np.hypot(way[0], way[1]) - r
    k = np.flatnonzero((g[1:] > 0) != (g[:-1] > 0))
    return np.asarray(k + g[k] / (g[k] - g[k + 1]))


def brute_force(plant: Any, family: QsoFamily, pair: tuple[int, int], x0: Array, t: float) -> float:
    """Return the least cost by one swing orbit from dense samples; infinite without a crossing."""
    equations = system(plant, normalised=True)
    taylor, unit = Taylor(equations), equations.unit
    way = taylor.sample(x0 / unit, np.linspace(0.0, t / equations.time_unit_s, 40001))
    total = 0.0
    for i in pair:
        period = family.members.period_s[i] / equations.time_unit_s
        orbit = taylor.sample(family.members.x0[:, i] / unit, np.linspace(0.0, period, 40001))
        angle, radius = np.arctan2(orbit[1], orbit[0]), np.hypot(orbit[0], orbit[1])
        place = crossings(way, radius, angle)
        samples = np.arange(way.shape[1])
        v = np.array([np.interp(place, samples, way[row]) for row in (3, 4)])
        at = np.arctan2(*(np.interp(place, samples, way[row]) for row in (1, 0)))
        order = np.argsort(angle)
        w = np.array(
            [np.interp(at, angle[order], orbit[row, order], period=2 * np.pi) for row in (3, 4)]
        )
        total += float(np.min(np.linalg.norm(v - w, axis=0), initial=np.inf))
    return total * float(unit[3])


@pytest.mark.parametrize("leg, pair", [(0, (1, 2)), (1, (2, 3))])
def test_minima_beside_a_scan(
    transfers: SwingTransfers, plant: Any, family: QsoFamily, swing: SwingFamilies, leg: int,
    pair: tuple[int, int],
) -> None:  # fmt: skip
    """No member is cheaper than its family's minimum, and those beside it are just dearer."""
    chains = Swing(swing, plant)
    own = transfers.member_leg == leg
    for f in np.unique(transfers.member_family[own]):
        members = own & (transfers.member_family == f)
        k = least(transfers, transfers.legs[leg], transfers.families[f])
        dv = float(transfers.least.total_m_s[k])
        assert dv <= transfers.member_dv_m_s[members].min() + 1e-6
        # the minimum itself, by samples of the orbits alone; tangent ones they cannot see
        if transfers.least.kind[k] == "interior" and transfers.least.angle_rad[:, k].min() > 0.01:
            x0, period = transfers.least.x0[:, k], float(transfers.least.period_s[k])
            assert brute_force(plant, family, pair, x0, period) == pytest.approx(dv, abs=1e-4)
            u = transfers.least.position[k] + np.array([-0.02, 0.02])
            x, t = chains.orbit(int(f), np.clip(u, 0.0, chains.branch(int(f)).size - 1.0))
            for i in range(2):
                start = x[:, i] * chains.flow.system.unit
                beside = brute_force(plant, family, pair, start, t[i] * plant.scales.time_s)
                assert beside >= dv - 1e-4


def test_front(transfers: SwingTransfers) -> None:
    for leg in range(2):
        own = transfers.front.leg == leg
        dv, tof = transfers.front.total_m_s[own], transfers.front.tof_s[own]
        assert front(dv, tof).all()
        assert dv.max() <= 2.0 * dv.min() * (1.0 + 1e-6)
        assert dv.min() == transfers.least.total_m_s[transfers.least.leg == leg].min()
        # no member of any family betters it
        assert dv.min() <= transfers.member_dv_m_s[transfers.member_leg == leg].min() + 1e-9


def test_route_is_its_legs_and_the_waiting(transfers: SwingTransfers, family: QsoFamily) -> None:
    routes, table = transfers.routes, transfers.least
    best = [np.flatnonzero(table.leg == leg) for leg in (0, 1)]
    best = [own[np.argmin(table.total_m_s[own])] for own in best]
    assert routes.total_m_s[0] == pytest.approx(table.total_m_s[best].sum(), abs=1e-9)
    assert routes.tof_s[0] == pytest.approx(table.tof_s[best].sum(), rel=1e-12)
    assert 0.0 <= routes.waiting_s[0] < family.members.period_s[2]
    assert routes.waiting_s[1] == 0.0


def test_flights_are_the_fronts_and_the_routes(transfers: SwingTransfers, plant: Any) -> None:
    """A coast per transfer of the fronts; a route's coasts are the waiting apart."""
    flights, front = transfers.flights, transfers.front
    count = front.size
    assert len(flights.plans) == count + 2
    assert len(set(flights.plans[:count])) == count
    assert flights.plans[count:] == (", ".join(ROUTE),) * 2
    np.testing.assert_allclose(flights.x[:3, 0, :count], front.place_m[0], rtol=0, atol=1e-3)
    np.testing.assert_allclose(flights.x[:3, -1, :count], front.place_m[1], rtol=0, atol=1e-3)
    np.testing.assert_allclose(flights.t_s[-1, :count], front.tof_s, rtol=1e-14)
    begin, end = flights.t_s[0, count:], flights.t_s[-1, count:]
    assert begin[0] == 0.0
    assert begin[1] - end[0] == pytest.approx(transfers.routes.waiting_s[0], abs=1e-6)
    made = system(plant, normalised=True)
    x = flights.x / made.unit[:, None, None]
    part = np.diff(flights.t_s, axis=0) / made.time_unit_s
    flown = Taylor(made).propagate(np.ascontiguousarray(x[:, 240]), part[240])
    np.testing.assert_allclose(flown, x[:, 241], rtol=0, atol=1e-12)


def test_what_makes_a_transfer_cheap(transfers: SwingTransfers) -> None:
    """Cost rises with the angle between the orbits and falls with the Jacobi constant."""
    assert np.all(transfers.rank[:, 0, 0] > 0.8)
    assert np.all(transfers.rank[:, 1, 0] < -0.5)
    assert np.all(transfers.rank[:, 0, 1] < 1e-6)
    assert np.all(transfers.rank[:, 1, 1] < 0.05)


def test_what_is_shown(
    transfers: SwingTransfers, plant: Any, family: QsoFamily, swing: SwingFamilies, tmp_path: Path
) -> None:
    check_product(transfers)
    published = tmp_path / "costs.csv"
    published.write_text("# source: a test\nleg,dv_m_s\nx = 30 km to x = 22 km,1.83\n")
    made = stage(plant, [ROUTE], reference=str(published), label="low")
    shown = made.present(transfers, family=family, swing=swing)
    check_presentation(shown)
    rows = shown.tables["table_5_low"].rows
    assert [row.get("dv_m_s_paper") for row in rows] == [None, 1.83]
    assert rows[0]["dv_less_paper_m_s"] is None
    assert rows[1]["dv_less_paper_m_s"] == pytest.approx(rows[1]["dv_m_s"] - 1.83)
    assert "tof_less_paper_d" not in rows[0]
    names = [column.name for column in shown.tables["table_5_low"].columns]
    assert names[1:4] == ["dv_m_s", "dv_m_s_paper", "dv_less_paper_m_s"]
    assert {"swing_least_low", "swing_front_low", "swing_routes_low"} <= set(shown.tables)


def test_leg_that_no_family_connects(plant: Any, family: QsoFamily, swing: SwingFamilies) -> None:
    """Families that end at 60 km do not reach the orbit of 100 km: a result, not an error."""
    made = stage(plant, [["x = 100 km", "x = 50 km", "x = 30 km"]])
    found = made.run(RecordingContext(), family=family, swing=swing)
    assert found.status == ("no member of any family meets x = 100 km", "found")
    assert np.isnan(found.routes.total_m_s[0])
    check_product(found)
    shown = made.present(found, family=family, swing=swing)
    check_presentation(shown)
    assert any("no transfer through swing orbits" in sentence for sentence in shown.verdict)


@pytest.mark.parametrize(
    "routes, words",
    [
        ([], "no route is asked for"),
        ([["a"]], "two orbits at least"),
        ([["a", "a"]], "to another orbit"),
        ([["a", "b"], ["a", "b"]], "stands twice"),
    ],
)
def test_bad_routes(plant: Any, routes: list[list[str]], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        stage(plant, routes)


def test_orbit_that_is_not_there(plant: Any, family: QsoFamily, swing: SwingFamilies) -> None:
    made = stage(plant, [["x = 50 km", "QSO-X"]])
    with pytest.raises(InputError, match="has no orbit 'QSO-X'; it has 'x = 100 km'"):
        made.run(RecordingContext(), family=family, swing=swing)


def test_other_equations(family: QsoFamily, swing: SwingFamilies) -> None:
    other = hill(create("gravity", "point_mass", gm_km3_s2=7.0596507848715e-4))
    with pytest.raises(StageError, match="do not solve the equations"):
        stage(other, [ROUTE]).run(RecordingContext(), family=family, swing=swing)


def test_reference_without_its_columns(plant: Any, tmp_path: Path) -> None:
    published = tmp_path / "costs.csv"
    published.write_text("# source: a test\nname,cost\na,1\n")
    with pytest.raises(InputError, match="need the columns leg and dv_m_s"):
        stage(plant, [ROUTE], reference=str(published))


@pytest.mark.slow
def test_published_leg(plant: Any, family: QsoFamily) -> None:
    """QSO-H to QSO-La: 21 m/s in Table 5; by 1:5 and 1:9 at the members that touch QSO-H."""
    swing = swing_of(plant, family, ["1:5", "1:6", "1:9"], x_max_km=200)
    made = stage(plant, [["x = 100 km", "x = 30 km"]])
    found = made.run(RecordingContext(), family=family, swing=swing)
    leg = found.legs[0]
    # each to 1e-3 m/s, on chains of other members than those it was first computed with
    for name, dv in (("1:5 x+", 16.2475), ("1:9 x+", 13.9129)):
        k = least(found, leg, name)
        assert found.least.total_m_s[k] == pytest.approx(dv, abs=1e-3)
        assert found.least.kind[k] == "touches x = 100 km"
    assert found.least.total_m_s.min() == pytest.approx(13.9129, abs=1e-3)
    assert found.least.closure_km.max() < 1e-7
