"""Product of the stage ``passes``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers

__all__ = ["SUN_IN_BEAM", "PassList"]

SUN_IN_BEAM = "Sun in beam"
"""Reason that is given for intervals in which the Sun is within the antenna's beam."""


@dataclass(frozen=True)
class PassList:
    """P passes of N satellites over S stations, in the order of station and time.

    Elevations are apparent if `refracted` is true, else geometric.

    Parameters
    ----------
    stations, satellites : tuple of str
        Names.
    start : str
        Date and time, UTC, from which all times count.
    refracted : bool
        Whether elevations are apparent.
    place_rad : ndarray, shape (2, S)
        Geodetic latitude and longitude of each station.
    mask_rad : ndarray, shape (361, S)
        Mask of each station at azimuths of 0°, 1° … 360°.
    searched_s : ndarray, shape (N,)
        Length of the search for each satellite.
    end_reasons : tuple of str, length N
        Reason why the search ended early; ``""`` if it did not.
    visibility : ndarray of str, shape (S, N)
        ``"always"``, ``"never"`` or ``"passes"``.
    highest_s, highest_rad : ndarray, shape (S, N)
        Time and value of each satellite's highest elevation.
    station, satellite : ndarray of int, shape (P,)
        Indices of station and satellite of each pass.
    revolution : ndarray of int, shape (P,)
        Number of the revolution in which it culminates; the first lasts from the start to the
        first ascending node.
    ascending : ndarray of bool, shape (P,)
        Whether the satellite moves northwards at the culmination.
    rise_s, culmination_s, set_s : ndarray, shape (P,)
        Times after the start.
    begun, unfinished : ndarray of bool, shape (P,)
        Whether the pass was under way at the start, and at the end of the search.
    highest_azimuth_rad, elevation_max_rad : ndarray, shape (P,)
        Azimuth and elevation at the culmination.
    peak_azimuth_rate_rad_s : ndarray, shape (P,)
        Largest azimuth rate.
    keyhole : ndarray of bool, shape (P,)
        Whether the pass rises into the keyhole of the mount.
    sunlit_part : ndarray, shape (P,)
        Fraction of the pass during which the satellite is outside the Earth's umbra.
    t_s : ndarray, shape (K, P)
        Times along each pass, from rise to set at equal steps.
    azimuth_rad, elevation_rad, range_m, range_rate_m_s : ndarray, shape (K, P)
        Topocentric coordinates and range rate at these times; azimuths in [0, 2π).
    sun_rad : ndarray, shape (2, P)
        Azimuth and elevation of the Sun at the culmination.
    span_pass : ndarray of int, shape (Q,)
        Pass of each disturbed interval.
    span_reason : ndarray of str, shape (Q,)
        ``"Sun in beam"``, or the reason of a blind sector.
    span_s : ndarray, shape (2, Q)
        Beginning and end of each interval.
    eclipse_satellite : ndarray of int, shape (E,)
        Satellite of each eclipse.
    eclipse_s : ndarray, shape (2, E)
        Beginning and end of each eclipse.
    ground_s : ndarray, shape (G, N)
        Times of the ground tracks, one day at most; NaN after their ends.
    ground : ndarray, shape (3, G, N)
        Geodetic latitude and longitude, rad, and height, m.
    warnings : tuple of str
        Sentences for the verdict.
    """

    stations: tuple[str, ...]
    satellites: tuple[str, ...]
    start: str
    refracted: bool
    place_rad: Array
    mask_rad: Array
    searched_s: Array
    end_reasons: tuple[str, ...]
    visibility: NDArray[np.str_]
    highest_s: Array
    highest_rad: Array
    station: Integers
    satellite: Integers
    revolution: Integers
    ascending: NDArray[np.bool_]
    rise_s: Array
    culmination_s: Array
    set_s: Array
    begun: NDArray[np.bool_]
    unfinished: NDArray[np.bool_]
    highest_azimuth_rad: Array
    elevation_max_rad: Array
    peak_azimuth_rate_rad_s: Array
    keyhole: NDArray[np.bool_]
    sunlit_part: Array
    t_s: Array
    azimuth_rad: Array
    elevation_rad: Array
    range_m: Array
    range_rate_m_s: Array
    sun_rad: Array
    span_pass: Integers
    span_reason: NDArray[np.str_]
    span_s: Array
    eclipse_satellite: Integers
    eclipse_s: Array
    ground_s: Array
    ground: Array
    warnings: tuple[str, ...]
