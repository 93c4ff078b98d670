"""Order conditions of the Runge–Kutta formulas, by rooted trees, and convergence by halving."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import combinations_with_replacement
from math import factorial, prod

import numpy as np
import pytest

from hillsphere.dynamics import StepMap, Tableau, system, tableau
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, sin

Tree = tuple["Tree", ...]


@lru_cache
def trees(order: int) -> frozenset[Tree]:
    """All rooted trees with so many nodes; a tree is the sorted tuple of its branches."""
    if order == 1:
        return frozenset({()})
    return frozenset(tuple(sorted(branches)) for branches in forests(order - 1, order - 1))


@lru_cache
def forests(nodes: int, largest: int) -> frozenset[Tree]:
    if nodes == 0:
        return frozenset({()})
    found = set()
    for size in range(1, min(nodes, largest) + 1):
        for count in range(1, nodes // size + 1):
            for same in combinations_with_replacement(sorted(trees(size)), count):
                for rest in forests(nodes - size * count, size - 1):
                    found.add(tuple(sorted(same + rest)))
    return frozenset(found)


def size(tree: Tree) -> int:
    return 1 + sum(size(b) for b in tree)


def density(tree: Tree) -> int:
    return size(tree) * prod(density(b) for b in tree)


def weight(tree: Tree, formula: Tableau) -> Array:
    """Elementary weight of each stage: Φ_i = Π over branches of Σ_j a_ij Φ_j."""
    result = np.ones(formula.stages)
    for branch in tree:
        result *= formula.a @ weight(branch, formula)
    return result


def test_the_number_of_rooted_trees() -> None:
    # Hairer, Nørsett, Wanner (1993), table II.2.2 (number of elementary differentials).
    assert [len(trees(n)) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]


# Residuals 6e-17 and 1e-15: the coefficients of dop853 reach 43.
@pytest.mark.parametrize(("name", "order", "tolerance"), [("rk6", 6, 3e-16), ("dop853", 8, 5e-15)])
def test_order_conditions(name: str, order: int, tolerance: float) -> None:
    # Hairer, Nørsett, Wanner (1993), theorem II.2.13: Σ b_i Φ_i(t) = 1/γ(t) for every tree t.
    formula = tableau(name)
    for n in range(1, order + 1):
        for tree in trees(n):
            residual = formula.b @ weight(tree, formula) - 1 / density(tree)
            assert abs(residual) < tolerance, (n, tree)
    worst = max(
        abs(formula.b @ weight(tree, formula) - 1 / density(tree)) for tree in trees(order + 1)
    )
    assert worst > 1e-5  # and no more than its order


@pytest.mark.parametrize(
    ("name", "orders", "tolerance"), [("rk6", [4, 3], 3e-16), ("dop853", [5, 3], 5e-15)]
)
def test_order_conditions_of_the_embedded_formulas(
    name: str, orders: list[int], tolerance: float
) -> None:
    # b̂ = b - errors meets the conditions of its own order (Hairer, Nørsett, Wanner 1993, section
    # II.5: orders 5 and 3 for dop853) and no more.
    formula = tableau(name)
    assert len(formula.errors) == len(orders)
    for errors, order in zip(formula.errors, orders, strict=True):
        embedded = formula.b - errors
        for n in range(1, order + 1):
            for tree in trees(n):
                residual = embedded @ weight(tree, formula) - 1 / density(tree)
                assert abs(residual) < tolerance, (n, tree)
        worst = max(abs(embedded @ weight(t, formula) - 1 / density(t)) for t in trees(order + 1))
        assert worst > 1e-5


def test_the_estimators_are_those_of_scipy() -> None:
    # Independent copy of the published coefficients; SciPy has one more column, of f(t + h), zero.
    reference = pytest.importorskip("scipy.integrate._ivp.dop853_coefficients")
    expected = np.array([reference.E5, reference.E3])
    np.testing.assert_allclose(tableau("dop853").errors, expected[:, :12], rtol=0, atol=1e-15)


def test_combined_step_error() -> None:
    # Hairer, Nørsett, Wanner (1993), equation II.10.17, for |e5| = 3 and |e3| = 40: 9/√(9 + 16).
    squares = np.array([[9.0, 0.0], [1600.0, 0.0]])
    np.testing.assert_allclose(tableau("dop853").step_error(*squares), [1.8, 0.0])
    # e³/(e² + ē²) for e = 3 and ē = 1.
    found = tableau("rk6").step_error(np.array([9.0]), np.array([1.0]))
    np.testing.assert_allclose(found, [2.7])


@pytest.mark.parametrize(("name", "stages"), [("rk6", 7), ("dop853", 12)])
def test_shape(name: str, stages: int) -> None:
    formula = tableau(name)
    assert formula.stages == stages
    assert np.all(np.triu(formula.a) == 0)
    # Nodes as printed: Luther (1968); Hairer, Nørsett, Wanner (1993), section II.5.
    q = np.sqrt(21.0)
    nodes = {
        "rk6": [0, 1, 1 / 2, 2 / 3, (7 - q) / 14, (7 + q) / 14, 1],
        "dop853": [
            *formula.c[:5], 1 / 3, 1 / 4, 4 / 13, 127 / 195, 3 / 5, 6 / 7, 1,
        ],
    }  # fmt: skip
    np.testing.assert_allclose(formula.c, nodes[name], rtol=0, atol=5e-15)


def test_unknown_formula() -> None:
    with pytest.raises(InputError, match="no Runge-Kutta formula 'rk4'; known: rk6, dop853"):
        tableau("rk4")


class Pendulum:
    """A driven pendulum: nonlinear and time-dependent, so that every tree counts."""

    frame = "inertial"
    states = (Variable("angle"), Variable("rate", time=-1))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (x[1], -sin(x[0]) + 0.5 * sin(2.0 * t) * x[0])

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


@pytest.mark.parametrize(("method", "order", "steps"), [("rk6", 6, 24), ("dop853", 8, 12)])
def test_order_by_step_halving(method: str, order: int, steps: int) -> None:
    step_map = StepMap(system(Pendulum()), method)
    x0 = np.array([1.2, 0.3])
    best = StepMap(system(Pendulum())).propagate(x0, 6.0, 2000)
    errors = [np.abs(step_map.propagate(x0, 6.0, n) - best).max() for n in (steps, 4 * steps)]
    # Over two halvings: 6.05 and 8.02.
    assert np.log2(errors[0] / errors[1]) / 2 == pytest.approx(order, abs=0.3)
    assert step_map.order == order


def test_density_of_the_tall_and_the_bushy_tree() -> None:
    tall: Tree = ()
    for _ in range(3):
        tall = (tall,)
    assert density(tall) == factorial(4)
    assert density(((), (), ())) == 4
