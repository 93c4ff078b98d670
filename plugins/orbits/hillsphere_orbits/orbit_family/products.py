"""What the stage ``orbit_family`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import OrbitSet, PeriodicOrbits

__all__ = ["FollowedFamily"]


@dataclass(frozen=True)
class FollowedFamily(OrbitSet):
    """A family of periodic orbits, the members asked for, and how parameters carried them.

    Parameters
    ----------
    members : PeriodicOrbits
        The N orbits asked for; where parameters change, those that arrived, at their end.
    curve : PeriodicOrbits
        K orbits along the family, of the plant as it is.
    member_indices, curve_indices : ndarray, shape (2, N), (2, K)
        Stability indices: planar and vertical of planar orbits, the larger and the smaller of those
        in space; NaN where they are complex.
    member_amplitude_m, curve_amplitude_m : ndarray, shape (N,), (K,)
        As the family measures it.
    member_clearance : ndarray, shape (N,)
        Least value of the plant's impact function along the orbit, negative inside the body as the
        plant declares it; NaN without a surface.
    asked : tuple of str, length M
        Every orbit asked for.
    status : tuple of str, length M
        ``"reached"``, or why it is not among the members.
    held : tuple of str, length M
        What kept its value as the parameters changed; empty if none did.
    held_value : ndarray, shape (M,)
        That value, natural units.
    parameters : tuple of str, length P
        Names of the parameters that change.
    parameter_start, parameter_end : ndarray, shape (P,)
        Their values, SI.
    way_orbit : ndarray of int, shape (W,)
        Which of the M orbits each step on the way belongs to.
    way_fraction : ndarray, shape (W,)
        Part of the change of the parameters there.
    way_x0 : ndarray, shape (n, W)
        State at the start, SI.
    way_period_s, way_integral : ndarray, shape (W,)
        Period and integral of motion (natural units).
    tracks_m : ndarray, shape (3, Q, N)
        Positions of the members along one period.
    method, check : str
        How orbits were found, and how closure was measured.
    ends : tuple of str
        Why the curve begins and stops where it does.
    body : str
        Name of the body; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    """

    curve: PeriodicOrbits
    member_indices: Array
    curve_indices: Array
    member_amplitude_m: Array
    curve_amplitude_m: Array
    member_clearance: Array
    asked: tuple[str, ...]
    status: tuple[str, ...]
    held: tuple[str, ...]
    held_value: Array
    parameters: tuple[str, ...]
    parameter_start: Array
    parameter_end: Array
    way_orbit: NDArray[np.int64]
    way_fraction: Array
    way_x0: Array
    way_period_s: Array
    way_integral: Array
    tracks_m: Array
    method: str
    check: str
    ends: tuple[str, str]
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float
