"""What the stage ``closed_loop`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.base.arrays import Array

__all__ = ["ClosedLoopFlight"]


@dataclass(frozen=True)
class ClosedLoopFlight:
    """The nominal flight, sample by sample; NaN beyond its end.

    Parameters
    ----------
    frame : str
        Frame of the states.
    states, state_units : tuple of str
        Names and units of the n states.
    controls, control_units : tuple of str
        Names and units of the p rows of a command.
    seen_states : tuple of str
        The q states that the law sees.
    period_s : float
        Time between samples.
    time_s : ndarray, shape (K + 1,)
        Times of the samples, and of the end of the last.
    x : ndarray, shape (n, K + 1)
        True states, SI.
    goal : ndarray, shape (n, K + 1)
        The reference.
    seen : ndarray, shape (q, K)
        What the law saw.
    u : ndarray, shape (p, K)
        What the actuator did from each sample on.
    own : ndarray, shape (p, K)
        What the law commanded by itself.
    feedforward : ndarray, shape (p, K), or None
        What the reference's command is from each sample on; None if it comes with none.
    dv_m_s : ndarray, shape (K + 1,)
        Δv spent until then.
    position_error_m, velocity_error_m_s : ndarray, shape (K + 1,)
        Distance and speed from the reference; of several spacecraft the largest.
    end_s : float
        Time of the end.
    end_x : ndarray, shape (n,)
        State there.
    status, cause : str
        How it ended.
    failed : bool
        Whether that counts as a failure; never if the status says that it is undecided, see
        `hillsphere.cases.case_classes`.
    metrics, units : tuple of str
        Names and units of the m metrics.
    values : ndarray, shape (m,)
        Their values.
    step_error : float
        Estimate of the step error at the end, in the plant's natural units.
    step_error_m : float or None
        How far the end moves with twice as many sub-steps; None where the tolerance held them.
    nearest_m, farthest_m : float
        Smallest and largest distance from the centre of the frame at the samples and the end.
    position_rows, velocity_rows : tuple of int
        Which states are positions and velocities.
    body : str
        What stands at the centre; ``""`` if the plant does not say.
    semi_axes_m : ndarray, shape (3,), or None
        Of its surface.
    surface_m : ndarray, shape (3, J, K), or None
        Points of it on circles of latitude, in the frame of the flight.
    prime_meridian_rad : float
        Angle about +z from +x to its longitude 0.
    series_radius_m : float or None
        Radius inside which its gravity is a series that may diverge.
    hill_distance_m : float or None
        Distance of the primary where the plant neglects terms of the relative order of the
        distance from the body; None where it does not.
    """

    frame: str
    states: tuple[str, ...]
    state_units: tuple[str, ...]
    controls: tuple[str, ...]
    control_units: tuple[str, ...]
    seen_states: tuple[str, ...]
    period_s: float
    time_s: Array
    x: Array
    goal: Array
    seen: Array
    u: Array
    own: Array
    feedforward: Array | None
    dv_m_s: Array
    position_error_m: Array
    velocity_error_m_s: Array
    end_s: float
    end_x: Array
    status: str
    cause: str
    failed: bool
    metrics: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    step_error: float
    step_error_m: float | None
    nearest_m: float
    farthest_m: float
    position_rows: tuple[int, ...]
    velocity_rows: tuple[int, ...]
    body: str
    semi_axes_m: Array | None
    surface_m: Array | None
    prime_meridian_rad: float
    series_radius_m: float | None
    hill_distance_m: float | None
