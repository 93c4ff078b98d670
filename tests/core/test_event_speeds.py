"""A length has a slope everywhere but at zero: flights that begin at rest, and their neighbours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.simulation import Cases, Flights, Simulator
from hillsphere.symbolic import Expr, Params, norm, sqrt

SPEED, RATE, PERIOD = 10.0, 0.2, 12.0


class Spring:
    """A plane oscillator that must not be too fast."""

    frame = "hill:toy"
    states = (
        Variable("x", 1), Variable("y", 1), Variable("vx", 1, -1), Variable("vy", 1, -1),
    )  # fmt: skip
    controls = (Variable("ux", 1, -2), Variable("uy", 1, -2))
    scales = Scales(100.0, 10.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[2], x[3], u[0] - RATE**2 * x[0], u[1] - RATE**2 * x[1])

    def size(self, v: tuple[Expr, ...]) -> Expr:
        return norm(v)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"speeding": 1.0 - self.size(x[2:4]) / SPEED}


class Rooted(Spring):
    """The same, its speed a root of which no more is known."""

    def size(self, v: tuple[Expr, ...]) -> Expr:
        return sqrt(v[0] * v[0] + v[1] * v[1])


class Idle:
    """No command."""

    actuation: Literal["hold", "impulse"] = "hold"
    period_s = PERIOD

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return np.zeros((2, y.shape[1])), xc


RESTING = np.array([[30.0], [0.0], [0.0], [0.0]])
FASTEST = np.array([1.000002, 1.0002, 1.02, 1.06, 0.9998])
"""Largest speeds, at half of the period; at both its ends most are slower by a third."""


def passing() -> Array:
    phase = 0.5 * np.pi - 0.5 * RATE * PERIOD
    size, zero = SPEED / RATE * FASTEST, np.zeros(len(FASTEST))
    return np.array([size * np.cos(phase), zero, -RATE * size * np.sin(phase), zero])


def fly(plant: Spring, *starts: Array) -> list[Flights]:
    """Fly one after the other in one simulator."""
    loop = Simulator(plant, Idle())
    return [loop.fly(Cases(x0), 1) for x0 in starts]


@pytest.mark.parametrize("plant", [Spring(), Rooted()])
@pytest.mark.parametrize("first", [RESTING, np.full((4, 1), np.nan), np.zeros((4, 1))])
def test_what_is_known_of_an_event_does_not_depend_on_the_first_flight(
    plant: Spring, first: Array
) -> None:
    x0 = passing()
    (alone,) = fly(plant, x0)
    assert alone.status == ("constraint",) * 4 + ("completed",)
    together = fly(plant, np.concatenate([first, x0], axis=1))[0]
    after = fly(plant, first, x0)[1]
    assert together.status[1:] == after.status == alone.status
    assert np.array_equal(together.time_s[1:], alone.time_s)
    assert np.array_equal(after.time_s, alone.time_s)


def test_flights_at_rest_are_decided_by_a_length_and_open_by_a_root() -> None:
    assert fly(Spring(), RESTING)[0].status == ("completed",)
    assert fly(Rooted(), RESTING)[0].status == ("unresolved",)


def test_a_length_is_bounded_by_what_its_vector_does() -> None:
    rng = np.random.default_rng(1)
    # Points of parabolas x + ẋ τ + ẍ τ²/2 about zero, and the length along them.
    x, rate, second = rng.uniform(-1.0, 1.0, (3, 3, 200))
    x[:, ::2] = 0.0

    def length(tau: float) -> Array:
        return np.asarray(np.linalg.norm(x + rate * tau + 0.5 * second * tau**2, axis=0))

    wide = 0.1
    box = [
        Bound((q - 2.0 * wide, q + 2.0 * wide), (v - wide, v + wide), iv.point(a))
        for q, v, a in zip(x, rate, second, strict=True)
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        found = norm(box)
    assert isinstance(found, Bound)
    assert found.rate is not None
    assert found.second is not None
    slope = (length(wide) - length(0.0)) / wide
    bend = (length(wide) - 2.0 * length(0.0) + length(-wide)) / wide**2
    for (low, high), value in ((found.rate, slope), (found.second, bend)):
        assert (low <= value + 1e-9).all()
        assert (value <= high + 1e-9).all()
    assert_allclose(found.second[0][::2], -np.linalg.norm(second[:, ::2], axis=0), rtol=1e-12)
