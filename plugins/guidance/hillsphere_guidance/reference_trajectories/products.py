"""What the stage ``reference_trajectories`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array
from hillsphere.products import FlightSet

__all__ = ["ReferenceTrajectories"]


@dataclass(frozen=True)
class ReferenceTrajectories(FlightSet):
    """Planned descents; of each flight the states on a grid, and the command held between.

    Flown with that command from its start, a flight meets its states at every second time of the
    grid (and at the end) exactly, and at the others but for what one held value cannot do.

    Parameters
    ----------
    flights : Trajectories
        N descents of d positions at K times, NaN beyond the end.
    command : ndarray, shape (d, K, N)
        The command as planned, not held, at these times, m/s².
    descents : tuple of str, length N
        What each is called in the mission, wherever it begins.
    guidance : str
        What planned them.
    account : tuple of str, length N
        How well each was found.
    start_distance_m, duration_s : ndarray, shape (N,)
        From the centre of the plant's frame; length.
    latitude_rad, longitude_rad : ndarray, shape (N,)
        Of the site, planetocentric, on the body; NaN without one.
    dv_m_s, dv_held_m_s : ndarray, shape (N,)
        ∫|a|dt of the command as planned, and as held.
    peak_m_s2 : ndarray, shape (N,)
        Largest |a| of the command as planned.
    replay_m, replay_held_m : ndarray, shape (2, N)
        Distance (m) and speed (m/s) from the planned end at which a flight with the command alone
        ends, by other propagators: as planned, and as held.
    height_m : ndarray, shape (K, N)
        Above the surface along the radius, negative below; NaN without a surface.
    surface_m : ndarray, shape (3, J, L), or None
        Points of the surface, in the plant's frame.
    body : str
        Name of the body; empty if the plant does not say.
    series_radius_m : float or None
        Radius inside which the gravity is a series that may diverge.
    compared : tuple of str, length C
        Names of other plants.
    difference_m_s2 : ndarray, shape (C, K, N)
        Size of the difference of their accelerations, without a command, from those of the plant
        along the paths.
    """

    command: Array
    descents: tuple[str, ...]
    guidance: str
    account: tuple[str, ...]
    start_distance_m: Array
    duration_s: Array
    latitude_rad: Array
    longitude_rad: Array
    dv_m_s: Array
    dv_held_m_s: Array
    peak_m_s2: Array
    replay_m: Array
    replay_held_m: Array
    height_m: Array
    surface_m: Array | None
    body: str
    series_radius_m: float | None
    compared: tuple[str, ...]
    difference_m_s2: Array
