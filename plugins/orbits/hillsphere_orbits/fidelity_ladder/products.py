"""Product of the stage ``fidelity_ladder``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.products import FlightSet
from hillsphere.products.fields import Label, Shape

__all__ = ["FidelityLadder"]


@dataclass(frozen=True)
class FidelityLadder(FlightSet):
    """Orbits on several plants, as flights over arcs between nodes.

    `flights` are those of the last plant, in its own frame and states, that converged and keep
    clear of the body: a plan and a coast each, called after the orbit.
    """

    rungs: Annotated[tuple[str, ...], Shape("rungs"), Label("rung")]
    """Names of the plants."""
    plants: Annotated[tuple[str, ...], Shape("rungs"), Label("equations")]
    """What they are."""
    frames: Annotated[tuple[str, ...], Shape("rungs"), Label("frame")]
    """Frames of their states."""
    state_counts: Annotated[tuple[int, ...], Shape("rungs")]
    """Number of states of each."""
    members: Annotated[tuple[str, ...], Shape("members"), Label("orbit")]
    """Names of the orbits."""
    times_s: Annotated[Array, Shape("nodes")]
    """Times of the nodes."""
    x: Annotated[Array, Shape(7, "nodes", "members", "rungs")]
    """States at the nodes in the frame of each plant, SI; NaN where a flight did not converge, and
    in the seventh row of plants with six states."""
    hill: Annotated[Array, Shape(6, "nodes", "members", "rungs")]
    """The same in the frame hill:BODY, x away from the primary at that moment."""
    departure_m: Annotated[Array, Shape("nodes", "members", "rungs")]
    """Distance of the nodes from the orbits."""
    converged: Annotated[NDArray[np.bool_], Shape("members", "rungs"), Label("converged")]
    """Whether the flight is continuous."""
    iterations: Annotated[Integers, Shape("members", "rungs"), Label("steps")]
    """Steps of multiple shooting."""
    gap: Annotated[Array, Shape("members", "rungs"), Label("largest gap", 2)]
    """Largest gap at a node, natural units."""
    departure_max_m: Annotated[
        Array, Shape("members", "rungs"), Label("largest departure", 4, "km")
    ]
    """Largest distance of the flight from the nearest point of the orbit, between the nodes too."""
    departure_rms_m: Annotated[Array, Shape("members", "rungs"), Label("rms departure", 4, "km")]
    """Root mean square of the same."""
    slip_s: Annotated[
        Array, Shape("members", "rungs"), Label("ahead of the orbit at the end", 4, "h")
    ]
    """Time by which the flight is ahead of the orbit at the end."""
    min_altitude_m: Annotated[Array, Shape("members", "rungs"), Label("least height", 5, "km")]
    """Least height above the surface; NaN without one, zero if the flight meets it."""
    survival_s: Annotated[
        Array, Shape("members", "rungs"), Label("survival without correction", 4, "d")
    ]
    """How long the flight stays within the limits from its first node without correction."""
    fate: tuple[str, ...]
    """What ended that flight (``"limit"``, ``"impact"``, ``"unresolved"`` where it is not proved
    whether the surface is met) or an empty text; members run fastest."""
    status: tuple[str, ...]
    """``"converged"``, or why not; members run fastest."""
    periodic_x0_m: Annotated[Array, Shape(6, "members", "rungs")]
    """First states, SI, of periodic orbits of the plants themselves with the same amplitude, in the
    frame hill:BODY; NaN where there is none."""
    periodic_s: Annotated[Array, Shape("members", "rungs"), Label("period", 12, "h")]
    """Their periods."""
    periodic_closure: Annotated[Array, Shape("members", "rungs"), Label("closure", 2)]
    """Distances of their states a period apart, natural units."""
    periodic_status: tuple[str, ...]
    """``"periodic"``, or why not; members run fastest."""
    period_s: Annotated[Array, Shape("members")]
    """Periods of the orbits themselves."""
    track_m: Annotated[Array, Shape(3, "points", "members")]
    """The orbits themselves in the frame hill:BODY."""
    limit: float
    """Of the survival: multiples of the orbit's amplitudes."""
    start_true_anomaly_rad: float
    """True anomaly at time zero."""
    body: str
    """Name of the moon; empty if the first plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from away from the primary to its longitude 0, in the mean."""

    def reference(self, rung: str, member: str) -> tuple[Array, Array]:
        """Return the flight of a member on a rung, as a reference to follow.

        Parameters
        ----------
        rung, member : str
            Names.

        Returns
        -------
        times_s : ndarray, shape (K + 1,)
            Times of the nodes.
        x : ndarray, shape (n, K + 1)
            States there, SI, in the frame of that plant.

        Raises
        ------
        InputError
            If there is no such flight, or it did not converge.
        """
        for kind, name, known in (("rung", rung, self.rungs), ("member", member, self.members)):
            if name not in known:
                raise InputError(f"the ladder has no {kind} {name!r}; it has {', '.join(known)}")
        r, m = self.rungs.index(rung), self.members.index(member)
        if not self.converged[m, r]:
            raise InputError(
                f"{member} on {rung} has no flight: {self.status[r * len(self.members) + m]}"
            )
        return self.times_s, self.x[: self.state_counts[r], :, m, r]
