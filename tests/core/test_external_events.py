"""Events of a plant that are functions of arrays, without any plugin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere.dynamics import Derivatives, StepMap, Taylor, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, ExternalEvents, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, variable


class Falling:
    """A stone over a floor that is tabulated: z̈ = −g, the floor at h(x) + p t."""

    frame = "body:floor"
    states = (Variable("x", 1), Variable("z", 1), Variable("vx", 1, -1), Variable("vz", 1, -1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(10.0, 2.0)
    event_terms = (Variable("floor:height", 1),)
    calls = 0

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("g", 10.0, "m/s2"), Parameter("rise", 0.0, "m/s"))

    def derivative(self, x: Any, u: Any, t: Expr, p: Params) -> tuple[Expr, ...]:
        return (x[2], x[3], 0.0 * p["rise"], -p["g"])

    def events(self, x: Any, t: Expr, p: Params) -> dict[str, Expr]:
        return {"impact": x[1] - variable("floor:height"), "left": x[0] + 100.0}

    def event_terms_array(self, x: Array, t: Array, p: Array) -> Array:
        type(self).calls += 1
        assert x.shape == (4, len(t))
        return np.asarray(np.abs(x[:1]) + p[1:2] * t)


X = np.array([[-3.0, 1.0, 4.0], [50.0, 60.0, 70.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])


@pytest.mark.parametrize("normalised", [False, True])
def test_the_step_map_finds_them(normalised: bool) -> None:
    """h(x) + p t = z − g t²/2, with the time and the parameter of each lane."""
    assert isinstance(Falling(), ExternalEvents)
    made = system(Falling(), run_time=["rise"], normalised=normalised)
    rise = np.array([0.0, 1.0, -2.0])
    unit, second = made.unit[:, None], made.time_unit_s
    found = StepMap(made).locate("impact", X / unit, 6.0 / second, 30, rise[None])
    drop = X[1] - np.abs(X[0])
    expected = (-rise + np.sqrt(rise**2 + 20.0 * drop)) / 10.0
    assert found.found.all()
    np.testing.assert_allclose(found.time * second, expected, rtol=1e-13)
    level = made.function(*made.events.values())(X / unit, rise[None], 0.0)
    np.testing.assert_allclose(level, [X[1] - np.abs(X[0]), X[0] + 100.0], rtol=1e-14)


def test_they_are_evaluated_where_events_are_watched_only() -> None:
    made, Falling.calls = system(Falling()), 0
    flow = StepMap(made)
    flow.propagate(X, 1.0, 50)
    Derivatives(made).both(X)
    made.function(made.events["left"])(X)
    assert Falling.calls == 0
    flow.locate("left", X, 1.0, 10)
    assert Falling.calls == 0
    flow.locate("impact", X, 1.0, 10)
    assert 10 <= Falling.calls <= 20
    single = made.function(made.events["impact"])(X[:, 0])
    assert single.shape == (1,)


def test_the_taylor_propagator_takes_the_others() -> None:
    made = system(Falling())
    assert made.external_events(tuple(made.events.values())) == ["floor:height"]
    Taylor(made, events=["left"]).propagate(X, 1.0)
    with pytest.raises(InputError, match="an event holds floor:height, a function of arrays"):
        Taylor(made, events=["impact", "left"])


def test_a_plant_that_is_not_consistent_is_refused() -> None:
    class Undeclared(Falling):
        event_terms = (Variable("other", 1),)

    class InEquations(Falling):
        def derivative(self, x: Any, u: Any, t: Expr, p: Params) -> tuple[Expr, ...]:
            return (x[2], x[3], variable("floor:height"), -p["g"])

    class WrongShape(Falling):
        def event_terms_array(self, x: Array, t: Array, p: Array) -> Array:
            return np.zeros(x.shape[1])

    with pytest.raises(InputError, match="events holds variables"):
        system(Undeclared())
    with pytest.raises(InputError, match="derivative holds variables"):
        system(InEquations())
    with pytest.raises(InputError, match=r"event_terms_array must return \(1, 3\), got \(3,\)"):
        StepMap(system(WrongShape())).locate("impact", X, 1.0, 5)
