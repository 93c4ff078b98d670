"""Resonances near the members of a planar family, from its stability indices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, gcd, pi

import numpy as np
from scipy.interpolate import CubicSpline

from hillsphere.interfaces import Array
from hillsphere_orbits.qso.products import QsoFamily

__all__ = ["NearbyResonance", "nearby_resonances"]

_FEWEST = 4
"""Fewest members of a stretch: a not-a-knot cubic spline needs four points."""
_PLANES = ("planar", "vertical")


@dataclass(frozen=True)
class NearbyResonance:
    """A resonance near a member.

    Parameters
    ----------
    member : int
        Which one.
    plane : str
        ``"planar"`` or ``"vertical"``.
    d, n : int
        The stability index of the plane is 2 cos(2π d/n): an orbit beside the periodic one comes
        back to itself after n revolutions.
    x_m : float
        Amplitude of the resonant orbit.
    distance_m : float
        That less the amplitude of the member.
    vy_offset_m_s : float
        Change of ẏ at the member's start that gives it the Jacobi constant of the resonant orbit;
        NaN if none does.
    """

    member: int
    plane: str
    d: int
    n: int
    x_m: float
    distance_m: float
    vy_offset_m_s: float


def nearby_resonances(family: QsoFamily, n_max: int, distance_m: float) -> list[NearbyResonance]:
    """Find every resonance of low order near a member of a family.

    Parameters
    ----------
    family : QsoFamily
        With stability indices along its curve; between its orbits they are interpolated by cubic
        splines.
    n_max : int
        Resonances d:n in lowest terms with 2 ≤ n ≤ n_max and d ≤ n/2, and 1:1.
    distance_m : float
        In amplitude x, either way.

    Returns
    -------
    list of NearbyResonance
        By member, the nearest first.
    """
    x0, members = family.curve.x0[0], family.members
    order = np.argsort(x0)
    x = x0[order]
    has_integral = bool(np.isfinite(family.curve.integral).all())
    integral = CubicSpline(x, family.curve.integral[order] if has_integral else np.zeros_like(x))
    speed = members.length_m / members.time_s
    resonances = []
    for plane, values in zip(_PLANES, family.curve_indices[:, order], strict=True):
        for d, n in _resonances(n_max):
            for place in _roots(x, values, 2.0 * cos(2.0 * pi * d / n)):
                for i in np.flatnonzero(np.abs(place - members.x0[0]) <= distance_m):
                    vy = float(members.x0[4, i] / speed)
                    # C = W − v²/2, and W stays as long as the place does
                    square = vy**2 + 2.0 * float(members.integral[i] - integral(place))
                    reached = has_integral and square >= 0.0
                    change = np.copysign(np.sqrt(square), vy) - vy if reached else np.nan
                    resonances.append(
                        NearbyResonance(
                            int(i), plane, d, n, float(place),
                            float(place - members.x0[0, i]), float(change * speed),
                        )
                    )  # fmt: skip
    return sorted(resonances, key=lambda r: (r.member, abs(r.distance_m), r.plane, r.d, r.n))


def _resonances(n_max: int) -> Iterator[tuple[int, int]]:
    yield 1, 1
    for n in range(2, n_max + 1):
        yield from ((d, n) for d in range(1, n // 2 + 1) if gcd(d, n) == 1)


def _roots(x: Array, values: Array, target: float) -> list[float]:
    """Return where values over x pass the target; stretches without values are left out."""
    gaps = np.flatnonzero(~np.isfinite(values))
    roots: list[float] = []
    begin = 0
    for end in (*gaps.tolist(), x.size):
        if end - begin >= _FEWEST:
            spline = CubicSpline(x[begin:end], values[begin:end])
            roots += spline.solve(target, extrapolate=False).tolist()
        begin = end + 1
    return roots
