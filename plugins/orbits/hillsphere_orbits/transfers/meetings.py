"""Where planar trajectories meet a closed curve.

A trajectory meets the curve r = R(θ) where g(t) = ln r(t) − ln R(θ(t)) vanishes: a function of one
variable, so that every meeting is found between two neighbouring extrema of g, and an extremum at
zero is a tangency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import bracketed_roots
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_orbits.flow import Flow
from hillsphere_orbits.transfers.curves import PolarOrbit, step_map_of

__all__ = ["Bends", "Meetings", "Strands", "meetings"]

_NEAR = 1e-3  # an extremum of g this near to zero is refined
_TOUCH = 1e-11  # an extremum of g this small is a tangency
_WIDTH = 1e-14  # of a bracket, relative to the time of a sub-step


@dataclass(frozen=True)
class Strands:
    """N planar trajectories, sampled at their sub-steps.

    Parameters
    ----------
    flow : Flow
        Normalised; states x, y, z, vx, vy, vz.
    way : ndarray, shape (6, steps + 1, N)
        States after every sub-step.
    h : ndarray, shape (N,)
        Length of the sub-steps.
    periodic : bool
        Whether the trajectories are closed.
    """

    flow: Flow
    way: Array
    h: Array
    periodic: bool

    @classmethod
    def fly(
        cls, flow: Flow, x0: Array, duration: Array, steps: int, *, periodic: bool = True
    ) -> Strands:
        """Propagate trajectories.

        Parameters
        ----------
        flow : Flow
            Equations.
        x0 : ndarray, shape (6, N)
            First states, in the plane z = 0.
        duration : ndarray, shape (N,)
            How long.
        steps : int
            Sub-steps, common to all.
        periodic : bool
            Whether they are closed.

        Returns
        -------
        Strands
            The samples.

        Raises
        ------
        InputError
            If there is no sub-step, or a trajectory leaves the plane.
        PropagationError
            If a trajectory turns non-finite.
        """
        if steps < 1:
            raise InputError(f"steps must be at least 1, got {steps}")
        if np.any(x0[2]) or np.any(x0[5]):
            raise InputError("meetings are defined for trajectories in the plane z = 0")
        whole = np.broadcast_to(np.asarray(duration, dtype=float), (x0.shape[1],))
        way = step_map_of(flow).trajectory(x0, whole, steps)
        return cls(flow, way, whole / steps, periodic)

    def at(self, lane: NDArray[np.intp], time: Array) -> Array:
        """Return the states (6, K) of trajectories (K,) at times (K,) since their start."""
        step = np.clip(np.floor(time / self.h[lane]).astype(int), 0, self.way.shape[1] - 2)
        base = np.ascontiguousarray(self.way[:, step, lane])
        state: Array = step_map_of(self.flow).step(base, time - step * self.h[lane])
        return state


@dataclass(frozen=True)
class Bends:
    """Extrema of g = ln r − ln R along trajectories, E in all, by lane and time.

    Parameters
    ----------
    lane : ndarray of int, shape (E,)
        Trajectory.
    time, value : ndarray, shape (E,)
        Time since its start, and g.
    dv : ndarray, shape (E,)
        Difference of the velocities of the trajectory and of the curve's orbit in the same
        direction from the origin.
    """

    lane: NDArray[np.intp]
    time: Array
    value: Array
    dv: Array


@dataclass(frozen=True)
class Meetings:
    """Where N trajectories meet a closed curve, K meetings in all, by lane and time.

    Parameters
    ----------
    lane : ndarray of int, shape (K,)
        Trajectory.
    time : ndarray, shape (K,)
        Since its start.
    state : ndarray, shape (6, K)
        Of the trajectory.
    on_curve : ndarray, shape (6, K)
        State of the curve's orbit at the same place.
    touch : ndarray of bool, shape (K,)
        Whether the curves touch there without crossing.
    bends : Bends
        Extrema of g; those far from zero are interpolated between the samples.
    """

    lane: NDArray[np.intp]
    time: Array
    state: Array
    on_curve: Array
    touch: NDArray[np.bool_]
    bends: Bends

    @property
    def dv(self) -> Array:
        """Difference of the velocities (K,), in the unit of the states."""
        return np.asarray(np.linalg.norm(self.state[3:] - self.on_curve[3:], axis=0))

    @property
    def angle(self) -> Array:
        """Angle between the curves where they meet, (K,), rad, 0 … π/2."""
        a, b = self.state[3:5], self.on_curve[3:5]
        cross, dot = a[0] * b[1] - a[1] * b[0], np.sum(a * b, axis=0)
        return np.asarray(np.arctan2(np.abs(cross), np.abs(dot)))


def meetings(curve: PolarOrbit, strands: Strands, touch: float = _TOUCH) -> Meetings:
    """Find every meeting of planar trajectories with a closed curve.

    Extrema of g between the samples are refined by partial steps of the formula that made them
    (where they are near zero; the sign of the others is beyond doubt), and each change of sign
    between neighbouring samples and extrema then holds one meeting, refined likewise. An extremum
    within `touch` of zero is a tangency, and counts once. A pair of extrema
    within one sub-step goes unseen, which matters only if g vanishes between them.

    Parameters
    ----------
    curve : PolarOrbit
        The closed curve.
    strands : Strands
        The trajectories.
    touch : float
        Largest |g| of a tangency: the distance of the curves relative to that from the origin.

    Returns
    -------
    Meetings
        To rounding.
    """
    way, h = strands.way, strands.h
    samples, cases = way.shape[1:]
    # g = ln r − ln R(θ) along every trajectory, with its time derivative
    g, rate = (a.reshape(samples, cases) for a in _gap(curve, way.reshape(6, -1)))
    if strands.periodic:
        # rounding must not make an extremum or a meeting at the seam appear twice or not at all
        g[-1], rate[-1] = g[0], rate[0]
    i, lane, part, peak = _bends(curve, strands, g, rate)

    # samples and extrema of every lane in the order of time, each with the sub-step it is in
    lanes = np.concatenate([np.tile(np.arange(cases), samples), lane])
    step = np.concatenate([np.repeat(np.arange(samples), cases), i])
    parts = np.concatenate([np.zeros(g.size), part])
    value = np.concatenate([g.ravel(), peak])
    is_peak = np.arange(value.size) >= g.size
    # whether an extremum is a minimum
    least = np.concatenate([np.zeros(g.size, dtype=bool), rate[i, lane] <= 0.0])
    # lexsort takes its last key first: by lane, then sub-step, then time within it
    order = np.lexsort((parts, step, lanes))
    lanes, step, parts = lanes[order], step[order], parts[order]
    value, is_peak, least = value[order], is_peak[order], least[order]
    # a tangency is no change of sign, whatever rounding makes of it and of samples beside it
    above = value > 0.0
    touching = np.flatnonzero(is_peak & (np.abs(value) <= touch))
    for beside in (-1, 1):
        other = np.clip(touching + beside, 0, value.size - 1)
        same = np.abs(value[other]) <= touch
        above[other[same]] = least[touching[same]]
    above[touching] = least[touching]
    # neighbours of one lane on opposite sides of the curve bracket exactly one meeting
    k = np.flatnonzero((above[1:] != above[:-1]) & (lanes[1:] == lanes[:-1]))
    end = np.where(step[k + 1] == step[k], parts[k + 1], h[lanes[k]])
    root = _refine_roots(
        curve, strands, 0, step[k], lanes[k], parts[k], end, value[k], value[k + 1]
    )

    places = np.concatenate([k, touching])
    time = step[places] * h[lanes[places]] + np.concatenate([root, parts[touching]])
    order = np.lexsort((time, lanes[places]))
    state = strands.at(lanes[places][order], time[order])
    by_time = np.lexsort((i, lane))
    bend_lane, bend_time = lane[by_time], (i * h[lane] + part)[by_time]
    there = strands.at(bend_lane, bend_time)
    bend_dv = np.linalg.norm(there[3:] - curve.state(_direction(there))[3:], axis=0)
    return Meetings(
        lane=lanes[places][order],
        time=time[order],
        state=state,
        on_curve=curve.state(_direction(state)),
        touch=(np.arange(places.size) >= k.size)[order],
        bends=Bends(bend_lane, bend_time, peak[by_time], bend_dv),
    )


def _bends(
    curve: PolarOrbit, strands: Strands, g: Array, rate: Array
) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
    """Return sub-step, lane, time since its beginning and value of every extremum of g."""
    i, lane = np.nonzero((rate[:-1] > 0.0) != (rate[1:] > 0.0))
    h, before, after = strands.h[lane], rate[i, lane], rate[i + 1, lane]
    # the cubic through values and slopes; the root of its slope between the samples
    a, b, rise = before * h, after * h, g[i + 1, lane] - g[i, lane]
    quadratic, linear = 3.0 * (a + b - 2.0 * rise), 2.0 * (3.0 * rise - 2.0 * a - b)
    root = np.sqrt(np.maximum(linear**2 - 4.0 * quadratic * a, 0.0))
    # the root in [0, 1] of q s² + l s + a, in the form without cancellation
    with np.errstate(divide="ignore", invalid="ignore"):
        s = -2.0 * a / (linear + np.where(before > 0.0, -root, root))
    s = np.clip(np.where(np.isfinite(s), s, 0.5), 0.0, 1.0)
    value = g[i, lane] + s * (a + s * (0.5 * linear + s * quadratic / 3.0))
    part = s * h
    # only extrema near zero decide between none, one and two meetings
    near: NDArray[np.intp] = np.flatnonzero(np.abs(value) <= _NEAR)
    step, own, zero = i[near], lane[near], np.zeros(near.size)
    part[near] = _refine_roots(
        curve, strands, 1, step, own, zero, strands.h[own], rate[step, own], rate[step + 1, own]
    )
    base = np.ascontiguousarray(strands.way[:, step, own])
    value[near] = _gap(curve, step_map_of(strands.flow).step(base, part[near]))[0]
    return i, lane, part, value


def _refine_roots(
    curve: PolarOrbit, strands: Strands, which: int, step: NDArray[np.intp],
    lane: NDArray[np.intp], begin: Array, end: Array, first: Array, last: Array,
) -> Array:  # fmt: skip
    """Return the times since the beginning of sub-steps at which g (0) or its rate (1) vanishes."""
    base = np.ascontiguousarray(strands.way[:, step, lane])
    stepper = step_map_of(strands.flow)

    def value(part: Array) -> Array:
        return _gap(curve, stepper.step(base, part))[which]

    return bracketed_roots(value, begin, end, first, last, _WIDTH * strands.h[lane])


def _gap(curve: PolarOrbit, state: Array) -> tuple[Array, Array]:
    """Return g = ln r − ln R(θ) and dg/dt (N,) at states (6, N)."""
    x, y, vx, vy = state[0], state[1], state[3], state[4]
    square = x * x + y * y
    # dg/dt = (x·v)/r² − (d ln R/dθ) θ̇
    log_r, slope = curve.log_radius(np.arctan2(y, x))
    radial, turning = (x * vx + y * vy) / square, (x * vy - y * vx) / square
    return 0.5 * np.log(square) - log_r, radial - slope * turning


def _direction(state: Array) -> Array:
    """Return the angle θ of the place of a state."""
    return np.asarray(np.arctan2(state[1], state[0]))
