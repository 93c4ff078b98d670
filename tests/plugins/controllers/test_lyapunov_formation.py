"""Continuous control of a formation: its equations written out, and its loop by SciPy."""

from __future__ import annotations

from copy import copy
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.dynamics import ArrayFunction, system
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.simulation.flow import closed_system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.simulation import Cases, simulate
from hillsphere.symbolic import time, variables
from hillsphere.testing import check_compensator

GM, STIFF, DAMP, RAMP = 1.801599, 1e-5, 1e-4, 7200.0
AU = 1.495978707e11
PUSH = 0.2 * 0.04 * 4.56e-6 / (0.9224 * (1 - 0.1912)) ** 2
START = np.array(
    [29.0, -1503.4, 407.1, 0.0, -2e-4, 1e-4, -1.2, -2126.2, 550.5, 1e-4, 0.0, -1e-4]
)  # fmt: skip
REFERENCE = START * 0.95


def plant(count: int = 2, **keys: Any) -> Any:
    body = create(
        "body", "asteroid", name="apophis", semi_major_axis_au=0.9224, eccentricity=0.1912,
        rotation_rate_rad_s=5.8177e-5,
    )  # fmt: skip
    gravity = create(
        "gravity", "harmonics", gm_m3_s2=GM, reference_radius_m=191.0, normalisation="none",
        tide_system="none", coefficients=[{"n": 2, "m": 0, "c": -0.1}, {"n": 2, "m": 2, "c": 0.02}],
    )  # fmt: skip
    craft = {"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}
    return create(
        "plant", "proximity", body=body, gravity=gravity, spacecraft=[craft] * count, **keys
    )


def law(of: Any, **keys: Any) -> Any:
    given = {"plant": of, "period_s": 600.0, "ramp_s": RAMP, **keys}
    return create("compensator", "lyapunov_formation", **given)


def command(x: Array, ref: Array, t: float) -> Array:
    """Return the command of one spacecraft as the law is printed, at perihelion."""
    grown = 1 - np.exp(-t / RAMP)
    r = x[:3]
    cancelled = GM * r / np.linalg.norm(r) ** 3 - np.array([PUSH, 0, 0])
    return np.asarray(cancelled - grown * (STIFF * (r - ref[:3]) + DAMP * x[3:]))


def test_command_as_printed() -> None:
    made = law(plant())
    own = variables(*(v.name for v in made.states))
    seen = variables(*(f"y{i}" for i in range(12)))
    goal = variables(*(f"r{i}" for i in range(12)))
    told = ArrayFunction(made.control(own, seen, goal, time), [*own, *seen, *goal])
    found = told(np.concatenate([np.zeros(13), START, REFERENCE]), t=5.0)
    want = [command(START[i : i + 6], REFERENCE[i : i + 6], 5.0) for i in (0, 6)]
    np.testing.assert_allclose(found, np.concatenate(want), rtol=1e-9)
    # what the estimate has moved counts, and the reference goes on at its velocity
    moved = np.concatenate([np.full(12, 1e-3), [30.0]])
    found = told(np.concatenate([moved, START, REFERENCE]), t=5.0)
    ahead = REFERENCE.copy()
    for i in (0, 6):
        ahead[i : i + 3] += 30.0 * REFERENCE[i + 3 : i + 6]
    want = [command(START[i : i + 6] + 1e-3, ahead[i : i + 6], 5.0) for i in (0, 6)]
    np.testing.assert_allclose(found, np.concatenate(want), rtol=1e-9)


def test_rates_and_command_at_once_are_those_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """And bounds of the closed loop evaluate the command, and the orbit of the law, once."""
    of = plant()
    made = law(of)
    own = (*variables(*(v.name for v in made.states)),)
    told = own, variables(*(f"y{i}" for i in range(12))), variables(*(f"r{i}" for i in range(12)))
    rates, command = made.rates_and_command(*told, time)
    assert rates == made.derivative(*told, time)
    assert command == made.control(*told, time)
    loop, _ = closed_system(of, made, ())
    seen: list[Any] = []
    disturbances = type(of).disturbances

    def counted(*args: Any) -> Any:
        seen.append(args)
        return disturbances(*args)

    monkeypatch.setattr(type(of), "disturbances", counted)
    assert loop.bounded is not None
    y = [Bound.of(value) for value in (*START, *np.zeros(14))]
    p = [Bound.of(1.0).value for _ in loop.run_time]
    loop.bounded.rates(Bound.of(5.0), y, p)
    assert len(seen) == 1


def test_a_derived_law_is_bounded_by_its_own_command() -> None:
    """Half the command is half the effort; that of the class it derives from proves nothing."""
    of = plant()
    made = law(of)

    class Halved(type(made)):  # type: ignore[misc]
        def control(self, *told: Any) -> Any:
            return tuple(0.5 * u for u in super().control(*told))

    halved = copy(made)
    halved.__class__ = Halved
    p = [*np.zeros(6), *np.eye(6).ravel(), *REFERENCE, *START]
    efforts = []
    for one in (made, halved):
        loop, _ = closed_system(of, one, ())
        assert loop.bounded is not None
        assert len(loop.run_time) == len(p)
        y = [Bound.of(value) for value in (*START, *np.zeros(14))]
        told = [Bound.of(float(value)).value for value in p]
        efforts.append(loop.bounded.rates(Bound.of(5.0), y, told)[-1].value[0])
    assert efforts[1] == pytest.approx(0.5 * efforts[0], rel=1e-9)
    assert efforts[0] > 0.0


def test_loop_by_scipy() -> None:
    """Six hours of one spacecraft with the true state as estimate."""
    made = plant(1)
    equations = system(made, controls=True)
    rate = equations.function(*equations.rhs)
    ref = REFERENCE[:6]
    spin = made.scene  # the orbit's distance, for the pressure that the law cancels

    def motion(t: float, y: Array) -> Array:
        near = AU / -spin(np.array([t]))["sun"][0, 0]
        goal = ref.copy()
        goal[:3] += np.remainder(t, 600.0) * ref[3:]
        u = command(y, goal, t)
        u[0] += PUSH - 0.2 * 0.04 * 4.56e-6 * near**2
        return rate(y, u, t)

    end, y = 6 * 3600.0, START[:6]
    for k in range(36):
        y = solve_ivp(
            motion, (600.0 * k, 600.0 * k + 599.9999999), y, method="DOP853", rtol=1e-11, atol=1e-9
        ).y[:, -1]
    flown = simulate(
        made,
        law(made),
        Cases(START[:6, None]),
        int(end / 600.0),
        reference=ref,
        substeps=10,
        method="rk6",
    )
    np.testing.assert_allclose(flown.x[:6, 0], y, rtol=0, atol=1e-4)


def test_estimate_is_carried_on_between_samples() -> None:
    """With the plant that the law believes in, a sample brings nothing new, however rare."""
    made = plant(2)
    still = REFERENCE.copy()
    still[[3, 4, 5, 9, 10, 11]] = 0.0
    often, seldom = (
        simulate(
            made, law(made, period_s=period), Cases(START[:, None]), round(14400.0 / period),
            reference=still, substeps=round(period / 60.0), method="rk6",
        ).x[:12, 0]
        for period in (60.0, 3600.0)
    )  # fmt: skip
    np.testing.assert_allclose(seldom, often, rtol=0, atol=1e-9)
    for i in (0, 6):
        start, end = (np.linalg.norm(x[i : i + 3] - still[i : i + 3]) for x in (START, often))
        assert end < 0.6 * start


def test_contract() -> None:
    check_compensator(law(plant(1)), 6, 3)
    check_compensator(law(plant(2), ramp_s=0.0), 12, 6)


def test_another_plant_is_refused() -> None:
    body = create("body", "moon", primary_gm_m3_s2=4.3e13, semi_major_axis_m=9.4e6)
    field = create("gravity", "point_mass", gm_m3_s2=7e5)
    with pytest.raises(InputError, match="disturbances"):
        law(create("plant", "hill", body=body, gravity=field))
