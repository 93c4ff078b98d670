"""What the stage on transfers by way of swing orbits hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import FlightSet

__all__ = ["SwingRoutes", "SwingTransfers", "Transfers"]


@dataclass(frozen=True)
class Transfers:
    """N transfers, each with two impulses: from one orbit to a swing orbit, from that to another.

    Parameters
    ----------
    leg : ndarray of int, shape (N,)
        Which pair of orbits is connected.
    family : ndarray of int, shape (N,)
        Family of the swing orbit.
    position : ndarray, shape (N,)
        Position of the swing orbit on its family's chain.
    kind : tuple of str, length N
        What singles the swing orbit out: ``"interior"`` (a minimum along the family), ``"touches
        ORBIT"`` (a minimum where it just meets an orbit), ``"end of the family"``, ``"member"``.
    x0 : ndarray, shape (6, N)
        State of the swing orbit at its start, SI.
    period_s, integral : ndarray, shape (N,)
        Its period, and its integral in natural units.
    departure_s, arrival_s : ndarray, shape (N,)
        Times on the swing orbit, since its start, at which it is entered and left.
    on_departure_s, on_arrival_s : ndarray, shape (N,)
        Times on the two other orbits, since their starts, of the same places.
    tof_s : ndarray, shape (N,)
        Time on the swing orbit.
    impulse_m_s : ndarray, shape (2, 3, N)
        Both impulses.
    angle_rad : ndarray, shape (2, N)
        Angles between the orbits there.
    bound_m_s : ndarray, shape (2, N)
        What the integrals alone ask for there.
    place_m : ndarray, shape (2, 3, N)
        Where the impulses are.
    closure_km, closure_m_s : ndarray, shape (N,)
        Largest miss of a patch point when the transfer is flown from its first state.
    altitude_m : ndarray, shape (N,)
        Least height above the body's surface; NaN without a surface.
    """

    leg: NDArray[np.int64]
    family: NDArray[np.int64]
    position: Array
    kind: tuple[str, ...]
    x0: Array
    period_s: Array
    integral: Array
    departure_s: Array
    arrival_s: Array
    on_departure_s: Array
    on_arrival_s: Array
    tof_s: Array
    impulse_m_s: Array
    angle_rad: Array
    bound_m_s: Array
    place_m: Array
    closure_km: Array
    closure_m_s: Array
    altitude_m: Array

    @property
    def dv_m_s(self) -> Array:
        """Both speed changes, (2, N)."""
        return np.asarray(np.linalg.norm(self.impulse_m_s, axis=1))

    @property
    def total_m_s(self) -> Array:
        """Sum of both speed changes, (N,)."""
        return np.asarray(np.sum(self.dv_m_s, axis=0))

    @property
    def size(self) -> int:
        """N."""
        return len(self.kind)


@dataclass(frozen=True)
class SwingRoutes:
    """Sequences of legs, each flown by its cheapest transfer; R routes.

    Parameters
    ----------
    name : tuple of str, length R
        Their orbits.
    legs : tuple of tuple of int, length R
        Their legs in order.
    total_m_s : ndarray, shape (R,)
        Sum of all impulses; NaN if a leg has no transfer.
    tof_s, waiting_s : ndarray, shape (R,)
        Time on swing orbits, and on the orbits between two legs until the next one begins.
    closure_km, closure_m_s : ndarray, shape (R,)
        Largest miss of a patch point when the whole route is flown from its first state.
    """

    name: tuple[str, ...]
    legs: tuple[tuple[int, ...], ...]
    total_m_s: Array
    tof_s: Array
    waiting_s: Array
    closure_km: Array
    closure_m_s: Array


@dataclass(frozen=True)
class SwingTransfers(FlightSet):
    """Transfers between planar orbits by way of families of swing orbits.

    Parameters
    ----------
    flights : Trajectories
        The transfers of `front`, a coast each, and of routes of more than one leg the transfers of
        their legs, apart by the times on the orbits in between.
    orbits : tuple of str
        The orbits that are connected.
    orbit_integral : ndarray, shape (O,)
        Their integrals, natural units.
    orbit_tracks_m : ndarray, shape (2, P, O)
        Their positions along one revolution.
    legs : tuple of str, length L
        Names of the pairs of orbits.
    departure, arrival : ndarray of int, shape (L,)
        Their orbits.
    bound_m_s : ndarray, shape (L,)
        Sum of two impulses below which no orbit in between can go, by the integrals alone.
    status : tuple of str, length L
        ``"found"``, or why there is no transfer.
    families : tuple of str, length F
        Names of the families of swing orbits.
    d, n : tuple of int, length F
        Resonances of the families.
    least : Transfers
        The cheapest transfer of every leg and family that connects its orbits.
    front : Transfers
        The transfers that no other one of their leg betters in both speed change and time, up to
        the cost that was asked for; of the members of the chains and the minima along them.
    member_leg, member_family : ndarray of int, shape (M,)
        Of every member of a family that connects the orbits of a leg.
    member_position : ndarray, shape (M,)
        Its position on the chain.
    member_dv_m_s, member_integral, member_angle_rad : ndarray, shape (M,)
        Its least cost, its integral, and the mean of both angles of that transfer.
    rank : ndarray, shape (L, 2, 2)
        Spearman's rank correlation and its p-value of the members' cost with the angle and with
        the integral; NaN where fewer than three members connect.
    rank_of_least : ndarray, shape (L, 2, 2)
        The same over the cheapest transfers of the families.
    routes : SwingRoutes
        What was asked for as routes.
    track_leg : ndarray of int, shape (K,)
        Leg of each track.
    tracks_m : ndarray, shape (2, P, K)
        Positions along the cheapest transfer of every leg that has one.
    frame : str
        Frame of states and places.
    length_m, time_s : float
        Natural units.
    body : str
        Name of the moon; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    """

    orbits: tuple[str, ...]
    orbit_integral: Array
    orbit_tracks_m: Array
    legs: tuple[str, ...]
    departure: NDArray[np.int64]
    arrival: NDArray[np.int64]
    bound_m_s: Array
    status: tuple[str, ...]
    families: tuple[str, ...]
    d: tuple[int, ...]
    n: tuple[int, ...]
    least: Transfers
    front: Transfers
    member_leg: NDArray[np.int64]
    member_family: NDArray[np.int64]
    member_position: Array
    member_dv_m_s: Array
    member_integral: Array
    member_angle_rad: Array
    rank: Array
    rank_of_least: Array
    routes: SwingRoutes
    track_leg: NDArray[np.int64]
    tracks_m: Array
    frame: str
    length_m: float
    time_s: float
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float
