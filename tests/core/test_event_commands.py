"""Bounds of the commands of affine laws contain what the laws command."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from hillsphere.engine.dynamics.system import PlantBounds
from hillsphere.engine.simulation.command_bounds import AffineLaw, affine_law
from hillsphere.engine.simulation.flow import closed_system
from hillsphere.interfaces import Array, Variable
from hillsphere.symbolic import Expr

from .test_simulation_ends import Shaft

LANES, STEPS, DENSE = 8, 3, 200


class Wide(Shaft):
    """A shaft with two lifts, so that the gain is a matrix."""

    controls = (Variable("lift", 1, -2), Variable("drag", 1, -2))  # type: ignore[assignment]

    def derivative(self, x: Any, u: Any, t: Expr, p: Any) -> tuple[Expr, ...]:
        return (x[1], u[0] - 0.3 * u[1] - p["gravity"])


class Affine:
    """ẋ = A (x, y, r) + a, u = C (x, y, r) + c on held measurements."""

    period_s, inputs = 5.0, 2
    measurement = "held"

    def __init__(self, rng: np.random.Generator, order: int, growth: float) -> None:
        m = order
        self.a = rng.normal(size=(m, m + 4)) * 10.0 ** rng.uniform(-2.0, 0.0, (m, 1))
        self.c = rng.normal(size=(2, m + 4))
        self.a0, self.c0 = rng.normal(size=m), rng.normal(size=2)
        if m:
            self.a[:, :m] -= np.eye(m) * (np.linalg.eigvals(self.a[:, :m]).real.max() - growth)
        self.states = tuple(Variable(f"own{i}") for i in range(m))

    def initial(self, n_cases: int) -> Array:
        return np.zeros((len(self.a), n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(self, xc: Any, y: Any, ref: Any, t: Any) -> tuple[Any, ...]:
        return self._of(self.a, self.a0, xc, y, ref)

    def control(self, xc: Any, y: Any, ref: Any, t: Any) -> tuple[Any, ...]:
        return self._of(self.c, self.c0, xc, y, ref)

    def _of(self, matrix: Array, constant: Array, *parts: Any) -> tuple[Any, ...]:
        z = [q for part in parts for q in part]
        return tuple(
            sum((w * q for w, q in zip(row, z, strict=True)), start=float(b))
            for row, b in zip(matrix.tolist(), constant, strict=True)
        )


def affine(law: Affine) -> AffineLaw:
    closed, _ = closed_system(Wide(), law, ())  # type: ignore[arg-type]
    found = closed.bounded.affine  # type: ignore[union-attr]
    assert isinstance(found, AffineLaw)
    return found


def dense_commands(law: Affine, y: Array, p: Array, h: float) -> Array:
    """Return what is done (STEPS, p, B, DENSE) by matrix exponentials of the held system."""
    m = len(law.a)
    feed, gain = p[:2], p[2:6].reshape(2, 2, -1)
    ref, seen = p[6:8], p[8:10]
    held = np.concatenate([seen, ref, np.ones((1, p.shape[1]))])
    whole = np.zeros((m + 5, m + 5))
    whole[:m] = np.concatenate([law.a, law.a0[:, None]], axis=1)
    out = np.empty((len(y) - 1, 2, p.shape[1], DENSE))
    for i, tau in enumerate(np.linspace(0.0, h, DENSE)):
        step = expm(whole * tau)
        for j in range(len(y) - 1):
            z = step @ np.concatenate([y[j, 2 : 2 + m], held])
            u = law.c @ z[:-1] + law.c0[:, None] + feed
            out[j, :, :, i] = np.einsum("ijB,jB->iB", gain, u)
    return out


@pytest.mark.parametrize("identity", [True, False])
@pytest.mark.parametrize("seed", range(25))
def test_bounds_contain_dense_commands(seed: int, identity: bool) -> None:
    rng = np.random.default_rng(seed)
    order = int(rng.integers(0, 5))
    # Poles from fast decay to growth by some e-folds in a step.
    growth = float(rng.choice([-5.0, -0.1, 0.0, 0.3]))
    law = Affine(rng, order, growth)
    bounds = affine(law)
    h = 10.0 ** rng.uniform(-2.0, 1.0)
    y = rng.normal(size=(STEPS + 1, 2 + order + 1, LANES)) * 10.0 ** rng.uniform(-3.0, 3.0)
    gain = np.repeat(np.eye(2).reshape(4, 1), LANES, axis=1)
    if not identity:
        gain = gain + rng.normal(size=(4, LANES))
    rest = rng.normal(size=(4, LANES)) * 10.0 ** rng.uniform(-3.0, 3.0)
    p = np.concatenate([rng.normal(size=(2, LANES)), gain, rest])
    done = dense_commands(law, y, p, h)
    lo, hi = bounds.command(y, p, h, p[None])
    # The samples themselves are good to some roundings of the exponential.
    small = 1e-11 * (1.0 + np.abs(done).max())
    assert (lo <= done.min(axis=(0, 3)) + small).all()
    assert (hi >= done.max(axis=(0, 3)) - small).all()
    middle = rng.normal(size=(2, 1))
    away = bounds.departure(y, p, middle, h, p[None])
    assert (away >= np.abs(done - middle[:, :, None]).max(axis=3) - small).all()
    # A shorter step needs no more room, whatever lengths are known already.
    short = bounds.departure(y, p, middle, 0.5 * h, p[None])
    assert (short <= away * (1.0 + 1e-9) + small).all()
    again = bounds.departure(y, p, middle, h, p[None])
    assert (again == away).all()


def test_bounds_are_not_needlessly_wide() -> None:
    """A law of one slow pole: twice the true range at most."""
    law = Affine(np.random.default_rng(1), 1, -0.01)
    y = np.zeros((2, 4, 1))
    p = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])[:, None]
    done = dense_commands(law, y, p, 1.0)
    lo, hi = affine(law).command(y, p, 1.0, p[None])
    assert (hi - lo <= 2.1 * np.ptp(done, axis=(0, 3)) + 1e-9).all()


@pytest.mark.parametrize("kind", ["product", "square", "time", "continuous"])
def test_what_is_not_affine_is_not_taken_for_it(kind: str) -> None:
    class Other(Affine):
        def control(self, xc: Any, y: Any, ref: Any, t: Any) -> tuple[Any, ...]:
            first, second = super().control(xc, y, ref, t)
            more = {"product": y[0] * y[1], "square": xc[0] * xc[0], "time": 0.1 * t}
            return first + more.get(kind, 0.0), second

    law = Other(np.random.default_rng(2), 2, -1.0)
    if kind == "continuous":
        law.measurement = "continuous"
    inner = PlantBounds(Wide(), (), False, np.ones(2), 1.0)
    assert affine_law(law, inner, 0) is None  # type: ignore[arg-type]
