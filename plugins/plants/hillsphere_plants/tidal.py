"""Tidal acceleration by a distant primary on motion about its moon, without cancellation.

The tidal acceleration is the attraction of the particle less that of the moon. Both are nearly
equal: their difference loses as many digits as the distance of the primary exceeds that of the
particle. The same holds for its potential.

References
----------
.. [1] Battin, R. H., An Introduction to the Mathematics and Methods of Astrodynamics, revised
   edition, AIAA, 1999, section 8.4 (the function f(q)).
"""

from __future__ import annotations

from hillsphere.symbolic import Expr, Scalar, Vec3, dot, sqrt

__all__ = ["tidal_acceleration", "tidal_potential"]


def tidal_acceleration(r: Vec3, d: Vec3, distance: Scalar, gm: Expr) -> Vec3:
    r"""Return the tidal acceleration by the primary.

    .. math::

        -GM\left[\frac{r-d}{|r-d|^3} + \frac{d}{D^3}\right]
        = -\frac{GM}{|r-d|^3}\,\left[r + f(q)\,d\right], \quad
        q = \frac{r\cdot(r-2d)}{D^2}, \quad f = q\,\frac{3+3q+q^2}{1+(1+q)^{3/2}} .

    Parameters
    ----------
    r : Vec3
        Position from the moon's centre, m.
    d : Vec3
        Position of the primary from there, m.
    distance : Expr
        D = \|d\|, m.
    gm : Expr
        Gravitational parameter of the primary, m³/s².

    Returns
    -------
    Vec3
        m/s².
    """
    # |r − d|² = D² (1 + q); f(q) = (1 + q)^(3/2) − 1 in the form without cancellation for small q
    q = _q(r, d, distance)
    cube = (1.0 + q) * sqrt(1.0 + q)
    f = q * (3.0 + 3.0 * q + q * q) / (1.0 + cube)
    factor = -gm / (distance * distance * distance * cube)
    return (
        factor * (r[0] + f * d[0]),
        factor * (r[1] + f * d[1]),
        factor * (r[2] + f * d[2]),
    )


def tidal_potential(r: Vec3, d: Vec3, distance: Scalar, gm: Expr) -> Expr:
    r"""Return the potential of `tidal_acceleration`, zero at the moon, m²/s².

    .. math::

        GM\left[\frac1{|r-d|} - \frac1D - \frac{r\cdot d}{D^3}\right] = \frac{GM}{D}\left[
        \frac{q^2(s+2)}{2s(1+s)^2} - \frac{r^2}{2D^2}\right], \quad s = \sqrt{1+q} .
    """
    # the bracket's terms of first order in r/D cancel; written so that only second order remains
    q = _q(r, d, distance)
    s = sqrt(1.0 + q)
    first = q * q * (s + 2.0) / (2.0 * s * (1.0 + s) * (1.0 + s))
    return gm / distance * (first - dot(r, r) / (2.0 * distance * distance))


def _q(r: Vec3, d: Vec3, distance: Scalar) -> Expr:
    along = (r[0] - 2.0 * d[0], r[1] - 2.0 * d[1], r[2] - 2.0 * d[2])
    return dot(r, along) / (distance * distance)
