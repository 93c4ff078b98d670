"""Noise in the loop, and results that do not depend on the grouping of the work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from hashlib import sha256
from math import inf
from typing import Any, Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.simulation import (
    BLOCK,
    Cases,
    Flights,
    Limit,
    NavigationErrors,
    Simulator,
    Thruster,
    draws,
)
from hillsphere.symbolic import Expr, Params, cos, dot, power, sin

SIGMA = [10.0, 10.0, 10.0, 0.05, 0.05, 0.05]


class Wobbling:
    """A point's attraction with a power and trigonometric functions in it."""

    frame = "hill:toy"
    states = tuple(Variable(n, 1) for n in "xyz") + tuple(Variable("v" + n, 1, -1) for n in "xyz")
    controls = tuple(Variable("a" + n, 1, -2) for n in "xyz")
    scales = Scales(20e3, 1e3)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", 7e5, "m3/s2"), Parameter("c", 1e-4))

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        pull = -p["gm"] * power(dot(x[:3], x[:3]), -1.5)
        push = (sin(x[1] / 1e3 + 1e-3 * t), cos(x[2] / 1e3), sin(x[0] / 1e3))
        return (
            *x[3:],
            *(pull * q + p["c"] * w + a for q, w, a in zip(x[:3], push, u, strict=True)),
        )

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": dot(x[:3], x[:3]) / 18e3**2 - 1.0}


class Corrections:
    """Δv = −K y with a memory, through a product of matrices."""

    period_s = 600.0
    actuation: Literal["hold", "impulse"] = "impulse"
    gain = np.hstack([5e-4 * np.eye(3), 0.7 * np.eye(3), 0.01 * np.eye(3)])

    def initial(self, n_cases: int) -> Array:
        return np.zeros((3, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        u: Array = self.gain @ np.concatenate([ref - y, xc])
        return u, np.asarray(0.5 * xc + u)


def cases(count: int) -> Cases:
    random = np.random.default_rng(2)
    size = np.array([2e3, 2e3, 2e3, 1.0, 1.0, 1.0])[:, None]
    middle = np.array([20e3, 0.0, 0.0, 0.0, 4.0, 0.0])[:, None]
    return Cases(
        x0=middle + size * random.normal(size=(6, count)),
        p=np.array([[7e5], [1e-4]]) * (1.0 + 0.1 * random.normal(size=(2, count))),
    )


def some(all_cases: Cases, which: Any) -> Cases:
    return Cases(all_cases.x0[:, which], all_cases.p[:, which], numbers=np.asarray(which))


def loop() -> Simulator:
    return Simulator(
        Wobbling(),
        Corrections(),
        reference=[20e3, 0.0, 0.0, 0.0, 0.0, 0.0],
        navigation=NavigationErrors(SIGMA, 3600.0),
        actuator=Thruster(magnitude_sigma=0.02, pointing_sigma_rad=0.03, minimum=0.01),
        run_time=["gm", "c"],
        limits=[Limit("far", lambda t, x, n: 40e3 - np.sqrt(np.sum(x[:3] ** 2, axis=0)))],
        substeps=4,
    )


def same(one: Flights, other: Flights, here: Any, there: Any) -> None:
    """Assert that cases `here` of one are, to the bit, cases `there` of the other."""
    for part in fields(Flights):
        a, b = getattr(one, part.name), getattr(other, part.name)
        if isinstance(a, np.ndarray):
            assert_array_equal(a[..., here], b[..., there], err_msg=part.name)
    assert [one.status[i] for i in here] == [other.status[i] for i in there]


def test_same_bits_for_any_grouping_and_order_of_blocks() -> None:
    count = 2 * BLOCK + 23
    every, flier = cases(count), loop()
    whole = flier.fly(every, 20, seed=5)
    assert set(whole.status) >= {"completed", "impact"}
    places = np.arange(count)
    for first in (2 * BLOCK, 0, BLOCK):  # each block alone, in another order
        which = places[first : first + BLOCK]
        same(flier.fly(some(every, which), 20, seed=5), whole, range(len(which)), which)
    other_way = np.concatenate([places[BLOCK:], places[:BLOCK]])
    same(loop().fly(some(every, other_way), 20, seed=5), whole, range(count), other_way)
    same(flier.fly(every, 20, seed=5), whole, places, places)


def test_a_case_has_the_same_bits_among_other_neighbours() -> None:
    every, flier = cases(90), loop()
    whole = flier.fly(every, 20, seed=5)
    order = np.random.default_rng(8).permutation(90)
    same(flier.fly(some(every, order), 20, seed=5), whole, range(90), order)
    same(flier.fly(some(every, [17]), 20, seed=5), whole, [0], [17])


def test_seed_and_stage_change_the_noise() -> None:
    every, flier = cases(3), loop()
    first = flier.fly(every, 5, seed=5)
    assert not np.array_equal(flier.fly(every, 5, seed=6).x, first.x)
    assert not np.array_equal(flier.fly(every, 5, seed=5, stage="other").x, first.x)


def test_draws_are_numpys_own_of_case_stage_and_stream() -> None:
    numbers = np.array([3, 0, 3])
    found = draws(11, "verify", numbers, "navigation", (4, 2))
    assert found.shape == (4, 2, 3)
    key = [int.from_bytes(sha256(n).digest()[:8], "big") for n in (b"verify", b"navigation")]
    sequence = np.random.SeedSequence(11, spawn_key=(key[0], 3, key[1]))
    expected = np.random.Generator(np.random.PCG64(sequence)).standard_normal((4, 2))
    assert_array_equal(found[..., 0], expected)
    assert_array_equal(found[..., 2], expected)
    assert not np.isclose(found[..., 1], expected).any()
    other = draws(11, "verify", numbers, "actuator", (4, 2))
    assert not np.isclose(other, found).any()


def observed(errors: NavigationErrors, samples: int, count: int, period: float) -> Array:
    w = draws(1, "test", np.arange(count), "navigation", (samples + 1, errors.noise))
    x = np.arange(errors.noise, dtype=float)[:, None] * np.ones(count)
    memory = errors.initial(np.zeros(count), x, w[0])
    found = []
    for k in range(samples):
        t = np.full(count, k * period)
        y, memory = errors.observe(k, t, x, np.zeros((3, count)), w[k + 1], memory)
        found.append(y - x)
    return np.array(found)


def test_correlated_navigation_errors_have_their_covariance() -> None:
    tau, period, count = 1000.0, 300.0, 4000
    sigma = np.array([2.0, 0.5])
    e = observed(NavigationErrors(sigma, tau), 9, count, period)
    # The standard error of a variance of 4000 numbers is 2.2 %, of a correlation at most 1.6 %.
    assert_allclose(e.std(axis=2), np.broadcast_to(sigma, (9, 2)), rtol=0.06)
    for lag in (1, 3, 8):
        rho = np.mean(e[0] * e[lag], axis=1) / sigma**2
        assert_allclose(rho, np.exp(-lag * period / tau), rtol=0, atol=0.06)
    assert abs(np.mean(e[0, 0] * e[0, 1])) < 0.06


def test_white_navigation_errors_are_independent() -> None:
    e = observed(NavigationErrors([2.0, 0.5]), 4, 4000, 300.0)
    assert_allclose(e.std(axis=2), np.broadcast_to([2.0, 0.5], (4, 2)), rtol=0.06)
    assert_allclose(np.mean(e[0] * e[1], axis=1) / [4.0, 0.25], 0.0, rtol=0, atol=0.06)


def test_thruster_limits_keep_the_direction() -> None:
    thruster = Thruster(minimum=0.3, maximum=5.0, quantum=0.25)
    u = np.array([[3.0, 0.1, 30.0, 0.0], [4.0, 0.2, 40.0, 0.0], [0.0, 0.0, 0.0, 0.0]]) * 0.42
    assert thruster.noise == 0
    done = thruster.execute(u, np.empty((0, 4)))
    # 2.1 → 2.0 (eight quanta), 0.094 → 0, 21 → 5, 0 → 0.
    assert_allclose(
        done[:2].T, [[1.2, 1.6], [0.0, 0.0], [3.0, 4.0], [0.0, 0.0]], atol=1e-15, rtol=0
    )


def test_thruster_errors_have_their_sizes() -> None:
    thruster = Thruster(magnitude_sigma=0.05, pointing_sigma_rad=0.02, thrusters=2)
    u = np.repeat([[1.0], [2.0], [2.0], [0.0], [0.0], [0.1]], 4000, axis=1)
    w = draws(3, "test", np.arange(4000), "actuator", (thruster.noise,))
    done = thruster.execute(u, w).reshape(2, 3, -1)
    command = u.reshape(2, 3, -1)
    size = np.linalg.norm(done, axis=1)
    ratio = size / np.linalg.norm(command, axis=1)
    assert_allclose(ratio.mean(axis=1), 1.0, rtol=0, atol=0.003)
    assert_allclose(ratio.std(axis=1), 0.05, rtol=0.06)
    # The angle about each of two axes has this deviation: their squares add up.
    angle = np.arccos(np.sum(done * command, axis=1) / size / np.linalg.norm(command, axis=1))
    assert_allclose(np.sqrt(np.mean(angle**2, axis=1) / 2), 0.02, rtol=0.06)
    one = Thruster(magnitude_sigma=0.05, pointing_sigma_rad=0.5, dimension=1)
    along = one.execute(np.full((1, 2), -3.0), np.array([[1.0, 0.0], [9.0, 9.0]]))
    assert_allclose(along, [[-3.15, -3.0]])


@pytest.mark.parametrize(
    "options",
    [
        {"magnitude_sigma": -0.1},
        {"pointing_sigma_rad": inf},
        {"minimum": 2.0, "maximum": 1.0},
        {"thrusters": 0},
    ],
)
def test_a_thruster_refuses_numbers_without_meaning(options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        Thruster(**options)


def test_navigation_errors_refuse_what_does_not_fit() -> None:
    with pytest.raises(InputError, match="sigma must be"):
        NavigationErrors([1.0, -1.0])
    with pytest.raises(InputError, match="correlation_time_s"):
        NavigationErrors([1.0], -1.0)
    flier = Simulator(Wobbling(), Corrections(), navigation=NavigationErrors([1.0]))
    with pytest.raises(InputError, match="sigma has 1 elements, the plant 6 states"):
        flier.fly(Cases(np.ones((6, 1)) * 20e3), 1)
