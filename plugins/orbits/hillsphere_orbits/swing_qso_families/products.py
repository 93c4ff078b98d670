"""What the stage on planar orbits of several revolutions hands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import OrbitSet, PeriodicOrbits

__all__ = ["SwingFamilies"]


@dataclass(frozen=True)
class SwingFamilies(OrbitSet):
    """Families of planar orbits of n revolutions: their curves, and the members asked for.

    Each family is a chain of orbits from where it branches off: positions along it are numbers
    from 0 to its number of orbits less one, see
    `hillsphere_orbits.swing_qso_families.curves.Swing`.

    Parameters
    ----------
    d, n : tuple of int, length F
        Resonance at which each family branches off; its orbits have n revolutions.
    axis : tuple of str, length F
        Axis on which the orbits start, ``"x"`` or ``"y"``: perpendicularly if they have a mirror.
    direction : tuple of int, length F
        Sense, +1 or −1, in which the family leaves along the kernel (+1 outwards).
    symmetry : tuple of str, length F
        Mirrors that the orbits keep: ``"x"`` (the x axis), ``"y"``, ``"xy"`` or ``"none"``.
    parent : tuple of int, length F
        Number of the family that it branches off; −1 for the family of one revolution.
    origin : PeriodicOrbits
        The orbit at which each family branches off, over n revolutions, at the start that the
        family's orbits have.
    ends : tuple of str, length F
        Why each family was followed no further.
    members, curve : PeriodicOrbits
        The N orbits asked for, by family and arclength; all K orbits along the families.
    member_family, curve_family : ndarray of int, shape (N,), (K,)
        Number of the family.
    member_position : ndarray, shape (N,)
        Position on the family's chain.
    member_indices, curve_indices : ndarray, shape (2, N), (2, K)
        Planar and vertical stability index over the full period.
    member_multipliers : ndarray of complex, shape (6, N)
        λ, 1/λ in the plane, those out of it, and 1, 1.
    member_stable, curve_stable : ndarray of bool, shape (N,), (K,)
        Whether no multiplier lies off the unit circle.
    member_half_residual, curve_half_residual : ndarray, shape (N,), (K,)
        Largest state that should vanish after half a period, by the other integrator, normalised;
        for orbits without mirror, the largest change of a state after the full period.
    curve_least_m, curve_largest_m : ndarray, shape (K,)
        Least and largest distance from the centre of mass along each orbit.
    event_family : ndarray of int, shape (E,)
        Family of each secondary bifurcation.
    event_kind : tuple of str, length E
        ``"fold"``, ``"branching"``, ``"doubling"`` …, see `hillsphere_orbits.secondary`.
    event_plane : tuple of str, length E
        ``"planar"`` or ``"vertical"``.
    event_orbits : PeriodicOrbits
        The E orbits there.
    tracks_m : ndarray, shape (3, P, N)
        Positions of the members along one period, ends included.
    family_tracks_m : ndarray, shape (3, P, F)
        The same of the orbit half-way along each family's chain.
    family_jacobi : ndarray, shape (F,)
        Jacobi constant of that orbit.
    method, check : str
        How orbits were found, and how closure was measured.
    notes : tuple of str
        What was left out and why: bifurcations without a family, members that do not exist.
    body : str
        Name of the moon; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    """

    d: tuple[int, ...]
    n: tuple[int, ...]
    axis: tuple[str, ...]
    direction: tuple[int, ...]
    symmetry: tuple[str, ...]
    parent: tuple[int, ...]
    origin: PeriodicOrbits
    ends: tuple[str, ...]
    curve: PeriodicOrbits
    member_family: NDArray[np.int64]
    curve_family: NDArray[np.int64]
    member_position: Array
    member_indices: Array
    curve_indices: Array
    member_multipliers: NDArray[np.complex128]
    member_stable: NDArray[np.bool_]
    curve_stable: NDArray[np.bool_]
    member_half_residual: Array
    curve_half_residual: Array
    curve_least_m: Array
    curve_largest_m: Array
    event_family: NDArray[np.int64]
    event_kind: tuple[str, ...]
    event_plane: tuple[str, ...]
    event_orbits: PeriodicOrbits
    tracks_m: Array
    family_tracks_m: Array
    family_jacobi: Array
    method: str
    check: str
    notes: tuple[str, ...]
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float

    def name(self, family: int) -> str:
        """Return a name, e.g. ``"2:5 x+"``; broken: it has lost one of its parent's mirrors."""
        sign = "+" if self.direction[family] > 0 else "−"
        kind = "asymmetric " if self.symmetry[family] == "none" else ""
        born = " broken" if self.parent[family] >= 0 and not kind else ""
        return f"{self.d[family]}:{self.n[family]} {kind}{self.axis[family]}{sign}{born}"
