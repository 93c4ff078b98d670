"""What the stage ``nonlinear_stability`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = ["NonlinearStability"]


@dataclass(frozen=True)
class NonlinearStability:
    """How M orbits bear offsets in D directions, P phases of injection and Q given offsets.

    Fates are numbers: 0 survives, 1 escape, 2 impact, 3 unresolved (no step that was tried kept
    the integral of motion). An offset is a position, m, or a velocity, m/s.

    Parameters
    ----------
    labels : tuple of str, length M
        Names of the orbits.
    amplitude_m : ndarray, shape (3, M)
        Largest |x|, |y| and |z| of each.
    limit_m : ndarray, shape (3, M)
        Beyond which it is lost; infinite where nothing limits it.
    reference_fate : ndarray of int, shape (M,)
        Of the orbit flown without any offset.
    reference_time_s : ndarray, shape (M,)
        When it was lost; the duration for one that survives.
    directions : tuple of str, length D
        ``"+x"``, ``"-vy"``, ``"position 1"`` (drawn) and so on.
    direction : ndarray, shape (6, D)
        Unit offsets in them.
    largest : ndarray, shape (M, D)
        Largest offset tried.
    survived, lost : ndarray, shape (M, D)
        Largest offset tried below the first loss, and that of the loss; infinite if none was lost.
    lost_fate : ndarray of int, shape (M, D)
        What became of the first one lost.
    lost_time_s : ndarray, shape (M, D)
        And when; NaN if none was lost.
    phases : ndarray, shape (P,)
        Parts of the period.
    counts : ndarray of int, shape (4, M, P)
        How many draws met each fate.
    low, high : ndarray, shape (M, P)
        Interval of the survival probability.
    median_loss_s : ndarray, shape (M, P)
        Median time of loss of those lost; NaN if none was.
    offset : ndarray, shape (6, Q)
        Offsets whose fate was asked for.
    offset_fate : ndarray of int, shape (M, Q)
        Their fates.
    offset_time_s : ndarray, shape (M, Q)
        When they were lost; the duration for those that survive.
    near_member : ndarray of int, shape (R,)
        Orbit beside which each resonance lies.
    near_plane : tuple of str, length R
        ``"planar"`` or ``"vertical"``.
    near_d, near_n : tuple of int, length R
        The resonance d:n.
    near_x_m, near_distance_m, near_vy_offset_m_s : ndarray, shape (R,)
        Amplitude of the resonant orbit, its distance, and the change of ẏ that gives the member
        its Jacobi constant.
    draws : int
        Per orbit and phase.
    confidence, sigma_position_m, sigma_velocity_m_s, duration_s, limit : float
        As asked for.
    doublings, scan : int
        Density of the search for edges.
    flights : int
        How many were flown.
    drift : float
        Largest relative change of the integral in a flight whose fate was resolved; NaN if the
        plant has none.
    has_surface : bool
        Whether the plant knows a surface to meet.
    """

    labels: tuple[str, ...]
    amplitude_m: Array
    limit_m: Array
    reference_fate: NDArray[np.int64]
    reference_time_s: Array
    directions: tuple[str, ...]
    direction: Array
    largest: Array
    survived: Array
    lost: Array
    lost_fate: NDArray[np.int64]
    lost_time_s: Array
    phases: Array
    counts: NDArray[np.int64]
    low: Array
    high: Array
    median_loss_s: Array
    offset: Array
    offset_fate: NDArray[np.int64]
    offset_time_s: Array
    near_member: NDArray[np.int64]
    near_plane: tuple[str, ...]
    near_d: tuple[int, ...]
    near_n: tuple[int, ...]
    near_x_m: Array
    near_distance_m: Array
    near_vy_offset_m_s: Array
    draws: int
    confidence: float
    sigma_position_m: float
    sigma_velocity_m_s: float
    duration_s: float
    limit: float
    doublings: int
    scan: int
    flights: int
    drift: float
    has_surface: bool

    def weakest(self, velocity: bool) -> NDArray[np.int64]:
        """Return the direction (M,) in which each orbit bears least.

        Parameters
        ----------
        velocity : bool
            Of the velocity offsets, or else of the position offsets.

        Returns
        -------
        ndarray of int, shape (M,)
            The stability radius is ``survived`` there: the least over the directions tried.
        """
        own = np.flatnonzero(self.direction[3:].any(axis=0) == velocity)
        # of directions that bear the same, the one in which a loss was found
        order = np.lexsort((self.lost[:, own], self.survived[:, own]))
        return np.asarray(own[order[:, 0]], dtype=np.int64)
