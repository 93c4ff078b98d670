"""Spherical harmonics of a homogeneous mesh, and how many degrees of them are enough."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import sqrt

import numpy as np
from scipy.special import roots_jacobi, roots_legendre

from hillsphere.errors import InputError
from hillsphere.formats.coefficients import Coefficient
from hillsphere.interfaces import Array
from hillsphere.model.shapes.mesh import Mesh

__all__ = [
    "HIGHEST_DEGREE",
    "MeshSeries",
    "count_points",
    "gauss_on_triangle",
    "mesh_coefficients",
    "mesh_series",
]

_POINTS = 8192
"""Points at which the functions are evaluated at once: their arrays stay in the cache."""
_QUADRATURE = 1e-14
"""Error of a mean over a face, relative to the largest value of the function: rounding."""
HIGHEST_DEGREE = 120
"""Highest degree of the coefficients: that of half of it compiles for many minutes."""
_SUMMED = 400
"""Degrees of the tail that are summed one by one, before the rest is bounded as a whole."""

_ROUNDING = 1e-15
"""Coefficients below this are zero but for the rounding of the integrals: those that a symmetry of
the shape forbids. They are left out: compiled code would carry them, and they change nothing."""


@dataclass(frozen=True)
class MeshSeries:
    """A series of a mesh that is cut where the rest is below a bound.

    Parameters
    ----------
    rows : tuple of Coefficient
        4π-normalised coefficients from degree 1 on, of the reference radius `radius_m`.
    degree : int
        Highest degree.
    radius_m : float
        Distance of the farthest vertex from the origin, m.
    from_m : float
        Distance from the origin from which the bound holds, m.
    bound : float
        Of the error of the acceleration there, in units of GM/r²; it falls with the distance.
    enough : int or None
        Degree that the tolerance asks for; None if it is beyond those that can be computed.
    """

    rows: tuple[Coefficient, ...]
    degree: int
    radius_m: float
    from_m: float
    bound: float
    enough: int | None


def mesh_series(mesh: Mesh, from_m: float, tolerance: float, max_degree: int) -> MeshSeries:
    r"""Return the series of a mesh with as many degrees as a tolerance asks for, up to a largest.

    With the radius R of the farthest vertex, the terms of degree n of the acceleration at the
    distance r are at most

    .. math::

        \frac{GM}{r^2}\Big(\frac Rr\Big)^n \min\Big[(2n+1)\sqrt{n+1}\,
        \Big(\sum_m\bar C_{nm}^2+\bar S_{nm}^2\Big)^{1/2},\; (n+1)\,M_n\Big], \qquad
        M_n = \frac1V\int\Big(\frac sR\Big)^n dV .

    The first bound (Cauchy's inequality and the addition theorem) needs the coefficients. The
    second holds for each mass point at s, since \|∇(P_n/r^{n+1})\| ≤ (n+1)/r^{n+2}, and needs the
    mean M_n only: over the pyramid of a face it is at most 3/(n+3) times the mean of (s/R)^n of the
    corners, as this is convex. M_n falls with n, which bounds all degrees that are not computed.

    Parameters
    ----------
    mesh : Mesh
        The body, homogeneous.
    from_m : float
        Least distance from the origin at which the bound must hold, m; beyond the farthest vertex.
    tolerance : float
        Error of the acceleration there that is enough, in units of GM/r².
    max_degree : int
        Largest degree; the bound says which error is left.

    Returns
    -------
    MeshSeries
        The coefficients, and the bound that they reach.

    Raises
    ------
    InputError
        If `from_m` is not outside the body.
    """
    radius = mesh.largest_radius_m
    if not from_m > radius:
        raise InputError(
            f"the series of a shape converges outside the sphere that holds it, of "
            f"{radius / 1e3:.6g} km about the origin; it cannot be used from "
            f"{from_m / 1e3:.6g} km on: give a larger series_from, or type = 'polyhedron'"
        )
    ratio = radius / from_m
    tails = _tails(mesh, ratio)
    enough = np.flatnonzero(tails <= 0.5 * tolerance)
    # degrees beyond those of the series are computed too: they make the bound of the rest sharper
    computed = max(int(enough[0]) if enough.size else HIGHEST_DEGREE, max_degree)
    table = mesh_coefficients(mesh, computed)
    degrees = np.arange(computed + 1)
    sizes = np.sqrt(np.sum(np.abs(table) ** 2, axis=1))
    terms = (2 * degrees + 1) * np.sqrt(degrees + 1.0) * sizes * ratio**degrees
    # what is left out if the series ends at each degree
    left = tails[computed] + np.append(np.cumsum(terms[:0:-1])[::-1], 0.0)
    met = np.flatnonzero(left <= tolerance)
    needed = int(met[0]) if met.size else None
    degree = max_degree if needed is None else min(needed, max_degree)
    c, s = (np.where(np.abs(part) > _ROUNDING, part, 0.0) for part in (table.real, table.imag))
    rows = tuple(
        Coefficient(n, m, float(c[n, m]), float(s[n, m]))
        for n in range(1, degree + 1)
        for m in range(n + 1)
        if c[n, m] or s[n, m]
    )
    return MeshSeries(rows, degree, radius, from_m, float(left[degree]), needed)


def mesh_coefficients(mesh: Mesh, degree: int) -> Array:
    r"""Return the 4π-normalised coefficients C̄ + iS̄ of a homogeneous mesh.

    .. math::

        \bar C_{nm} + i\bar S_{nm} = \frac1{(2n+1)V}\int\Big(\frac sR\Big)^n \bar P_{nm}
        (\sin\varphi)\,e^{im\lambda}\,dV

    with the radius R of the farthest vertex [1]_. The integrand is homogeneous of degree n, so that
    the integral over the pyramid of a face, of volume v with its tip at the origin, is 3v/(n+3)
    times its mean over the face. That is found by Gauss's rule: with enough points to be exact for
    a polynomial of this degree, or fewer if those give it to rounding, as on small faces.

    Parameters
    ----------
    mesh : Mesh
        F faces.
    degree : int
        Highest degree N.

    Returns
    -------
    ndarray of complex, shape (N + 1, N + 1)
        Rows n, columns m; zero for m > n.

    References
    ----------
    .. [1] R. A. Werner (1997), Spherical harmonic coefficients for the potential of a
       constant-density polyhedron, Computers & Geosciences 23(10), 1071-1077.
    """
    radius = mesh.largest_radius_m
    a, b, c = mesh.corners / radius
    longest = max(float(np.linalg.norm(s, axis=0).max()) for s in (b - a, c - b, a - c))
    u, v, weights = gauss_on_triangle(count_points(degree, 0.5 * longest))
    shares = mesh.heights * mesh.doubled_areas / (6.0 * mesh.volume_m3)
    sums = np.zeros((degree + 1, degree + 1), dtype=complex)
    step = max(1, _POINTS // len(u))
    for first in range(0, shares.size, step):
        here = slice(first, first + step)
        places = a[:, here, None] + (b - a)[:, here, None] * u + (c - a)[:, here, None] * v
        sums += _weighted_sums(
            places.reshape(3, -1), np.outer(shares[here], weights).ravel(), degree
        )
    n = np.arange(degree + 1)[:, None]
    result: Array = sums * 3.0 / ((n + 3) * (2 * n + 1))
    return result


def _weighted_sums(x: Array, weights: Array, degree: int) -> Array:
    """Return Σ w sⁿ P̄nm e^{imλ} over points x (3, N), shape (degree + 1, degree + 1).

    By the recursions of the normalised functions: from m − 1 to m on the diagonal, from n − 1 and
    n − 2 to n for each order; all are bounded, and stable for s ≤ 1.
    """
    sums = np.zeros((degree + 1, degree + 1), dtype=complex)
    across, z, square = x[0] + 1j * x[1], x[2], np.sum(x * x, axis=0)
    # the weights are carried in the functions, which saves a product for each
    sector = weights.astype(complex)
    for m in range(degree + 1):
        if m:
            sector *= across * sqrt((2 * m + 1) / (2 * m) if m > 1 else 3.0)
        before, last = np.zeros_like(sector), sector.copy()
        sums[m, m] = last.sum()
        for n in range(m + 1, degree + 1):
            up = sqrt((2 * n - 1) * (2 * n + 1) / ((n - m) * (n + m)))
            before *= square
            down = (2 * n + 1) * (n + m - 1) * (n - m - 1) / ((2 * n - 3) * (n + m) * (n - m))
            before *= -sqrt(down)
            before += last * (up * z)
            before, last = last, before
            sums[n, m] = last.sum()
    return sums


@cache
def gauss_on_triangle(k: int) -> tuple[Array, Array, Array]:
    """Return k² places u, v in the unit triangle and weights of sum one, of degree 2k − 1.

    Gauss's rule on the square with one side collapsed to a corner, whose Jacobian 1 − u is the
    weight of Jacobi's polynomials.
    """
    x, wx = roots_jacobi(k, 1.0, 0.0)
    y, wy = roots_legendre(k)
    u = np.repeat(0.5 * (1.0 + x), k)
    v = np.tile(0.5 * (1.0 + y), k) * (1.0 - u)
    weights = np.outer(wx, wy).ravel()
    return u, v, weights / weights.sum()


def count_points(degree: int, half_side: float) -> int:
    r"""Return how many points in each direction give the mean over a face to rounding.

    Exact are (degree + 2)/2. Along a side of half the length h, radii of the body, the function is
    at most (1 + hρ)ⁿ times its largest value on the sphere where its argument is in the ellipse of
    Bernstein with the semi-axes' sum ρ: a homogeneous harmonic polynomial of a complex vector is
    bounded by its Lie norm, at most \|Re\| + \|Im\|. Gauss's rule with k points then errs by at
    most 64/15 of that over ρ^{2k} (1 − ρ⁻²) (L. N. Trefethen, Approximation Theory and
    Approximation Practice, SIAM 2013, theorem 19.3), twice for both directions.
    """
    exact = degree // 2 + 1
    rho = np.geomspace(1.1, 1e3, 200)
    for k in range(1, exact):
        errors = degree * np.log1p(half_side * rho) - 2 * k * np.log(rho) - np.log1p(-(rho**-2.0))
        if errors.min() < np.log(_QUADRATURE * 15.0 / 128.0):
            return k
    return exact


def _tails(mesh: Mesh, ratio: float) -> Array:
    """Return the bounds of all degrees above 0, 1, … that need no coefficients."""
    degrees = np.arange(HIGHEST_DEGREE + _SUMMED)
    reach = np.linalg.norm(mesh.vertices, axis=1) / mesh.largest_radius_m
    shares = np.abs(mesh.heights * mesh.doubled_areas) / (6.0 * mesh.volume_m3)
    # weight of each vertex: a third of the pyramids that have it as a corner
    weights = np.bincount(
        mesh.faces.ravel(), np.repeat(shares / 3.0, 3), minlength=len(mesh.vertices)
    )
    means = np.empty(degrees.size)
    power = weights
    for n in degrees.tolist():
        means[n] = 3.0 / (n + 3) * power.sum()
        power = power * reach
    terms = (degrees + 1) * means * ratio**degrees
    top = float(degrees[-1])
    rest = means[-1] * ratio ** (top + 1) * ((top + 2) - (top + 1) * ratio) / (1.0 - ratio) ** 2
    return np.asarray(rest + np.append(np.cumsum(terms[:0:-1])[::-1], 0.0))[: HIGHEST_DEGREE + 1]
