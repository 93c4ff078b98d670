"""The conformance kit finds what is broken in a gravity model or a plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, Vec3, constant, dot, power, sqrt
from hillsphere.testing import ContractViolation, check_gravity, check_plant

GM = 5.0e5


def points() -> Array:
    vectors = np.random.default_rng(3).normal(size=(3, 12))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0) * 2.0e4)


class PointMass:
    """A sound model; each fault below overrides one thing."""

    frame = "body"
    gm_m3_s2 = GM

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM, "m3/s2"),)

    def potential(self, r: Vec3, p: Params) -> Expr:
        return p["gm"] / sqrt(dot(r, r))

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        factor = -p["gm"] * power(dot(r, r), -1.5)
        return (factor * r[0], factor * r[1], factor * r[2])


class WrongSign(PointMass):
    def potential(self, r: Vec3, p: Params) -> Expr:
        return -(p["gm"] / sqrt(dot(r, r)))


class WrongFactor(PointMass):
    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        x, y, z = super().acceleration(r, p)
        return (x, y, 1.0001 * z)


class NotHarmonic(PointMass):
    """Consistent with itself, but the field of no mass: U = GM r₀^0.1 / r^1.1."""

    def potential(self, r: Vec3, p: Params) -> Expr:
        size: float = 2.0e4**0.1
        return p["gm"] * size * power(dot(r, r), -0.55)

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        size: float = 2.0e4**0.1
        factor = -1.1 * size * p["gm"] * power(dot(r, r), -1.55)
        return (factor * r[0], factor * r[1], factor * r[2])


class WrongMass(PointMass):
    gm_m3_s2 = 1.1 * GM


class DeadParameter(PointMass):
    def potential(self, r: Vec3, p: Params) -> Expr:
        return constant(GM) / sqrt(dot(r, r))

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        return super().acceleration(r, {"gm": constant(GM)})


class WrongNominal(PointMass):
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM), Parameter("gm", GM))


class Disagreeing(PointMass):
    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(p[0] / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-p[0] * r / np.linalg.norm(r, axis=0) ** 3)

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        x, y, z = super().acceleration(r, p)
        return (1.001 * x, y, z)


def test_a_sound_model_passes() -> None:
    check_gravity(PointMass(), points())


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (WrongSign, "must be \\+U, positive"),
        (WrongFactor, "acceleration against ∇U"),
        (NotHarmonic, "Laplace's equation fails"),
        (WrongMass, "against −GM/r²"),
        (DeadParameter, "parameter 'gm' changes nothing"),
        (WrongNominal, "names repeat"),
        (Disagreeing, "array against expression"),
    ],
)
def test_a_fault_of_a_gravity_model_is_found(model: Callable[[], Any], message: str) -> None:
    with pytest.raises(ContractViolation, match=message):
        check_gravity(model(), points())


class Pendulum:
    """A sound plant: ẍ = −k x + a, ½(v² + k x²) conserved, mirror x(−t)."""

    frame = "body:test"
    states: tuple[Variable, ...] = (Variable("x", 1), Variable("v", 1, -1))
    controls: tuple[Variable, ...] = (Variable("a", 1, -2),)
    scales = Scales(2.0, 5.0)
    integral_variable = Variable("energy", 2, -2)
    mirrors: Mapping[str, tuple[int, ...]] = {"start": (1, -1)}

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", 0.04, "1/s2"),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0] - p["k"] * x[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"top": x[1]}

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        return 0.5 * (x[1] * x[1] + p["k"] * (x[0] * x[0]))


class Damped(Pendulum):
    mirrors: Mapping[str, tuple[int, ...]] = {}

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], u[0] - p["k"] * x[0] - 1e-3 * x[1])


class WrongMirror(Pendulum):
    mirrors: Mapping[str, tuple[int, ...]] = {"start": (1, 1)}


class WrongMirrorLength(Pendulum):
    mirrors: Mapping[str, tuple[int, ...]] = {"start": (1, -1, 1)}


class DeadControl(Pendulum):
    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], -p["k"] * x[0])


class InfiniteEvent(Pendulum):
    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"top": x[1] / (x[0] - x[0] * 1.0)}


def states() -> Array:
    return np.random.default_rng(4).normal(size=(2, 8)) * [[2.0], [0.4]]


def test_a_sound_plant_passes() -> None:
    check_plant(Pendulum(), states())


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        (Damped, "integral of motion"),
        (WrongMirror, "mirror 'start'"),
        (WrongMirrorLength, "one sign per state"),
        (DeadControl, "control 'u:a' changes nothing"),
        (InfiniteEvent, "event 'top' is not finite"),
    ],
)
def test_a_fault_of_a_plant_is_found(plant: Callable[[], Any], message: str) -> None:
    with pytest.raises(ContractViolation, match=message):
        check_plant(plant(), states())


def test_states_of_the_wrong_shape_are_refused() -> None:
    with pytest.raises(ContractViolation, match=r"x must be \(2, N\)"):
        check_plant(Pendulum(), np.zeros((3, 4)))
