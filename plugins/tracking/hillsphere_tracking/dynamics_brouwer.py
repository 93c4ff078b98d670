r"""Brouwer's theory of a satellite about an oblate planet [1]_, as symbolic expressions.

The expressions are the single source for values and derivatives: `mean_elements` and the trackers
compile them. With η = √(1−e²), θ = cos i, γ₂ = (J2/2)(R/a)²/η⁴, γ₄ = −(3/8)J4(R/a)⁴/η⁸,

.. math::

    \dot M/n &= 1 + \tfrac32 γ_2 η (3θ^2-1) + \tfrac{3}{32} γ_2^2 η [-15+16η+25η^2
        + (30-96η-90η^2)θ^2 + (105+144η+25η^2)θ^4] + \tfrac{15}{16} γ_4 η e^2 (3-30θ^2+35θ^4), \\
    \dot ω/n &= \tfrac32 γ_2 (5θ^2-1) + \tfrac{3}{32} γ_2^2 [-35+24η+25η^2
        + (90-192η-126η^2)θ^2 + (385+360η+45η^2)θ^4]
        + \tfrac{5}{16} γ_4 [21-9η^2 + (126η^2-270)θ^2 + (385-189η^2)θ^4], \\
    \dot Ω/n &= -3γ_2 θ + \tfrac38 γ_2^2 [(-5+12η+9η^2)θ - (35+36η+5η^2)θ^3]
        + \tfrac54 γ_4 (5-3η^2) θ (3-7θ^2).

The short-period terms are of first order in J2, in Lyddane's combinations [2]_, which stay finite
at e = 0 and i = 0. The long-period terms are neglected: they contain the divisor 1 − 5θ², which
vanishes at the critical inclinations 63.4° and 116.6°. Over a pass they are nearly constant, and
fitted or converted mean elements absorb them.

References
----------
.. [1] Brouwer, D. (1959), Solution of the problem of artificial satellite theory without drag,
   Astron. J. 64, 378-397.
.. [2] Lyddane, R. H. (1963), Small eccentricities or inclinations in the Brouwer theory of the
   artificial satellite, Astron. J. 68, 555-558.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from hillsphere import symbolic as sy
from hillsphere.errors import InputError
from hillsphere.symbolic import Expr, Scalar, Vec3

__all__ = ["Equinoctial", "ZonalField", "at_time", "osculating_equinoctial", "position"]


@dataclass(frozen=True)
class ZonalField:
    """Zonal gravity field of a planet; the defaults are the Earth.

    Parameters
    ----------
    gm_m3_s2, radius_m : float
        Gravitational parameter, and the equatorial radius to which J2 and J4 refer.
    j2, j4 : float
        Zonal coefficients, not normalised.

    Raises
    ------
    InputError
        If `gm_m3_s2` or `radius_m` is not positive, or a value is not finite.
    """

    gm_m3_s2: float = 398600.4418e9
    radius_m: float = 6378137.0
    j2: float = 1.08262668e-3
    j4: float = -1.61962159e-6

    def __post_init__(self) -> None:
        values = (self.gm_m3_s2, self.radius_m, self.j2, self.j4)
        if not (all(map(isfinite, values)) and self.gm_m3_s2 > 0.0 and self.radius_m > 0.0):
            raise InputError(f"a zonal field needs finite values, gm and radius > 0, got {values}")


@dataclass(frozen=True)
class Equinoctial:
    """Equinoctial elements a, e cos ϖ, e sin ϖ, t cos Ω, t sin Ω, λ = M + ϖ.

    With s = 1, ϖ = ω + Ω and t = tan(i/2): regular except at i = 180°. With s = −1, ϖ = ω − Ω and
    t = cot(i/2): regular except at i = 0.
    """

    a: Expr
    k: Expr
    h: Expr
    q: Expr
    p: Expr
    longitude: Expr

    def tuple(self) -> tuple[Expr, ...]:
        """Return the six elements in this order."""
        return (self.a, self.k, self.h, self.q, self.p, self.longitude)


def at_time(elements: tuple[Expr, ...], dt: Scalar, field: ZonalField) -> tuple[Expr, ...]:
    """Return mean elements a, e, i, Ω, ω, M after a time dt (s), by the secular rates."""
    # the rates of the module's docstring: g2 = γ₂, g4 = γ₄, th = θ, eta = η
    a, e, i, node, perigee, mean = elements
    e2 = e * e
    eta2 = 1.0 - e2
    eta = sy.sqrt(eta2)
    th = sy.cos(i)
    th2 = th * th
    th4 = th2 * th2
    n = sy.sqrt(field.gm_m3_s2 / (a * a * a))
    ratio = field.radius_m / a
    ratio2 = ratio * ratio
    g2 = 0.5 * field.j2 * ratio2 / (eta2 * eta2)
    g4 = -0.375 * field.j4 * ratio2 * ratio2 / (eta2 * eta2 * eta2 * eta2)
    mean_rate = n * (
        1.0
        + 1.5 * g2 * eta * (3.0 * th2 - 1.0)
        + 3.0 / 32.0 * g2 * g2 * eta
        * (
            -15.0 + 16.0 * eta + 25.0 * eta2
            + (30.0 - 96.0 * eta - 90.0 * eta2) * th2
            + (105.0 + 144.0 * eta + 25.0 * eta2) * th4
        )
        + 15.0 / 16.0 * g4 * eta * e2 * (3.0 - 30.0 * th2 + 35.0 * th4)
    )  # fmt: skip
    perigee_rate = n * (
        1.5 * g2 * (5.0 * th2 - 1.0)
        + 3.0 / 32.0 * g2 * g2
        * (
            -35.0 + 24.0 * eta + 25.0 * eta2
            + (90.0 - 192.0 * eta - 126.0 * eta2) * th2
            + (385.0 + 360.0 * eta + 45.0 * eta2) * th4
        )
        + 5.0 / 16.0 * g4
        * (
            21.0 - 9.0 * eta2 + (126.0 * eta2 - 270.0) * th2 + (385.0 - 189.0 * eta2) * th4
        )
    )  # fmt: skip
    node_rate = n * th * (
        -3.0 * g2
        + 0.375 * g2 * g2
        * (-5.0 + 12.0 * eta + 9.0 * eta2 - (35.0 + 36.0 * eta + 5.0 * eta2) * th2)
        + 1.25 * g4 * (5.0 - 3.0 * eta2) * (3.0 - 7.0 * th2)
    )  # fmt: skip
    return (
        a, e, i, node + node_rate * dt, perigee + perigee_rate * dt, mean + mean_rate * dt
    )  # fmt: skip


def osculating_equinoctial(
    elements: tuple[Expr, ...], sense: Expr, field: ZonalField, *, short_period: bool = True
) -> Equinoctial:
    """Convert mean elements a, e, i, Ω, ω, M to osculating equinoctial elements.

    The result is regular at e = 0 and at i = 0. `sense` is s, +1 or −1 (see `Equinoctial`). Without
    `short_period` the mean elements are only converted to equinoctial ones.
    """
    a, e, i, node, perigee, mean = elements
    # selectors of the two cases s = 1 and s = −1, since an expression has no branches
    plus, minus = 0.5 * (1.0 + sense), 0.5 * (1.0 - sense)
    half = 0.5 * i
    # size of the node's vector: sin(i/2), or cos(i/2) for s = −1
    size = plus * sy.sin(half) + minus * sy.cos(half)
    cn, sn = sy.cos(node), sy.sin(node)
    longitude = mean + perigee + sense * node
    e_cos, e_sin = e * sy.cos(mean), e * sy.sin(mean)
    size_cos, size_sin = size * cn, size * sn
    if short_period:
        eta2 = 1.0 - e * e
        eta = sy.sqrt(eta2)
        # E − M by Kepler's equation, then the equation of the centre f − M
        apart = sy.kepler(e_sin, e_cos, e_sin)
        ecc = mean + apart
        ce, se = sy.cos(ecc), sy.sin(ecc)
        # f − E as in `kepler.true_anomaly`
        beta = e / (1.0 + eta)
        centre = apart + 2.0 * sy.atan2(beta * se, 1.0 - beta * ce)
        f = mean + centre
        cf, sf = sy.cos(f), sy.sin(f)
        th = sy.cos(i)
        th2 = th * th
        off = 1.0 - th2
        odd = 3.0 * th2 - 1.0
        ratio = field.radius_m / a
        g2 = 0.5 * field.j2 * ratio * ratio / (eta2 * eta2)
        w = (1.0 + e * cf) / eta2  # a/r
        w3 = w * w * w
        # arguments 2ω + k f of the periodic terms, k = 1, 2, 3
        wide = 2.0 * perigee
        c2, s2 = sy.cos(wide + 2.0 * f), sy.sin(wide + 2.0 * f)
        c1, s1 = sy.cos(wide + f), sy.sin(wide + f)
        c3, s3 = sy.cos(wide + 3.0 * f), sy.sin(wide + 3.0 * f)
        a_new = a * (
            1.0 + g2 * eta2 * eta2 * (odd * (w3 - 1.0 / (eta2 * eta)) + 3.0 * off * w3 * c2)
        )
        # Brouwer's δe with the divisor e taken out: ((a/r)³ − η⁻³)/e and ((a/r)³ − η⁻⁴)/e
        tail = 3.0 * cf + e * cf * cf * (3.0 + e * cf)
        de = 0.5 * g2 * (
            odd * (e * eta + e / (1.0 + eta) + tail)
            + 3.0 * off * (e + tail) * c2
            - eta2 * off * (3.0 * c1 + c3)
        )  # fmt: skip
        # e δM (`e_dl`): the sum `sines` returns below in δM + δω
        near = eta2 * w * w
        sines = 2.0 * odd * (near + w + 1.0) * sf + 3.0 * off * (
            (1.0 - near - w) * s1 + (near + w + 1.0 / 3.0) * s3
        )
        e_dl = -0.25 * eta2 * eta * g2 * sines
        # `drift` is f − M + e sin f; δi, δΩ (`dh`) and δM + δω (`dlg`) follow
        drift = centre + e * sf
        triple = 3.0 * s2 + e * (3.0 * s1 + s3)
        di = 0.5 * g2 * th * sy.sin(i) * (3.0 * c2 + e * (3.0 * c1 + c3))
        dh = -0.5 * g2 * th * (6.0 * drift - triple)
        # δM + δω: the two parts with the divisor e join to −(η²−η³)/e = η² e/(1+η)
        dlg = 0.25 * g2 * (
            e * eta2 / (1.0 + eta) * sines
            + 6.0 * (5.0 * th2 - 1.0) * drift
            + (3.0 - 5.0 * th2) * triple
        )  # fmt: skip
        # Lyddane: e + δe and e δM turn e cos M, e sin M; δi and δΩ turn the node's vector
        cm, sm = sy.cos(mean), sy.sin(mean)
        e_cos, e_sin = (e + de) * cm - e_dl * sm, (e + de) * sm + e_dl * cm
        grown = size + 0.5 * di * (plus * sy.cos(half) - minus * sy.sin(half))
        size_cos, size_sin = grown * cn - size * dh * sn, grown * sn + size * dh * cn
        longitude = longitude + dlg + sense * dh
        a = a_new
    # from e cos M, e sin M and λ to e cos ϖ, e sin ϖ; from sin(i/2) to tan(i/2)
    cl, sl = sy.cos(longitude), sy.sin(longitude)
    steep = sy.sqrt(1.0 - size_cos * size_cos - size_sin * size_sin)
    return Equinoctial(
        a,
        e_cos * cl + e_sin * sl,
        e_cos * sl - e_sin * cl,
        size_cos / steep,
        size_sin / steep,
        longitude,
    )


def position(orbit: Equinoctial, sense: Expr) -> Vec3:
    """Return the inertial position (m) of osculating equinoctial elements.

    Kepler's equation is solved for the eccentric longitude F = E + ϖ, so that e = 0 is regular.
    """
    a, k, h, q, p, longitude = orbit.tuple()
    cl, sl = sy.cos(longitude), sy.sin(longitude)
    e_cos, e_sin = k * cl + h * sl, k * sl - h * cl  # e cos M, e sin M
    ecc = longitude + sy.kepler(e_sin, e_cos, e_sin)
    cf, sf = sy.cos(ecc), sy.sin(ecc)
    # coordinates in the orbital plane, in the equinoctial axes
    b = 1.0 / (1.0 + sy.sqrt(1.0 - k * k - h * h))
    x = a * ((1.0 - h * h * b) * cf + h * k * b * sf - k)
    y = a * ((1.0 - k * k * b) * sf + h * k * b * cf - h)
    # rotation of these axes to the inertial frame, in terms of p and q
    scale = 1.0 / (1.0 + p * p + q * q)
    return (
        scale * ((1.0 - p * p + q * q) * x + 2.0 * sense * p * q * y),
        scale * (2.0 * p * q * x + sense * (1.0 + p * p - q * q) * y),
        scale * (2.0 * q * y - 2.0 * sense * p * x),
    )
