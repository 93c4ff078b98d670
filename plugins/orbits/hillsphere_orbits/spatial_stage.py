"""The stage ``spatial_qso_families``: families in space, their members and their stability."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import Bifurcations
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.shooting import SymmetricShooting
from hillsphere_orbits.spatial_family import Spatial, branch_off, height, spatial_problem
from hillsphere_orbits.spatial_presentation import present_families
from hillsphere_orbits.spatial_products import SpatialFamilies
from hillsphere_orbits.spatial_specs import SpatialFamiliesSpec
from hillsphere_orbits.spatial_stability import is_stable, spectrum
from hillsphere_orbits.specs import read_resonance
from hillsphere_orbits.survey import LockedMoon, Surveyor

__all__ = ["SpatialFamiliesStage"]

_SAME_EQUATIONS = 1e-8
_STATES = ("x", "y", "z", "vx", "vy", "vz")
_TRACK_POINTS = 1600


class SpatialFamiliesStage:
    """Families of orbits in space from the vertical bifurcations of planar ones.

    Parameters
    ----------
    spec : SpatialFamiliesSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant has other states than x, y, z, vx, vy, vz.
    """

    def __init__(self, spec: SpatialFamiliesSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        names = tuple(v.name for v in self.plant.states)
        if names != _STATES:
            raise InputError(
                f"families in space need a plant with states {', '.join(_STATES)}; "
                f"{type(self.plant).__name__} has {', '.join(names)}"
            )

    def run(self, ctx: Context, bifurcations: Bifurcations) -> SpatialFamilies:
        """Compute the families.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        bifurcations : Bifurcations
            Where they branch off.

        Returns
        -------
        SpatialFamilies
            Curves, members, windows of stability.

        Raises
        ------
        InputError
            If a resonance is not among the bifurcations, an amplitude is beyond a family, or the
            plant's equations do not keep the mirrors.
        StageError
            If the bifurcations belong to other equations.
        ConvergenceError
            If a family cannot be followed.
        """
        spec, unit = self.spec, self.plant.scales.length_m
        chosen = self._chosen(bifurcations)
        flow = flow_of(self.plant)
        problem = spatial_problem(flow, spec.branch, _samples())
        x, period = self._planar(problem, bifurcations, chosen)
        n = np.array(bifurcations.n)[chosen]
        advance = ctx.track("families in space", 4)
        heights = [z / unit for z in spec.z_amplitudes_m]
        # a little beyond, so that the largest amplitude asked for is passed
        z_max = (spec.z_max_m or max(spec.z_amplitudes_m)) / unit * (1.0 + 1e-6)
        problem, first = branch_off(problem, x, period, n)
        spatial = Spatial.follow(problem, first, z_max)
        problem = spatial.problem
        ctx.info(f"{len(n)} families followed; {problem.steps} sub-steps of half a period")
        advance(1)
        family, target, z = spatial.members_at(heights)
        resonances = [f"{bifurcations.d[i]}:{bifurcations.n[i]}" for i in chosen]
        self._refuse_missing(spatial, family, target, resonances)
        advance(1)
        surveyor = Surveyor(self.plant, problem)
        asked = np.array(spec.z_amplitudes_m)[target]
        labels = _labels(resonances, family, asked)
        members = surveyor.orbits(z, labels)
        curve_family, curve_z = spatial.curve
        curve = surveyor.orbits(curve_z, ("",) * curve_z.shape[1])
        advance(1)
        window_family, begin, end = spatial.windows(curve.monodromy)
        advance(1)
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        edges = np.empty((2, window_family.size))
        if window_family.size:
            edges = np.array([height(problem, begin), height(problem, end)]) * unit
        return SpatialFamilies(
            branch=spec.branch,
            d=tuple(bifurcations.d[i] for i in chosen),
            n=tuple(bifurcations.n[i] for i in chosen),
            bifurcation_x_m=bifurcations.orbits.x0[0, chosen],
            ends=tuple(branch.ends[1] for branch in spatial.branches),
            members=members,
            curve=curve,
            member_family=family,
            curve_family=curve_family,
            member_z_m=asked,
            curve_z_m=height(problem, curve_z) * unit,
            member_multipliers=spectrum(members.monodromy),
            curve_multipliers=spectrum(curve.monodromy),
            member_stable=is_stable(members.monodromy),
            curve_stable=is_stable(curve.monodromy),
            member_half_residual=_half_residual(surveyor, problem, z),
            curve_half_residual=_half_residual(surveyor, problem, curve_z),
            window_family=window_family,
            window_z_m=edges,
            tracks_m=_tracks(problem, z) * unit,
            method=f"half a period between two states that the mirror keeps; branch {spec.branch}",
            check=surveyor.check,
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )

    def present(self, product: SpatialFamilies, bifurcations: Bifurcations) -> Presentation:
        """Show members, windows of stability, the families in space and their multipliers."""
        return present_families(product, self.spec.label)

    def _chosen(self, bifurcations: Bifurcations) -> list[int]:
        """Return the numbers of the bifurcations to start from, in the order asked for."""
        pairs = list(zip(bifurcations.d, bifurcations.n, strict=True))
        vertical = [i for i, plane in enumerate(bifurcations.plane) if plane == "vertical"]
        wanted = [pair for text in self.spec.resonances if (pair := read_resonance(text))]
        there = ", ".join(dict.fromkeys(f"{pairs[i][0]}:{pairs[i][1]}" for i in vertical)) or "none"
        if missing := [pair for pair in wanted if pair not in {pairs[i] for i in vertical}]:
            names = ", ".join(f"{d}:{n}" for d, n in missing)
            raise InputError(
                f"resonances: no vertical bifurcation {names} was found (found: {there}); ask the "
                "bifurcations stage for it, or leave it out"
            )
        if not vertical:
            raise InputError(
                "there is no vertical bifurcation to start from; ask the bifurcations stage for "
                "some with its key vertical"
            )
        if not wanted:
            return vertical
        return [i for pair in wanted for i in vertical if pairs[i] == pair]

    def _planar(
        self, problem: SymmetricShooting, bifurcations: Bifurcations, chosen: list[int]
    ) -> tuple[Array, Array]:
        """Return normalised states and periods of the planar orbits, tried on these equations."""
        system, orbits = problem.flow.system, bifurcations.orbits
        x = orbits.x0[:, chosen] / system.unit[:, None]
        period = orbits.period_s[chosen] / system.time_unit_s
        end = problem.flow.with_matrix(x, period, problem.flow.steps_for(x, period))[0]
        error = float(np.max(np.abs(end - x)))
        if orbits.frame != system.frame or not error <= _SAME_EQUATIONS:
            raise StageError(
                f"the bifurcating orbits (frame {orbits.frame}) do not solve the equations of this "
                f"stage's plant (frame {system.frame}; closure {error:.1e}); give the plant with "
                "which they were computed"
            )
        return x, period

    def _refuse_missing(
        self,
        spatial: Spatial,
        family: NDArray[np.int64],
        target: NDArray[np.int64],
        resonances: list[str],
    ) -> None:
        met = set(zip(family.tolist(), target.tolist(), strict=True))
        faults = []
        for f, branch in enumerate(spatial.branches):
            lost = [
                f"{z / 1e3:.6g}"
                for k, z in enumerate(self.spec.z_amplitudes_m)
                if (f, k) not in met
            ]
            if lost:
                tall = height(spatial.problem, branch.z) * self.plant.scales.length_m / 1e3
                faults.append(
                    f"{resonances[f]} has no member of amplitude {', '.join(lost)} km (it has "
                    f"{tall.min():.6g} to {tall.max():.6g} km; it ends: {branch.ends[1]})"
                )
        if faults:
            raise InputError(f"z_amplitudes_m: {'; '.join(faults)}")


def _samples() -> Array:
    """States around the body at which mirrors are tried, shape (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    place = np.geomspace(0.7, 4.0, 48) * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])


def _labels(resonances: list[str], family: NDArray[np.int64], z_m: Array) -> tuple[str, ...]:
    names: list[str] = []
    for f, z in zip(family, z_m, strict=True):
        name = f"{resonances[int(f)]}, {z / 1e3:.9g} km"
        count = sum(other.split(" #")[0] == name for other in names)
        names.append(f"{name} #{count + 1}" if count else name)
    return tuple(names)


def _half_residual(surveyor: Surveyor, problem: SymmetricShooting, z: Array) -> Array:
    """Largest state with sign −1 after half a period, by the surveyor's propagator, (N,)."""
    end = surveyor.propagate(problem.state(z), z[-1])
    odd = np.array(problem.mirror) == -1
    return np.asarray(np.max(np.abs(end[odd]), axis=0))


def _tracks(problem: SymmetricShooting, z: Array) -> Array:
    """Return normalised positions (3, P, N) along one period, ends included."""
    half = problem.flow.trajectory(problem.state(z), z[-1], problem.steps)
    thinned = half[:, :: max(1, 2 * problem.steps // _TRACK_POINTS)]
    sign = np.array(problem.mirror, dtype=float)[:, None, None]
    # the second half is the mirror image of the first, run backwards
    return np.ascontiguousarray(np.concatenate([thinned, (sign * thinned)[:, ::-1]], axis=1)[:3])
