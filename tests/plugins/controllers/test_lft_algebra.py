from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.algebra import (
    diagonal,
    dynamics,
    feedback,
    inverse,
    join_inputs,
    matrix_block,
    number,
    parameter,
    stack_outputs,
    star,
    state_space,
)
from hillsphere_controllers.linear_fractional.polynomials import affine
from hillsphere_controllers.linear_fractional.reduction import minimal
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import (
    corners,
    random_values,
    real_parameter,
)
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.systems.algebra import (
    append,
    gain,
    parallel,
    series,
)
from hillsphere_controllers.systems.algebra import feedback as closed_loop
from hillsphere_controllers.systems.algebra import star as certain_star
from hillsphere_controllers.systems.exchange import load_mat, save_mat

MASS = real_parameter("mass", 1.0, 3.0, 1.5)
STIFFNESS = real_parameter("stiffness", -2.0, 5.0)
OMEGA = np.array([0.0, 0.3, 1.0, 7.0, np.inf])


def uncertain_system(seed: int, outputs: int = 2, inputs: int = 2, order: int = 3) -> Lft:
    random = np.random.default_rng(seed)
    shape = (order + outputs, order + inputs)
    matrix = affine(
        random.normal(size=shape),
        {u.name: np.outer(*(random.normal(size=n) for n in shape)) for u in (MASS, STIFFNESS)},
        (MASS, STIFFNESS),
    )
    return state_space(matrix, order)


def at(found: Lft, values: Mapping[str, Array], sample: int) -> LtiSystem:
    return found.at({u.name: values[u.name][sample] for u in found.uncertainties})


def first_order(a: float, b: float, c: float, d: float) -> LtiSystem:
    return LtiSystem(np.array([[a]]), np.array([[b]]), np.array([[c]]), np.array([[d]]))


def agree(one: LtiSystem, other: LtiSystem, rtol: float = 1e-10) -> None:
    first, second = one.response(OMEGA), other.response(OMEGA)
    assert_allclose(first, second, rtol=0, atol=rtol * float(np.abs(second).max()))


OPERATIONS: dict[
    str, tuple[Callable[[Lft, Lft], Lft], Callable[[LtiSystem, LtiSystem], LtiSystem]]
] = {
    "sum": (lambda g, h: g + h, parallel),
    "difference": (lambda g, h: g - h, lambda g, h: parallel(g, series(h, gain(-np.eye(2))))),
    "product": (lambda g, h: g @ h, lambda g, h: series(h, g)),
    "multiple": (lambda g, _: -2.5 * g, lambda g, _: series(g, gain(-2.5 * np.eye(2)))),
    "beside": (
        lambda g, h: join_inputs(g, h),
        lambda g, h: series(append(g, h), gain(np.hstack([np.eye(2), np.eye(2)]))),
    ),
    "stacked": (
        lambda g, h: stack_outputs(g, h),
        lambda g, h: series(gain(np.vstack([np.eye(2), np.eye(2)])), append(g, h)),
    ),
    "diagonal": (lambda g, h: diagonal(g, h), append),
    "feedback": (lambda g, h: feedback(g, h), closed_loop),
    "positive feedback": (lambda g, h: feedback(g, h, 1), lambda g, h: closed_loop(g, h, 1)),
    "star": (lambda g, h: star(g, h, 1, 1), lambda g, h: certain_star(g, h, 1, 1)),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_is_that_of_the_systems_at_all_corners(name: str) -> None:
    uncertain, certain = OPERATIONS[name]
    g, h = uncertain_system(1), uncertain_system(2)
    made = uncertain(g, h)
    values = corners((MASS, STIFFNESS))
    for sample in range(4):
        agree(at(made, values, sample), certain(at(g, values, sample), at(h, values, sample)))


@pytest.mark.parametrize("certain", [np.array([[1.0, 2.0], [0.5, -1.0]]), "system"])
def test_certain_matrices_and_systems_take_part_on_both_sides(certain: Array | str) -> None:
    g = uncertain_system(3)
    other: Array | LtiSystem = (
        uncertain_system(4).nominal if isinstance(certain, str) else np.asarray(certain)
    )
    alone = other if isinstance(other, LtiSystem) else gain(other)
    values = random_values(g.uncertainties, 1, seed=5)
    plain = at(g, values, 0)
    agree(at(g @ other, values, 0), series(alone, plain))
    agree(at(other @ g, values, 0), series(plain, alone))
    agree(at(other + g, values, 0), parallel(alone, plain))
    agree(at(other - g, values, 0), parallel(alone, series(plain, gain(-np.eye(2)))))


def test_inverse_times_original_is_the_identity() -> None:
    g = uncertain_system(6)
    both = inverse(g) @ g
    values = random_values(g.uncertainties, 5, seed=7)
    response = both.response(OMEGA, values)
    assert_allclose(response, np.broadcast_to(np.eye(2), response.shape), rtol=0, atol=1e-9)


def test_inverse_times_original_without_states_needs_no_copies() -> None:
    """Formally, with matrices in the place of the parameters: all copies can be taken out."""
    matrix = np.eye(3) * (parameter(MASS) @ np.ones((1, 1))).nominal.d[0, 0]
    g = affine(matrix, {"mass": np.ones((3, 3)), "stiffness": np.diag([1.0, 0.3, 0.0])},
               (MASS, STIFFNESS))  # fmt: skip
    both = minimal(inverse(g) @ g)
    assert both.size == 0
    assert_allclose(both.nominal.d, np.eye(3), rtol=0, atol=1e-14)


def test_a_singular_direct_term_has_no_inverse() -> None:
    with pytest.raises(InputError, match="no proper inverse"):
        inverse(affine(np.ones((2, 2)), {"mass": np.ones((2, 2))}, (MASS,)) - 0.0 * np.eye(2))
    with pytest.raises(InputError, match="only a square system"):
        inverse(uncertain_system(1, outputs=1))


def test_copies_of_one_uncertainty_stand_together() -> None:
    m, k = parameter(MASS), parameter(STIFFNESS)
    made = m @ k @ m + k
    assert [b.name for b in made.blocks] == ["mass", "stiffness"]
    assert made.times == (2, 2)
    assert isinstance(made.structure, BlockStructure)
    values = random_values((MASS, STIFFNESS), 20)
    expected = values["mass"] ** 2 * values["stiffness"] + values["stiffness"]
    assert_allclose(made.matrices(values)[3][:, 0, 0], expected, rtol=1e-12)


def test_spring_and_mass() -> None:
    """ẍ = (u − k x)/m: states, position and velocity."""
    per_mass, k = inverse(parameter(MASS)), parameter(STIFFNESS)
    force = join_inputs(-k, np.array([[0.0, 1.0]]))
    matrix = stack_outputs(
        np.array([[0.0, 1.0, 0.0]]), per_mass @ force, np.array([[1.0, 0.0, 0.0]])
    )
    found = minimal(state_space(matrix, 2))
    assert found.size == 2
    a, b, c, d = found.matrices({"mass": [1.0, 2.5], "stiffness": [4.0, -1.0]})
    assert_allclose(a[0], [[0.0, 1.0], [-4.0, 0.0]], rtol=0, atol=1e-14)
    assert_allclose(a[1], [[0.0, 1.0], [0.4, 0.0]], rtol=0, atol=1e-14)
    assert_allclose(b[:, :, 0], [[0.0, 1.0], [0.0, 0.4]], rtol=0, atol=1e-14)
    assert_allclose(c[:, 0], [[1.0, 0.0], [1.0, 0.0]], rtol=0, atol=0)
    assert not d.any()


def test_dynamic_uncertainty_takes_a_system() -> None:
    weight = first_order(-2.0, 1.0, 3.0, 0.1)
    error = dynamics("actuator", weight=weight)
    plant = uncertain_system(8, 1, 1)
    made = plant @ (np.eye(1) + error)
    unknown = first_order(-1.0, 1.0, 1.0, 0.0)
    nominal = plant.nominal
    expected = series(parallel(gain(np.eye(1)), series(unknown, weight)), nominal)
    agree(made.at({"actuator": unknown}), expected)
    assert made.structure.blocks[-1].kind == "full"
    with pytest.raises(InputError, match="not dynamic"):
        (np.eye(1) + matrix_block("constant", 1, 1)).at({"constant": unknown})


def test_full_blocks_and_complex_numbers() -> None:
    made = np.eye(2) + 0.5 * matrix_block("wheel", 2, 2) @ np.diag([1.0, 3.0])
    block = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert_allclose(
        made.matrices({"wheel": block})[3][0], np.eye(2) + 0.5 * block @ np.diag([1.0, 3.0]),
        rtol=1e-15,
    )  # fmt: skip
    response = number("phase", 2.0, 0.5).response(np.zeros(1), {"phase": np.array([1j, -1.0])})
    assert_allclose(response[:, 0, 0, 0], [2.0 + 0.5j, 1.5], rtol=1e-15)
    with pytest.raises(InputError, match="complex values"):
        number("phase", 2.0, 0.5).matrices({"phase": 1j})


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: parameter(MASS) + parameter(real_parameter("mass", 0.0, 1.0)), "two different"),
        (lambda: uncertain_system(1) + uncertain_system(1, 1), "one shape"),
        (lambda: uncertain_system(1) @ uncertain_system(1, 1), "does not fit"),
        (lambda: uncertain_system(1) * uncertain_system(1, 1), "does not fit"),
        (lambda: feedback(uncertain_system(1), np.ones((1, 2))), "must be 2 × 2 to fit"),
        (lambda: star(uncertain_system(1), uncertain_system(2), 3, 1), "do not fit"),
        (lambda: stack_outputs(uncertain_system(1), np.ones((1, 3))), "number of inputs"),
        (lambda: uncertain_system(1).matrices({"mess": 1.0}), "no uncertainty 'mess'"),
        (lambda: uncertain_system(1).matrices({"mass": np.ones((2, 2))}), "do not fit"),
        (lambda: uncertain_system(1).at({"mass": [1.0, 2.0]}), "one value each"),
        (lambda: state_space(uncertain_system(1), 1), "without states"),
        (lambda: parameter(matrix_block("wheel", 1, 1).uncertainties[0]), "no real parameter"),
        (lambda: inverse(parameter(STIFFNESS)).matrices({"stiffness": 0.0}), "singular"),
        (lambda: number("phase", 1.0, 0.0), "radius"),
        (
            lambda: dynamics("actuator", weight=first_order(1.0, 1.0, 1.0, 1.0)),
            "must be stable",
        ),
    ],
)
def test_what_does_not_fit_is_said(wrong: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        wrong()


def test_written_to_a_file_and_read_again(tmp_path: Path) -> None:
    made = uncertain_system(9)
    save_mat(tmp_path / "plant.mat", {"lft": (made.system, made.structure)})
    read = load_mat(tmp_path / "plant.mat")
    assert isinstance(read["lft"], tuple)
    system, structure = read["lft"]
    assert isinstance(system, LtiSystem)
    assert isinstance(structure, BlockStructure)
    assert structure.blocks == made.blocks
    agree(system, made.system)
