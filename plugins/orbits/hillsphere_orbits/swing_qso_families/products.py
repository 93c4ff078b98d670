"""Product of the stage on planar orbits of several revolutions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.products.fields import Label, Shape

__all__ = ["SwingFamilies"]


@dataclass(frozen=True)
class SwingFamilies(OrbitSet):
    """Families of planar orbits of n revolutions: their curves, and the members asked for.

    Each family is a chain of orbits from where it branches off: positions along it are numbers
    from 0 to its number of orbits less one, see
    `hillsphere_orbits.swing_qso_families.curves.Swing`.

    """

    d: Annotated[tuple[int, ...], Shape("families")]
    """The family branches off at the resonance d:n."""
    n: Annotated[tuple[int, ...], Shape("families")]
    """Revolutions of its orbits."""
    axis: Annotated[tuple[str, ...], Shape("families")]
    """Axis on which the orbits start, ``"x"`` or ``"y"``: perpendicularly if they have a mirror."""
    direction: Annotated[tuple[int, ...], Shape("families")]
    """Sense, +1 or −1, in which the family leaves along the kernel (+1 outwards)."""
    symmetry: Annotated[tuple[str, ...], Shape("families"), Label("symmetry")]
    """Mirrors that the orbits keep: ``"x"`` (the x axis), ``"y"``, ``"xy"`` or ``"none"``."""
    parent: Annotated[tuple[int, ...], Shape("families")]
    """Number of the family that it branches off; −1 for the family of one revolution."""
    origin: PeriodicOrbits
    """The orbit at which each family branches off, over n revolutions, at the start that the
    family's orbits have."""
    ends: Annotated[tuple[str, ...], Shape("families"), Label("why it ends")]
    """Why each family was followed no further."""
    curve: PeriodicOrbits
    """All orbits along the families."""
    member_family: Annotated[Integers, Shape("members")]
    """Number of the family of each orbit asked for, by family and arclength."""
    curve_family: Annotated[Integers, Shape("curve")]
    """Number of the family of each orbit of the curve."""
    member_position: Annotated[Array, Shape("members")]
    """Position on the family's chain."""
    member_indices: Annotated[Array, Shape(2, "members")]
    """Planar and vertical stability index over the full period."""
    curve_indices: Annotated[Array, Shape(2, "curve")]
    """The same along the curve."""
    member_multipliers: Annotated[NDArray[np.complex128], Shape(6, "members")]
    """λ, 1/λ in the plane, those out of it, and 1, 1."""
    member_stable: Annotated[NDArray[np.bool_], Shape("members"), Label("stable")]
    """Whether no multiplier lies off the unit circle."""
    curve_stable: Annotated[NDArray[np.bool_], Shape("curve")]
    """The same along the curve."""
    member_half_residual: Annotated[Array, Shape("members"), Label("at half a period", 2)]
    """Largest state that should vanish after half a period, by the other integrator, normalised;
    for orbits without mirror, the largest change of a state after the full period."""
    curve_half_residual: Annotated[Array, Shape("curve")]
    """The same along the curve."""
    curve_least_m: Annotated[Array, Shape("curve")]
    """Least distance from the centre of mass along each orbit."""
    curve_largest_m: Annotated[Array, Shape("curve")]
    """Largest distance from it."""
    event_family: Annotated[Integers, Shape("events")]
    """Family of each secondary bifurcation."""
    event_kind: Annotated[tuple[str, ...], Shape("events"), Label("kind")]
    """``"fold"``, ``"branching"``, ``"doubling"`` …, see `hillsphere_orbits.secondary`."""
    event_plane: Annotated[tuple[str, ...], Shape("events"), Label("plane")]
    """``"planar"`` or ``"vertical"``."""
    event_orbits: PeriodicOrbits
    """The orbits there."""
    tracks_m: Annotated[Array, Shape(3, "points", "members")]
    """Positions of the members along one period, ends included."""
    family_tracks_m: Annotated[Array, Shape(3, "points", "families")]
    """The same of the orbit half-way along each family's chain."""
    family_jacobi: Annotated[Array, Shape("families")]
    """Jacobi constant of that orbit."""
    method: str
    """How orbits were found."""
    check: str
    """How closure was measured."""
    notes: tuple[str, ...]
    """What was left out and why: bifurcations without a family, members that do not exist."""
    body: str
    """Name of the moon; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""

    def name(self, family: int) -> str:
        """Return a name, e.g. ``"2:5 x+"``; broken: it has lost one of its parent's mirrors."""
        sign = "+" if self.direction[family] > 0 else "−"
        kind = "asymmetric " if self.symmetry[family] == "none" else ""
        born = " broken" if self.parent[family] >= 0 and not kind else ""
        return f"{self.d[family]}:{self.n[family]} {kind}{self.axis[family]}{sign}{born}"
