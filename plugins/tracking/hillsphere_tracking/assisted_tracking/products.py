"""Product of the stage ``assisted_tracking``: one case, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array, Integers

__all__ = ["AssistedTracking"]


@dataclass(frozen=True)
class AssistedTracking:
    """One case of P passes with L outages in total, and T trackers.

    Parameters
    ----------
    satellite : str
        Name of the satellite.
    start : str
        Epoch of the elements, UTC, the origin of the times.
    trackers, passes, stations : tuple of str
        Names of the T trackers, of the P passes, and of each pass's station.
    revolution : ndarray of int, shape (P,)
        Revolution in which each pass culminates.
    directions : tuple of str, length P
        ``"ascending"`` or ``"descending"``, at the culmination.
    plain_acquisition_s, plain_duration_s, plain_elevation_max_rad : ndarray, shape (P,)
        Rise above the mask, duration and highest elevation of the orbit of the elements; NaN if
        the satellite does not rise in that revolution.
    earth_shift_rad : ndarray, shape (P,)
        Angle by which the Earth is turned eastwards to reach the requested elevation.
    acquisition_s, duration_s, elevation_max_rad : ndarray, shape (P,)
        First measurement above the mask, time from rise to set, and highest elevation of the
        tracked pass.
    station_error_m : ndarray, shape (P,)
        Error of the station's location that the trackers assume.
    t_s : ndarray, shape (K, P)
        Times since the acquisition of each pass; NaN after its end.
    true_rad, measured_rad : ndarray, shape (2, K, P)
        True and measured azimuth and elevation.
    bias_rad, sigma_rad : ndarray, shape (2, K, P)
        Systematic part of the antenna's errors, and standard deviation of its noise.
    outage_pass : ndarray of int, shape (L,)
        Pass of each outage.
    outage_s : ndarray, shape (L,)
        Beginning of each outage after the acquisition.
    outage_names : tuple of str, length L
        Names of the outages in the metrics.
    error_rad, sky_error_rad, encoder_error_rad : ndarray, shape (T, L, K)
        Errors of the measures ``error_max``, ``sky_error_max`` and ``encoder_error_max``: before
        the loss errors of the estimate from the measurements so far, after it errors of the
        prediction.
    spread_rad : ndarray, shape (T, L, K)
        Larger standard deviation on the sky, from the tracker's covariance.
    metrics, units : tuple of str
        Names and units of the metrics, see `hillsphere_tracking.assisted_tracking.measures`.
    values : ndarray, shape (m,)
        Values of the metrics.
    lock_angle_rad : float
        Error up to which the signal is received.
    warnings : tuple of str
        Sentences for the verdict.
    """

    satellite: str
    start: str
    trackers: tuple[str, ...]
    passes: tuple[str, ...]
    stations: tuple[str, ...]
    revolution: Integers
    directions: tuple[str, ...]
    plain_acquisition_s: Array
    plain_duration_s: Array
    plain_elevation_max_rad: Array
    earth_shift_rad: Array
    acquisition_s: Array
    duration_s: Array
    elevation_max_rad: Array
    station_error_m: Array
    t_s: Array
    true_rad: Array
    measured_rad: Array
    bias_rad: Array
    sigma_rad: Array
    outage_pass: Integers
    outage_s: Array
    outage_names: tuple[str, ...]
    error_rad: Array
    sky_error_rad: Array
    encoder_error_rad: Array
    spread_rad: Array
    metrics: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    lock_angle_rad: float
    warnings: tuple[str, ...]
