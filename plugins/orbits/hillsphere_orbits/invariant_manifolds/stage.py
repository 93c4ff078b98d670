"""The stage ``invariant_manifolds``: manifolds of unstable orbits and their crossings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Context, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.symbolic import Expr
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.invariant_manifolds.flight import UNPROVED, Watch
from hillsphere_orbits.invariant_manifolds.presentation import present_manifolds
from hillsphere_orbits.invariant_manifolds.products import Manifolds
from hillsphere_orbits.invariant_manifolds.sampling import (
    Leaves,
    LocalManifold,
    classify_manifolds,
    leaves,
    sides_are_images,
)
from hillsphere_orbits.invariant_manifolds.specs import InvariantManifoldsSpec
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.survey import LockedMoon

__all__ = [
    "InvariantManifoldsStage",
    "enders",
    "orbits_on",
    "period_steps",
    "select_orbits",
    "trial_places",
]

_STATES = ("x", "y", "z", "vx", "vy", "vz")
_SAME_EQUATIONS = 1e-8
"""Largest closure beside the growth of errors over a period, natural units, of orbits that count as
solutions of this plant's equations. By default they are
computed to 1e-10 or better; other equations (another gravity model, say) give far more."""
_ACCURACY = 1e-4  # of a state after a period, relative to where trajectories start
_TRACKS = 16  # per side of a manifold
_TRACK_POINTS = 480
"""Intervals of a stored trajectory: a smooth curve in a figure through many revolutions."""
_ORBIT_POINTS = 800
"""Intervals of a drawn orbit."""


class InvariantManifoldsStage:
    """Manifolds of unstable periodic orbits of any family.

    Parameters
    ----------
    spec : InvariantManifoldsSpec
        With its references bound.

    Raises
    ------
    InputError
        If the plant has other states than x, y, z, vx, vy, vz.
    """

    def __init__(self, spec: InvariantManifoldsSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        names = tuple(v.name for v in self.plant.states)
        if names != _STATES:
            raise InputError(
                f"manifolds need a plant with states {', '.join(_STATES)}; "
                f"{type(self.plant).__name__} has {', '.join(names)}"
            )

    def run(
        self,
        ctx: Context,
        orbits: tuple[OrbitSet, ...],
    ) -> Manifolds:
        """Fly the manifolds.

        Parameters
        ----------
        ctx : Context
            Log and progress.
        orbits : tuple of OrbitSet
            Families whose members are taken.

        Returns
        -------
        Manifolds
            Trajectories and their crossings.

        Raises
        ------
        InputError
            If a requested member does not exist.
        StageError
            If the orbits belong to other equations.
        """
        spec, flow = self.spec, flow_of(self.plant)
        given = select_orbits(members_of(*orbits), spec.members)
        x0, period = orbits_on(flow, given)
        kinds = classify_manifolds(given.monodromy)
        names, watch, ends = self._watch(flow)
        parts: list[_Part] = []
        multiplier, one_side = np.full(period.size, np.nan), np.zeros(period.size, dtype=bool)
        advance = ctx.track("manifolds", period.size * len(spec.directions))
        for i, kind in enumerate(kinds):
            if kind != "unstable":
                ctx.info(f"{given.labels[i]}: {kind}, no manifold")
                advance(len(spec.directions))
                continue
            steps = period_steps(flow, x0[:, i], period[i], given.monodromy[:, :, i])
            for direction in spec.directions:
                stable = direction == "stable"
                local = LocalManifold.of(flow, x0[:, i], period[i], steps, stable=stable)
                multiplier[i] = local.multiplier
                one_side[i] = sides_are_images(local, trial_places())
                parts += [
                    _Part(i, stable, self._leaves(local, watch, side, ends)) for side in local.sides
                ]
                advance(1)
        ctx.info(f"{sum(part.leaves.p.size for part in parts)} trajectories")
        if unproved := sum(int(np.sum(~part.leaves.ends.resolved)) for part in parts):
            ctx.info(f"{unproved} of them touch what is watched, or offer no bound: {UNPROVED}")
        return self._product(flow, given, x0, kinds, multiplier, one_side, names, parts)

    def present(self, product: Manifolds, orbits: tuple[OrbitSet, ...]) -> Presentation:
        """Show the crossings, and the tubes with the cylinders and the body."""
        return present_manifolds(product, self.spec)

    def _watch(self, flow: Flow) -> tuple[tuple[str, ...], Watch, tuple[str, ...]]:
        """Return the events' names, their functions, and which of them end a flight."""
        system, unit = flow.system, self.plant.scales.length_m
        x, y, z = system.x[:3]
        functions: dict[str, Expr] = {"plane z = 0": z}
        for radius in self.spec.cylinders_m:
            functions[f"cylinder {radius / 1e3:.9g} km"] = x * x + y * y - (radius / unit) ** 2
        ends = enders(flow)
        functions |= {name: system.events[name] for name in ends}
        return tuple(functions), Watch(system, functions), ends

    def _leaves(
        self, local: LocalManifold, watch: Watch, side: int, ends: tuple[str, ...]
    ) -> Leaves:
        spec = self.spec
        return leaves(
            local,
            watch,
            np.arange(spec.trajectories) / spec.trajectories,
            side,
            start=spec.start_distance,
            distance=spec.distance,
            duration=spec.duration_s / self.plant.scales.time_s,
            ends=ends,
        )

    def _product(
        self,
        flow: Flow,
        orbits: PeriodicOrbits,
        x0: Array,
        kinds: tuple[str, ...],
        multiplier: Array,
        one_side: NDArray[np.bool_],
        names: tuple[str, ...],
        parts: list[_Part],
    ) -> Manifolds:
        unit, clock = flow.system.unit[:, None], flow.system.time_unit_s
        limit = self.spec.duration_s / clock
        count = np.cumsum([0, *(part.leaves.p.size for part in parts)])
        rows = [_rows(part, limit) for part in parts]
        moon = self.plant if isinstance(self.plant, LockedMoon) else None
        kept = [_tracks(flow, part, row) for part, row in zip(parts, rows, strict=True)]
        period = orbits.period_s / clock
        own = [flow.plain.trajectory(x0[:, i], t, _ORBIT_POINTS)[:3] for i, t in enumerate(period)]
        ended = [np.append(names, "")[part.leaves.ends.ended_by] for part in parts]
        return Manifolds(
            orbits=orbits,
            kinds=kinds,
            multiplier=multiplier,
            one_side=one_side,
            distance=self.spec.distance,
            start_distance=self.spec.start_distance,
            orbit=_all([np.full(p.leaves.p.size, p.orbit) for p in parts], np.int64),
            stable=_all([np.full(p.leaves.p.size, p.stable) for p in parts], np.bool_),
            side=_all([np.full(p.leaves.p.size, p.leaves.side) for p in parts], np.int64),
            p=_all([p.leaves.p for p in parts], float),
            start=_all([p.leaves.start for p in parts], float, 6) * unit,
            end=_all([row.end for row in rows], float, 6) * unit,
            start_time_s=_all([-p.leaves.left for p in parts], float) * clock,
            end_time_s=_all([row.end_time for row in rows], float) * clock,
            ended_by=tuple(
                str(name) if e else ""
                for row, some in zip(rows, ended, strict=True)
                for name, e in zip(some, row.ended, strict=True)
            ),
            events=names,
            met_trajectory=_all([r.lane + c for r, c in zip(rows, count, strict=False)], np.int64),
            met_event=_all([r.event for r in rows], np.int64),
            met_time_s=_all([r.time for r in rows], float) * clock,
            met_rising=_all([r.rising for r in rows], np.bool_),
            met=_all([r.x for r in rows], float, 6) * unit,
            track_trajectory=_all(
                [lanes + c for (lanes, _), c in zip(kept, count, strict=False)], np.int64
            ),
            tracks_m=np.concatenate(
                [np.empty((3, _TRACK_POINTS + 1, 0)), *(way for _, way in kept)], axis=2
            )
            * unit[0],
            orbit_tracks_m=np.stack(own, axis=2) * unit[0],
            body=moon.body_name if moon else "",
            semi_axes_m=tuple(moon.semi_axes_m or ()) if moon else (),
            prime_meridian_rad=moon.prime_meridian_rad if moon else 0.0,
        )


def select_orbits(orbits: PeriodicOrbits, labels: tuple[str, ...]) -> PeriodicOrbits:
    """Return the orbits of these names, in this order; all of them if no name is given."""
    if not labels:
        return orbits
    if missing := [name for name in labels if name not in orbits.labels]:
        there = "; ".join(orbits.labels[:12]) + ("; …" if len(orbits.labels) > 12 else "")
        raise InputError(f"members: no orbit is called {missing[0]!r}; there are: {there}")
    i = [orbits.labels.index(name) for name in labels]
    return replace(
        orbits,
        x0=orbits.x0[:, i],
        period_s=orbits.period_s[i],
        integral=orbits.integral[i],
        monodromy=np.ascontiguousarray(orbits.monodromy[:, :, i]),
        residual=orbits.residual[i],
        labels=labels,
    )


def orbits_on(flow: Flow, orbits: PeriodicOrbits) -> tuple[Array, Array]:
    """Return normalised states (6, N) and periods (N,) of orbits, tried on these equations.

    Parameters
    ----------
    flow : Flow
        Normalised equations.
    orbits : PeriodicOrbits
        Said to solve them.

    Returns
    -------
    x0 : ndarray, shape (6, N)
        States.
    period : ndarray, shape (N,)
        Periods.

    Raises
    ------
    StageError
        If the frame differs, or an orbit does not close to 1e-8 of its size and magnification.
    """
    system = flow.system
    x0 = np.ascontiguousarray(orbits.x0 / system.unit[:, None])
    period = orbits.period_s / system.time_unit_s
    if not period.size:
        return x0, period
    growth = np.maximum(1.0, np.max(np.abs(orbits.monodromy), axis=(0, 1)))
    steps = flow.plain.choose_steps(x0, period, 1e-10 * float(np.max(growth)))
    end = flow.plain.propagate(x0, period, 2 * steps, strict=False)
    error = np.max(np.abs(end - x0), axis=0) / growth
    if orbits.frame != system.frame or not np.all(error <= _SAME_EQUATIONS):
        raise StageError(
            f"the orbits (frame {orbits.frame}) do not solve the equations of this stage's plant "
            f"(frame {system.frame}; closure {np.max(error):.1e}); give the plant with which they "
            "were computed"
        )
    return x0, period


def period_steps(
    flow: Flow, x0: Array, period: float, monodromy: Array, accuracy: float = 1e-9
) -> int:
    """Return an even number of sub-steps of a period that keeps an accuracy.

    Parameters
    ----------
    flow : Flow
        Normalised.
    x0 : ndarray, shape (6,)
        A state of the orbit.
    period : float
        Its period.
    monodromy : ndarray, shape (6, 6)
        Its matrix.
    accuracy : float
        Largest change of the state after a period, halving the sub-steps, relative to the orbit's
        own magnification (its largest multiplier), which no sub-step can mend.

    Returns
    -------
    int
        The sub-steps.
    """
    growth = max(1.0, float(np.max(np.abs(np.linalg.eigvals(monodromy)))))
    steps = flow.plain.choose_steps(x0, period, accuracy * growth)
    return 2 * -(-steps // 2)


def enders(flow: Flow) -> tuple[str, ...]:
    """Return the plant's events that end a flight."""
    return tuple(name for name in ("impact", "escape") if name in flow.system.events)


def trial_places() -> Array:
    """Return states around the body at which symmetries are tried, (6, 48), normalised."""
    rng = np.random.default_rng(20)
    direction = rng.normal(size=(3, 48))
    place = np.geomspace(0.7, 4.0, 48) * direction / np.linalg.norm(direction, axis=0)
    return np.concatenate([place, rng.normal(size=(3, 48))])


@dataclass(frozen=True, eq=False)
class _Part:
    """One side of one manifold."""

    orbit: int
    stable: bool
    leaves: Leaves


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows of the product for one side: times from ε on, normalised, cut at the duration."""

    end: Array
    end_time: Array
    ended: NDArray[np.bool_]
    lane: NDArray[np.intp]
    event: NDArray[np.intp]
    time: Array
    rising: NDArray[np.bool_]
    x: Array


def _rows(part: _Part, limit: float) -> _Rows:
    flown, left = part.leaves.ends, part.leaves.left
    zeros = flown.zeros
    time = zeros.time - left[zeros.lane]
    keep = np.abs(time) * np.where(time * zeros.time > 0.0, 1.0, 0.0) <= limit
    z = zeros.select(keep)
    end_time = flown.time - left
    ended = (flown.ended_by >= 0) & (np.abs(end_time) <= limit)
    return _Rows(flown.x, end_time, ended, z.lane, z.event, time[keep], z.rising, z.x)


def _tracks(flow: Flow, part: _Part, row: _Rows) -> tuple[NDArray[np.intp], Array]:
    """Return some trajectories and positions (3, P + 1, J) along them, from ε to their ends."""
    count = part.leaves.p.size
    lanes = np.unique(np.linspace(0, count - 1, min(count, _TRACKS)).astype(np.intp))
    lanes = lanes[np.isfinite(row.end_time[lanes]) & np.isfinite(row.end[:, lanes]).all(axis=0)]
    way = flow.plain.trajectory(
        np.ascontiguousarray(row.end[:, lanes]), -row.end_time[lanes], 2 * _TRACK_POINTS,
        strict=False,
    )  # fmt: skip
    return lanes, np.ascontiguousarray(way[:3, ::-2])


def _all(parts: list[NDArray[Any]], kind: Any, rows: int = 0) -> Any:
    """Join arrays along their last axis; an empty one if there are none."""
    empty = np.empty((rows, 0) if rows else 0, dtype=kind)
    return np.concatenate([empty, *parts], axis=-1).astype(kind)
