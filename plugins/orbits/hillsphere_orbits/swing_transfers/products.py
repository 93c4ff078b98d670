"""Product of the stage on transfers through swing orbits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.products import FlightSet
from hillsphere.products.fields import Label, Shape

__all__ = ["SwingRoutes", "SwingTransfers", "Transfers"]


@dataclass(frozen=True)
class Transfers:
    """Transfers of two impulses: from one orbit to a swing orbit, from that to another."""

    leg: Annotated[Integers, Shape("transfers")]
    """Which pair of orbits is connected."""
    family: Annotated[Integers, Shape("transfers")]
    """Family of the swing orbit."""
    position: Annotated[Array, Shape("transfers")]
    """Position of the swing orbit on its family's chain."""
    kind: Annotated[tuple[str, ...], Shape("transfers"), Label("where")]
    """What singles the swing orbit out: ``"interior"`` (a minimum along the family), ``"touches
    ORBIT"`` (a minimum where it just meets an orbit), ``"end of the family"``, ``"member"``."""
    x0: Annotated[Array, Shape(6, "transfers")]
    """State of the swing orbit at its start, SI."""
    period_s: Annotated[Array, Shape("transfers")]
    """Its period."""
    integral: Annotated[Array, Shape("transfers"), Label("Jacobi constant", 10)]
    """Its integral, natural units."""
    departure_s: Annotated[Array, Shape("transfers")]
    """Time on the swing orbit, since its start, at which it is entered."""
    arrival_s: Annotated[Array, Shape("transfers")]
    """The same at which it is left."""
    on_departure_s: Annotated[Array, Shape("transfers")]
    """Time of the same place on the orbit that is left, since its start."""
    on_arrival_s: Annotated[Array, Shape("transfers")]
    """The same on the orbit that is reached."""
    tof_s: Annotated[Array, Shape("transfers"), Label("time of flight", 7, "d")]
    """Time on the swing orbit."""
    impulse_m_s: Annotated[Array, Shape(2, 3, "transfers")]
    """Both impulses."""
    angle_rad: Annotated[Array, Shape(2, "transfers")]
    """Angles between the orbits there."""
    bound_m_s: Annotated[Array, Shape(2, "transfers")]
    """What the integrals alone ask for there."""
    place_m: Annotated[Array, Shape(2, 3, "transfers")]
    """Where the impulses are."""
    closure_km: Annotated[Array, Shape("transfers"), Label("closure", 2)]
    """Largest miss of a patch point when the transfer is flown from its first state."""
    closure_m_s: Annotated[Array, Shape("transfers"), Label("closure", 2)]
    """The same of the velocity."""
    altitude_m: Annotated[Array, Shape("transfers"), Label("least altitude", 5, "km")]
    """Least height above the body's surface; NaN without a surface."""

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
    """Sequences of legs, each flown by its cheapest transfer."""

    name: Annotated[tuple[str, ...], Shape("routes"), Label("route")]
    """Their orbits."""
    legs: Annotated[tuple[tuple[int, ...], ...], Shape("routes")]
    """Their legs in order."""
    total_m_s: Annotated[Array, Shape("routes"), Label("ΔV", 8)]
    """Sum of all impulses; NaN if a leg has no transfer."""
    tof_s: Annotated[Array, Shape("routes"), Label("on swing orbits, without waiting", 6, "d")]
    """Time on swing orbits."""
    waiting_s: Annotated[Array, Shape("routes"), Label("waiting in between", 6, "d")]
    """Time on the orbits between two legs until the next one begins."""
    closure_km: Annotated[Array, Shape("routes"), Label("closure", 2)]
    """Largest miss of a patch point when the whole route is flown from its first state."""
    closure_m_s: Annotated[Array, Shape("routes"), Label("closure", 2)]
    """The same of the velocity."""


@dataclass(frozen=True)
class SwingTransfers(FlightSet):
    """Transfers between planar orbits through families of swing orbits.

    `flights` are the transfers of `front`, a coast each, and of routes of more than one leg the
    transfers of their legs, apart by the times on the orbits in between.
    """

    orbits: Annotated[tuple[str, ...], Shape("orbits")]
    """The orbits that are connected."""
    orbit_integral: Annotated[Array, Shape("orbits")]
    """Their integrals, natural units."""
    orbit_tracks_m: Annotated[Array, Shape(2, "points", "orbits")]
    """Their positions along one revolution."""
    legs: Annotated[tuple[str, ...], Shape("legs"), Label("leg")]
    """Names of the pairs of orbits."""
    departure: Annotated[Integers, Shape("legs")]
    """Number of the orbit that each leads from."""
    arrival: Annotated[Integers, Shape("legs")]
    """Number of the orbit that each leads to."""
    bound_m_s: Annotated[Array, Shape("legs"), Label("bound by energy", 6)]
    """Sum of two impulses below which no orbit in between can go, by the integrals alone."""
    status: Annotated[tuple[str, ...], Shape("legs"), Label("status")]
    """``"found"``, or why there is no transfer."""
    families: Annotated[tuple[str, ...], Shape("families")]
    """Names of the families of swing orbits."""
    d: Annotated[tuple[int, ...], Shape("families")]
    """The family branches off at the resonance d:n."""
    n: Annotated[tuple[int, ...], Shape("families")]
    """Revolutions of its orbits."""
    least: Transfers
    """The cheapest transfer of every leg and family that connects its orbits."""
    front: Transfers
    """The Pareto front of each leg in speed change and time, up to the requested cost, among the
    members of the chains and the minima along them."""
    member_leg: Annotated[Integers, Shape("members")]
    """Leg of every member of a family that connects its orbits."""
    member_family: Annotated[Integers, Shape("members")]
    """Family of each of these members."""
    member_position: Annotated[Array, Shape("members")]
    """Its position on the chain."""
    member_dv_m_s: Annotated[Array, Shape("members")]
    """Its least cost."""
    member_integral: Annotated[Array, Shape("members")]
    """Its integral."""
    member_angle_rad: Annotated[Array, Shape("members")]
    """Mean of both angles of that transfer."""
    rank: Annotated[Array, Shape("legs", 2, 2)]
    """Spearman's rank correlation and its p-value of the members' cost with the angle and with the
    integral; NaN where fewer than three members connect."""
    rank_of_least: Annotated[Array, Shape("legs", 2, 2)]
    """The same over the cheapest transfers of the families."""
    routes: SwingRoutes
    """The requested routes."""
    track_leg: Annotated[Integers, Shape("tracks")]
    """Leg of each track."""
    tracks_m: Array
    """Positions along the cheapest transfer of every leg that has one."""
    frame: str
    """Frame of states and places."""
    length_m: float
    """Natural unit."""
    time_s: float
    """Natural unit."""
    body: str
    """Name of the moon; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""
