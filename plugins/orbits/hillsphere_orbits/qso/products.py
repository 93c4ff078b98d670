"""What the orbit stages hand on."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array
from hillsphere.products import OrbitSet, PeriodicOrbits

__all__ = ["QsoFamily"]


@dataclass(frozen=True)
class QsoFamily(OrbitSet):
    """A family of quasi-satellite orbits: the curve, and the members that were asked for.

    Parameters
    ----------
    members : PeriodicOrbits
        The N orbits asked for that the family has, in that order.
    curve : PeriodicOrbits
        K orbits from the largest amplitude to the smallest, equally spaced in arclength
        relative to distance.
    member_indices, curve_indices : ndarray, shape (2, N), (2, K)
        Planar and vertical stability index; NaN where they are complex.
    y_max_m, vx_at_y_max_m_s : ndarray, shape (N,)
        Largest y of each member and vx there.
    tracks_m : ndarray, shape (3, P, N)
        Positions of the members along one revolution.
    nearest_m : float
        Least distance of any orbit of the curve from the moon's centre.
    drift : ndarray, shape (N,)
        Largest change of the integral over `drift_revolutions`, natural units.
    drift_revolutions : int
        Revolutions.
    name : str
        What tells this family from another in a legend: its gravity or its label.
    body : str
        Name of the moon; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    primary_distance_m : float or None
        Distance of the primary, by which the Hill approximation is judged; None if the equations
        are not Hill's or nothing is known of it.
    series_radius_m : float or None
        Radius inside which the gravity is a series without guarantee of convergence.
    method : str
        How the orbits were found.
    check : str
        How closure and drift were measured.
    ends : tuple of str
        Why the curve stops at its largest and its smallest amplitude.
    missing : tuple of str
        Which orbits that were asked for the family does not have, and what it has instead.
    """

    curve: PeriodicOrbits
    member_indices: Array
    curve_indices: Array
    y_max_m: Array
    vx_at_y_max_m_s: Array
    tracks_m: Array
    nearest_m: float
    drift: Array
    drift_revolutions: int
    name: str
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float
    primary_distance_m: float | None
    series_radius_m: float | None
    method: str
    check: str
    ends: tuple[str, str]
    missing: tuple[str, ...] = ()
