"""What the stage ``fidelity_ladder`` hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products import FlightSet

__all__ = ["FidelityLadder"]


@dataclass(frozen=True)
class FidelityLadder(FlightSet):
    """N orbits on R plants, as flights over K arcs.

    Parameters
    ----------
    flights : Trajectories
        Those of the last plant, in its own frame and states, that converged and keep clear of the
        body: a plan and a coast each, called after the orbit.
    rungs : tuple of str
        Names of the R plants.
    plants, frames : tuple of str
        What they are, and the frames of their states.
    state_counts : tuple of int
        Number of states of each.
    members : tuple of str
        Names of the N orbits.
    times_s : ndarray, shape (K + 1,)
        Times of the nodes.
    x : ndarray, shape (7, K + 1, N, R)
        States at the nodes in the frame of each plant, SI; NaN where a flight did not converge,
        and in the seventh row of plants with six states.
    hill : ndarray, shape (6, K + 1, N, R)
        The same in the frame hill:BODY, x away from the primary at that moment.
    departure_m : ndarray, shape (K + 1, N, R)
        Distance of the nodes from the orbits.
    converged : ndarray of bool, shape (N, R)
        Whether the flight is continuous.
    iterations : ndarray of int, shape (N, R)
        Steps of multiple shooting.
    gap : ndarray, shape (N, R)
        Largest gap at a node, natural units.
    departure_max_m, departure_rms_m : ndarray, shape (N, R)
        Of the flight from the nearest point of the orbit, between the nodes too.
    slip_s : ndarray, shape (N, R)
        Time by which the flight is ahead of the orbit at the end.
    altitude_min_m : ndarray, shape (N, R)
        Least height above the surface; NaN without one, zero if the flight meets it.
    survival_s : ndarray, shape (N, R)
        How long the flight stays within the limits from its first node without correction.
    fate : tuple of str, length N·R
        What ended that flight (``"limit"``, ``"impact"``, ``"unresolved"`` where it is not proved
        whether the surface is met) or an empty text; members run fastest.
    status : tuple of str, length N·R
        ``"converged"``, or why not; members run fastest.
    periodic_x0_m : ndarray, shape (6, N, R)
        First states, SI, of periodic orbits of the plants themselves with the same amplitude, in
        the frame hill:BODY; NaN where there is none.
    periodic_s, periodic_closure : ndarray, shape (N, R)
        Their periods, and the distances of states a period apart, natural units.
    periodic_status : tuple of str, length N·R
        ``"periodic"``, or why not; members run fastest.
    period_s : ndarray, shape (N,)
        Periods of the orbits themselves.
    track_m : ndarray, shape (3, P, N)
        The orbits themselves in the frame hill:BODY.
    limit : float
        Of the survival: multiples of the orbit's amplitudes.
    start_true_anomaly_rad : float
        True anomaly at time zero.
    body : str
        Name of the moon; empty if the first plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from away from the primary to its longitude 0, in the mean.
    """

    rungs: tuple[str, ...]
    plants: tuple[str, ...]
    frames: tuple[str, ...]
    state_counts: tuple[int, ...]
    members: tuple[str, ...]
    times_s: Array
    x: Array
    hill: Array
    departure_m: Array
    converged: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    gap: Array
    departure_max_m: Array
    departure_rms_m: Array
    slip_s: Array
    altitude_min_m: Array
    survival_s: Array
    fate: tuple[str, ...]
    status: tuple[str, ...]
    periodic_x0_m: Array
    periodic_s: Array
    periodic_closure: Array
    periodic_status: tuple[str, ...]
    period_s: Array
    track_m: Array
    limit: float
    start_true_anomaly_rad: float
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float

    def reference(self, rung: str, member: str) -> tuple[Array, Array]:
        """Return the flight of a member on a rung, for what shall follow it.

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
