"""Seeded generalised plants of six kinds that are hard on H∞ synthesis, orders 2 to 20."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem

__all__ = ["KINDS", "PLANTS", "hostile_plant"]

PLANTS = 500
_ORDERS = (2, 20)
_DECADES = 4.0
"""Poles of the first kind and scales of the second lie within 10^±4."""
_UNSTABLE = 0.25
"""Share of the modes that are unstable."""

Plant = tuple[LtiSystem, int, int]


def hostile_plant(index: int) -> tuple[str, LtiSystem, int, int]:
    """Return the kind, the plant and its numbers of controls and measurements.

    The kind is that of the index modulo their number; everything else is drawn from a generator
    seeded by the index.
    """
    random = np.random.default_rng([20, index])
    name = list(KINDS)[index % len(KINDS)]
    order = int(random.integers(_ORDERS[0], _ORDERS[1] + 1))
    plant, controls, measurements = KINDS[name](random, order)
    return name, plant, controls, measurements


def _assemble(random: np.random.Generator, a: Array, rows: Array, columns: Array) -> Plant:
    """Return a plant with these states; `rows` and `columns` (n,) scale those of B and C."""
    n = len(a)
    k, q = (int(random.integers(1, 3)) for _ in range(2))
    p1, m1 = k + int(random.integers(0, 3)), q + int(random.integers(0, 3))
    b = rows[:, None] * random.normal(size=(n, m1 + k))
    c = columns * random.normal(size=(p1 + q, n))
    d = random.normal(size=(p1 + q, m1 + k))
    d[:p1, :m1] *= float(random.integers(0, 2))
    d[p1:, m1:] *= float(random.integers(0, 2))
    return LtiSystem(a, b, c, d), k, q


def _random_states(random: np.random.Generator, n: int) -> Array:
    """Return A with poles of about size one, some of them unstable as a rule."""
    a = random.normal(size=(n, n)) / np.sqrt(n)
    return np.asarray(a - random.uniform(-0.5, 1.0) * np.eye(n))


def _rotate(random: np.random.Generator, plant: LtiSystem) -> LtiSystem:
    """Return the plant in states turned by a random orthogonal matrix."""
    turn = np.linalg.qr(random.normal(size=(plant.order, plant.order)))[0]
    return LtiSystem(turn.T @ plant.a @ turn, turn.T @ plant.b, plant.c @ turn, plant.d)


def _with_poles_apart(random: np.random.Generator, n: int) -> Plant:
    size = 10.0 ** random.uniform(-_DECADES, _DECADES, size=n)
    a = np.diag(np.where(random.random(n) < _UNSTABLE, size, -size))
    # modes of gain one about their poles, or of residue one
    share = size ** (0.5 * float(random.integers(0, 2)))
    plant, k, q = _assemble(random, a, share, share)
    return (_rotate(random, plant) if random.random() < 0.5 else plant), k, q


def _with_units_apart(random: np.random.Generator, n: int) -> Plant:
    plant, k, q = _assemble(random, _random_states(random, n), np.ones(n), np.ones(n))
    p, m = plant.shape
    x, into, out = (10.0 ** random.uniform(-_DECADES, _DECADES, size=s) for s in (n, m, p))
    return LtiSystem(
        plant.a * x / x[:, None], plant.b / x[:, None] * into, out[:, None] * plant.c * x,
        out[:, None] * plant.d * into,
    ), k, q  # fmt: skip


def _with_a_mode_out_of_reach(random: np.random.Generator, n: int) -> Plant:
    values = random.normal(size=n)
    values[0] = 10.0 ** random.uniform(-2.0, 0.5)
    plant, k, q = _assemble(random, np.diag(values), np.ones(n), np.ones(n))
    (p, m), small = plant.shape, 10.0 ** random.uniform(-7.0, -2.0)
    b, c = plant.b.copy(), plant.c.copy()
    if random.random() < 0.5:
        b[0, m - k :] *= small
    else:
        c[p - q :, 0] *= small
    return _rotate(random, LtiSystem(plant.a, b, c, plant.d)), k, q


def _with_small_direct_terms(random: np.random.Generator, n: int) -> Plant:
    plant, k, q = _assemble(random, _random_states(random, n), np.ones(n), np.ones(n))
    (p, m), d, which = plant.shape, plant.d.copy(), int(random.integers(0, 3))
    if which != 1:
        d[: p - q, m - k :] *= 10.0 ** random.uniform(-7.0, -2.0)
    if which != 0:
        d[p - q :, : m - k] *= 10.0 ** random.uniform(-7.0, -2.0)
    return LtiSystem(plant.a, plant.b, plant.c, d), k, q


def _with_light_damping(random: np.random.Generator, n: int) -> Plant:
    a = np.zeros((n, n))
    for i in range(0, n - 1, 2):
        omega, damping = 10.0 ** random.uniform(-1.0, 1.0), 10.0 ** random.uniform(-6.0, -3.0)
        a[i : i + 2, i : i + 2] = omega * np.array([[-damping, 1.0], [-1.0, -damping]])
    if n % 2:
        a[-1, -1] = -(10.0 ** random.uniform(-1.0, 1.0))
    plant, k, q = _assemble(random, a, np.ones(n), np.ones(n))
    return (_rotate(random, plant) if random.random() < 0.5 else plant), k, q


def _with_zeros_on_the_axis(random: np.random.Generator, n: int) -> Plant:
    """Zeros at 0 or ±jω from u to z or from w to y, or integrators that w does not drive."""
    plant, k, q = _assemble(random, _random_states(random, n), np.ones(n), np.ones(n))
    p, m = plant.shape
    a, b, c, d = plant.a.copy(), plant.b.copy(), plant.c.copy(), plant.d.copy()
    which = int(random.integers(0, 3))
    axis = np.zeros((n, n))
    omega = 10.0 ** random.uniform(-1.0, 1.0)
    axis[0, 1], axis[1, 0] = omega, -omega
    if which == 2:
        # integrators reached and shown, but neither driven by w nor weighted in z
        count = int(random.integers(1, 3))
        a[:count], a[:, :count] = 0.0, 0.0
        a[:count, :count] = np.eye(count, k=1)
        b[:count, : m - k] = 0.0
        return LtiSystem(a, b, c, d), k, q
    turn = np.linalg.qr(random.normal(size=(n, n)))[0]
    zeros = -np.diag(10.0 ** random.uniform(-1.0, 1.0, size=n))
    zeros[:2, :2] = axis[:2, :2] if random.random() < 0.5 else np.diag([0.0, -1.0])
    zeros = turn.T @ zeros @ turn
    if which == 0:  # as many weighted outputs as controls: A − B2 D12⁻¹ C1 has the zeros
        c, d = np.vstack([c[:k], c[p - q :]]), np.vstack([d[:k], d[p - q :]])
        a = zeros + b[:, m - k :] @ np.linalg.solve(d[:k, m - k :], c[:k])
    else:
        b, d = np.hstack([b[:, :q], b[:, m - k :]]), np.hstack([d[:, :q], d[:, m - k :]])
        a = zeros + np.linalg.solve(d[p - q :, :q].T, b[:, :q].T).T @ c[p - q :]
    return LtiSystem(a, b, c, d), k, q


KINDS: dict[str, Callable[[np.random.Generator, int], Plant]] = {
    "poles apart": _with_poles_apart,
    "units apart": _with_units_apart,
    "mode out of reach": _with_a_mode_out_of_reach,
    "small direct terms": _with_small_direct_terms,
    "light damping": _with_light_damping,
    "zeros on the axis": _with_zeros_on_the_axis,
}
