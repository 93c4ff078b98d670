"""Events of Taylor batches against flights in closed form: pairs, coincidences, touches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from hillsphere.dynamics import Taylor, system
from hillsphere.engine.dynamics.taylor_batches import TaylorBatches
from hillsphere.interfaces import Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params

from .test_dynamics_brackets import Throw as Thrown

RNG_SEED = 11


@dataclass(frozen=True)
class Throw(Thrown):
    """z̈ = −1 below a ceiling at z = 1; the top is v²/2 above the start."""

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"ceiling": 1.0 - x[0], "floor": x[0] - 1.0}


@dataclass(frozen=True)
class Circle:
    """A circle of radius one in the plane z = 0, about a centre at rest, and planes x = c."""

    frame = "inertial"
    states = (Variable("x", 1), Variable("y", 1), Variable("z", 1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("c", 0.5),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (-x[1], x[0], -x[2])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        near = x[0] - p["c"]
        return {"near": near, "far": -near, "steep": -near * (3.0 + x[1] + x[0] * x[0])}


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("apart", [1e-1, 1e-3, 1e-4, 1e-5, 1e-6])
def test_throws_that_graze(apart: float, sense: float) -> None:
    """Both crossings, `apart` of each other, are met, and the first, or the second, ends it."""
    v = np.random.default_rng(RNG_SEED).uniform(0.5, 2.0, 41)
    x = np.array([1.0 + apart**2 / 8.0 - 0.5 * v**2, sense * v])
    s = system(Throw())
    exact = sense * (v[None] + 0.5 * apart * np.array([[-1.0], [1.0]]))
    # rounding of z, 2e-16, over the speed at the crossing, half of `apart`
    atol = 4e-16 / apart
    met = Taylor(s, record=["ceiling"]).fly(x, sense * 5.0).crossings["ceiling"]
    assert [len(times) for times, _ in met] == [2] * 41
    np.testing.assert_allclose(np.array([t for t, _ in met]).T, exact, rtol=0, atol=10 * atol)
    for row, name in enumerate(("ceiling", "floor")):
        ends = Taylor(s, events=[name]).fly(x, sense * 5.0)
        assert set(ends.ended_by) == {name}
        np.testing.assert_allclose(ends.time, exact[row], rtol=0, atol=10 * atol)


@pytest.mark.parametrize("apart", [1e-1, 1e-3, 1e-4, 1e-5, 1e-6])
def test_a_circle_that_grazes_a_plane(apart: float) -> None:
    """On x = cos t the plane x = cos(apart/2) is met twice, `apart` of each other, each turn."""
    c = np.full((1, 5), np.cos(0.5 * apart))
    t = np.linspace(1.0, 3.0, 5)
    x = np.array([np.cos(t), np.sin(t), 0.0 * t])
    s = system(Circle(), run_time=["c"])
    met = Taylor(s, record=["near"]).fly(x, 13.0, c).crossings["near"]
    turns = 2.0 * np.pi * np.array([1.0, 1.0, 2.0, 2.0])
    for lane in range(5):
        exact = turns + 0.5 * apart * np.array([-1.0, 1.0, -1.0, 1.0]) - t[lane]
        np.testing.assert_allclose(met[lane][0], exact, rtol=0, atol=4e-14 / apart)
    ends = Taylor(s, events=["near"]).fly(x, 13.0, c)
    np.testing.assert_allclose(ends.time, 2 * np.pi + 0.5 * apart - t, rtol=0, atol=4e-14 / apart)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("order", [("near", "far"), ("far", "near"), ("near", "steep"),
                                   ("steep", "near")])  # fmt: skip
def test_an_event_that_falls_where_another_rises(order: tuple[str, str], sense: float) -> None:
    """One stop for the rise would leave the other event behind, below zero, unseen."""
    c = np.random.default_rng(RNG_SEED).uniform(-0.9, 0.9, (1, 400))
    start = np.zeros((3, 400))
    s = system(Circle(), run_time=["c"])
    flights = Taylor(s, events=order)
    for side, name in ((1.0, "near"), (-1.0, next(q for q in order if q != "near"))):
        start[0] = side
        ends = flights.fly(start, sense * 6.0, c)
        assert set(ends.ended_by) == {name}
        # the sine of the angle is above 0.43
        np.testing.assert_allclose(ends.time, sense * np.arccos(side * c[0]), rtol=0, atol=2e-14)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_flights_that_start_on_a_surface(sense: float) -> None:
    """On x = cos t at x = c: what falls ends there, also with no slope; what rises flies on."""
    s = system(Circle(), run_time=["c"])
    flights = Taylor(s, events=["near"])
    # at rest at the largest x, at the smallest, and on the way
    x = np.array([[1.0, -1.0, 0.6, 0.6], [0.0, 0.0, 0.8 * sense, -0.8 * sense], [0.0] * 4])
    ends = flights.fly(x, sense * 6.0, x[:1])
    assert ends.ended_by == ("near", None, "near", "near")
    exact = sense * np.array([0.0, 6.0, 0.0, 2.0 * np.arccos(0.6)])
    np.testing.assert_allclose(ends.time, exact, rtol=0, atol=1e-14)


def test_what_is_zero_throughout_is_no_crossing() -> None:
    s = system(Circle())
    x = np.array([[1.0, 1.0], [0.0, 0.0], [0.0, 1e-3]])
    met = Taylor(s, record={"plane": s.x[2], "turn": s.x[1]}).fly(x, 13.0).crossings
    assert [len(times) for times, _ in met["plane"]] == [0, 0]
    assert [len(times) for times, _ in met["turn"]] == [4, 4]


def test_a_fall_of_which_the_series_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sign at the end of the flight still tells; the flight is halved down to the clock."""

    def silent(self: TaylorBatches) -> list[Any]:
        return []

    monkeypatch.setattr(TaylorBatches, "_terminal", silent)
    s = system(Circle(), run_time=["c"])
    x = np.array([[1.0, 1.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    ends = Taylor(s, events=["near"], record={"turn": s.x[1]}).fly(x, [3.5, 0.5, 3.5])
    assert ends.ended_by == ("near", None, None)
    np.testing.assert_allclose(ends.time, [np.pi / 3.0, 0.5, 3.5], rtol=0, atol=1e-14)
    assert [len(times) for times, _ in ends.crossings["turn"]] == [0, 0, 1]
