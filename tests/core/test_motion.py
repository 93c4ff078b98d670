"""The motion of a plant in SI: against SciPy, finite differences, and its own reversal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hillsphere as hs
from hillsphere.dynamics import Trajectory
from hillsphere.errors import InputError

X0 = np.array([60e3, 0.0, 5e3, 0.0, -25.0, 0.5])
DURATION_S = 20000.0


@pytest.fixture(scope="module")
def motion() -> hs.Motion:
    gravity = hs.create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], density_g_cm3=1.86)
    phobos = hs.create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377)
    return hs.Motion(hs.create("plant", "hill", body=phobos, gravity=gravity))


def test_a_flight_is_that_of_scipy(motion: hs.Motion) -> None:
    path = motion.propagate(X0, DURATION_S, times_s=[0.0, 5000.0, DURATION_S])
    solved: Any = solve_ivp(
        lambda t, x: motion.derivative(x, t), (0.0, DURATION_S), X0, "DOP853",
        t_eval=[0.0, 5000.0, DURATION_S], rtol=1e-12, atol=1e-9,
    )  # fmt: skip
    np.testing.assert_allclose(path.x[:3], solved.y[:3], atol=1e-5)
    np.testing.assert_allclose(path.x[3:], solved.y[3:], atol=1e-9)
    np.testing.assert_array_equal(path[-1], path.x[:, -1])
    np.testing.assert_allclose(motion.end(X0, DURATION_S), path[-1], atol=1e-6)


def test_derivatives_are_those_of_differences(motion: hs.Motion) -> None:
    steps = np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
    lanes = X0[:, None] + np.concatenate([steps, -steps], axis=1)
    rates, ends = motion.derivative(lanes), motion.end(lanes, DURATION_S)
    by = 2.0 * np.diag(steps)
    end, phi = motion.stm(X0, DURATION_S)
    np.testing.assert_allclose(end, motion.end(X0, DURATION_S), atol=1e-5)
    assert abs(phi - (ends[:, :6] - ends[:, 6:]) / by).max() < 1e-8 * abs(phi).max()
    matrix = motion.jacobian(X0)
    assert abs(matrix - (rates[:, :6] - rates[:, 6:]) / by).max() < 1e-9 * abs(matrix).max()


def test_flights_run_backwards(motion: hs.Motion) -> None:
    there = motion.end(X0, DURATION_S)
    back = motion.propagate(there, -DURATION_S, t_s=DURATION_S)
    assert back.t_s[-1] == 0.0
    np.testing.assert_allclose(back[-1], X0, atol=1e-5)


def test_events_are_crossed_without_ending_the_flight(motion: hs.Motion) -> None:
    (impact,) = motion.crossings([13.5e3, 0.0, 0.0, 0.0, 0.0, 0.0], 1000.0)
    assert impact.name == "impact"
    assert np.linalg.norm(impact.x[:3] / [13.03e3, 11.4e3, 9.14e3]) == pytest.approx(1.0, abs=1e-9)


def test_a_trajectory_is_indexed_and_shown(motion: hs.Motion) -> None:
    path = motion.propagate(X0, DURATION_S, times_s=5)
    assert [len(path), len(path[1:3]), len(list(path))] == [5, 2, 5]
    np.testing.assert_array_equal(path["vy"], path.x[4])
    assert repr(path) == "<Trajectory: 5 states from 0 s to 20000 s, frame 'hill:body'>"
    frame = path.to_pandas()
    assert list(frame.columns) == ["x", "y", "z", "vx", "vy", "vz"]
    assert frame.loc[5000.0, "x"] == path.x[0, 1]
    assert path.plot().data[0].type == "scatter3d"


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: m.propagate(X0, 10.0, times_s=[20.0]), "time 20 s is not within the flight"),
        (lambda m: m.propagate(X0, 10.0, times_s=0), "number of times must be at least 1"),
        (lambda m: m.propagate(X0[:3], 10.0), "must be (6,) or (6, N), got (3,)"),
        (lambda m: m.end(X0 * np.nan, 10.0), "states must be finite"),
        (lambda m: m.crossings(X0, 10.0, ["landing"]), "no event 'landing'"),
        (lambda m: m.propagate(X0, 10.0)["w"], "no state 'w'; there are: x, y"),
        (lambda m: hs.Motion(m.plant, {"gm": 1.0}), "no parameter 'gm'; the plant has"),
    ],
)
def test_invalid_input_is_told(motion: hs.Motion, call: Any, message: str) -> None:
    with pytest.raises(InputError, match=message.replace("(", r"\(").replace(")", r"\)")):
        call(motion)


def test_parameters_may_be_given(motion: hs.Motion) -> None:
    lighter = hs.Motion(motion.plant, {"gravity.density": 930.0})
    change = motion.derivative(X0)[3:] - lighter.derivative(X0)[3:]
    # Half the density is half the attraction, which is what is left without the tidal terms.
    assert change[0] < 0.0
    whole = hs.Motion(motion.plant, {"gravity.density": 1e-9}).derivative(X0)[3:]
    np.testing.assert_allclose(2.0 * change, motion.derivative(X0)[3:] - whole, rtol=1e-9)


def test_a_trajectory_may_be_empty() -> None:
    assert repr(Trajectory(np.zeros(0), np.zeros((6, 0)), ("x",), "icrf")).startswith(
        "<Trajectory: no state"
    )
