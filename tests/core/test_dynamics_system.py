"""A plant as a system of equations: units, run-time parameters, derivatives, errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from hillsphere.dynamics import (
    ArrayFunction,
    Derivatives,
    StepMap,
    System,
    system,
    variational_equations,
)
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, cos, dot, norm, parameter, sin, variable

GM, OMEGA = 7.0e5, 2.3e-4
LENGTH = (GM / OMEGA**2) ** (1 / 3)


@dataclass(frozen=True)
class HillPointMass:
    """Circular Hill problem, SI, with a small disturbance that depends on time."""

    amplitude: float = 0.0
    length_m: float = LENGTH

    frame = "hill:moon"
    states = (
        Variable("x", 1), Variable("y", 1), Variable("z", 1),
        Variable("vx", 1, -1), Variable("vy", 1, -1), Variable("vz", 1, -1),
    )  # fmt: skip
    controls = (Variable("ax", 1, -2), Variable("ay", 1, -2), Variable("az", 1, -2))
    integral_variable = Variable("jacobi", 2, -2)

    @property
    def mirrors(self) -> Mapping[str, tuple[int, ...]]:
        return {"xz": (1, -1, 1, -1, 1, -1)}

    @property
    def scales(self) -> Scales:
        return Scales(self.length_m, 1.0 / OMEGA)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", GM, "m3/s2"), Parameter("n", OMEGA, "rad/s"))

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        n, pull = p["n"], p["gm"] * norm(x[:3]) ** -3.0
        push = self.amplitude * cos(3.0 * n * t)
        return (
            *x[3:],
            2.0 * n * x[4] + 3.0 * n * n * x[0] - pull * x[0] + u[0] + push,
            -2.0 * n * x[3] - pull * x[1] + u[1],
            -n * n * x[2] - pull * x[2] + u[2],
        )

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"impact": norm(x[:3]) - 1.1e4}

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        n = p["n"]
        tide = 0.5 * n * n * (3.0 * x[0] * x[0] - x[2] * x[2])
        return tide + p["gm"] / norm(x[:3]) - 0.5 * dot(x[3:], x[3:])


X_SI = np.array([[2.9e4, 1.0e4, 500.0, 0.3, -4.0, 0.1], [4e4, -2e4, 50.0, 2.3, 4.0, -0.1]]).T
UNIT = Scales(LENGTH, 1 / OMEGA).of(HillPointMass.states)


def test_normalised_is_a_change_of_units_only() -> None:
    plant = HillPointMass(amplitude=1e-4)
    si, hat = system(plant), system(plant, normalised=True)
    np.testing.assert_array_equal(si.unit, np.ones(6))
    np.testing.assert_array_equal(hat.unit, UNIT)
    np.testing.assert_array_equal(si.scale, UNIT)
    np.testing.assert_array_equal(hat.scale, np.ones(6))
    assert (si.time_unit_s, hat.time_unit_s) == (1.0, 1 / OMEGA)
    assert hat.frame == "hill:moon"
    assert hat.mirrors == plant.mirrors

    t = np.array([100.0, 9000.0])
    x_hat = X_SI / UNIT[:, None]
    f_si = Derivatives(si).rate(X_SI, t=t)
    f_hat = Derivatives(hat).rate(x_hat, t=t * OMEGA)
    np.testing.assert_allclose(f_hat, f_si / OMEGA / UNIT[:, None], rtol=3e-15)

    assert si.integral is not None
    assert hat.integral is not None
    c_si, c_hat = si.function(si.integral)(X_SI), hat.function(hat.integral)(x_hat)
    np.testing.assert_allclose(c_hat, c_si / (LENGTH * OMEGA) ** 2, rtol=2e-15)
    # Events keep the plant's values: only where they vanish matters.
    g_si, g_hat = (s.function(s.events["impact"]) for s in (si, hat))
    np.testing.assert_allclose(g_hat(x_hat), g_si(X_SI), rtol=1e-14)


def test_normalised_equations_are_the_textbook_ones() -> None:
    # ẍ = 2ẏ + 3x − x/r³, ÿ = −2ẋ − y/r³, z̈ = −z − z/r³ (Hill's equations in units of L and 1/n).
    hat = system(HillPointMass(), normalised=True)
    x = np.array([1.2, 0.4, 0.3, 0.1, -2.4, 0.2])
    r3 = np.linalg.norm(x[:3]) ** 3
    expected = [
        *x[3:],
        2 * x[4] + 3 * x[0] - x[0] / r3,
        -2 * x[3] - x[1] / r3,
        -x[2] - x[2] / r3,
    ]
    np.testing.assert_allclose(Derivatives(hat).rate(x[:, None])[:, 0], expected, rtol=3e-15)


def test_flight_in_either_units_is_the_same_flight() -> None:
    plant = HillPointMass(amplitude=1e-4)
    seconds = 2.0e4
    a = StepMap(system(plant)).propagate(X_SI, seconds, 200, t0=500.0)
    hat = StepMap(system(plant, normalised=True))
    b = hat.propagate(X_SI / UNIT[:, None], seconds * OMEGA, 200, t0=500.0 * OMEGA)
    np.testing.assert_allclose(b * UNIT[:, None] / a, 1.0, rtol=8e-14)


@pytest.mark.parametrize("normalised", [False, True])
def test_run_time_parameters_equal_constants(normalised: bool) -> None:
    constant = system(HillPointMass(), normalised=normalised)
    late = system(HillPointMass(), run_time=["n", "gm"], normalised=normalised)
    assert late.run_time_names == ("n", "gm")
    x = X_SI / late.unit[:, None]
    expected = Derivatives(constant).rate(x)
    # Not to the bit: the compiler folds constants in another order.
    np.testing.assert_allclose(Derivatives(late).rate(x), expected, rtol=1e-13)
    np.testing.assert_allclose(Derivatives(late).rate(x, [OMEGA, GM]), expected, rtol=1e-13)
    # One column per lane, SI whatever the units of the states.
    p = np.array([[OMEGA, OMEGA], [GM, 2 * GM]])
    found = Derivatives(late).rate(x, p)
    double = found[3:, 1] - expected[3:, 1]
    size = GM / np.linalg.norm(X_SI[:3, 1]) ** 3
    pull = -size * X_SI[:3, 1] * late.time_unit_s / late.unit[3:]
    np.testing.assert_allclose(double, pull, rtol=5e-14)
    np.testing.assert_allclose(found[:, 0], expected[:, 0], rtol=1e-13)


def test_controls_are_accelerations_in_si() -> None:
    hat = system(HillPointMass(), normalised=True, run_time=["gm"], controls=True)
    assert hat.run_time_names == ("gm", "u:ax", "u:ay", "u:az")
    x = X_SI / UNIT[:, None]
    d = Derivatives(hat, ["u:ax", "u:ay", "u:az"])
    p = np.array([GM, 1e-5, 2e-5, -3e-5])
    change = d.rate(x, p) - d.rate(x)
    expected = np.array([0, 0, 0, 1e-5, 2e-5, -3e-5])[:, None] / (LENGTH * OMEGA**2)
    np.testing.assert_allclose(change, np.repeat(expected, 2, axis=1), rtol=0, atol=2e-15)
    _, jacobian = d.both(x, p)
    assert jacobian.shape == (6, 9, 2)
    by_control = np.vstack([np.zeros((3, 3)), np.eye(3) / (LENGTH * OMEGA**2)])
    np.testing.assert_allclose(jacobian[:, 6:], by_control[:, :, None].repeat(2, 2), rtol=2e-15)


def test_jacobian_by_complex_step() -> None:
    # An independent right-hand side in complex numpy; its imaginary part is exact to rounding.
    def rate(x: np.ndarray, gm: complex) -> np.ndarray:
        pull = gm * (x[0] ** 2 + x[1] ** 2 + x[2] ** 2) ** -1.5
        n = OMEGA
        return np.array(
            [
                x[3], x[4], x[5],
                2 * n * x[4] + 3 * n * n * x[0] - pull * x[0],
                -2 * n * x[3] - pull * x[1],
                -n * n * x[2] - pull * x[2],
            ]
        )  # fmt: skip

    late = system(HillPointMass(), run_time=["gm"])
    found = Derivatives(late, ["gm"]).both(X_SI)[1]
    for lane in range(2):
        expected = np.empty((6, 7))
        for j in range(6):
            moved = X_SI[:, lane].astype(complex)
            moved[j] += 1e-30j
            expected[:, j] = rate(moved, GM).imag / 1e-30
        expected[:, 6] = rate(X_SI[:, lane].astype(complex), GM + 1e-30j).imag / 1e-30
        np.testing.assert_allclose(found[:, :, lane], expected, rtol=1e-13, atol=1e-22)


def test_variational_equations_by_hand() -> None:
    hat = system(HillPointMass(), normalised=True)
    y, rate = variational_equations(hat)
    assert len(y) == len(rate) == 42
    rng = np.random.default_rng(3)
    x, phi = X_SI / UNIT[:, None], rng.normal(size=(6, 6, 2))
    found = ArrayFunction(rate, y)(np.concatenate([x, phi.reshape(36, 2)]))
    f, jacobian = Derivatives(hat).both(x)
    np.testing.assert_allclose(found[:6], f, rtol=1e-14)
    expected = np.einsum("ikN,kjN->ijN", jacobian, phi).reshape(36, 2)
    np.testing.assert_allclose(found[6:], expected, rtol=1e-13, atol=1e-15)


@dataclass(frozen=True)
class Odd:
    """A plant of one state with one fault."""

    fault: str = ""
    frame = "inertial"

    @property
    def states(self) -> tuple[Variable, ...]:
        if self.fault == "none":
            return ()
        return (Variable("x"), Variable("x" if self.fault == "twice" else "y"))

    @property
    def controls(self) -> tuple[Variable, ...]:
        return (Variable("push"),)

    @property
    def scales(self) -> Scales:
        return Scales(1.0, -1.0 if self.fault == "scales" else 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("rate", 2.0),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        if self.fault == "short":
            return (x[1],)
        if self.fault == "symbol":
            return (x[1], variable("hidden"))
        if self.fault == "parameter":
            return (x[1], parameter("hidden"))
        return (x[1], p.get("swing", p["rate"] * sin(t)) + u[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {"stop": variable("hidden")} if self.fault == "event" else {}

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        return (variable("hidden"),) if self.fault == "switch" else ()

    def time_terms(self, t: Expr, p: Params) -> Mapping[str, Expr]:
        if self.fault == "term":
            return {"swing": variable("hidden")}
        return {"rate" if self.fault == "term's name" else "swing": p["rate"] * sin(t)}


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("none", "Odd: states need different names, got []"),
        ("twice", "Odd: states need different names, got ['x', 'x']"),
        ("scales", "Odd: scales must be positive and finite"),
        ("short", "Odd: 2 states but 1 derivatives"),
        ("symbol", "Odd: derivative holds variables that are not states: ['hidden']"),
        ("parameter", "Odd: derivative holds parameters that it did not declare: ['hidden']"),
        ("event", "Odd: events holds variables that are not states: ['hidden']"),
        ("switch", "Odd: switches holds variables that are not states: ['hidden']"),
        ("term", "Odd: time_terms holds variables that are not states: ['hidden']"),
        ("term's name", "Odd: time_terms have names of parameters: ['rate']"),
    ],
)
def test_inconsistent_plants_are_refused(fault: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        system(Odd(fault), apart=True)
    assert message in str(caught.value)


@pytest.mark.parametrize("normalised", [False, True])
def test_terms_of_time_stand_apart(normalised: bool) -> None:
    apart = system(Odd(), apart=True, normalised=normalised)
    assert list(apart.time_terms) == ["swing"]
    assert not system(Odd()).time_terms
    # with the rate at run time the swing is no function of time alone
    assert not system(Odd(), apart=True, run_time=["rate"]).time_terms
    x, t = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 0.0]]), np.array([0.0, 0.7, 1.4])
    for when in (t, np.full(3, 0.7)):
        want = StepMap(system(Odd(), normalised=normalised)).propagate(x, 2.0, 10, None, when)
        found = StepMap(apart).propagate(x, 2.0, 10, None, when)
        np.testing.assert_allclose(found, want, rtol=1e-14)
    with pytest.raises(InputError, match="derivatives need a system without terms of time"):
        StepMap(apart, stm=True)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["rato"], "Odd has no parameter 'rato'; did you mean 'rate'?"),
        (["mass"], "Odd has no parameter 'mass'; it has ['rate']"),
        (["rate", "rate"], "given twice"),
        ("rate", "must be a sequence of names"),
    ],
)
def test_run_time_names_are_checked(names: Sequence[str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        system(Odd(), run_time=names)
    assert message in str(caught.value)


def test_shapes_and_names_are_checked_where_they_enter() -> None:
    s: System = system(Odd(), run_time=["rate"])
    with pytest.raises(InputError, match=r"p must be \(1,\) or \(1, 3\), got \(2, 1\)"):
        s.parameters(np.zeros(2), 3)
    with pytest.raises(InputError, match=r"x must be \(2, N\), got \(2,\)"):
        Derivatives(s).rate(np.zeros(2))
    with pytest.raises(InputError, match=r"derivatives by \['gm'\]"):
        Derivatives(s, ["gm"])
    with pytest.raises(InputError, match=r"derivatives by \['u:push'\]"):
        variational_equations(s, ["u:push"])


def test_parameters_default_to_their_nominal_values() -> None:
    s = system(Odd(), run_time=["rate"], controls=True)
    np.testing.assert_array_equal(s.parameters(None, 3), [[2.0] * 3, [0.0] * 3])
    given: Array = s.parameters([5.0, 1.0], 2)
    np.testing.assert_array_equal(given, [[5.0, 5.0], [1.0, 1.0]])
    none = system(Odd()).parameters(None, 4)
    assert none.shape == (0, 4)
