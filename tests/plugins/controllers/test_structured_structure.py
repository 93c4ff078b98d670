from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.structured.bounded import Bounded
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import (
    Diagonal,
    Sizes,
    Structure,
    controller_of,
    free_state_space,
    mask_gains,
    static,
)

NAN = np.nan
STRUCTURES: dict[str, Structure] = {
    "static": static(2, 3),
    "second order": free_state_space(2, 1, 2),
    "strictly proper": free_state_space(2, 2, 1, strictly_proper=True),
    "masked": mask_gains(np.array([[NAN, 1.0, 0.0], [0.0, NAN, NAN], [NAN, 2.0, NAN]]), 1),
    "pid": Pid(),
    "pi": Pid(derivative=False),
    "pd": Pid(integral=False),
    "p": Pid(integral=False, derivative=False),
    "transfer function": TransferFunction(3),
    "strictly proper one": TransferFunction(3, 2),
    "diagonal": Diagonal([Pid(), free_state_space(1, 2, 1), static(1, 2)]),
    "bounded": Bounded(static(1, 3), np.array([-1.0, -np.inf, 2.0]), np.array([3.0, np.inf, 5.0])),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_slopes_by_differences(name: str) -> None:
    """Jᵀ vec(dK) against central differences of ⟨dK, K(θ)⟩; sizes are as said."""
    structure, random = STRUCTURES[name], np.random.default_rng(3)
    theta = random.normal(size=structure.size)
    shape = structure.order + structure.controls, structure.order + structure.measurements
    assert structure.gains(theta).shape == shape
    slope = random.normal(size=(2, *shape))
    step = 1e-5
    for i in range(structure.size):
        move = step * np.eye(structure.size)[i]
        change = structure.gains(theta + move) - structure.gains(theta - move)
        wanted = np.sum(slope * change, axis=(1, 2)) / (2.0 * step)
        found = structure.pull_back(theta, slope)[:, i]
        assert_allclose(found, wanted, rtol=0, atol=3e-9 * (1.0 + np.abs(wanted).max()))
    sizes = Sizes(np.ones(structure.controls), np.ones(structure.measurements), 2.0)
    middle, spread = structure.typical(sizes)
    assert middle.shape == spread.shape == (structure.size,)
    assert (spread > 0.0).all()


def response(structure: Structure, theta: Array, s: complex) -> complex:
    made = controller_of(structure, theta)
    assert s.real == 0.0
    return complex(made.response(np.array([s.imag]))[0, 0, 0])


def test_pid_is_the_formula() -> None:
    s = 0.7j
    theta = np.array([2.0, 0.3, 1.5, np.log(20.0)])
    wanted = 2.0 + 0.3 / s + 1.5 * s / (1.0 + s / 20.0)
    assert_allclose(response(Pid(), theta, s), wanted, rtol=1e-13)
    assert_allclose(response(Pid(derivative=False), theta[:2], s), 2.0 + 0.3 / s, rtol=1e-13)
    wanted = 2.0 + 1.5 * s / (1.0 + s / 20.0)
    assert_allclose(response(Pid(integral=False), theta[[0, 2, 3]], s), wanted, rtol=1e-13)


def test_transfer_function_is_the_formula() -> None:
    s = 0.7j
    wanted = (4.0 + 5.0 * s + 6.0 * s**2) / (1.0 + 2.0 * s + s**2)
    theta = np.array([1.0, 2.0, 4.0, 5.0, 6.0])
    assert_allclose(response(TransferFunction(2), theta, s), wanted, rtol=1e-13)
    wanted = 4.0 / (1.0 + 2.0 * s + s**2)
    assert_allclose(response(TransferFunction(2, 2), theta[:3], s), wanted, rtol=1e-13)


def test_diagonal_keeps_the_loops_apart() -> None:
    structure = Diagonal([Pid(derivative=False), static(1, 1)])
    made = controller_of(structure, np.array([2.0, 0.5, -3.0])).response(np.array([1.0]))[0]
    assert_allclose(made, np.diag([2.0 - 0.5j, -3.0]), rtol=1e-14)


def test_bounds_hold_for_every_parameter() -> None:
    structure = STRUCTURES["bounded"]
    assert isinstance(structure, Bounded)
    for phi in np.random.default_rng(1).normal(scale=50.0, size=(100, 3)):
        theta = structure.parameters(phi)
        assert (theta >= structure.lower).all()
        assert (theta <= structure.upper).all()
    inside = np.array([2.5, -7.0, 2.5])
    assert_allclose(structure.parameters(structure.free(inside)), inside, rtol=1e-13)
    outside = structure.parameters(structure.free(np.array([9.0, 1.0, -9.0])))
    assert_allclose(outside, [3.0, 1.0, 2.0], rtol=0, atol=2e-3)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="free"):
        mask_gains(np.zeros((2, 2)))
    with pytest.raises(InputError, match="order 2"):
        mask_gains(np.full((2, 2), NAN), 2)
    with pytest.raises(InputError, match="one part"):
        Diagonal([])
    with pytest.raises(InputError, match="relative degree"):
        TransferFunction(2, 3)
    with pytest.raises(InputError, match="2 entries"):
        Bounded(static(1, 2), np.zeros(3), np.ones(3))
    with pytest.raises(InputError, match="below"):
        Bounded(static(1, 2), np.array([0.0, 1.0]), np.array([1.0, 1.0]))
    with pytest.raises(InputError, match="pairs"):
        Bounded(static(1, 2), np.array([0.0, -np.inf]), np.array([1.0, 1.0]))
