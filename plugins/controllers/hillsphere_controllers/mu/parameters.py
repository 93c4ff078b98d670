"""Real parameters of perturbations of unit size, and derivatives with respect to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import BlockStructure

__all__ = ["UnitPerturbation"]

Complex = NDArray[np.complex128]


class UnitPerturbation:
    """Q of a structure by real parameters.

    A real block has one parameter, its scalar in [−1, 1]; a complex scalar of size one has its
    angle. A full block is a dyad u vᴴ of unit norm, given by the real and imaginary parts of two
    vectors whose lengths do not matter.

    Parameters
    ----------
    structure : BlockStructure
        Of Q, its blocks squared.

    Attributes
    ----------
    bounds : list of tuple
        The least and the largest value of each parameter, None without one.
    """

    def __init__(self, structure: BlockStructure) -> None:
        self.structure = structure
        self.bounds: list[tuple[float | None, float | None]] = []
        for k, block in enumerate(structure.blocks):
            if block.kind == "real":
                self.bounds.append((-1.0, 1.0))
            elif structure.scalar(k):
                self.bounds.append((None, None))
            else:
                self.bounds += [(None, None)] * (4 * int(structure.sizes[k]))

    def parameters(self, q: Complex) -> Array:
        """Return the parameters (k,) of a squared Q."""
        x: list[float] = []
        for k, span in enumerate(self.structure.spans()):
            block = q[span, span]
            if self.structure.blocks[k].kind == "real":
                x.append(float(np.clip(block[0, 0].real, -1.0, 1.0)))
            elif self.structure.scalar(k):
                x.append(float(np.angle(block[0, 0])))
            else:
                u, _, vh = np.linalg.svd(block)
                left, right = u[:, 0], vh[0].conj()
                x += [*left.real, *left.imag, *right.real, *right.imag]
        return np.array(x)

    def q(self, x: Array) -> Complex:
        """Return the squared Q (n, n)."""
        values: list[complex | Complex] = []
        i = 0
        for k, block in enumerate(self.structure.blocks):
            if block.kind == "real":
                values.append(complex(x[i]))
                i += 1
            elif self.structure.scalar(k):
                values.append(np.exp(1j * x[i]))
                i += 1
            else:
                (u, _), (v, _), i = _vectors(x, i, int(self.structure.sizes[k]))
                values.append(np.outer(u, v.conj()))
        return self.structure.perturbation(values)

    def derivative(self, x: Array, row: Complex, column: Complex) -> Complex:
        """Return the derivatives (k,) of row Q column for fixed vectors (n,)."""
        made = np.zeros(len(self.bounds), dtype=complex)
        i = 0
        for k, span in enumerate(self.structure.spans()):
            left, right = row[span], column[span]
            if self.structure.blocks[k].kind == "real":
                made[i] = left @ right
                i += 1
            elif self.structure.scalar(k):
                # d exp(jφ)/dφ = j exp(jφ)
                made[i] = 1j * np.exp(1j * x[i]) * (left @ right)
                i += 1
            else:
                n = int(self.structure.sizes[k])
                (u, of_u), (v, of_v), after = _vectors(x, i, n)
                s, t = np.vdot(v, right), left @ u
                whole = s * t
                # the length of a vector changes nothing: what lies along it is taken away
                made[i : i + n] = (left * s - whole * u.real) / of_u
                made[i + n : i + 2 * n] = (1j * left * s - whole * u.imag) / of_u
                made[i + 2 * n : i + 3 * n] = (t * right - whole * v.real) / of_v
                made[i + 3 * n : after] = (-1j * t * right - whole * v.imag) / of_v
                i = after
        return made


def _vectors(x: Array, i: int, n: int) -> tuple[tuple[Complex, float], tuple[Complex, float], int]:
    """Return the unit vectors of a full block with their lengths, and where they end in x."""
    u: Complex = x[i : i + n] + 1j * x[i + n : i + 2 * n]
    v: Complex = x[i + 2 * n : i + 3 * n] + 1j * x[i + 3 * n : i + 4 * n]
    sizes = [max(float(np.linalg.norm(one)), 1e-12) for one in (u, v)]
    return (u / sizes[0], sizes[0]), (v / sizes[1], sizes[1]), i + 4 * n
