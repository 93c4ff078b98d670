"""Product of the stage ``nonlinear_stability``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape

__all__ = ["NonlinearStability"]


@dataclass(frozen=True)
class NonlinearStability:
    """Survival of orbits by direction of offset, phase of injection, and for given offsets.

    Fates are numbers: 0 survives, 1 escape, 2 impact, 3 unresolved (no step that was tried kept
    the integral of motion). An offset is a position, m, or a velocity, m/s.
    """

    labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
    """Names of the orbits."""
    amplitude_m: Annotated[Array, Shape(3, "orbits")]
    """Largest |x|, |y| and |z| of each."""
    limit_m: Annotated[Array, Shape(3, "orbits")]
    """Beyond which it is lost; infinite where nothing limits it."""
    reference_fate: Annotated[Integers, Shape("orbits")]
    """Of the orbit flown without any offset."""
    reference_time_s: Annotated[Array, Shape("orbits")]
    """When it was lost; the duration for one that survives."""
    directions: Annotated[tuple[str, ...], Shape("directions"), Label("direction")]
    """``"+x"``, ``"-vy"``, ``"position 1"`` (drawn) and so on."""
    direction: Annotated[Array, Shape(6, "directions")]
    """Unit offsets in them."""
    largest: Annotated[Array, Shape("orbits", "directions")]
    """Largest offset tried."""
    survived: Annotated[Array, Shape("orbits", "directions")]
    """Largest offset tried below the first loss."""
    lost: Annotated[Array, Shape("orbits", "directions")]
    """Offset of the first loss; infinite without a loss."""
    lost_fate: Annotated[Integers, Shape("orbits", "directions")]
    """Fate of the first lost flight."""
    lost_time_s: Annotated[Array, Shape("orbits", "directions"), Label("lost after", 4, "h")]
    """Time of that loss; NaN without one."""
    phases: Annotated[Array, Shape("phases"), Label("phase of injection", 4)]
    """Parts of the period."""
    counts: Annotated[Integers, Shape(4, "orbits", "phases")]
    """How many draws met each fate."""
    low: Annotated[Array, Shape("orbits", "phases"), Label("from", 4)]
    """Lower end of the interval of the survival probability."""
    high: Annotated[Array, Shape("orbits", "phases"), Label("to", 4)]
    """Its upper end."""
    median_loss_s: Annotated[Array, Shape("orbits", "phases"), Label("median time of loss", 4, "h")]
    """Median time of loss; NaN without a loss."""
    offset: Annotated[Array, Shape(6, "offsets")]
    """Given offsets."""
    offset_fate: Annotated[Integers, Shape("orbits", "offsets")]
    """Their fates."""
    offset_time_s: Annotated[Array, Shape("orbits", "offsets")]
    """When they were lost; the duration for those that survive."""
    near_member: Annotated[Integers, Shape("resonances")]
    """Orbit beside which each resonance lies."""
    near_plane: Annotated[tuple[str, ...], Shape("resonances"), Label("plane")]
    """``"planar"`` or ``"vertical"``."""
    near_d: Annotated[tuple[int, ...], Shape("resonances")]
    """The resonance is d:n."""
    near_n: Annotated[tuple[int, ...], Shape("resonances")]
    """The resonance is d:n."""
    near_x_m: Annotated[Array, Shape("resonances"), Label("x of the resonant orbit", 7, "km")]
    """Amplitude of the resonant orbit."""
    near_distance_m: Annotated[Array, Shape("resonances"), Label("distance", 4, "km")]
    """Its distance from the member."""
    near_vy_offset_m_s: Annotated[
        Array, Shape("resonances"), Label("Δẏ that reaches its Jacobi constant", 4, "cm_s")
    ]
    """Change of ẏ that gives the member the Jacobi constant of the resonant orbit."""
    draws: int
    """Per orbit and phase."""
    confidence: float
    """Of the intervals, as requested."""
    sigma_position_m: float
    """Of injection errors, as requested."""
    sigma_velocity_m_s: float
    """Of injection errors, as requested."""
    duration_s: float
    """Of the flights, as requested."""
    limit: float
    """Multiples of an orbit's amplitudes beyond which it is lost, as requested."""
    doublings: int
    """Density of the search for edges: how often the largest offset is halved."""
    scan: int
    """Density of the search for edges: equal parts below that."""
    flights: int
    """How many were flown."""
    drift: float
    """Largest relative change of the integral in a flight whose fate was resolved; NaN if the
    plant has none."""
    has_surface: bool
    """Whether the plant knows a surface to meet."""

    def weakest(self, velocity: bool) -> NDArray[np.int64]:
        """Return the direction (M,) of the least stability radius of each orbit.

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
        # among equal radii, the direction in which a loss was found
        order = np.lexsort((self.lost[:, own], self.survived[:, own]))
        return np.asarray(own[order[:, 0]], dtype=np.int64)
