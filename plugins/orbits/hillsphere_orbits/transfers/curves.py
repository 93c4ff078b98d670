"""Planar periodic orbits as closed curves r = R(θ).

An orbit that circles the origin in one sense and meets every direction once (a quasi-satellite
orbit of one revolution) is such a curve; its radius and state in any direction are splines through
states of the compiled flow, exact to rounding.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from hillsphere.dynamics import StepMap
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow

__all__ = ["PolarOrbit", "step_map_of"]

_NODES = 1024  # equally spaced angles; with splines of degree 7 the error is rounding
_MAPS: WeakKeyDictionary[Flow, StepMap] = WeakKeyDictionary()


def step_map_of(flow: Flow) -> StepMap:
    """Return the step map without derivatives, six times as fast; kept with the flow."""
    if flow not in _MAPS:
        _MAPS[flow] = StepMap(flow.system)
    return _MAPS[flow]


class PolarOrbit:
    """A planar periodic orbit that meets every direction from the origin once.

    Parameters
    ----------
    flow : Flow
        Normalised; states x, y, z, vx, vy, vz.
    x0 : ndarray, shape (6,)
        A state of the orbit.
    period : float
        Its period.
    name : str
        For errors.

    Raises
    ------
    InputError
        If the orbit leaves the plane z = 0, does not close, or meets a direction twice.
    """

    def __init__(self, flow: Flow, x0: Array, period: float, name: str = "the orbit") -> None:
        self.flow, self.x0, self.period, self.name = flow, np.array(x0, float), float(period), name
        if x0[2] != 0.0 or x0[5] != 0.0:
            raise InputError(f"{name} leaves the plane z = 0; a planar one is needed")
        steps = max(128, flow.steps_for(self.x0[:, None], period))
        way = step_map_of(flow).trajectory(self.x0, period, steps)
        angle = np.unwrap(np.arctan2(way[1], way[0]))
        turn = angle[-1] - angle[0]
        self.sense = 1.0 if turn > 0.0 else -1.0
        once = abs(abs(turn) - 2.0 * np.pi) < 1e-6
        if not once or np.any(self.sense * _turning(way) <= 0.0):
            raise InputError(
                f"{name} does not meet every direction once, so it is no curve r(θ); transfers "
                "start and end at orbits of one revolution, such as quasi-satellite orbits"
            )
        self._begin = float(angle[0])
        grid = self._begin + self.sense * 2.0 * np.pi * np.arange(_NODES + 1) / _NODES
        time, state = self._on_angles(way, angle, grid)
        # a spline of the time minus its mean growth, which is periodic as the others are
        mean = self.period * np.arange(_NODES + 1) / _NODES
        columns = np.array([np.log(np.hypot(state[0], state[1])), time - mean, state[3], state[4]])
        # a periodic spline needs equal ends; they agree to the closure of the orbit
        columns[:, -1] = columns[:, 0]
        turns = np.arange(_NODES + 1) / _NODES
        # degree 7 on equal angles: the error falls with the eighth power of their spacing
        self._spline: BSpline = make_interp_spline(turns, columns.T, k=7, bc_type="periodic")
        # the radius alone, which is asked for far more often
        self._log_radius: BSpline = make_interp_spline(turns, columns[0], k=7, bc_type="periodic")
        self._slope: BSpline = self._log_radius.derivative()

    def _on_angles(self, way: Array, angle: Array, grid: Array) -> tuple[Array, Array]:
        """Return times and states of the orbit at angles, by Newton's iteration in a sub-step."""
        h = self.period / (way.shape[1] - 1)
        passed = self.sense * angle
        i = np.clip(np.searchsorted(passed, self.sense * grid, side="right") - 1, 0, len(angle) - 2)
        share = (grid - angle[i]) / (angle[i + 1] - angle[i])
        part, base = share * h, np.ascontiguousarray(way[:, i])
        stepper = step_map_of(self.flow)
        state: Array = base
        for _ in range(6):
            state = stepper.step(base, part)
            cos, sin = np.cos(grid), np.sin(grid)
            off = np.arctan2(state[1] * cos - state[0] * sin, state[0] * cos + state[1] * sin)
            # Newton's step: θ̇ = (x·vy − y·vx)/r²
            part = part - off / (_turning(state) / (state[0] ** 2 + state[1] ** 2))
            if float(np.max(np.abs(off))) < 1e-15:
                break
        return i * h + part, state

    def _turns(self, angle: Array) -> Array:
        turns = self.sense * (np.asarray(angle, dtype=float) - self._begin) / (2.0 * np.pi)
        return np.asarray(turns - np.floor(turns))

    def radius(self, angle: Array) -> Array:
        """Return R(θ) at angles θ (any shape), rad, normalised."""
        return np.asarray(np.exp(self._log_radius(self._turns(angle))))

    def log_radius(self, angle: Array) -> tuple[Array, Array]:
        """Return ln R and d ln R/dθ at angles θ (any shape)."""
        turns = self._turns(angle)
        slope = self.sense / (2.0 * np.pi) * self._slope(turns)
        return np.asarray(self._log_radius(turns)), np.asarray(slope)

    def time(self, angle: Array) -> Array:
        """Return the time of flight (…) from `x0` to the angle, in [0, period)."""
        turns = self._turns(angle)
        time = self._spline(turns)[..., 1] + self.period * turns
        return np.asarray(np.where(time >= self.period, time - self.period, np.maximum(0.0, time)))

    def state(self, angle: Array) -> Array:
        """Return the states (6, N) at angles (N,)."""
        angle = np.asarray(angle, dtype=float)
        log_r, _, vx, vy = self._spline(self._turns(angle)).T
        r, zero = np.exp(log_r), np.zeros_like(log_r)
        return np.array([r * np.cos(angle), r * np.sin(angle), zero, vx, vy, zero])

    @property
    def track(self) -> Array:
        """Positions (2, K) along the orbit, for figures."""
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        return np.asarray(self.radius(angle) * np.array([np.cos(angle), np.sin(angle)]))

    @property
    def largest_speed(self) -> float:
        """Largest speed on the orbit."""
        turns = np.arange(4 * _NODES) / (4 * _NODES)
        # the speed is flat at its largest: between samples it is larger by their spacing squared
        squares = np.sum(self._spline(turns)[:, 2:] ** 2, axis=1)
        k = int(np.argmax(squares))
        before, here, after = squares[k - 1], squares[k], squares[(k + 1) % len(squares)]
        bend = before - 2.0 * here + after
        # vertex of the parabola through three samples
        top = here - (0.125 * (after - before) ** 2 / bend if bend < 0.0 else 0.0)
        return float(np.sqrt(top))


def _turning(state: Array) -> Array:
    """Return x·vy − y·vx: the sense in which a state circles the origin."""
    return np.asarray(state[0] * state[4] - state[1] * state[3])
