"""The stage ``fidelity_ladder``: periodic orbits continued to higher-fidelity equations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import OrbitSet, PeriodicOrbits, Trajectories
from hillsphere_orbits.coverage.ellipsoid_geometry import nearest_point
from hillsphere_orbits.fidelity_ladder.orbits import NearOrbit, OrbitCurves
from hillsphere_orbits.fidelity_ladder.periodic import periodic_on
from hillsphere_orbits.fidelity_ladder.presentation import present_ladder
from hillsphere_orbits.fidelity_ladder.products import FidelityLadder
from hillsphere_orbits.fidelity_ladder.rung import Rung, describe_plant, name_rungs
from hillsphere_orbits.fidelity_ladder.specs import FidelityLadderSpec
from hillsphere_orbits.fidelity_ladder.survival import survival
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.multiple_shooting import ContinuousFlights, reconverge
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.survey import NEARLY_PLANAR, LockedMoon

__all__ = ["FidelityLadderStage"]

_ARC = 1.5
"""Length of an arc, natural units: gaps of neighbouring flights stay linear over it."""
_BETWEEN = 12
"""Points of an arc at which departure and height are taken."""


class FidelityLadderStage:
    """Periodic orbits continued to higher-fidelity equations.

    Parameters
    ----------
    spec : FidelityLadderSpec
        With its references bound.
    """

    def __init__(self, spec: FidelityLadderSpec) -> None:
        self.spec = spec
        self.plants: list[Plant] = [ref.get() for ref in spec.rungs]

    def run(
        self,
        ctx: Context,
        orbits: tuple[OrbitSet, ...],
    ) -> FidelityLadder:
        """Carry the members over.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        orbits : tuple of OrbitSet
            Products whose members are carried over.

        Returns
        -------
        FidelityLadder
            One flight per member and rung; those that fail are classified.

        Raises
        ------
        InputError
            If a member is unknown, or a plant has other states.
        StageError
            If the orbits do not solve the equations of the first rung.
        """
        given = self._select_orbits(members_of(*orbits))
        curves = OrbitCurves(self.plants[0], given)
        span = self.spec.duration_s / curves.time_unit_s
        arcs = self.spec.segments or max(1, round(span / _ARC))
        t = np.linspace(0.0, self.spec.duration_s, arcs + 1)
        anomaly = self.spec.start_true_anomaly_rad
        names = name_rungs([ref.name for ref in self.spec.rungs], self.plants)
        rungs = [Rung(plant, t, anomaly) for plant in self.plants]
        moon = self.plants[0] if isinstance(self.plants[0], LockedMoon) else None
        advance = ctx.track("rungs", len(rungs))
        results, recurring = [], []
        for name, rung in zip(names, rungs, strict=True):
            one = self._climb(rung, curves)
            recurring.append(periodic_on(rung, given, _at_start(one, rung, curves)))
            for member, status in zip(given.labels, one.status, strict=True):
                if status != "converged":
                    ctx.info(f"{member} on {name}: {status}")
            results.append(one)
            advance(1)
        return FidelityLadder(
            flights=_flights(rungs[-1], given.labels, results[-1]),
            rungs=names,
            plants=tuple(describe_plant(plant) for plant in self.plants),
            frames=tuple(plant.frame for plant in self.plants),
            state_counts=tuple(rung.n for rung in rungs),
            members=given.labels,
            times_s=t,
            x=np.stack([one.x for one in results], axis=-1),
            hill=np.stack([one.hill for one in results], axis=-1),
            departure_m=np.stack([one.departure for one in results], axis=-1),
            converged=np.stack([one.flown.converged for one in results], axis=-1),
            iterations=np.stack([one.flown.iterations for one in results], axis=-1),
            gap=np.stack([one.flown.gap for one in results], axis=-1),
            departure_max_m=np.stack([one.largest for one in results], axis=-1),
            departure_rms_m=np.stack([one.rms for one in results], axis=-1),
            slip_s=np.stack([one.slip for one in results], axis=-1) * curves.time_unit_s,
            min_altitude_m=np.stack([one.altitude for one in results], axis=-1),
            survival_s=np.stack([one.survival for one in results], axis=-1),
            fate=tuple(fate for one in results for fate in one.fate),
            status=tuple(status for one in results for status in one.status),
            periodic_x0_m=np.stack([one.x0 for one in recurring], axis=-1),
            periodic_s=np.stack([one.period_s for one in recurring], axis=-1),
            periodic_closure=np.stack([one.closure for one in recurring], axis=-1),
            periodic_status=tuple(status for one in recurring for status in one.status),
            period_s=given.period_s,
            track_m=curves.track_m(),
            limit=self.spec.limit,
            start_true_anomaly_rad=anomaly,
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )

    def present(
        self,
        product: FidelityLadder,
        orbits: tuple[OrbitSet, ...] = (),
    ) -> Presentation:
        """Show a row per member and rung, the departures over time and the flights."""
        return present_ladder(product, self.spec.label)

    def _select_orbits(self, orbits: PeriodicOrbits) -> PeriodicOrbits:
        """Return the orbits asked for."""
        known = orbits.labels
        if not known:
            raise InputError("the families have no members to carry over; ask them for some")
        if unknown := [name for name in self.spec.members if name not in known]:
            raise InputError(
                f"members: no orbit is called {unknown[0]!r}; there are: {', '.join(known)}"
            )
        wanted = self.spec.members or known
        at = [known.index(name) for name in wanted]
        return replace(
            orbits,
            x0=orbits.x0[:, at],
            period_s=orbits.period_s[at],
            integral=orbits.integral[at],
            monodromy=orbits.monodromy[:, :, at],
            residual=orbits.residual[at],
            labels=tuple(wanted),
        )

    def _climb(self, rung: Rung, curves: OrbitCurves) -> _RungResult:
        """Find the flights of one rung and describe them."""
        target = NearOrbit(curves, rung)
        flown = reconverge(rung.plant, rung.t_s, target.start(), target=target)
        good = np.flatnonzero(flown.converged)
        cases = len(flown.converged)
        points = len(rung.t_s)
        x = np.full((7, points, cases), np.nan)
        x[: rung.n, :, good] = flown.x[:, :, good]
        hill = np.full((6, points, cases), np.nan)
        hill[:, :, good] = rung.hill(flown.x[:, :, good])
        made = _RungResult(
            flown=flown,
            x=x,
            hill=hill,
            departure=np.full((points, cases), np.nan),
            largest=np.full(cases, np.nan),
            rms=np.full(cases, np.nan),
            slip=np.where(flown.converged, flown.slip[-1], np.nan),
            altitude=np.full(cases, np.nan),
            survival=np.full(cases, np.nan),
            fate=[""] * cases,
            status=[f"not converged: {why}" if why else "converged" for why in flown.reasons],
        )
        if good.size:
            self._describe(made, rung, curves, good)
        return made

    def _describe(
        self, made: _RungResult, rung: Rung, curves: OrbitCurves, good: NDArray[np.intp]
    ) -> None:
        """Fill in departures, heights and survival of the flights that converged."""
        flow = flow_of(rung.plant)
        unit, n = flow.system.unit, rung.n
        points = len(rung.t_s)
        start = np.ascontiguousarray(made.x[:n, :-1, good].reshape(n, -1)) / unit[:, None]
        durations = np.repeat(np.diff(rung.t_s), good.size) / flow.system.time_unit_s
        steps = _BETWEEN * -(-made.flown.steps // _BETWEEN)
        way = flow.plain.trajectory(start, durations, steps)[:, :: steps // _BETWEEN]
        states = way.reshape(n, -1) * unit[:, None]
        place = rung.hill(states).reshape(6, _BETWEEN + 1, points - 1, good.size)
        t = rung.t_s / curves.time_unit_s
        parts = np.linspace(0.0, 1.0, _BETWEEN + 1)[:, None]
        times = (t[:-1] + parts * np.diff(t))[..., None] + made.flown.slip[:-1, good]
        flat = place.reshape(6, -1, good.size) / curves.unit[:, None, None]
        phase = curves.nearest(flat, times.reshape(-1, good.size), good)
        nearest, _ = curves.at(phase, good)
        away = np.linalg.norm((flat - nearest)[:3], axis=0) * curves.unit[0]
        away = away.reshape(_BETWEEN + 1, points - 1, good.size)
        made.departure[:-1, good], made.departure[-1, good] = away[0], away[-1, -1]
        made.largest[good] = np.max(away, axis=(0, 1))
        made.rms[good] = np.sqrt(np.mean(away[:-1] ** 2, axis=(0, 1)))
        height = _height(rung, states)
        if height is not None:
            made.altitude[good] = np.min(height.reshape(-1, good.size), axis=0)
            for lane in good[made.altitude[good] <= 0.0]:
                made.status[lane] = "converged, but meets the body"
        amplitude = curves.amplitudes_m()
        limits = self.spec.limit * np.where(
            amplitude > NEARLY_PLANAR * np.max(amplitude, axis=0), amplitude, np.inf
        )
        lost, fates = survival(rung, made.x[:n, 0, good], limits[:, good])
        made.survival[good] = lost
        for lane, fate in zip(good, fates, strict=True):
            made.fate[lane] = fate


@dataclass(frozen=True, eq=False)
class _RungResult:
    """The flights of one rung."""

    flown: ContinuousFlights
    x: Array
    hill: Array
    departure: Array
    largest: Array
    rms: Array
    slip: Array
    altitude: Array
    survival: Array
    fate: list[str]
    status: list[str]


def _at_start(made: _RungResult, rung: Rung, curves: OrbitCurves) -> Array:
    """Return states (6, N), SI, of the flights where they pass the starts of their orbits.

    That is half-way if they can be there, where neither end is near at which they are free.
    """
    flow = flow_of(rung.plant)
    states = np.full((6, len(curves.period)), np.nan)
    if rung.n > 6:
        return states
    phase = rung.t_s[:, None] / curves.time_unit_s + made.flown.slip
    for m in np.flatnonzero(made.flown.converged):
        period = curves.period[m]
        start = period * np.floor(0.5 * phase[-1, m] / period)
        k = int(np.argmin(np.abs(phase[:, m] - start)))
        x = made.x[:6, k, m] / flow.system.unit
        states[:, m] = flow.plain.propagate(x, start - phase[k, m], made.flown.steps)
    return states * flow.system.unit[:, None]


def _flights(rung: Rung, members: tuple[str, ...], result: _RungResult) -> Trajectories:
    """Return the flights of a rung that converged and keep clear of the body."""
    good = [m for m, status in enumerate(result.status) if status == "converged"]
    names = tuple(members[m] for m in good)
    return Trajectories(
        frame=rung.plant.frame,
        states=tuple(v.name for v in rung.plant.states),
        plans=names,
        labels=names,
        t_s=np.repeat(rung.t_s[:, None], len(good), axis=1),
        x=np.ascontiguousarray(result.x[: rung.n][:, :, good]),
    )


def _height(rung: Rung, x: Array) -> Array | None:
    """Return heights above the surface (N,) at states (n, N), SI, zero inside; None without one."""
    moon = rung.plant
    if not isinstance(moon, LockedMoon) or moon.semi_axes_m is None:
        return None
    axes = np.array(moon.semi_axes_m)
    angle = moon.prime_meridian_rad
    c, s = np.cos(angle), np.sin(angle)
    r = np.array([c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]])
    outside = np.sum((r / axes[:, None]) ** 2, axis=0) > 1.0
    height = np.zeros(x.shape[1])
    away = r[:, outside]
    height[outside] = np.linalg.norm(away - nearest_point(away, axes), axis=0)
    return height
