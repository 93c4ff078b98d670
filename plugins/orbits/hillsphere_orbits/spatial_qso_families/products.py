"""What the stages on families in space hand on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.products import OrbitSet, PeriodicOrbits

__all__ = ["SpatialFamilies", "StationKeepingIndex"]


@dataclass(frozen=True)
class SpatialFamilies(OrbitSet):
    """Families of orbits in space: their curves, and the members that were asked for.

    Parameters
    ----------
    members : PeriodicOrbits
        The N orbits asked for, by family, amplitude and arclength.
    branch : str
        ``"position"``, ``"velocity"`` or ``"companion"``, as asked for.
    d, n : tuple of int, length F
        Resonance at which each family branches off; its orbits have n revolutions.
    starts : tuple of str, length F
        ``"position"`` (z ≠ 0, ż = 0 on the plane xz), ``"velocity"`` (z = 0, ż ≠ 0 on the x axis)
        or ``"y_position"`` (z ≠ 0, ż = 0 on the plane yz).
    of_position : tuple of bool, length F
        Whether this is the family that also starts on the plane xz with z ≠ 0 and x > 0.
    bifurcation_x_m : ndarray, shape (F,)
        Amplitude x of the planar orbit there.
    ends : tuple of str, length F
        Why each family was followed no further, or not at all.
    missing : tuple of str
        Which families have no member of which amplitudes asked for, and what they have; a sentence
        each.
    curve : PeriodicOrbits
        All K orbits along the families, denser where stability may change.
    member_family, curve_family : ndarray of int, shape (N,), (K,)
        Number of the family.
    member_z_m, curve_z_m : ndarray, shape (N,), (K,)
        Amplitude.
    curve_place : ndarray, shape (K,)
        Position along the family, in steps of its continuation.
    member_multipliers, curve_multipliers : ndarray of complex, shape (6, N), (6, K)
        λ, 1/λ of the dominant pair, those of the other one, and 1, 1.
    curve_return_index : ndarray of complex, shape (2, K)
        Indices c = ν + 1/ν of the return map N, the dominant one first: smooth along a family.
    curve_return_power : ndarray of int, shape (K,)
        M = N² (2) where half a period leads to a mirror image of the start in space, else M = N.
    member_stable, curve_stable : ndarray of bool, shape (N,), (K,)
        Whether no multiplier lies off the unit circle.
    member_half_residual, curve_half_residual : ndarray, shape (N,), (K,)
        Largest state that should vanish after half a period, by the other integrator, normalised.
    window_family : ndarray of int, shape (W,)
        Family of each window of stability.
    window_z_m : ndarray, shape (2, W)
        Amplitudes at which it begins and ends, in the order of the family.
    secondary_family : ndarray of int, shape (E,)
        Family of each secondary bifurcation.
    secondary_kind : tuple of str, length E
        ``"fold"``, ``"branching"``, ``"doubling"`` or ``"krein"``.
    secondary_z_m, secondary_jacobi : ndarray, shape (E,)
        Amplitude and integral there.
    secondary_index : ndarray of complex, shape (2, E)
        Stability indices b = λ + 1/λ there.
    tracks_m : ndarray, shape (3, P, N)
        Positions of the members along one period.
    method, check : str
        How orbits were found, and how closure was measured.
    body : str
        Name of the moon; empty if the plant does not say.
    semi_axes_m : tuple of float
        Semi-axes of its surface along its own axes; empty if it has none.
    prime_meridian_rad : float
        Angle from +x to its longitude 0.
    """

    branch: str
    d: tuple[int, ...]
    n: tuple[int, ...]
    starts: tuple[str, ...]
    of_position: tuple[bool, ...]
    bifurcation_x_m: Array
    ends: tuple[str, ...]
    missing: tuple[str, ...]
    curve: PeriodicOrbits
    member_family: NDArray[np.int64]
    curve_family: NDArray[np.int64]
    member_z_m: Array
    curve_z_m: Array
    curve_place: Array
    member_multipliers: NDArray[np.complex128]
    curve_multipliers: NDArray[np.complex128]
    curve_return_index: NDArray[np.complex128]
    curve_return_power: NDArray[np.int64]
    member_stable: NDArray[np.bool_]
    curve_stable: NDArray[np.bool_]
    member_half_residual: Array
    curve_half_residual: Array
    window_family: NDArray[np.int64]
    window_z_m: Array
    secondary_family: NDArray[np.int64]
    secondary_kind: tuple[str, ...]
    secondary_z_m: Array
    secondary_jacobi: Array
    secondary_index: NDArray[np.complex128]
    tracks_m: Array
    method: str
    check: str
    body: str
    semi_axes_m: tuple[float, ...]
    prime_meridian_rad: float


@dataclass(frozen=True)
class StationKeepingIndex:
    """Cost of nulling the unstable component of members of families in space.

    Parameters
    ----------
    n : tuple of int, length N
        Revolutions of each member.
    z_m : ndarray, shape (N,)
        Amplitude.
    x0, vy, period, jacobi : ndarray, shape (N,)
        Normalised.
    lambda_max : ndarray, shape (N,)
        Largest modulus of a multiplier.
    stable : ndarray of bool, shape (N,)
        Whether there is no unstable multiplier.
    v_cm_m_s : ndarray, shape (N,)
        The index; NaN for a stable member, which has no unstable component to null.
    labels : tuple of str
        Names of the members.
    """

    n: tuple[int, ...]
    z_m: Array
    x0: Array
    vy: Array
    period: Array
    jacobi: Array
    lambda_max: Array
    stable: NDArray[np.bool_]
    v_cm_m_s: Array
    labels: tuple[str, ...]
