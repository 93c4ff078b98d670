"""Reference trajectories for the closed loop: a held state, or states interpolated in time."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError, StageError
from hillsphere.engine.simulation.flow import thrust_vectors, velocity_rows
from hillsphere.interfaces.loop import CommandSteps
from hillsphere.interfaces.plant import Plant
from hillsphere.products.products import FlightSet

__all__ = ["Course", "Rows", "course_along", "course_at"]

_SAME_TIME = 1e-9
"""Part of the length of a trajectory (and at least 1 ns) within which two times are the same: far
above the rounding of sums of periods, far below any sampling period."""


class Rows:
    """Rows of a plant's states that are positions and velocities.

    Parameters
    ----------
    plant : Plant
        A plant with as many positions as velocities; the i-th velocity is the rate of the i-th
        position. For several spacecraft each three consecutive rows belong to one.

    Raises
    ------
    InputError
        If the numbers of positions and velocities differ or are zero.
    """

    def __init__(self, plant: Plant) -> None:
        self.names = tuple(v.name for v in plant.states)
        self.positions = [i for i, v in enumerate(plant.states) if (v.length, v.time) == (1, 0)]
        self.velocities = velocity_rows(plant)
        if len(self.positions) != len(self.velocities) or not self.positions:
            raise InputError(
                "the closed loop needs a plant with positions and as many velocities among its "
                f"states; this one has {', '.join(self.names) or 'none'}"
            )
        self.moving = sorted([*self.positions, *self.velocities])
        self.others = [i for i in range(len(self.names)) if i not in self.moving]
        self.vectors = thrust_vectors(len(self.positions))
        """Number of positions in space: one, or one per spacecraft."""

    def distance(self, difference: Array) -> Array:
        """Return the largest length (N,), m, over the spacecraft, of position differences."""
        return self._largest(difference[self.positions])

    def speed(self, difference: Array) -> Array:
        """Return the largest length (N,), m/s, over the spacecraft, of velocity differences."""
        return self._largest(difference[self.velocities])

    def _largest(self, each: Array) -> Array:
        squares = np.add.reduce((each * each).reshape(self.vectors, -1, each.shape[1]), axis=1)
        return np.asarray(np.sqrt(np.maximum.reduce(squares, axis=0)))


class Course:
    """A reference trajectory as a function of the time since its start.

    Parameters
    ----------
    rows : Rows
        Positions and velocities of the plant.
    t : ndarray, shape (J,)
        Times, s, rising from zero; a single one for a held state.
    x : ndarray, shape (n, J)
        States at these times, SI.
    u : ndarray, shape (p, J), or None
        Command held from each time to the next; the last one holds after the end.

    Notes
    -----
    Between two times positions are interpolated by the cubic Hermite polynomial of positions and
    velocities, velocities are its derivative, and other states are interpolated linearly. After the
    last time all states are constant.
    """

    def __init__(self, rows: Rows, t: Array, x: Array, u: Array | None = None) -> None:
        self.rows, self._t, self._x, self._u = rows, t, x, u
        self.length_s = float(t[-1])
        self._last: tuple[float, Array] | None = None
        self._cubic = (
            CubicHermiteSpline(t, x[rows.positions], x[rows.velocities], axis=1)
            if len(t) > 1
            else None
        )

    @property
    def start(self) -> Array:
        """State at the start (n,)."""
        return np.array(self._x[:, 0])

    @property
    def commanded(self) -> bool:
        """Whether the trajectory has a command."""
        return self._u is not None

    def at(self, t: Array) -> Array:
        """Return the states (n, N) at times (N,) since the start."""
        if self._cubic is None:
            return np.broadcast_to(self._x, (len(self._x), len(t)))
        # The lanes of a block mostly fly at the same time.
        if len(t) > 1 and (t == t[0]).all():
            # Several limits and deviations evaluate the reference at the same time: cache it.
            if self._last is None or self._last[0] != t[0]:
                self._last = float(t[0]), self.at(t[:1])
            return np.broadcast_to(self._last[1], (len(self._x), len(t)))
        # A NaN time, of a case that never began, gives NaN.
        within = np.clip(t, 0.0, self.length_s)
        out = np.empty((len(self._x), len(t)))
        out[self.rows.positions] = self._cubic(within)
        out[self.rows.velocities] = self._cubic(within, 1)
        for row in self.rows.others:
            out[row] = np.interp(within, self._t, self._x[row])
        # At the nodes return the given states without the rounding of the interpolation.
        near = np.clip(np.searchsorted(self._t, within), 0, len(self._t) - 1)
        same = np.abs(self._t[near] - within) <= self._slack
        out[:, same] = self._x[:, near[same]]
        return out

    def fastest(self) -> tuple[float, float]:
        """Return upper bounds of the speed, m/s, and of the acceleration, m/s², of the trajectory.

        The derivatives of a cubic are bounded by their Bernstein coefficients: the first derivative
        by three of them (both ends and one between), the second, which is linear, by its values at
        the ends. The bounds are norms over all spacecraft together.
        """
        if self._cubic is None:
            return 0.0, 0.0
        # On each interval the position is c₀ s³ + c₁ s² + c₂ s + c₃ with 0 ≤ s ≤ dt. The Bernstein
        # coefficients of its derivative are those at the ends, and c₂ + c₁ dt between them.
        c, dt = self._cubic.c, np.diff(self._t)[:, None]
        first, last = c[2], (3.0 * c[0] * dt + 2.0 * c[1]) * dt + c[2]
        between = c[2] + c[1] * dt
        speed = np.maximum(np.maximum(np.abs(first), np.abs(last)), np.abs(between))
        bend = np.maximum(np.abs(2.0 * c[1]), np.abs(6.0 * c[0] * dt + 2.0 * c[1]))
        return (
            float(np.sqrt(np.sum(speed**2, axis=1)).max()),
            float(np.sqrt(np.sum(bend**2, axis=1)).max()),
        )

    def extended(self, more_s: float, *, held: bool) -> Course:
        """Return the trajectory, continued for `more_s` seconds after its end.

        Positions continue with the velocity at the end, velocities are constant, other states
        continue with the rate of the last step. The command keeps its last value if `held`;
        otherwise it is zero.
        """
        if self._cubic is None or not more_s > 0.0:
            return self
        rows, end = self.rows, self._x[:, -1].copy()
        step_s = self._t[-1] - self._t[-2]
        rate = (end - self._x[:, -2]) / step_s
        end[rows.positions] += more_s * end[rows.velocities]
        end[rows.others] += more_s * rate[rows.others]
        u = self._u
        if u is not None:
            last = u[:, -1:] if held else np.zeros_like(u[:, -1:])
            u = np.concatenate([u[:, :-1], last, last], axis=1)
        t = np.append(self._t, self.length_s + more_s)
        return Course(rows, t, np.concatenate([self._x, end[:, None]], axis=1), u)

    def acceleration_beyond(self, *, held: bool) -> Array:
        """Return the acceleration (p,) of a spacecraft on the trajectory right after its end.

        It is the trajectory's acceleration before its end, plus the change of the command there
        (see `extended`) if the command is an acceleration, that is, has one row per position.
        """
        rows = self.rows.positions
        if self._cubic is None:
            return np.zeros(len(rows))
        a: Array = self._cubic(self.length_s, 2)
        if self._u is None or len(self._u) != len(rows):
            return a
        return np.asarray(a + (self._u[:, -1] if held else 0.0) - self._u[:, -2])

    def command(self, t: Array) -> Array | None:
        """Return the command (p, N) that is held from times (N,) on; None without one."""
        if self._u is None:
            return None
        place = np.searchsorted(self._t, t + self._slack, side="right") - 1
        return np.ascontiguousarray(self._u[:, np.clip(place, 0, len(self._t) - 1)])

    def steps(self, t: Array, period_s: float) -> list[CommandSteps] | None:
        """Return the command in each of the periods that begin at times (K,).

        None without a command, or if it does not change within any period, where `command`
        suffices.
        """
        if self._u is None:
            return None
        commands = []
        for begin in t.tolist():
            end = begin + period_s
            changes = (self._t > begin + self._slack) & (self._t < end - self._slack)
            times = np.concatenate([[begin], self._t[changes], [end]])
            u = self.command(times[:-1])
            assert u is not None
            commands.append(CommandSteps(np.diff(times) / period_s, u.T[:, :, None].copy()))
        return commands if any(len(one.shares) > 1 for one in commands) else None

    @property
    def _slack(self) -> float:
        """Difference, s, below which two times count as equal."""
        return _SAME_TIME * max(self.length_s, 1.0)


def course_at(rows: Rows, state: Array) -> Course:
    """Return the reference that holds one state (n,)."""
    return Course(rows, np.zeros(1), state[:, None])


def course_along(plant: Plant, rows: Rows, product: FlightSet, name: str) -> Course:
    """Return the reference along a trajectory of an earlier stage.

    Parameters
    ----------
    plant : Plant
        Plant that follows the trajectory.
    rows : Rows
        Positions and velocities of the plant; other states missing in the trajectory are zero.
    product : FlightSet
        Product with the trajectory.
    name : str
        Label of the trajectory; ``""`` for the only one.

    Returns
    -------
    Course
        The reference, with times from the start of the trajectory.

    Raises
    ------
    InputError
        If no trajectory has the name, or none is given and there are several.
    StageError
        If the trajectory has another frame or other controls, or lacks positions, velocities or
        times.
    """
    flights = product.flights
    lanes = [i for i, label in enumerate(flights.labels) if name in ("", label)]
    if len(lanes) != 1:
        known = ", ".join(repr(label) for label in flights.labels) or "none"
        many = f"{len(lanes)} trajectories are" if lanes else "no trajectory is"
        called = f"called {name!r}" if name else "there"
        raise InputError(f"follow: {many} {called}; needs.reference has {known}")
    if flights.frame != plant.frame:
        raise StageError(
            f"the reference is given in frame {flights.frame!r}, the plant moves in "
            f"{plant.frame!r}; follow it with a plant in its frame"
        )
    (lane,) = lanes
    there = np.isfinite(flights.t_s[:, lane])
    t = flights.t_s[there, lane]
    place = {state: i for i, state in enumerate(flights.states)}
    missing = [rows.names[i] for i in rows.moving if rows.names[i] not in place]
    x = np.zeros((len(rows.names), len(t)))
    for i, state in enumerate(rows.names):
        if state in place:
            x[i] = flights.x[place[state], there, lane]
    if missing or len(t) < 2 or not np.isfinite(x).all() or not (np.diff(t) > 0).all():
        raise StageError(
            f"trajectory {flights.labels[lane]!r} cannot be followed: it needs finite "
            "positions and velocities at two rising times or more"
            + (f", and has no {', '.join(missing)}" if missing else "")
        )
    if flights.u is None:
        return Course(rows, t - t[0], x)
    names = tuple(v.name for v in plant.controls)
    if flights.controls != names:
        raise StageError(
            f"the reference's command is {flights.controls}, the plant's controls are {names}"
        )
    return Course(rows, t - t[0], x, np.nan_to_num(flights.u[:, there, lane]))
