"""Product of the stage ``manifold_transfers``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products import FlightSet, PeriodicOrbits
from hillsphere.products.fields import Label, Shape

__all__ = ["ManifoldTransfers"]


@dataclass(frozen=True)
class ManifoldTransfers(FlightSet):
    """Transfers between two planar orbits through unstable ones.

    `flights` are of each connected orbit the transfer of least impulse and the quickest: two coasts
    each.
    """

    departure: PeriodicOrbits
    """The planar orbit that is left."""
    arrival: PeriodicOrbits
    """The planar orbit that is reached."""
    orbits: PeriodicOrbits
    """The orbits in between."""
    status: Annotated[tuple[str, ...], Shape("orbits"), Label("status")]
    """``"connected"``, ``"no departure leg"``, ``"no arrival leg"``, ``"no leg"``, or ``"stable"``
    and ``"complex"``, which have no manifold, or what went wrong."""
    revolutions: Annotated[Integers, Shape("orbits")]
    """n of each orbit; 0 where its product has no such field."""
    z_m: Annotated[Array, Shape("orbits"), Label("amplitude z", 9, "km")]
    """Its amplitude z; NaN where its product has no such field."""
    multiplier: Annotated[Array, Shape("orbits")]
    """Largest multiplier; NaN without a manifold."""
    bound_m_s: Annotated[Array, Shape(2, "orbits")]
    """What an impulse at departure and at arrival costs at least, by the Jacobi constants."""
    trajectories: Annotated[Integers, Shape("orbits")]
    """Trajectories of the meshes."""
    leg_member: Annotated[Integers, Shape("legs")]
    """Orbit of each leg: all entries of the ladders, by orbit, departure first, and time."""
    leg_arrives: Annotated[NDArray[np.bool_], Shape("legs")]
    """Whether the leg leads to the arrival orbit; otherwise it comes from the departure orbit."""
    leg_side: Annotated[Integers, Shape("legs")]
    """Side of the manifold, 1 or −1."""
    leg_p: Annotated[Array, Shape("legs"), Label("p", 9)]
    """Place in the fundamental domain."""
    leg_tof_s: Annotated[Array, Shape("legs"), Label("time of flight", 7, "d")]
    """Time of flight."""
    leg_dv_m_s: Annotated[Array, Shape("legs"), Label("ΔV", 8)]
    """Impulse."""
    leg_place_bound_m_s: Annotated[Array, Shape("legs"), Label("ΔV at least there, by energy", 8)]
    """What the impulse costs at least at its place."""
    leg_near: Annotated[Array, Shape(6, "legs")]
    """State at the end that is at the unstable orbit, SI."""
    leg_orbit: Annotated[Array, Shape(6, "legs")]
    """That orbit's at the same time, SI."""
    leg_state: Annotated[Array, Shape(6, "legs")]
    """State at the end that is at the planar orbit, SI."""
    leg_target: Annotated[Array, Shape(6, "legs")]
    """That orbit's there, SI."""
    leg_closure_km: Annotated[Array, Shape("legs"), Label("closure", 2)]
    """Largest miss when the leg, and the planar orbit to the meeting, are flown anew from their
    first states by Taylor series."""
    leg_closure_m_s: Annotated[Array, Shape("legs"), Label("closure", 2)]
    """The same of the velocity."""
    leg_altitude_m: Annotated[Array, Shape("legs"), Label("least altitude", 4, "km")]
    """Least height above the surface; NaN if the plant has no surface."""
    leg_impact: Annotated[NDArray[np.bool_], Shape("legs"), Label("impact")]
    """Whether it met the surface in that flight."""
    transfer_legs: Annotated[Integers, Shape(2, "transfers")]
    """Departure and arrival leg of the transfers that no other one through the same orbit betters,
    by orbit and time."""
    checked: Annotated[tuple[str, ...], Shape("checked")]
    """Orbits whose search was repeated with twice the samples."""
    check_entries: Annotated[Integers, Shape(2, "checked")]
    """Entries of their ladders with the samples and with twice as many."""
    check_shift_m_s: Annotated[Array, Shape("checked")]
    """By how much an entry moved; infinite if their number differs."""
    leg_limit_s: float
    """Longest time of flight of a leg."""
    distance: float
    """From the orbit where times of flight begin; normalised."""
    start_distance: float
    """Where the linear motion ends; normalised."""
    closure_limit_m: float
    """Legs with a larger miss are listed, but make no transfer."""
    mirrored: bool
    """Whether departure legs are mirror images of legs along the unstable manifold."""
    departure_track_m: Array
    """Positions x, y along the planar orbit that is left."""
    arrival_track_m: Array
    """The same of the one that is reached."""
    body: str
    """Name of the moon; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""

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
