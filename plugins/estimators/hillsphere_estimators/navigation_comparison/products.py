"""What the stage ``navigation_comparison`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array

__all__ = ["NavigationComparison"]


@dataclass(frozen=True)
class NavigationComparison:
    """C sets of sensors side by side; S spacecraft, P swept points; NaN where there is nothing.

    Parameters
    ----------
    labels, spacecraft, points : tuple of str
        Names of the sets, the spacecraft and the points.
    cases, lost : ndarray, shape (C, P)
        Numbers of flights of the campaign, and of those that failed; what follows is that of the
        others.
    position_m : ndarray, shape (3, C, P, S)
        5 %, 50 % and 95 % of the position errors at the end.
    velocity_m_s : ndarray, shape (C, P, S)
        Median velocity errors.
    rms_m, bound_m : ndarray, shape (C, P, S)
        Root mean square position errors and their bound.
    bound_ratio : ndarray, shape (2, C, P, S)
        Of the two, and its standard error.
    nees, nees_low, nees_high : ndarray, shape (C, P)
        Mean normalised errors squared at the end, with the 99.9 % band.
    paper_position_m, paper_velocity_m_s : ndarray, shape (C, S)
        Published single draws.
    ratio : ndarray, shape (3, C - 1, P)
        Rms position error of all spacecraft, of each set to the one before: lower limit, value,
        upper limit; empty if no order is claimed.
    answers : tuple of str
        ``confirmed``, ``refuted`` or ``undecided``, for each pair and point in turn.
    lightest : str
        The lightest set that meets the requirement at every point without losing a flight, with
        its mass; ``""`` if none was asked for.
    time_s : ndarray, shape (C, K)
        Times of the flights' measurements.
    error_m, sigma_m : ndarray, shape (C, S, K)
        Position error of the first flight, and what its filter believes.
    mean_nees : ndarray, shape (C, K)
        Over the flights of the stage that were not lost.
    flight_rms_m : ndarray, shape (C, S)
        Root mean square position errors at their end.
    flight_states, flight_runs, flight_lost : ndarray, shape (C,)
        Numbers of states, of flights, and of those that were lost.
    """

    labels: tuple[str, ...]
    spacecraft: tuple[str, ...]
    points: tuple[str, ...]
    cases: Array
    lost: Array
    position_m: Array
    velocity_m_s: Array
    rms_m: Array
    bound_m: Array
    bound_ratio: Array
    nees: Array
    nees_low: Array
    nees_high: Array
    paper_position_m: Array
    paper_velocity_m_s: Array
    ratio: Array
    answers: tuple[str, ...]
    lightest: str
    time_s: Array
    error_m: Array
    sigma_m: Array
    mean_nees: Array
    flight_rms_m: Array
    flight_states: Array
    flight_runs: Array
    flight_lost: Array
