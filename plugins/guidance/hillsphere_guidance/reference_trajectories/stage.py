"""The stage ``reference_trajectories``: descents planned by guidance and flown again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.engine.start_states import with_placed_start
from hillsphere.engine.surroundings import Surroundings
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array, Context, Guidance, GuidanceTask, GuidedFlight, Plant
from hillsphere.presentation import Presentation
from hillsphere.products import Trajectories
from hillsphere.show.reference import ReferenceTable
from hillsphere_guidance.held_commands import solve_held_command
from hillsphere_guidance.held_steps import command_times
from hillsphere_guidance.motion import Motion, motion_of
from hillsphere_guidance.reference_trajectories.presentation import present_references
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories
from hillsphere_guidance.reference_trajectories.specs import (
    DescentSpec,
    ReferenceTrajectoriesSpec,
)
from hillsphere_guidance.replays import replay_continuous, replay_held
from hillsphere_guidance.sites import Ground
from hillsphere_guidance.splines import gauss_nodes

__all__ = ["ReferenceTrajectoriesStage"]

_NODES = 4
"""Quadrature nodes between two breaks of a command, exact to degree 7 in time: a command of the
splines has degree 3 but for the field."""
_MESH = (37, 73)
"""Circles of latitude and points of each on the drawn surface: every 5° in both."""
_ON_GROUND = 1e-9
"""Depth of a start below the surface, relative to its distance from the centre, that is
rounding."""


@dataclass(frozen=True)
class _Descent:
    """One flight to be planned."""

    name: str
    of: str
    task: GuidanceTask
    latitude_rad: float
    longitude_rad: float


@dataclass(frozen=True)
class _Flown:
    """One planned flight on its grid of times."""

    t: Array
    x: Array
    u: Array
    command: Array
    dv: float
    dv_held: float
    peak: float
    replay: Array
    replay_held: Array
    account: str


class ReferenceTrajectoriesStage:
    """Reference trajectories.

    Parameters
    ----------
    spec : ReferenceTrajectoriesSpec
        With its references bound.

    Raises
    ------
    InputError
        If plant, guidance and descents do not fit together.
    """

    def __init__(self, spec: ReferenceTrajectoriesSpec) -> None:
        self.spec = spec
        self.plant: Plant = spec.plant.get()
        self.guidance: Guidance = spec.guidance.get()
        self.motion = motion_of(self.plant)
        self._others = [self._other(one.name, one.get()) for one in spec.compare]
        self.published = ReferenceTable.read(spec.reference) if spec.reference else None
        if self.published and not {"descent", "dv_m_s"} <= set(self.published.columns):
            raise InputError(
                "reference: the published costs need the columns descent and dv_m_s, got "
                f"{', '.join(self.published.columns)}"
            )
        starts = [self._start(descent) for descent in spec.descents]
        try:
            self._ground: Ground | None = Ground(self.plant, starts[0])
        except InputError:
            if any(descent.site for descent in spec.descents):
                raise
            self._ground = None
        self.descents = self._expand_starts(starts)

    def run(self, ctx: Context) -> ReferenceTrajectories:
        """Plan every descent, hold its command on the grid, and fly both again.

        Parameters
        ----------
        ctx : Context
            Log and progress.

        Returns
        -------
        ReferenceTrajectories
            In the order of the mission, then from the other distances.

        Raises
        ------
        StageError
            If a descent cannot be planned; the message names it.
        """
        advance = ctx.track("reference trajectories", len(self.descents))
        flown = []
        for descent in self.descents:
            try:
                flown.append(self._fly_descent(descent))
            except HillsphereError as error:
                raise StageError(f"descent {descent.name!r}: {error}") from error
            ctx.info(f"{descent.name}: {flown[-1].account}")
            advance(1)
        return self._product(flown)

    def present(self, product: ReferenceTrajectories) -> Presentation:
        """Show costs, replays and paths."""
        return present_references(product, self.spec, self.published)

    def _other(self, name: str, plant: Plant) -> Motion:
        """Return the motion of a plant that is compared."""
        names = [[v.name for v in one.states] for one in (self.plant, plant)]
        if plant.frame != self.plant.frame or names[0] != names[1]:
            raise InputError(
                f"compare: plant {name!r} moves in the frame {plant.frame!r} with the states "
                f"{', '.join(names[1])}; it must be {self.plant.frame!r} with {', '.join(names[0])}"
            )
        return motion_of(plant)

    def _start(self, descent: DescentSpec) -> Array:
        """Return the state (n,) at the start of a descent."""
        motion, name = self.motion, descent.name
        start = with_placed_start(descent.start, self.plant, f"descent {name!r}: start")
        d = motion.axes
        for key, values in (
            ("start.position", start.position_m),
            ("start.velocity", start.velocity_m_s or (0.0,) * d),
            ("end_position", descent.end_position_m or (0.0,) * d),
            ("end_velocity", descent.end_velocity_m_s or (0.0,) * d),
        ):
            if len(values) != d:
                raise InputError(
                    f"descent {name!r}: {key}: the plant has {d} axes, got {len(values)} numbers"
                )
        others = [motion.states[i].name for i in motion.others]
        if set(start.others) != set(others):
            raise InputError(
                f"descent {name!r}: start.others: the plant's states beside positions and "
                f"velocities are {', '.join(others) or 'none'}, got "
                f"{', '.join(start.others) or 'none'}"
            )
        q = np.array([[start.others[other]] for other in others]).reshape(len(others), 1)
        speed = start.velocity_m_s or (0.0,) * d
        r, v = np.array(start.position_m)[:, None], np.array(speed)[:, None]
        return motion.assemble(r, v, q)[:, 0]

    def _expand_starts(self, starts: Sequence[Array]) -> list[_Descent]:
        """Return the descents from their own starts, then from the other distances."""
        rows = self.motion.positions
        descents = []
        for distance in (None, *self.spec.start_distances_m):
            for descent, begun in zip(self.spec.descents, starts, strict=True):
                x, name, key = begun.copy(), descent.name, "start.position"
                if distance is not None:
                    x[rows] *= distance / np.linalg.norm(x[rows])
                    name += f" from {distance / 1e3:.9g} km"
                    key = "start_distances"
                self._check_start(x[rows], f"descent {name!r}: {key}")
                descents.append(self._task(descent, name, x))
        return descents

    def _check_start(self, r: Array, where: str) -> None:
        """Refuse a descent that begins inside of the body."""
        if self._ground is None or self._ground.height(r[:, None])[0] >= 0.0:
            return
        below = -self._ground.heights(r[:, None])[0] if r.any() else np.inf
        if below > _ON_GROUND * np.linalg.norm(r):
            place = "at its centre" if np.isinf(below) else f"{below:.6g} m below ground"
            raise InputError(
                f"{where}: it must be outside of the body, got {r.tolist()} m, {place}"
            )

    def _task(self, descent: DescentSpec, name: str, start: Array) -> _Descent:
        time_s, site = descent.start.time_s, descent.site
        if site is None or self._ground is None:
            speed = descent.end_velocity_m_s or (0.0,) * self.motion.axes
            end = np.array(descent.end_position_m), np.array(speed)
            task = GuidanceTask(start, *end, descent.duration_s, time_s)
            return _Descent(name, descent.name, task, np.nan, np.nan)
        place = self._ground.site(site.latitude_rad, site.longitude_rad)
        down = -(descent.touchdown_speed_m_s or 0.0) * place.up
        task = GuidanceTask(start, place.position_m, down, descent.duration_s, time_s, place.up)
        return _Descent(name, descent.name, task, site.latitude_rad, site.longitude_rad)

    def _fly_descent(self, descent: _Descent) -> _Flown:
        """Plan one descent, and fly it again."""
        motion, task = self.motion, descent.task
        flight = self.guidance.plan(self.plant, task)
        t = command_times(task.duration_s, self.spec.step_s)
        x, command = flight.states(t), flight.command(t)
        mean, dv, peak = _integrals(flight, t, motion.axes)
        u = solve_held_command(motion, t, x, mean, task.time_s)
        end = replay_continuous(motion, flight, task.start, task.time_s)
        held = replay_held(motion, t, u, task.start, task.time_s)[:, -1]
        goal = x[:, -1]
        sizes = np.linalg.norm(u, axis=0)
        return _Flown(
            t, x, np.append(u, u[:, -1:], axis=1), command, dv,
            float(sizes @ np.diff(t)), max(peak, float(np.linalg.norm(command, axis=0).max())),
            self._apart(end, goal), self._apart(held, goal), flight.account,
        )  # fmt: skip

    def _apart(self, x: Array, goal: Array) -> Array:
        """Return distance and speed (2,) between two states (n,)."""
        gap = x - goal
        rows = self.motion.positions, self.motion.velocities
        return np.array([np.linalg.norm(gap[own]) for own in rows])

    def _product(self, flown: Sequence[_Flown]) -> ReferenceTrajectories:
        motion, around = self.motion, Surroundings.of(self.plant)
        tasks = [descent.task for descent in self.descents]
        x = _pad_and_stack([one.x for one in flown])
        names = tuple(descent.name for descent in self.descents)
        return ReferenceTrajectories(
            flights=Trajectories(
                frame=self.plant.frame,
                states=tuple(v.name for v in motion.states),
                plans=names,
                labels=names,
                t_s=_pad_and_stack([one.t[None] for one in flown])[0],
                x=x,
                controls=motion.controls,
                u=_pad_and_stack([one.u for one in flown]),
            ),
            command=_pad_and_stack([one.command for one in flown]),
            descents=tuple(descent.of for descent in self.descents),
            guidance=self.spec.guidance.name,
            account=tuple(one.account for one in flown),
            start_distance_m=np.array(
                [np.linalg.norm(task.start[motion.positions]) for task in tasks]
            ),
            duration_s=np.array([task.duration_s for task in tasks]),
            latitude_rad=np.array([descent.latitude_rad for descent in self.descents]),
            longitude_rad=np.array([descent.longitude_rad for descent in self.descents]),
            dv_m_s=np.array([one.dv for one in flown]),
            dv_held_m_s=np.array([one.dv_held for one in flown]),
            peak_m_s2=np.array([one.peak for one in flown]),
            replay_m=np.transpose([one.replay for one in flown]),
            replay_held_m=np.transpose([one.replay_held for one in flown]),
            height_m=self._heights(x),
            surface_m=None if self._ground is None else self._ground.mesh(*_MESH),
            body=around.body,
            series_radius_m=around.series_radius_m,
            compared=tuple(one.name for one in self.spec.compare),
            difference_m_s2=self._differences(_pad_and_stack([one.t[None] for one in flown])[0], x),
        )

    def _differences(self, t: Array, x: Array) -> Array:
        """Return the differences (C, K, N) of other plants' accelerations at states (n, K, N)."""
        there = np.isfinite(x).all(axis=0)
        out = np.full((len(self._others), *there.shape), np.nan)
        begun = np.array([descent.task.time_s for descent in self.descents])
        times, states = (t + begun)[there], np.ascontiguousarray(x[:, there])
        for k, other in enumerate(self._others):
            gap = other.field(states, times)[0] - self.motion.field(states, times)[0]
            out[k, there] = np.linalg.norm(gap, axis=0)
        return out

    def _heights(self, x: Array) -> Array:
        """Return heights (K, N) of states (n, K, N); NaN stays."""
        r = x[self.motion.positions]
        heights = np.full(x.shape[1:], np.nan)
        there = np.isfinite(r).all(axis=0)
        if self._ground is not None:
            heights[there] = self._ground.heights(np.ascontiguousarray(r[:, there]))
        return heights


def _integrals(flight: GuidedFlight, t: Array, axes: int) -> tuple[Array, float, float]:
    """Return the mean command over each step (d, K − 1), ∫|a|dt, and the largest |a|."""
    breaks = np.union1d(t, flight.breaks_s)
    place, weights = gauss_nodes(breaks, _NODES)
    a = flight.command(place)
    size = np.linalg.norm(a, axis=0)
    step = np.clip(np.searchsorted(t, place, side="right") - 1, 0, len(t) - 2)
    mean = np.array([np.bincount(step, row * weights, len(t) - 1) for row in a])
    return mean / np.diff(t), float(size @ weights), float(size.max())


def _pad_and_stack(arrays: Sequence[Array]) -> Array:
    """Put arrays (n, K) of different lengths K side by side, (n, max K, N), NaN beyond the end."""
    longest = max(array.shape[1] for array in arrays)
    out = np.full((len(arrays[0]), longest, len(arrays)), np.nan)
    for i, array in enumerate(arrays):
        out[:, : array.shape[1], i] = array
    return out
