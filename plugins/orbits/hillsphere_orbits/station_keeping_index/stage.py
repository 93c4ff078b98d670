"""The stage ``station_keeping_index``: an analytic cost of holding unstable orbits.

An error e = (δr, δv) grows along the unstable direction of the monodromy matrix M; its component
there is w·e with the left eigenvector w = (w_r, w_v) of the multiplier λ. A velocity change along
w_v that nulls it has the size |w·e|/|w_v|, its standard deviation for errors σ_r, σ_v per axis is
sqrt(σ_v² + σ_r² |w_r|²/|w_v|²), and it is made once per period T:

    v_cm = (duration/T) · k · sqrt(σ_v² + σ_r² (|w_r|/|w_v|)²)

with k standard deviations. It is an index: the state is taken to be known perfectly.

References
----------
.. [1] The Phobos QSO bifurcation paper (document provided by JAXA: bifurcated families of
   quasi-satellite orbits around Phobos for MMX), section 4.1.1 and Table 3.
.. [2] Nakamiya, M., Kawakatsu, Y., orbit maintenance of halo orbits by elimination of the unstable
   component, cited there as 30.
"""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Presentation
from hillsphere.show.reference import ReferenceTable
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies, StationKeepingIndex
from hillsphere_orbits.spatial_qso_families.specs import StationKeepingSpec
from hillsphere_orbits.station_keeping_index.presentation import present_index

__all__ = ["StationKeepingStage", "correction_speed"]

_NEEDED = ("n", "Az_km", "v_cm_m_s")


def correction_speed(monodromy: Array, sigma_position: float, sigma_velocity: float) -> Array:
    """Return the standard deviation of the velocity change that nulls the unstable component.

    Parameters
    ----------
    monodromy : ndarray, shape (6, 6, N)
        Of unstable orbits, at the place of the correction.
    sigma_position, sigma_velocity : float
        Standard deviations per axis, in the units of the matrix.

    Returns
    -------
    ndarray, shape (N,)
        In the unit of velocity of the matrix.
    """
    values, vectors = np.linalg.eig(np.transpose(monodromy, (2, 1, 0)))
    lane = np.arange(len(values))
    w = vectors[lane, :, np.argmax(np.abs(values), axis=1)]
    ratio = np.linalg.norm(w[:, :3], axis=1) / np.linalg.norm(w[:, 3:], axis=1)
    return np.asarray(np.sqrt(sigma_velocity**2 + (sigma_position * ratio) ** 2))


class StationKeepingStage:
    """Cost of nulling the unstable component of every member once per period.

    Parameters
    ----------
    spec : StationKeepingSpec
        With its references bound.

    Raises
    ------
    InputError
        If the table of published values cannot be read or lacks a column.
    """

    def __init__(self, spec: StationKeepingSpec) -> None:
        self.spec = spec
        self.reference = ReferenceTable.read(spec.reference) if spec.reference else None
        if self.reference is not None:
            missing = [name for name in _NEEDED if name not in self.reference.columns]
            if missing:
                raise InputError(
                    f"reference: no column {', '.join(missing)}; it has "
                    f"{', '.join(self.reference.columns)}"
                )

    def run(self, ctx: Context, families: SpatialFamilies) -> StationKeepingIndex:
        """Compute the index of every member.

        Parameters
        ----------
        ctx : Context
            Log.
        families : SpatialFamilies
            Whose members are judged.

        Returns
        -------
        StationKeepingIndex
            NaN for stable members.
        """
        spec, orbits = self.spec, families.members
        speed = orbits.length_m / orbits.time_s
        unstable = np.flatnonzero(~families.member_stable)
        cost = np.full(orbits.period_s.shape, np.nan)
        if unstable.size:
            one = correction_speed(
                np.ascontiguousarray(orbits.monodromy[:, :, unstable]),
                spec.sigma_position_m / orbits.length_m,
                spec.sigma_velocity_m_s / speed,
            )
            periods = spec.duration_s / orbits.period_s[unstable]
            cost[unstable] = periods * spec.sigmas * one * speed
        ctx.info(f"{unstable.size} of {cost.size} members are unstable")
        return StationKeepingIndex(
            n=tuple(families.n[int(f)] for f in families.member_family),
            z_m=families.member_z_m,
            x0=orbits.x0[0] / orbits.length_m,
            vy=orbits.x0[4] / speed,
            period=orbits.period_s / orbits.time_s,
            jacobi=orbits.integral,
            lambda_max=np.max(np.abs(families.member_multipliers), axis=0),
            stable=families.member_stable,
            v_cm_m_s=cost,
            labels=orbits.labels,
        )

    def present(self, product: StationKeepingIndex, families: SpatialFamilies) -> Presentation:
        """Show Table 3, beside published values where the Spec cites them."""
        return present_index(product, self.spec, self.reference)
