"""The upper atmosphere as an expression of the Earth-fixed position."""

from __future__ import annotations

from typing import cast

from hillsphere.base.geodetic import Ellipsoid
from hillsphere.symbolic import Expr, Scalar, Vec3, atan2, constant, sqrt
from hillsphere.symbolic._heyoka import heyoka as _hy

__all__ = ["density", "geodetic_expressions", "nrlmsise00_density"]

_AXIS_M = 1.0
"""Length by which the polar axis, where longitude has no derivative, is blunted."""


def geodetic_expressions(r: Vec3, ellipsoid: Ellipsoid) -> tuple[Expr, Expr, Expr]:
    """Return latitude, rad, longitude, rad, and height, m, as expressions.

    Bowring's latitude [1]_, one step: to 1e-8 rad below 2000 km, its height to a micrometre there.
    Smooth also on the polar axis, where positions are off by up to a metre for that.

    Parameters
    ----------
    r : Vec3
        Earth-fixed position, m.
    ellipsoid : Ellipsoid
        To which the coordinates refer.

    Returns
    -------
    latitude, longitude, height : Expr
        Geodetic.

    References
    ----------
    .. [1] Bowring, B. R. (1976), Transformation from spatial to geographical coordinates, Survey
       Review 23(181), 323-327.
    """
    x, y, z = r
    a = ellipsoid.equatorial_radius_m
    b = a * (1.0 - ellipsoid.flattening)
    squared = 1.0 - (b / a) ** 2
    axial = sqrt(x * x + y * y + _AXIS_M**2)
    # parametric latitude β of the point of the ellipsoid below, tan β = a z/(b p)
    length = sqrt((a * z) * (a * z) + (b * axial) * (b * axial))
    sin_beta, cos_beta = a * z / length, b * axial / length
    up = z + squared * a * a / b * sin_beta * sin_beta * sin_beta
    out = axial - squared * a * cos_beta * cos_beta * cos_beta
    hypotenuse = sqrt(up * up + out * out)
    s, c = up / hypotenuse, out / hypotenuse
    height = axial * c + z * s - a * sqrt(1.0 - squared * s * s)
    return atan2(up, out), atan2(y, x + _AXIS_M), height


def density(
    r: Vec3,
    day_of_year: Scalar,
    ellipsoid: Ellipsoid,
    f107: Scalar,
    f107_average: Scalar,
    ap: Scalar,
) -> Expr:
    """Return the density at an Earth-fixed position, kg/m³ (`nrlmsise00_density`).

    Parameters
    ----------
    r : Vec3
        Earth-fixed position, m.
    day_of_year : Scalar
        Days (UTC) since the first of January, with fraction.
    ellipsoid : Ellipsoid
        Above which heights count.
    f107, f107_average, ap : Scalar
        Solar flux of the day before and its mean over 81 days, 1e-22 W/(m² Hz); daily Ap.

    Returns
    -------
    Expr
        The density.
    """
    latitude, longitude, height = geodetic_expressions(r, ellipsoid)
    return nrlmsise00_density(height, latitude, longitude, day_of_year, f107, f107_average, ap)


def nrlmsise00_density(
    altitude_m: Scalar,
    latitude_rad: Scalar,
    longitude_rad: Scalar,
    day_of_year: Scalar,
    f107: Scalar,
    f107_average: Scalar,
    ap: Scalar,
) -> Expr:
    """Density of the upper atmosphere, by a neural network fitted to NRLMSISE-00 [1]_.

    Smooth everywhere; fitted between 180 and 1000 km, beyond which it goes on exponentially.

    Parameters
    ----------
    altitude_m, latitude_rad, longitude_rad : Scalar
        Geodetic, on WGS 84.
    day_of_year : Scalar
        Days (UTC) since the first of January, with fraction.
    f107, f107_average : Scalar
        Solar flux at 10.7 cm, 1e-22 W/(m² Hz): of the day before, and its mean over 81 days.
    ap : Scalar
        Daily geomagnetic index.

    Returns
    -------
    Expr
        kg/m³.

    References
    ----------
    .. [1] D. Izzo, G. Acciarini, F. Biscani (2024), NeuralODEs for VLEO simulations: introducing
       thermoNET for thermosphere modeling.
    """
    given = (altitude_m, latitude_rad, longitude_rad, f107, f107_average, ap, day_of_year)
    h, latitude, longitude, *rest = (
        constant(q) if isinstance(q, int | float) else q for q in given
    )
    place = [h * 1e-3, latitude, longitude]
    return cast(Expr, _hy.model.nrlmsise00_tn(place, *rest))
