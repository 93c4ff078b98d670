"""Members continued along a path of parameters in legs, with a description of their way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import System
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.parameter_continuation import (
    HeldQuantity,
    ParameterPath,
    ParameterProblem,
    hold_integral,
    hold_orbit_quantity,
)
from hillsphere_orbits.parameter_paths import Method, carry, refine_orbits
from hillsphere_orbits.qso.families import Family

__all__ = ["Arrival", "continue_members", "keep_members"]

_TRACK_POINTS = 240
"""Intervals of a stored track: a smooth curve in a figure, and a small product."""
_REACHED = "reached"


@dataclass(frozen=True)
class Arrival:
    """Continuation of M orbits: the N that arrived, and the ways of all; normalised.

    Parameters
    ----------
    problem : ParameterProblem or None
        Equations at the end; None if no parameter changes.
    z : ndarray, shape (m, N)
        Orbits that arrived, with the fraction if there is a problem.
    status : tuple of str, length M
        ``"reached"``, or why an orbit ended before.
    held_value : ndarray, shape (M,)
        Of the quantity that was held; empty without a problem.
    way_orbit : ndarray of int, shape (W,)
        Number of the orbit of each step on the last leg.
    way : ndarray, shape (m, W)
        The steps.
    way_x0, way_period, way_integral : ndarray, shape (n, W), (W,), (W,)
        Their states (SI), periods and integrals.
    tracks : ndarray, shape (3, Q, N)
        Positions along one period.
    clearance : ndarray, shape (N,)
        Least value of the impact function along the orbit; NaN without one.
    """

    problem: ParameterProblem | None
    z: Array
    status: tuple[str, ...]
    held_value: Array
    way_orbit: NDArray[np.int64]
    way: Array
    way_x0: Array
    way_period: Array
    way_integral: Array
    tracks: Array
    clearance: Array


def keep_members(family: Family, z: Array) -> Arrival:
    """Return the members (m, N) of a family as they are: no parameter changes."""
    problem = family.problem
    flow, none = problem.flow, np.empty(0)
    way = flow.trajectory(problem.state(z), problem.period(z), 2 * problem.steps)
    return Arrival(
        problem=None,
        z=z,
        status=(_REACHED,) * z.shape[1],
        held_value=none,
        way_orbit=np.empty(0, dtype=np.int64),
        way=np.empty((len(z) + 1, 0)),
        way_x0=np.empty((len(flow.names), 0)),
        way_period=none,
        way_integral=none,
        tracks=_thin_positions(way),
        clearance=_clearance(flow.system, way, flow.system.parameters(None, way[0].size)),
    )


def continue_members(
    plant: Plant,
    family: Family,
    z: Array,
    kinds: Sequence[str],
    legs: Sequence[ParameterPath],
    method: Method,
    accuracy: float,
    advance: Callable[[int], None],
) -> Arrival:
    """Continue members along paths of the same parameters, one path after the other.

    Parameters
    ----------
    plant : Plant
        Whose parameters.
    family : Family
        The family, of the plant as it is.
    z : ndarray, shape (m, M)
        Its members.
    kinds : sequence of str, length M
        What each of them keeps: ``"amplitude"``, ``"period"`` or ``"jacobi"``.
    legs : sequence of ParameterPath
        The paths; the first begins at the plant's own values.
    method : {"arclength", "natural"}
        See `carry`.
    accuracy : float
        To which periods are propagated at the end.
    advance : callable
        Called with 1 for each orbit and leg that is done.

    Returns
    -------
    Arrival
        Orbits that do not arrive are classified.

    Raises
    ------
    InputError
        If the family's equations cannot be solved at other parameters, or nothing can be held.
    ConvergenceError
        If an orbit that arrived cannot be corrected as exactly as the accuracy asks.
    """
    problem = ParameterProblem.of(family.problem, plant, legs[0])
    status = [_REACHED] * z.shape[1]
    values, ends = np.full(z.shape[1], np.nan), np.full((len(z) + 1, z.shape[1]), np.nan)
    ways: dict[int, Array] = {}
    for kind in dict.fromkeys(kinds):
        lanes = np.array([i for i, other in enumerate(kinds) if other == kind], dtype=np.intp)
        here = z[:, lanes]
        for number, leg in enumerate(legs):
            problem = replace(problem, path=leg)
            held = _quantity_to_hold(kind, problem, family)
            start = np.concatenate([here, np.zeros((1, here.shape[1]))])
            values[lanes] = held(start)[0]
            continued = carry(problem, here, held, method=method, advance=advance)
            for i, word in zip(lanes, continued.status, strict=True):
                before = " on the way to the start of the path" if number < len(legs) - 1 else ""
                status[i] = word if word == _REACHED else word + before
            if number == len(legs) - 1:
                ways.update(zip(lanes.tolist(), continued.ways, strict=True))
            lanes, here = lanes[continued.reached], continued.z[:-1, continued.reached]
            ends[:, lanes] = continued.z[:, continued.reached]
    there = np.array([word == _REACHED for word in status], dtype=bool)
    if there.any():
        steps = max(problem.base.steps, problem.steps_for(ends[:, there], 0.1 * accuracy))
        problem = problem.with_steps(steps)
    for kind in dict.fromkeys(kinds):
        own = there & np.array([other == kind for other in kinds])
        if own.any():
            ends[:, own] = refine_orbits(
                problem, ends[:, own], _quantity_to_hold(kind, problem, family), values[own]
            )
    return _describe_arrival(problem, ends[:, there], tuple(status), values, ways)


def _describe_arrival(
    problem: ParameterProblem,
    z: Array,
    status: tuple[str, ...],
    values: Array,
    ways: dict[int, Array],
) -> Arrival:
    order = sorted(ways)
    way = np.concatenate([ways[i] for i in order], axis=1) if order else np.empty((len(z), 0))
    system, p = problem.flow.system, problem.path.at(z[-1])
    steps = 2 * problem.base.steps
    path = problem.flow.map.trajectory(problem.state(z), problem.period(z), steps, p)
    return Arrival(
        problem=problem,
        z=z,
        status=status,
        held_value=values,
        way_orbit=np.repeat(np.array(order, dtype=np.int64), [ways[i].shape[1] for i in order]),
        way=way,
        way_x0=problem.state(way) * system.unit[:, None],
        way_period=problem.period(way),
        way_integral=problem.integral(way),
        tracks=_thin_positions(path),
        clearance=_clearance(system, path, np.tile(p, (1, path.shape[1]))),
    )


def _quantity_to_hold(kind: str, problem: ParameterProblem, family: Family) -> HeldQuantity:
    if kind == "jacobi":
        return hold_integral(problem)
    return hold_orbit_quantity(family.period if kind == "period" else family.amplitude)


def _thin_positions(way: Array) -> Array:
    """Return positions (3, Q, N) of trajectories (n, K, N), ends included."""
    last = way.shape[1] - 1
    kept = np.linspace(0, last, min(last, _TRACK_POINTS) + 1).round().astype(np.intp)
    return np.ascontiguousarray(way[:3, kept])


def _clearance(system: System, way: Array, p: Array) -> Array:
    """Least value of the impact function along trajectories (n, K, N), (N,); NaN without one."""
    n, points, cases = way.shape
    if "impact" not in system.events:
        return np.full(cases, np.nan)
    flat = np.ascontiguousarray(way.reshape(n, points * cases))
    values = system.function(system.events["impact"])(flat, p)[0]
    return np.asarray(np.min(values.reshape(points, cases), axis=0, initial=np.inf))
