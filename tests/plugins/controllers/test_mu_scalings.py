from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.scalings import Basis


def test_derivatives_of_the_barrier_are_those_of_differences() -> None:
    """Gradient and Hessian with all kinds of blocks and two matrices, against the potential."""
    structure = BlockStructure(
        [repeated_real(2), repeated_complex(2), repeated_real(1), full(2, 2)]
    )
    random = np.random.default_rng(3)
    n = structure.size
    m = random.normal(size=(2, n, n)) + 1j * random.normal(size=(2, n, n))
    m /= np.linalg.norm(m, 2, axis=(1, 2))[:, None, None]
    basis = Basis(structure, np.ones(n, dtype=bool), 1.0)
    x = basis.parameters(np.eye(n, dtype=complex), np.zeros((n, n), dtype=complex))
    x = x + 0.05 * random.normal(size=x.size)
    gradient, hessian = basis.derivatives(m, x, 3.0)
    step = 1e-5 * np.eye(x.size)
    slopes = [basis.potential(m, x + h, 3.0) - basis.potential(m, x - h, 3.0) for h in step]
    assert_allclose(gradient, np.array(slopes) / 2e-5, rtol=1e-6, atol=1e-6)
    bends = [
        basis.derivatives(m, x + h, 3.0)[0] - basis.derivatives(m, x - h, 3.0)[0] for h in step
    ]
    assert_allclose(hessian, np.array(bends) / 2e-5, rtol=1e-6, atol=1e-6)
