"""Where the Sun and the Moon stand, as expressions of time."""

from __future__ import annotations

from typing import cast

from hillsphere.base.constants import AU_M
from hillsphere.symbolic import Expr, Vec3
from hillsphere.symbolic._heyoka import heyoka as _hy

__all__ = ["GM_M3_S2", "moon_position", "sun_position"]

GM_M3_S2 = {"sun": 1.32712440041e20, "moon": 4.9028001e12}
"""Gravitational parameters, m³/s², rounded (Park, R. S., et al., The JPL planetary and lunar
ephemerides DE440 and DE441, Astronomical Journal 161, 105, 2021)."""


def sun_position(centuries: Expr) -> Vec3:
    """Position of the Sun as seen from the Earth, m, in the axes of the ICRF.

    By the series VSOP2013 [1]_ of the barycentre of Earth and Moon, cut off at 1e-4: to 2e-4 of the
    distance from 1950 to 2050.

    Parameters
    ----------
    centuries : Expr
        Julian centuries (TDB) since J2000.0.

    Returns
    -------
    Vec3
        Position of the Sun.

    References
    ----------
    .. [1] J.-L. Simon, G. Francou, A. Fienga, H. Manche (2013), New analytical planetary theories
       VSOP2013 and TOP2013, Astronomy & Astrophysics 557, A49.
    """
    series = _hy.model.vsop2013_cartesian_icrf(3, time_expr=centuries * 0.1, thresh=1e-4)
    x, y, z = (cast(Expr, q) * -AU_M for q in series[:3])
    return (x, y, z)


def moon_position(centuries: Expr) -> Vec3:
    """Position of the Moon as seen from the Earth, m, in the axes of FK5 (ICRF to 0.02″).

    By the series ELP2000 [1]_, cut off at 1e-4: to 1e-3 of the distance.

    Parameters
    ----------
    centuries : Expr
        Julian centuries (TDB) since J2000.0.

    Returns
    -------
    Vec3
        Position of the Moon.

    References
    ----------
    .. [1] M. Chapront-Touzé, J. Chapront (1983), The lunar ephemeris ELP 2000, Astronomy &
       Astrophysics 124, 50-62.
    """
    series = _hy.model.elp2000_cartesian_fk5(time_expr=centuries, thresh=1e-4)
    x, y, z = (cast(Expr, q) * 1e3 for q in series)
    return (x, y, z)
