r"""Frequency intervals on which given scalings prove a bound of µ, by a Hamiltonian matrix.

With M(s) = C (s I − A)⁻¹ B + D₀ and scalings D, G, in coordinates where D and the levels L are the
identity,

.. math::

    -F(ω) = \begin{bmatrix} (jω - A)^{-1} B \\ I \end{bmatrix}^\mathsf{H}
            \begin{bmatrix} Q & S \\ S^\mathsf{H} & R \end{bmatrix}
            \begin{bmatrix} (jω - A)^{-1} B \\ I \end{bmatrix}, \quad
    Q = C^\mathsf{H} C, \; S = C^\mathsf{H} (D_0 - jG), \;
    R = D_0^\mathsf{H} D_0 - j D_0^\mathsf{H} G + j G D_0 - I,

is singular just where the matrix

.. math::

    \begin{bmatrix} A - B R^{-1} S^\mathsf{H} & -B R^{-1} B^\mathsf{H} \\
    -(Q - S R^{-1} S^\mathsf{H}) & -(A - B R^{-1} S^\mathsf{H})^\mathsf{H} \end{bmatrix}

has the eigenvalue jω [1]_. An F positive at one frequency stays so up to the next of these.

References
----------
.. [1] C. Roos, F. Lescher, J.-M. Biannic, C. Döll, G. Ferreres (2009), A set of µ-analysis based
   tools to evaluate the robustness properties of high-dimensional uncertain systems, Proc. IEEE
   Multi-conference on Systems and Control.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvals, solve_triangular

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.scalings import Scalings

__all__ = ["Loop"]

Complex = NDArray[np.complex128]

_NEAR = 1e-2
"""An eigenvalue this near the imaginary axis, relative to its size, may be a crossing."""
_SINGULAR = 1e10
"""Condition number of R up to which the Hamiltonian matrix is formed by its inverse; beyond, the
pencil keeps the digits that the inverse loses."""
_CUTS = 30
"""Points in the piece in which F becomes negative, at 1 − 2⁻ᵏ of its length: they close in on its
end, where the crossing usually lies."""


class Loop:
    """A stable system in continuous time, closed by a block structure.

    Parameters
    ----------
    system : LtiSystem
        M, its states scaled.
    structure : BlockStructure
        Of Δ.
    free : ndarray of bool, shape (n,)
        Indices of the squared matrix whose level is β², the others' being one.
    """

    def __init__(
        self, system: LtiSystem, structure: BlockStructure, free: NDArray[np.bool_]
    ) -> None:
        self.system, self.structure, self.free = system, structure, free
        self._response = Response(system.a, system.b, system.c, system.d)
        self.poles = self._response.poles
        n = system.order
        self._d = structure.pad_to_square(system.d + 0j)
        rows, columns = structure.places()
        self._b = np.zeros((n, structure.size))
        self._c = np.zeros((structure.size, n))
        self._b[:, columns], self._c[rows] = system.b, system.c

    def response(self, omega: Array) -> Complex:
        """Return M (K, p, m) at frequencies, which may be infinite."""
        made = np.empty((omega.size, *self.system.shape), dtype=complex)
        there = np.isfinite(omega)
        made[~there] = self.system.d
        if there.any():
            made[there] = self._response((1j * omega[there]).astype(complex))
        return made

    def scaled(self, root: Array) -> LtiSystem:
        """Return the squared system with outputs times, and inputs divided by, sizes (n,)."""
        return LtiSystem(
            self.system.a, self._b / root, root[:, None] * self._c,
            root[:, None] * self._d.real / root,
        )  # fmt: skip

    def reach(self, scalings: Scalings, beta: float, omega: float) -> tuple[float, float]:
        """Return the ends of the interval on which the scalings prove β.

        Parameters
        ----------
        scalings : Scalings
            Of the squared matrix; they prove β at ω.
        beta : float
            The bound.
        omega : float
            A frequency, rad/s; may be zero or infinite.
        """
        # normalise D and the levels L to the identity: D = K Kᴴ, and the inputs by K⁻ᴴ L^(−1/2)
        root: Complex = np.asarray(np.linalg.cholesky(scalings.d), dtype=complex)
        weight = np.where(self.free, beta, 1.0)
        inverse = solve_triangular(root, np.eye(len(root)), lower=True, check_finite=False)
        into = inverse.conj().T / weight
        b, c, d = self._b @ into, root.conj().T @ self._c, root.conj().T @ self._d @ into
        g = (inverse @ scalings.g @ inverse.conj().T) / weight[:, None]
        # imaginary eigenvalues jω of the Hamiltonian matrix: F(ω) is singular there
        eigenvalues = _eigenvalues(self.system.a, b, c, d, g)
        near = np.abs(eigenvalues.real) <= _NEAR * np.abs(eigenvalues)
        crossings = np.unique(eigenvalues[near].imag)
        crossings = crossings[crossings > 0.0]

        def positive(at: Array) -> NDArray[np.bool_]:
            return self._positive(at, root, into, g)

        return (
            _positive_reach(omega, crossings[crossings < omega][::-1], 0.0, positive),
            _positive_reach(omega, crossings[crossings > omega], np.inf, positive),
        )

    def _positive(
        self, omega: Array, root: Complex, into: Complex, g: Complex
    ) -> NDArray[np.bool_]:
        x = root.conj().T @ self.structure.pad_to_square(self.response(omega)) @ into
        gx = g @ x
        xh = x.conj().swapaxes(1, 2)
        # F in normalised coordinates: I − Xᴴ X − j(G X − Xᴴ G)
        f = np.eye(len(root)) - xh @ x - 1j * (gx - gx.conj().swapaxes(1, 2))
        return np.asarray(np.linalg.eigvalsh(f)[:, 0] > 0.0)


def _positive_reach(
    omega: float, crossings: Array, end: float, positive: Callable[[Array], NDArray[np.bool_]]
) -> float:
    """Return how far F stays positive on the way from ω by crossings to an end.

    Rounding displaces crossings: F is looked at there, half-way between them and at the end, and
    the piece in which it first becomes negative is cut finer.
    """
    stops = np.concatenate([[omega], crossings, [end]])
    between = stops.copy()
    if np.isinf(omega):
        # an infinite end is represented by four times the last crossing
        between[0] = 4.0 * between[1]
    elif np.isinf(end):
        between[-1] = 4.0 * between[-2] + float(between[-2] == 0.0)
    path = np.empty(2 * stops.size - 1)
    path[::2], path[1::2] = stops, 0.5 * (between[1:] + between[:-1])
    bad = np.flatnonzero(~positive(path))
    if bad.size == 0:
        return end
    # not even at ω itself, beyond rounding: an empty interval
    if bad[0] == 0:
        return omega
    path[[0, -1]] = between[[0, -1]]
    good = path[bad[0] - 1]
    finer = good + (path[bad[0]] - good) * (1.0 - 0.5 ** np.arange(_CUTS))
    worse = np.append(np.flatnonzero(~positive(finer)), finer.size)
    return float(finer[worse[0] - 1]) if worse[0] > 0 else omega


def _eigenvalues(a: Array, b: Complex, c: Complex, d: Complex, g: Complex) -> Complex:
    """Return the finite eigenvalues of the Hamiltonian in normalised coordinates."""
    n, m = b.shape
    q, s = c.conj().T @ c, c.conj().T @ (d - 1j * g)
    gd = g @ d
    r = d.conj().T @ d + 1j * (gd - gd.conj().T) - np.eye(m)
    if np.linalg.cond(r) < _SINGULAR:
        # the Hamiltonian matrix of the module's second equation
        back = np.linalg.solve(r, np.hstack([s.conj().T, b.conj().T]))
        up = a - b @ back[:, :n]
        whole = np.block([[up, -b @ back[:, n:]], [-(q - s @ back[:, :n]), -up.conj().T]])
        return np.asarray(np.linalg.eigvals(whole))
    # F(∞) is singular: the pencil needs no inverse of it
    left = np.block(
        [[a, np.zeros((n, n)), b], [-q, -a.T, -s], [s.conj().T, b.conj().T, r]]
    )  # fmt: skip
    right = np.zeros_like(left)
    right[: 2 * n, : 2 * n] = np.eye(2 * n)
    eigenvalues = eigvals(left, right, check_finite=False)
    return np.asarray(eigenvalues[np.isfinite(eigenvalues)])
