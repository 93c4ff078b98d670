from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.errors import NotStabilisableError, SingularProblemError
from hillsphere_controllers.full_order.h2 import H2Design, h2_synthesis, optimal_cost
from hillsphere_controllers.systems.algebra import lower_lft

MATRICES = ("a", "b", "c", "d")


def plant(seed: int, order: int, k: int, q: int, dt_s: float | None = None) -> LtiSystem:
    """One with every matrix full, D11 zero in continuous time."""
    random = np.random.default_rng(seed)
    p = m = k + q + 1
    d = random.normal(size=(p + q, m + k))
    a = random.normal(size=(order, order))
    if dt_s is None:
        d[:p, :m] = 0.0
    return LtiSystem(
        a if dt_s is None else 0.6 * a,
        random.normal(size=(order, m + k)),
        random.normal(size=(p + q, order)),
        d,
        dt_s,
    )


def scalar_plant(a: float) -> LtiSystem:
    """ẋ = a x + w₁ + u, z = (x, u), y = x + w₂."""
    return LtiSystem(
        np.array([[a]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
    )


@pytest.mark.parametrize("a", [-2.0, 0.0, 3.0])
def test_scalar_problem_in_closed_form(a: float) -> None:
    """Both equations read 2 a x + 1 = x², the controller is −x²/(s + 2x − a), the cost x + x³."""
    x = a + np.sqrt(a * a + 1.0)
    found = h2_synthesis(scalar_plant(a), 1, 1)
    # tr B1ᵀ X B1 + tr F Y Fᵀ with X = Y = −F = x
    assert_allclose(found.norm, np.sqrt(x + x**3), rtol=1e-10)
    s = 1j * np.array([0.0, 0.7, 20.0])
    assert_allclose(
        found.controller.response(s.imag)[:, 0, 0], -(x**2) / (s + 2.0 * x - a), rtol=1e-10
    )


def from_matrices(made: dict[str, Array], dt_s: float | None = None) -> LtiSystem:
    return LtiSystem(made["a"], made["b"], made["c"], made["d"], dt_s)


def without_direct(loop: LtiSystem) -> LtiSystem:
    return replace(loop, d=np.zeros_like(loop.d)) if loop.dt_s is None else loop


def slope(given: LtiSystem, design: H2Design) -> float:
    """Return the largest derivative of log ‖T‖₂ by any entry of the controller."""
    made, step, worst = design.controller, 1e-6, 0.0
    for name in MATRICES if given.dt_s is not None else MATRICES[:3]:
        for place in np.ndindex(getattr(made, name).shape):
            norms = []
            for sign in (1.0, -1.0):
                moved = {key: np.array(getattr(made, key)) for key in MATRICES}
                moved[name][place] += sign * step
                loop = lower_lft(given, from_matrices(moved, made.dt_s))
                norms.append(h2_norm(without_direct(loop)))
            worst = max(worst, abs(norms[0] - norms[1]) / (2.0 * step * design.norm))
    return worst


@pytest.mark.parametrize("dt_s", [None, 0.1])
@pytest.mark.parametrize("seed", range(4))
def test_no_entry_of_the_controller_can_be_bettered(seed: int, dt_s: float | None) -> None:
    k, q = 1 + seed % 2, 2 - seed % 2
    given = plant(seed, 2 + seed, k, q, dt_s)
    found = h2_synthesis(given, k, q)
    loop = without_direct(lower_lft(given, found.controller))
    assert loop.is_stable
    assert_allclose(h2_norm(loop), found.norm, rtol=1e-9)
    assert slope(given, found) < 3e-6


@pytest.mark.parametrize("seed", range(6))
def test_slicot_finds_the_same(seed: int) -> None:
    slycot = pytest.importorskip("slycot")
    k, q = 1 + seed % 2, 2 - seed % 2
    given = plant(10 + seed, 3 + seed, k, q)
    made = slycot.sb10hd(
        given.order, given.shape[1], given.shape[0], k, q, given.a, given.b, given.c, given.d, 0.0
    )
    theirs = without_direct(lower_lft(given, LtiSystem(*made[:4])))
    assert_allclose(h2_synthesis(given, k, q).norm, h2_norm(theirs), rtol=1e-7)


@pytest.mark.parametrize("discrete", [False, True])
def test_optimal_cost_is_what_the_flight_costs(discrete: bool) -> None:
    """From a state, without disturbance: the energy of C x + D u, and no less by another gain."""
    random = np.random.default_rng(8)
    a, b = random.normal(size=(4, 4)), random.normal(size=(4, 2))
    c, d = random.normal(size=(5, 4)), random.normal(size=(5, 2))
    x, f = optimal_cost(a, b, c, d, discrete=discrete)
    start = random.normal(size=(4, 1))

    def cost(gain: Array) -> float:
        """‖C (s − A)⁻¹ x0‖₂², the energy; in steps it begins one step late."""
        flown = LtiSystem(
            a + b @ gain, start, c + d @ gain, np.zeros((5, 1)), 1.0 if discrete else None
        )
        return h2_norm(flown) ** 2

    assert_allclose(cost(f), float((start.T @ x @ start)[0, 0]), rtol=1e-9)
    assert all(cost(f + 1e-3 * random.normal(size=f.shape)) > cost(f) for _ in range(20))


def test_units_of_states_controls_and_measurements_change_nothing() -> None:
    given = plant(2, 4, 1, 1)
    x, u = 10.0 ** np.array([6.0, -6.0, 3.0, 0.0]), np.array([1.0, 1.0, 1.0, 1e5])
    y = np.array([1.0, 1.0, 1.0, 1e-6])[:, None]
    scaled = LtiSystem(
        given.a / x[:, None] * x, given.b / x[:, None] * u, y * given.c * x, y * given.d * u
    )
    found = h2_synthesis(scaled, 1, 1)
    assert_allclose(found.norm, h2_synthesis(given, 1, 1).norm, rtol=1e-8)
    loop = without_direct(lower_lft(scaled, found.controller))
    assert_allclose(h2_norm(loop), found.norm, rtol=1e-6)


def test_what_is_stable_need_not_be_reached_nor_seen() -> None:
    """A mode that is neither: the plant is not minimal, the controller all the same optimal."""
    given = scalar_plant(1.0)
    more = LtiSystem(
        np.diag([1.0, -3.0, -4.0]),
        np.vstack([given.b, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]]),
        np.hstack([given.c, [[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]]),
        given.d,
    )
    assert_allclose(h2_synthesis(more, 1, 1).norm, h2_synthesis(given, 1, 1).norm, rtol=1e-9)


def changed(given: LtiSystem, **entries: list[list[float]]) -> LtiSystem:
    kept = {name: np.array(entries.get(name, getattr(given, name))) for name in MATRICES}
    return from_matrices(kept)


def test_what_has_no_optimum_is_named() -> None:
    given = scalar_plant(1.0)
    for made, error, message in (
        (changed(given, b=[[1.0, 0.0, 0.0]]), NotStabilisableError, "controls do not reach"),
        (changed(given, c=[[1.0], [0.0], [0.0]]), NotStabilisableError, "do not show"),
        (
            changed(given, d=[[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
            SingularProblemError,
            "D11",
        ),
        (
            changed(given, d=[[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
            SingularProblemError,
            "D12 lacks full rank",
        ),
        (
            changed(given, d=[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]),
            SingularProblemError,
            "D21 lacks full rank",
        ),
        (  # an integrator that costs nothing
            changed(scalar_plant(0.0), c=[[0.0], [0.0], [1.0]]),
            SingularProblemError,
            "not weighted",
        ),
    ):
        with pytest.raises(error, match=message):
            h2_synthesis(made, 1, 1, regularisation=0.0)
    for k, q in ((0, 1), (1, 4), (4, 1)):
        with pytest.raises(InputError, match="do not fit a plant"):
            h2_synthesis(given, k, q)


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_zeros_of_a_square_problem_are_mirrored(seed: int, discrete: bool) -> None:
    """As many weighted outputs as controls: nothing else is weighted than the zeros outside."""
    random = np.random.default_rng(seed)
    a, b = 0.7 * random.normal(size=(4, 4)), random.normal(size=(4, 1))
    c, d = random.normal(size=(1, 4)), np.array([[0.3]])
    zeros = np.linalg.eigvals(a - b @ c / d[0, 0]).astype(complex)
    outside = np.abs(zeros) > 1.0 if discrete else zeros.real > 0.0
    mirrored = np.where(outside, 1.0 / zeros.conj() if discrete else -zeros.conj(), zeros)
    x, f = optimal_cost(a, b, c, d, discrete=discrete)
    assert_allclose(
        np.sort_complex(np.round(np.linalg.eigvals(a + b @ f), 6)),
        np.sort_complex(np.round(mirrored, 6)), rtol=0.0, atol=3e-6,
    )  # fmt: skip
    assert np.linalg.matrix_rank(x, tol=1e-8 * max(np.abs(x).max(), 1.0)) == outside.sum()


def test_a_loop_that_can_be_silent_is() -> None:
    """No zero outside from u to z: the least norm is zero, and what is left of it is rounding."""
    given = LtiSystem(
        np.array([[-1.3, 0.4], [0.2, -2.1]]), np.array([[1.0, 0.7], [0.3, 1.1]]),
        np.array([[0.9, 0.8], [1.0, 0.2]]), np.array([[0.0, 0.3], [0.7, 0.0]]),
    )  # fmt: skip
    assert h2_synthesis(given, 1, 1).norm < 1e-7
