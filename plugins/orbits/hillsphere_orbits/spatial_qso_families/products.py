"""Product of the stages on families in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.products.fields import Label, Shape

__all__ = ["SpatialFamilies", "StationKeepingIndex"]


@dataclass(frozen=True)
class SpatialFamilies(OrbitSet):
    """Families of orbits in space: their curves, and the members that were asked for."""

    branch: str
    """``"position"``, ``"velocity"`` or ``"companion"``, as requested."""
    d: Annotated[tuple[int, ...], Shape("families")]
    """The family branches off at the resonance d:n."""
    n: Annotated[tuple[int, ...], Shape("families")]
    """Revolutions of its orbits."""
    starts: Annotated[tuple[str, ...], Shape("families")]
    """``"position"`` (z ≠ 0, ż = 0 on the plane xz), ``"velocity"`` (z = 0, ż ≠ 0 on the x axis)
    or ``"y_position"`` (z ≠ 0, ż = 0 on the plane yz)."""
    of_position: Annotated[tuple[bool, ...], Shape("families")]
    """Whether this is the family that also starts on the plane xz with z ≠ 0 and x > 0."""
    bifurcation_x_m: Annotated[Array, Shape("families"), Label("x of the planar orbit", 9, "km")]
    """Amplitude x of the planar orbit there."""
    ends: Annotated[tuple[str, ...], Shape("families"), Label("it ends")]
    """Why each family was followed no further, or not at all."""
    missing: tuple[str, ...]
    """Families without members of requested amplitudes, and their amplitudes; a sentence
    each."""
    curve: PeriodicOrbits
    """All orbits along the families, denser where stability may change."""
    member_family: Annotated[Integers, Shape("members")]
    """Number of the family of each orbit asked for, by family, amplitude and arclength."""
    curve_family: Annotated[Integers, Shape("curve")]
    """Number of the family of each orbit of the curve."""
    member_z_m: Annotated[Array, Shape("members"), Label("amplitude z", 9, "km")]
    """Amplitude."""
    curve_z_m: Annotated[Array, Shape("curve")]
    """Amplitude."""
    curve_place: Annotated[Array, Shape("curve")]
    """Position along the family, in steps of its continuation."""
    member_multipliers: Annotated[NDArray[np.complex128], Shape(6, "members")]
    """λ, 1/λ of the dominant pair, those of the other one, and 1, 1."""
    curve_multipliers: Annotated[NDArray[np.complex128], Shape(6, "curve")]
    """The same along the curve."""
    curve_return_index: Annotated[NDArray[np.complex128], Shape(2, "curve")]
    """Indices c = ν + 1/ν of the return map N, the dominant one first: smooth along a family."""
    curve_return_power: Annotated[Integers, Shape("curve")]
    """M = N² (2) where half a period leads to a mirror image of the start in space, else M = N."""
    member_stable: Annotated[NDArray[np.bool_], Shape("members"), Label("stable")]
    """Whether no multiplier lies off the unit circle."""
    curve_stable: Annotated[NDArray[np.bool_], Shape("curve")]
    """The same along the curve."""
    member_half_residual: Annotated[Array, Shape("members"), Label("at half a period", 2)]
    """Largest state that should vanish after half a period, by the other integrator, normalised."""
    curve_half_residual: Annotated[Array, Shape("curve")]
    """The same along the curve."""
    window_family: Annotated[Integers, Shape("windows")]
    """Family of each window of stability."""
    window_z_m: Annotated[Array, Shape(2, "windows")]
    """Amplitudes at which it begins and ends, in the order of the family."""
    secondary_family: Annotated[Integers, Shape("events")]
    """Family of each secondary bifurcation."""
    secondary_kind: Annotated[tuple[str, ...], Shape("events"), Label("kind")]
    """``"fold"``, ``"branching"``, ``"doubling"`` or ``"krein"``."""
    secondary_z_m: Annotated[Array, Shape("events"), Label("amplitude z", 8, "km")]
    """Amplitude there."""
    secondary_jacobi: Annotated[Array, Shape("events"), Label("Jacobi constant", 10)]
    """Integral there."""
    secondary_index: Annotated[NDArray[np.complex128], Shape(2, "events")]
    """Stability indices b = λ + 1/λ there."""
    tracks_m: Annotated[Array, Shape(3, "points", "members")]
    """Positions of the members along one period."""
    method: str
    """How orbits were found."""
    check: str
    """How closure was measured."""
    body: str
    """Name of the moon; empty if the plant does not say."""
    semi_axes_m: tuple[float, ...]
    """Semi-axes of its surface along its own axes; empty if it has none."""
    prime_meridian_rad: float
    """Angle from +x to its longitude 0."""


@dataclass(frozen=True)
class StationKeepingIndex:
    """Cost of nulling the unstable component of members of families in space."""

    n: Annotated[tuple[int, ...], Shape("members"), Label("revolutions")]
    """Revolutions of each member."""
    z_m: Annotated[Array, Shape("members"), Label("amplitude z", 9, "km")]
    """Amplitude."""
    x0: Annotated[Array, Shape("members"), Label("x at the start", 12)]
    """Normalised."""
    vy: Annotated[Array, Shape("members"), Label("ẏ at the start", 12)]
    """Normalised."""
    period: Annotated[Array, Shape("members"), Label("period in 1/n", 12)]
    """Normalised."""
    jacobi: Annotated[Array, Shape("members"), Label("Jacobi constant", 12)]
    """Normalised."""
    lambda_max: Annotated[Array, Shape("members"), Label("largest |λ|", 9)]
    """Largest modulus of a multiplier."""
    stable: Annotated[NDArray[np.bool_], Shape("members"), Label("stable")]
    """Whether there is no unstable multiplier."""
    v_cm_m_s: Annotated[Array, Shape("members"), Label("v_cm", 6)]
    """The index; NaN for a stable member, which has no unstable component to null."""
    labels: Annotated[tuple[str, ...], Shape("members")]
    """Names of the members."""
