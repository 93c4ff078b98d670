"""The asteroid of the plant ``proximity`` on its orbit and about its axis, as expressions of time.

References
----------
.. [1] Vallado, D. A. (2013), Fundamentals of Astrodynamics and Applications, 4th ed., section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from hillsphere.symbolic import (
    Expr,
    Params,
    Vec3,
    atan2,
    constant,
    cos,
    eccentric_anomaly,
    power,
    sin,
    sqrt,
)
from hillsphere_plants.rotation import mean_anomaly

__all__ = ["OrbitPoint", "axes_of", "body_turn", "orbit_at", "orbit_known", "orbit_terms"]

_ORBIT = "orbit."


class OrbitPoint(NamedTuple):
    """State of the asteroid on its Keplerian orbit.

    Parameters
    ----------
    distance : Expr
        Distance from the Sun, m.
    rate, acceleration : Expr
        ḟ and f̈ of the true anomaly, rad/s and rad/s².
    travelled : Expr
        f − f₀ since time 0, rad.
    """

    distance: Expr
    rate: Expr
    acceleration: Expr
    travelled: Expr


def orbit_at(t: Expr, p: Params) -> OrbitPoint:
    """Return the state of the asteroid on its Keplerian orbit.

    Parameters
    ----------
    t : Expr
        Time, s.
    p : Params
        ``primary_gm``, ``semi_major_axis``, ``eccentricity`` and ``true_anomaly`` at time 0.

    Returns
    -------
    OrbitPoint
        By Kepler's equation [1]_.
    """
    gm, a, e, start = (
        p[key] for key in ("primary_gm", "semi_major_axis", "eccentricity", "true_anomaly")
    )
    mean = mean_anomaly(start, e)[0] + sqrt(gm * power(a, -3.0)) * t
    eccentric = eccentric_anomaly(e, mean)
    c, s = cos(eccentric), sin(eccentric)
    root = sqrt(1.0 - e * e)
    beta = e / (1.0 + root)
    # f − E = 2 atan(β sin E/(1 − β cos E)): exact, and unlike tan(f/2) without a choice of quadrant
    anomaly = eccentric + 2.0 * atan2(beta * s, 1.0 - beta * c)
    distance = a * (1.0 - e * c)
    # ḟ = h/R² with h = √(GM a (1 − e²)); Ṙ = √(GM a) e sin E / R; f̈ = −2 ḟ Ṙ/R
    rate = sqrt(gm * a) * root / (distance * distance)
    outward = sqrt(gm * a) * e * s / distance
    return OrbitPoint(distance, rate, -2.0 * rate * outward / distance, anomaly - start)


def orbit_terms(orbit: OrbitPoint) -> dict[str, Expr]:
    """Return the expressions of a point by names for `hillsphere.interfaces.TimedPlant`."""
    return {_ORBIT + name: e for name, e in orbit._asdict().items()}


def orbit_known(p: Params) -> OrbitPoint | None:
    """Return the point of which `orbit_terms` stand among the parameters, or None."""
    terms = [p.get(_ORBIT + name) for name in OrbitPoint._fields]
    known = [e for e in terms if e is not None]
    return OrbitPoint(*known) if len(known) == len(terms) else None


def body_turn(
    t: Expr, p: Params, travelled: Expr, equinox: float, tilt: tuple[float, float]
) -> tuple[Vec3, Vec3, Vec3]:
    """Return the body's axes in the Hill frame, as rows.

    Parameters
    ----------
    t : Expr
        Time, s.
    p : Params
        ``rotation_rate``, ``rotation_angle`` at time 0 and ``true_anomaly`` there.
    travelled : Expr
        f − f₀, rad.
    equinox : float
        True anomaly at which the Sun comes north over the equator, rad.
    tilt : tuple of float
        Cosine and sine of the obliquity.

    Returns
    -------
    tuple of Vec3
        Rows of the matrix from the Hill frame to the body's: towards longitude 0, the third axis
        completing, and the spin axis.
    """
    spin = p["rotation_angle"] + p["rotation_rate"] * t
    upright, leaning = tilt
    if not leaning:
        c, s = cos(spin - travelled), sin(spin - travelled)
        zero = constant(0.0)
        return (c, s, zero), (-s, c, zero), (zero, zero, constant(1.0))
    # by way of inertial axes with x along the line of the equinox, in which orbit plane and equator
    # intersect: rotations by u from the Hill frame, by the obliquity, and by v to the body
    start = p["true_anomaly"] - equinox
    u, v = start + travelled, start + spin
    cu, su, cv, sv = cos(u), sin(u), cos(v), sin(v)
    along = (cu, -su)  # the line's components on x and y of the Hill frame
    across = (upright * su, upright * cu, constant(leaning))
    return (
        (cv * along[0] + sv * across[0], cv * along[1] + sv * across[1], sv * across[2]),
        (cv * across[0] - sv * along[0], cv * across[1] - sv * along[1], cv * across[2]),
        (-leaning * su, -leaning * cu, constant(upright)),
    )


def axes_of(rows: Sequence[Vec3], r: Vec3, *, back: bool = False) -> Vec3:
    """Return the components along the rows of a vector, or (`back`) the vector of components."""
    table = list(zip(*rows, strict=True)) if back else list(rows)
    x, y, z = (row[0] * r[0] + row[1] * r[1] + row[2] * r[2] for row in table)
    return (x, y, z)
