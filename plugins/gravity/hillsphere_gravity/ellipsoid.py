"""Gravity of a homogeneous tri-axial ellipsoid."""

from __future__ import annotations

from math import pi, prod
from sys import float_info

from hillsphere.interfaces import Parameter
from hillsphere.symbolic import (
    Expr,
    Params,
    Scalar,
    Vec3,
    dot,
    greater,
    maximum,
    minimum,
    number_in,
    power,
    select,
    sqrt,
    sum_of,
)
from hillsphere_gravity.carlson import MOST_DUPLICATIONS, carlson_rf_rd, duplications_for
from hillsphere_gravity.specs import EllipsoidSpec

__all__ = ["CODATA_2018_G", "Ellipsoid", "homogeneous_bound"]

CODATA_2018_G = 6.67430e-11
"""Constant of gravitation, m³/(kg s²): Tiesinga et al. (2021), Rev. Mod. Phys. 93, 025010."""

_LEAST_HALF = 1e-12
"""Least square of cos(θ/2) in `_confocal`: at 0 the root's derivative is infinite. A change of
cos(θ/2) by up to 1e-6 is removed by the Newton step after it."""
_THIRD = (
    7.660444431189829e-01, 2.474090663228401e-01, -1.550918843710593e-02, 2.466352815702471e-03,
    -5.041246782281836e-04, 1.164254444024750e-04, -2.892003841316938e-05, 7.541131605350303e-06,
    -2.035474973147588e-06, 5.639775268445228e-07, -1.603647473166151e-07, 4.617955473808906e-08,
    -1.241851354123506e-08, 3.601632120721053e-09, -1.706996504922347e-09, 5.267350653124788e-10,
)  # fmt: skip
"""cos(⅔ arccos((1 + t)/2)) on −1 ≤ t ≤ 1 by powers of t, its Chebyshev series cut after degree 15:
within 7e-15, measured in 40 digits."""
_ON_SURFACE = 1.0 - 8.0 * float_info.epsilon
"""A point within rounding of the surface takes the gradient of the outside, so that a particle
resting on the body can leave it upwards."""
_AXIS_NAMES = ("axis_x", "axis_y", "axis_z")


class Ellipsoid:
    r"""A homogeneous ellipsoid, exact inside, on and outside its surface.

    With Λ the largest root of x²/(a²+Λ) + y²/(b²+Λ) + z²/(c²+Λ) = 1 outside and 0 inside, and
    u = a²+Λ, v = b²+Λ, w = c²+Λ [1]_ [2]_::

        U   = GM (³⁄₂ R_F(u,v,w) − ½ [x² R_D(v,w;u) + y² R_D(w,u;v) + z² R_D(u,v;w)])
        g_x = −GM x R_D(v,w;u), and so on.

    Spheres and spheroids need no special case, and the axes no order of size.

    Parameters
    ----------
    spec : EllipsoidSpec
        Its parameters. Run-time parameters: ``density`` or ``gm``, whichever the spec gives, and
        ``axis_x``, ``axis_y``, ``axis_z``. Axes set at run time change the attraction; with a
        density the mass as well; `surface` keeps the nominal ones.

    References
    ----------
    .. [1] S. Chandrasekhar (1969), Ellipsoidal Figures of Equilibrium, ch. 3.
    .. [2] B. C. Carlson (1995), Numerical Algorithms 10, 13–26 (the integrals).
    """

    frame = "body"

    def __init__(self, spec: EllipsoidSpec) -> None:
        self._axes = spec.axes_m
        self._density = spec.density_kg_m3
        constant_g = spec.gravitational_constant
        self._gravitational_constant = CODATA_2018_G if constant_g is None else constant_g
        if spec.gm_m3_s2 is not None:
            self.gm_m3_s2 = spec.gm_m3_s2
        elif spec.density_kg_m3 is not None:
            volume = 4.0 / 3.0 * pi * prod(spec.axes_m)
            self.gm_m3_s2 = self._gravitational_constant * spec.density_kg_m3 * volume
        # Lengths are divided by the greatest axis, so that powers up to the sixth of a distance
        # stay of order one near the body whatever its size.
        self._unit = max(spec.axes_m)

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return the nominal semi-axes along x, y, z, m."""
        return self._axes

    def surface(self, r: Vec3) -> Expr:
        """Return x²/a² + y²/b² + z²/c² − 1: negative inside, zero on the nominal surface."""
        x, y, z = (r[i] / self._axes[i] for i in range(3))
        return x * x + y * y + z * z - 1.0

    def switches(self, r: Vec3, p: Params) -> tuple[Expr, ...]:
        """Return x²/a² + y²/b² + z²/c² − 1 with the axes of `p`: inside, Λ is zero."""
        position, squares = self._scale_position(r, p)
        return (_level(position, squares) - 1.0,)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return ``density`` or ``gm``, then the three axes."""
        mass = (
            Parameter("gm", self.gm_m3_s2, "m3/s2", positive=True)
            if self._density is None
            else Parameter("density", self._density, "kg/m3", positive=True)
        )
        axes = zip(_AXIS_NAMES, self._axes, strict=True)
        return (mass, *(Parameter(name, value, "m", positive=True) for name, value in axes))

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the body-fixed position r, m."""
        position, squares = self._scale_position(r, p)
        rf, rd = carlson_rf_rd(_confocal(position, squares), _duplications(squares))
        moment = dot([q * q for q in position], rd)
        return self._gm(p) / self._unit * (1.5 * rf - 0.5 * moment)

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s², at the body-fixed position r, m."""
        position, squares = self._scale_position(r, p)
        _, rd = carlson_rf_rd(_confocal(position, squares), _duplications(squares))
        factor = -self._gm(p) / self._unit**2
        return (
            factor * position[0] * rd[0],
            factor * position[1] * rd[1],
            factor * position[2] * rd[2],
        )

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s², see `homogeneous_bound`."""
        a, b, c = (p[name] for name in _AXIS_NAMES)
        reach = maximum(maximum(a, b), c)
        return homogeneous_bound(distance, self._gm(p), power(a * b * c, 1.0 / 3.0), reach)

    def _gm(self, p: Params) -> Expr:
        if self._density is None:
            return p["gm"]
        a, b, c = (p[name] for name in _AXIS_NAMES)
        return (4.0 / 3.0 * pi * self._gravitational_constant) * p["density"] * a * b * c

    def _scale_position(self, r: Vec3, p: Params) -> tuple[Vec3, Vec3]:
        """Position and squared axes in units of the greatest nominal axis."""
        a, b, c = (p[name] / self._unit for name in _AXIS_NAMES)
        per_unit = 1.0 / self._unit
        return (r[0] * per_unit, r[1] * per_unit, r[2] * per_unit), (a * a, b * b, c * c)


def homogeneous_bound(distance: Expr, gm: Expr, radius: Scalar, reach: Scalar) -> Expr:
    r"""Return an upper bound of the attraction of a homogeneous body of any shape.

    Of all sets of one volume the ball about the point has the largest integral of 1/s² (the
    integrand falls with the distance s), so that :math:`|\nabla U| \le G\rho\int s^{-2} dV \le
    4\pi G\rho R = 3GM/R^2`, with R the radius of the ball of the body's volume. Outside its
    enclosing sphere all mass is at least ``distance − reach`` away.

    Parameters
    ----------
    distance : Expr
        From the centre, m.
    gm : Expr
        GM, m³/s².
    radius : Expr or float
        R, m.
    reach : Expr or float
        Radius of a sphere about the centre that holds the body, m.

    Returns
    -------
    Expr
        m/s².
    """
    gap = distance - reach
    # At or within the sphere the quotient says nothing, and the minimum is the first bound.
    return minimum(3.0 * gm / (radius * radius), gm * power(gap * gap, -1.0))


def _confocal(position: Vec3, squares: Vec3) -> Vec3:
    """Return the squared semi-axes of the confocal ellipsoid through a point, of the body inside.

    Λ is the largest root of the cubic λ³ + p₂λ² + p₁λ + p₀ = 0, which has three real roots,
    2√q cos(θ/3) − p₂/3 with cos θ = …/q^(3/2). Where terms cancel, near the surface, that is good
    to the rounding of the terms only, and one Newton step on the confocal equation restores Λ to
    its own rounding. That step also makes the automatic derivative right: its own derivative is
    that of the implicit function, and the starting value enters only through its error.
    """
    a2, b2, c2 = squares
    x, y, z = position
    outside = greater(_level(position, squares), _ON_SURFACE)
    # Inside, the cubic is evaluated at a harmless point outside: its own values there may be
    # infinite, and in a derivative zero times infinity is not zero.
    x2 = select(outside, x * x, 4.0 * a2)
    y2 = select(outside, y * y, 0.0)
    z2 = select(outside, z * z, 0.0)
    p2 = a2 + b2 + c2 - x2 - y2 - z2
    p1 = a2 * b2 + b2 * c2 + c2 * a2 - x2 * (b2 + c2) - y2 * (c2 + a2) - z2 * (a2 + b2)
    p0 = a2 * b2 * c2 - x2 * b2 * c2 - y2 * c2 * a2 - z2 * a2 * b2
    q = p2 * p2 / 9.0 - p1 / 3.0
    size = sqrt(q)
    cosine = ((p1 * p2 - 3.0 * p0) / 6.0 - p2 * p2 * p2 / 27.0) / (q * size)
    # cos²(θ/2) = (1 + cos θ)/2, zero only where two of the larger roots meet, which is inside.
    half = sqrt(maximum(0.5 + 0.5 * cosine, _LEAST_HALF))
    root = 2.0 * size * _cosine_of_third(half) - p2 / 3.0
    u, v, w = root + a2, root + b2, root + c2
    # Newton step on x²/u + y²/v + z²/w = 1, whose derivative by Λ is −Σ x²/u²
    over = (1.0 / u, 1.0 / v, 1.0 / w)
    parts = (x2 * over[0], y2 * over[1], z2 * over[2])
    excess = parts[0] + parts[1] + parts[2] - 1.0
    root = root + excess / dot(parts, over)
    root = select(outside, root, 0.0)
    return (root + a2, root + b2, root + c2)


def _cosine_of_third(half: Expr) -> Expr:
    """Return cos(θ/3) from cos(θ/2) in [0, 1].

    As a function of cos(θ/2) it has no singularity but at −1, so that a polynomial of degree 15
    gives it to rounding.
    """
    t = 2.0 * half - 1.0
    t2 = t * t
    t4 = t2 * t2
    powers: tuple[Scalar, ...] = (1.0, t, t2, t * t2)
    total: Expr | None = None
    for first in reversed(range(0, len(_THIRD), 4)):
        # four terms at a time: few products, most of them independent of each other
        part = sum_of([c * p for c, p in zip(_THIRD[first : first + 4], powers, strict=True)])
        total = part if total is None else part + t4 * total
    assert total is not None
    return total


def _duplications(squares: Vec3) -> int:
    """Return the number that Carlson's integrals need outside; most if axes are set at run time."""
    try:
        return duplications_for([number_in(square) for square in squares])
    except TypeError:
        return MOST_DUPLICATIONS


def _level(position: Vec3, squares: Vec3) -> Expr:
    """Return x²/a² + y²/b² + z²/c², one on the surface."""
    x, y, z = position
    a2, b2, c2 = squares
    return x * x / a2 + y * y / b2 + z * z / c2
