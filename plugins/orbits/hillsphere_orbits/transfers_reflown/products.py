"""What the stage ``transfers_reflown`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import FlightSet

__all__ = ["TransfersReflown"]


@dataclass(frozen=True)
class TransfersReflown(FlightSet):
    """Q plans of transfers on R plants, with P patch points and C coasts in all.

    Parameters
    ----------
    flights : Trajectories
        Coasts of the last plant, in its own frame and states, by their nodes; of the plans that
        can be flown there.
    rungs, rung_plants : tuple of str
        Names of the R plants, and what they are.
    plans : tuple of str
        Names of the Q plans.
    tof_s : ndarray, shape (Q,)
        Time from the beginning of the first coast to the end of the last.
    stay_s : ndarray, shape (Q,)
        Part of it that is spent on orbits between coasts.
    plan_dv_m_s : ndarray, shape (Q,)
        Sum of the impulses as planned.
    dv_m_s : ndarray, shape (Q, R)
        Sum of the impulses on each plant; NaN where the plan cannot be flown.
    displacement_m : ndarray, shape (Q, R)
        Largest distance of a patch point from its place in the plan.
    closure_m, closure_m_s : ndarray, shape (Q, R)
        Largest miss of the end of a coast when it is flown from its first state alone.
    altitude_min_m : ndarray, shape (Q, R)
        Least height of the coasts above the surface, that of the first plant where the plant itself
        has none; NaN if that has none either, zero where it is met.
    gap : ndarray, shape (Q, R)
        Largest gap at a node, natural units.
    iterations : ndarray of int, shape (Q, R)
        Steps of multiple shooting, summed over the coasts.
    status : tuple of str, length Q·R
        ``"reflown"``, or why not; plans run fastest.
    patch_plan : ndarray of int, shape (P,)
        Plan of each patch point.
    patches : tuple of str, length P
        What meets there.
    patch_held : tuple of str, length P
        Orbit on which the patch point stays, or ``"place of the plan"``.
    patch_plan_dv_m_s : ndarray, shape (P,)
        Impulse as planned.
    patch_dv_m_s : ndarray, shape (P, R)
        Impulse on each plant.
    coast_plan : ndarray of int, shape (C,)
        Plan of each coast.
    coast_m : ndarray, shape (3, L, C, R)
        Positions along the coasts on each plant in the frame hill:BODY; NaN beyond the end, and
        from the first coast on that was not found.
    start_true_anomaly_rad : float
        True anomaly at the beginning of each first coast.
    """

    rungs: tuple[str, ...]
    rung_plants: tuple[str, ...]
    plans: tuple[str, ...]
    tof_s: Array
    stay_s: Array
    plan_dv_m_s: Array
    dv_m_s: Array
    displacement_m: Array
    closure_m: Array
    closure_m_s: Array
    altitude_min_m: Array
    gap: Array
    iterations: NDArray[np.int64]
    status: tuple[str, ...]
    patch_plan: NDArray[np.int64]
    patches: tuple[str, ...]
    patch_held: tuple[str, ...]
    patch_plan_dv_m_s: Array
    patch_dv_m_s: Array
    coast_plan: NDArray[np.int64]
    coast_m: Array
    start_true_anomaly_rad: float
