"""The stage ``transfers_reflown``: transfers at Phobos on truer equations.

The orbits are those of the Phobos QSO bifurcation paper, Table 1, to the digits of two independent
integrators; the transfers between them are made here by single shooting.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import Taylor
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array
from hillsphere.presentation import Panel, Space
from hillsphere.products import FlightSet, OrbitSet, PeriodicOrbits, Trajectories
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.transfers_reflown.presentation import present_reflown
from hillsphere_orbits.transfers_reflown.products import TransfersReflown
from hillsphere_orbits.transfers_reflown.stage import TransfersReflownStage

# x0 km: ẏ0, T; natural units
TABLE_1 = {
    100: (-8.40921768351853, 6.22507185085014),
    30: (-2.81471632617670, 4.73057690305042),
    20: (-2.26316654014995, 3.25671279975914),
}
PHOBOS_KM = 9377.0


@cache
def plant(name: str) -> Any:
    keys: dict[str, Any] = {
        "body": create(
            "body", "moon", name="phobos", primary_gm_km3_s2=42828.37,
            semi_major_axis_km=PHOBOS_KM, eccentricity=0.0151, libration_amplitude_deg=-1.09,
        ),
        "gravity": create(
            "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], density_g_cm3=1.86,
            gravitational_constant=6.674e-11,
        ),
    }  # fmt: skip
    if name == "hill":
        return create("plant", "hill", **keys)
    if name == "elliptic":
        keys |= {"orbit": "elliptic", "rotation": "libration"}
    if name == "point":  # a body without surface
        keys["gravity"] = create("gravity", "point_mass", gm_km3_s2=7.0596507848715e-4)
    return create("plant", "three_body", **keys)


@cache
def orbits() -> OrbitSet:
    flow = flow_of(plant("hill"))
    system = flow.system
    x0 = np.zeros((6, len(TABLE_1)))
    x0[0] = np.array(list(TABLE_1)) * 1e3 / system.unit[0]
    x0[4] = [vy for vy, _ in TABLE_1.values()]
    period = np.array([t for _, t in TABLE_1.values()])
    end, phi = flow.with_matrix(x0, period, 200)
    return OrbitSet(
        PeriodicOrbits(
            frame="hill:phobos",
            states=flow.names,
            x0=x0 * system.unit[:, None],
            period_s=period * system.time_unit_s,
            integral=np.full(len(TABLE_1), np.nan),
            monodromy=phi,
            residual=np.linalg.norm(end - x0, axis=0),
            labels=tuple(f"x = {x} km" for x in TABLE_1),
            length_m=float(system.unit[0]),
            time_s=system.time_unit_s,
        )
    )


def on(x_km: int, phase: float) -> Array:
    """State of an orbit at a part of its period, normalised."""
    flow, members = flow_of(plant("hill")), orbits().members
    i = list(TABLE_1).index(x_km)
    start = members.x0[:, i : i + 1] / flow.system.unit[:, None]
    end: Array = flow.plain.propagate(start, phase * TABLE_1[x_km][1], 200)
    return end[:, 0]


def shot(start: Array, place: Array, time: float) -> Array:
    """First state at the place of `start` that comes to `place` after a time, normalised."""
    flow = flow_of(plant("hill"))
    x = start.copy()
    for _ in range(40):
        end, phi = flow.with_matrix(x[:, None], time, 200)
        step = np.linalg.solve(phi[:3, 3:, 0], place - end[:3, 0])
        x[3:] += step * min(1.0, 0.3 / float(np.linalg.norm(step)))
        if np.linalg.norm(step) < 1e-13:
            return x
    raise AssertionError("no such transfer")


def coast(start: Array, time: float, states: int = 41) -> tuple[Array, Array]:
    """Return times, s, and states, SI, of a coast."""
    system = flow_of(plant("hill")).system
    t = np.linspace(0.0, time, states)
    x = Taylor(system).sample(start[:, None], t)[:, :, 0]
    return t * system.time_unit_s, x * system.unit[:, None]


def flights(plans: dict[str, list[tuple[Array, Array]]]) -> FlightSet:
    coasts = [one for given in plans.values() for one in given]
    most = max(t.size for t, _ in coasts)
    t_s, x = np.full((most, len(coasts)), np.nan), np.full((6, most, len(coasts)), np.nan)
    for i, (t, states) in enumerate(coasts):
        t_s[: t.size, i], x[:, : t.size, i] = t, states
    return FlightSet(
        Trajectories(
            "hill:phobos",
            flow_of(plant("hill")).names,
            tuple(name for name, given in plans.items() for _ in given),
            tuple(f"coast {k + 1}" for given in plans.values() for k in range(len(given))),
            t_s,
            x,
        )
    )


@cache
def direct(part: float = 0.5) -> list[tuple[Array, Array]]:
    """From the 100 km orbit to the 30 km one with an impulse on the way."""
    start, end = on(100, 0.2), on(30, 0.15)
    middle = (1.0 - part) * on(100, 0.45)[:3] + part * on(30, 0.4)[:3]
    first, second = coast(shot(start, middle, 1.5), 1.5), (middle, 2.9)
    guess = np.concatenate([second[0], on(30, 0.4)[3:]])
    t, x = coast(shot(guess, end[:3], second[1]), second[1], 61)
    return [first, (t + first[0][-1], x)]


@cache
def staying() -> list[tuple[Array, Array]]:
    """From the 100 km orbit to the 30 km one, and after a stay there to the 20 km one.

    The times leave the stay out.
    """
    one = coast(shot(on(100, 0.2), on(30, 0.6)[:3], 3.0), 3.0)
    t, x = coast(shot(on(30, 0.3), on(20, 0.8)[:3], 1.2), 1.2)
    system = flow_of(plant("hill")).system
    stay = 0.7 * TABLE_1[30][1] * system.time_unit_s
    return [one, (t + one[0][-1] + stay, x)]


def fly(*rungs: str, given: FlightSet | None = None, **keys: Any) -> TransfersReflown:
    known = flights({"direct": direct(), "staying": staying()}) if given is None else given
    stage = create(
        "stage", "transfers_reflown", needs={"flights": ["a"], "orbits": ["b"]},
        rungs=[plant(name) for name in rungs], **keys,
    )  # fmt: skip
    assert isinstance(stage, TransfersReflownStage)
    found = stage.run(RecordingContext(), flights=(known,), orbits=(orbits(),))
    check_product(found)
    check_presentation(stage.present(found, flights=(known,), orbits=(orbits(),)))
    return found


@pytest.fixture(scope="module")
def found() -> TransfersReflown:
    plans = ["direct", "staying"]
    return fly("hill", "circular", "elliptic", plans=plans, start_true_anomaly_deg=90)


@pytest.mark.slow
def test_every_plan_is_found(found: TransfersReflown) -> None:
    assert found.plans == ("direct", "staying")
    assert set(found.status) == {"reflown"}
    assert np.max(found.gap) < 1.5e-10
    assert np.max(found.closure_m) < 1e-6
    assert np.max(found.closure_m_s) < 1e-9


def test_patch_points(found: TransfersReflown) -> None:
    """Impulses by hand: where an orbit, a coast and the next one meet."""
    system = flow_of(plant("hill")).system
    speed = system.unit[3]
    a, b = direct()
    by_hand = [
        np.linalg.norm(a[1][3:, 0] - on(100, 0.2)[3:] * speed),
        np.linalg.norm(b[1][3:, 0] - a[1][3:, -1]),
        np.linalg.norm(b[1][3:, -1] - on(30, 0.15)[3:] * speed),
    ]
    np.testing.assert_allclose(found.patch_plan_dv_m_s[:3], by_hand, rtol=1e-9)
    assert found.patches[:3] == (
        "x = 100 km → coast 1", "coast 1 → coast 2", "coast 2 → x = 30 km",
    )  # fmt: skip
    assert found.patch_held == (
        "x = 100 km", "place of the plan", "x = 30 km",
        "x = 100 km", "x = 30 km", "x = 30 km", "x = 20 km",
    )  # fmt: skip
    np.testing.assert_array_equal(found.patch_plan, [0, 0, 0, 1, 1, 1, 1])
    for q in range(2):
        own = found.patch_plan == q
        total = np.sum(found.patch_dv_m_s[own], axis=0)
        np.testing.assert_allclose(found.dv_m_s[q], total, rtol=1e-14)


def test_the_first_rung_returns_the_plan(found: TransfersReflown) -> None:
    np.testing.assert_allclose(found.dv_m_s[:, 0], found.plan_dv_m_s, rtol=0, atol=3e-10)
    assert np.max(found.displacement_m[:, 0]) < 1e-6


def test_the_stay_is_flown(found: TransfersReflown) -> None:
    """0.7 of a period between the coasts, as the times tell."""
    period = TABLE_1[30][1] * plant("hill").scales.time_s
    np.testing.assert_allclose(found.stay_s, [0.0, 0.7 * period], rtol=0, atol=1e-3)
    first, second = staying()
    assert found.tof_s[1] == pytest.approx(second[0][-1] - first[0][0], abs=1e-3)


def test_the_next_rungs_differ_by_their_terms(found: TransfersReflown) -> None:
    """On the circle by the next term of the tide, L/a of the impulses; on the ellipse by e more."""
    change = np.abs(found.dv_m_s - found.plan_dv_m_s[:, None])
    relative = change / found.plan_dv_m_s[:, None]
    ratio = 100.0 / PHOBOS_KM
    assert np.all((relative[:, 1] > 0.003 * ratio) & (relative[:, 1] < 2.0 * ratio))
    assert np.all(relative[:, 2] < 10.0 * 0.0151)
    assert np.all(found.displacement_m[:, 2] > 1.5 * found.displacement_m[:, 1])
    # orbits move by x²/a, on the ellipse by e x
    assert np.all((found.displacement_m[:, 1] > 100.0) & (found.displacement_m[:, 1] < 3e3))
    assert np.all(found.displacement_m[:, 2] < 3.0 * 0.0151 * 100e3)


def test_coasts_of_the_last_rung_are_handed_on(found: TransfersReflown) -> None:
    """Solutions of its equations in its own states, the clock running on over the stay."""
    flown = found.flights
    assert flown.frame == plant("elliptic").frame
    assert flown.states[6] == "true_anomaly"
    assert flown.plans == ("direct", "direct", "staying", "staying")
    system = flow_of(plant("elliptic")).system
    for i in range(4):
        there = np.isfinite(flown.t_s[:, i])
        t, x = flown.t_s[there, i], flown.x[:, there, i] / system.unit[:, None]
        end = Taylor(system).propagate(x[:, :-1], np.diff(t) / system.time_unit_s)
        np.testing.assert_allclose(end, x[:, 1:], rtol=0, atol=1e-9)
        anomaly = plant("elliptic").true_anomaly_after(0.5 * np.pi, t)
        np.testing.assert_allclose(x[6], anomaly, rtol=0, atol=1e-9)


def test_the_phase_of_the_ellipse_counts(found: TransfersReflown) -> None:
    other = fly("hill", "elliptic", plans=["direct"], start_true_anomaly_deg=270)
    assert abs(other.dv_m_s[0, 1] - found.dv_m_s[0, 2]) > 0.01


def test_stay_without_a_time_goes_from_phase_to_phase() -> None:
    """Two coasts that follow one another at once, apart on an orbit that both end on."""
    system = flow_of(plant("hill")).system
    one = coast(on(30, 0.0), 1.0)
    t, x = coast(on(30, 0.75), 1.0)
    found = fly("hill", given=flights({"round": [one, (t + one[0][-1], x)]}))
    stay = 0.75 * TABLE_1[30][1] - 1.0
    assert found.status == ("reflown",)
    assert found.stay_s[0] == pytest.approx(stay * system.time_unit_s, abs=1e-3)
    assert found.plan_dv_m_s[0] < 1e-6
    assert found.flights.t_s[0, 1] == pytest.approx((1.0 + stay) * system.time_unit_s, abs=1e-3)


def test_the_cheapest_are_chosen() -> None:
    """Of each pair of orbits: one leads to the 30 km orbit, one to the 20 km one."""
    given = flights({"one": direct(), "two": direct(0.55), "staying": staying()})
    every = fly("hill", given=given)
    assert set(every.plans) == {"one", "two", "staying"}
    best = fly("hill", given=given, cheapest=1)
    assert best.plans[0] == every.plans[int(np.argmin(every.plan_dv_m_s[:2]))]
    assert best.plans[1] == "staying"


@pytest.mark.parametrize("z_m, kind", [(2.0, Panel), (2e4, Space)])
def test_paths_are_in_space_if_there_is_something_to_see(
    found: TransfersReflown, z_m: float, kind: type
) -> None:
    coasts = found.coast_m.copy()
    coasts[2] = z_m * np.sign(coasts[0])
    shown = present_reflown(replace(found, coast_m=coasts), "")
    chart: Any = shown.figures["transfers_reflown_paths"]
    (panel,) = chart.panels
    assert isinstance(panel, kind)


def test_plans_that_fail_are_rows() -> None:
    """Coasts that do not meet; and one that goes through the body."""
    one = coast(on(30, 0.0), 1.0)
    t, x = coast(shot(on(100, 0.2), on(30, 0.6)[:3], 3.0), 3.0)
    fall = np.array([0.8, 0.0, 0.0, -1.0, 0.0, 0.0])
    given = flights(
        {"apart": [one, (t + one[0][-1], x)], "falls": [coast(fall, 0.32, 201)], "good": [one]}
    )
    found = fly("hill", "circular", given=given, plans=["apart", "falls", "good"])
    assert found.status[0].startswith("not joined: coast 'coast 2' begins")
    assert found.status[3] == found.status[0]
    assert found.status[1] == "coast 'coast 1' meets the body"
    assert found.min_altitude_m[1, 0] == 0.0
    assert found.status[2] == "reflown"
    assert np.isnan(found.dv_m_s[:2]).all()
    assert found.flights.plans == ("good",)
    assert found.dv_m_s[2, 0] == pytest.approx(0.0, abs=1e-9)


def test_height_is_that_of_the_first_rung_where_there_is_none() -> None:
    """A point mass has no surface; its coasts are near those about the ellipsoid."""
    found = fly("hill", "point", plans=["staying"])
    assert found.min_altitude_m[0, 1] == pytest.approx(found.min_altitude_m[0, 0], rel=0.3)


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="no plan is called 'hazy'; there are: direct, staying"):
        fly("hill", plans=["hazy"])
    with pytest.raises(InputError, match="no plant is given"):
        fly()
    with pytest.raises(InputError, match="rungs: a plant is listed twice"):
        fly("hill", "circular", "hill")
    with pytest.raises(StageError, match="do not solve the equations of the first rung"):
        fly("circular")
    given = flights({"direct": direct()})
    for name, why in (("elliptic", "found first"), ("circular", "does not solve the equations")):
        needs = {"flights": ["a"]}
        stage = create("stage", "transfers_reflown", needs=needs, rungs=[plant(name)])
        with pytest.raises(StageError, match=why):
            stage.run(RecordingContext(), flights=(given,))
    given = FlightSet(
        replace(given.flights, plans=(), labels=(), t_s=np.empty((0, 0)), x=np.empty((6, 0, 0)))
    )
    assert fly("hill", given=given).plans == ()
