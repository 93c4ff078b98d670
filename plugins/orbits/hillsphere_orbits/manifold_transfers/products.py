"""What the stage ``manifold_transfers`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import FlightSet, PeriodicOrbits

__all__ = ["ManifoldTransfers"]


@dataclass(frozen=True)
class ManifoldTransfers(FlightSet):
    """Transfers between two planar orbits through unstable ones.

    Parameters
    ----------
    flights : Trajectories
        Of each connected orbit the transfer of least impulse and the quickest: two coasts each.
    departure, arrival : PeriodicOrbits
        The planar orbits, one each.
    orbits : PeriodicOrbits
        The M orbits in between.
    status : tuple of str, length M
        ``"connected"``, ``"no departure leg"``, ``"no arrival leg"``, ``"no leg"``, or
        ``"stable"`` and ``"complex"``, which have no manifold, or what went wrong.
    revolutions : ndarray of int, shape (M,)
        n of each orbit; 0 where its product does not tell.
    z_m : ndarray, shape (M,)
        Its amplitude z; NaN where its product does not tell.
    multiplier : ndarray, shape (M,)
        Largest multiplier; NaN without a manifold.
    bound_m_s : ndarray, shape (2, M)
        What an impulse at departure and at arrival costs at least, by the Jacobi constants.
    trajectories : ndarray of int, shape (M,)
        Trajectories of the meshes.
    leg_member : ndarray of int, shape (L,)
        Orbit of each leg; all entries of the ladders, by orbit, departure before arrival, and time.
    leg_arrives : ndarray of bool, shape (L,)
        Whether the leg leads to the arrival orbit; otherwise it comes from the departure orbit.
    leg_side : ndarray of int, shape (L,)
        Side of the manifold, 1 or −1.
    leg_p : ndarray, shape (L,)
        Place in the fundamental domain.
    leg_tof_s, leg_dv_m_s : ndarray, shape (L,)
        Time of flight and impulse.
    leg_place_bound_m_s : ndarray, shape (L,)
        What the impulse costs at least at its place.
    leg_near, leg_orbit : ndarray, shape (6, L)
        State at the end that is at the unstable orbit, and that orbit's at the same time, SI.
    leg_state, leg_target : ndarray, shape (6, L)
        State at the end that is at the planar orbit, and that orbit's there, SI.
    leg_closure_km, leg_closure_m_s : ndarray, shape (L,)
        Largest misses when the leg, and the planar orbit to the meeting, are flown anew from their
        first states by Taylor series.
    leg_altitude_m : ndarray, shape (L,)
        Least height above the surface; NaN if the plant tells of none.
    leg_impact : ndarray of bool, shape (L,)
        Whether it met the surface in that flight.
    transfer_legs : ndarray of int, shape (2, Q)
        Departure and arrival leg of the transfers that no other one through the same orbit betters,
        by orbit and time.
    checked : tuple of str, length C
        Orbits whose search was repeated with twice the samples.
    check_entries : ndarray of int, shape (2, C)
        Entries of their ladders with the samples and with twice as many.
    check_shift_m_s : ndarray, shape (C,)
        By how much an entry moved; infinite if their number differs.
    leg_limit_s : float
        Longest time of flight of a leg.
    distance, start_distance : float
        Where times of flight begin, where the linear motion ends; normalised.
    closure_limit_m : float
        Legs with a larger miss are listed, but make no transfer.
    mirrored : bool
        Whether departure legs are mirror images of legs along the unstable manifold.
    departure_track_m, arrival_track_m : ndarray, shape (2, P)
        Positions x, y along the planar orbits.
    body : str
        Name of the moon; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    """

    departure: PeriodicOrbits
    arrival: PeriodicOrbits
    orbits: PeriodicOrbits
    status: tuple[str, ...]
    revolutions: NDArray[np.int64]
    z_m: Array
    multiplier: Array
    bound_m_s: Array
    trajectories: NDArray[np.int64]
    leg_member: NDArray[np.int64]
    leg_arrives: NDArray[np.bool_]
    leg_side: NDArray[np.int64]
    leg_p: Array
    leg_tof_s: Array
    leg_dv_m_s: Array
    leg_place_bound_m_s: Array
    leg_near: Array
    leg_orbit: Array
    leg_state: Array
    leg_target: Array
    leg_closure_km: Array
    leg_closure_m_s: Array
    leg_altitude_m: Array
    leg_impact: NDArray[np.bool_]
    transfer_legs: NDArray[np.int64]
    checked: tuple[str, ...]
    check_entries: NDArray[np.int64]
    check_shift_m_s: Array
    leg_limit_s: float
    distance: float
    start_distance: float
    closure_limit_m: float
    mirrored: bool
    departure_track_m: Array
    arrival_track_m: Array
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float

    @property
    def transfer_dv_m_s(self) -> Array:
        """Sum of both impulses, (Q,)."""
        return np.asarray(np.sum(self.leg_dv_m_s[self.transfer_legs], axis=0))

    @property
    def transfer_tof_s(self) -> Array:
        """Sum of both times of flight, (Q,)."""
        return np.asarray(np.sum(self.leg_tof_s[self.transfer_legs], axis=0))

    @property
    def transfer_member(self) -> NDArray[np.int64]:
        """Orbit of each transfer, (Q,)."""
        return np.asarray(self.leg_member[self.transfer_legs[0]])
