"""Checks of guidance: a plan obeys the plant's equations and meets both boundary conditions."""

from __future__ import annotations

import numpy as np

from hillsphere.engine.dynamics.system import system
from hillsphere.engine.dynamics.variational import Derivatives
from hillsphere.interfaces import Array, Guidance, GuidanceTask, GuidedFlight, Plant
from hillsphere.testing.contract import check_close, require

__all__ = ["check_guidance"]

_PIECES, _NODES = 64, 8
"""Intervals of the flight and Gauss nodes in each: on an interval the quadrature is exact for
polynomials up to degree 15, which leaves the integral of smooth trajectories to rounding."""


def check_guidance(
    guidance: Guidance, plant: Plant, task: GuidanceTask, *, tol: float = 1e-9
) -> GuidedFlight:
    """Check guidance on one task.

    Parameters
    ----------
    guidance : Guidance
        The component to check.
    plant : Plant
        The plant of the flight.
    task : GuidanceTask
        A feasible task.
    tol : float
        Largest error, in the plant's natural units.

    Returns
    -------
    GuidedFlight
        The plan, for further tests.

    Raises
    ------
    ContractViolation
        Unless

        - the flight has the requested duration, and its breaks rise from 0 to its end;
        - states (n, K) and commands (p, K) are finite at any times, in any order;
        - it begins at the start and ends at position and velocity of the end;
        - its states follow from its commands by the plant's equations;
        - the task is not changed, and the same task gives the same bits.
    """
    what = type(guidance).__name__
    require(isinstance(guidance, Guidance), f"{what} has no method plan")
    given = [q.copy() for q in (task.start, task.end_position_m, task.end_velocity_m_s)]
    flight, again = (guidance.plan(plant, task) for _ in range(2))
    for a, b in zip(given, (task.start, task.end_position_m, task.end_velocity_m_s), strict=True):
        require(np.array_equal(a, b), f"{what}: plan changes the task")
    duration, breaks = flight.duration_s, flight.breaks_s
    require(duration == task.duration_s, f"{what}: {duration} s instead of {task.duration_s} s")
    require(
        len(breaks) > 1 and breaks[0] == 0.0 and breaks[-1] == duration,
        f"{what}: breaks must run from 0 to {duration} s, got {breaks}",
    )
    require((np.diff(breaks) > 0.0).all(), f"{what}: breaks must rise, got {breaks}")
    edges = np.union1d(breaks, np.linspace(0.0, duration, _PIECES + 1))
    t, weights = _nodes(edges)
    x, u = flight.states(t), flight.command(t)
    n, p = len(plant.states), len(plant.controls)
    require(x.shape == (n, len(t)), f"{what}: states must be {(n, len(t))}, are {x.shape}")
    require(u.shape == (p, len(t)), f"{what}: commands must be {(p, len(t))}, are {u.shape}")
    unit = plant.scales.of(plant.states)[:, None]
    for name, values in (("states", x), ("commands", u)):
        require(np.isfinite(values).all(), f"{what}: {name} are not finite")
    backwards = flight.states(np.ascontiguousarray(t[::-1]))[:, ::-1]
    check_close(f"{what}: states at times in another order", backwards, x, unit, tol)
    require(
        np.array_equal(again.states(t), x) and np.array_equal(again.command(t), u),
        f"{what}: the same task gives another flight",
    )
    kinds = [(v.length, v.time) for v in plant.states]
    places = [i for i, kind in enumerate(kinds) if kind == (1, 0)]
    speeds = [i for i, kind in enumerate(kinds) if kind == (1, -1)]
    ends = flight.states(np.array([0.0, duration]))
    check_close(f"{what}: start", ends[:, :1], task.start[:, None], unit, tol)
    goal = np.concatenate([task.end_position_m, task.end_velocity_m_s])[:, None]
    rows = [*places, *speeds]
    check_close(f"{what}: end", ends[rows, 1:], goal, unit[rows], tol)
    rate = Derivatives(system(plant, controls=True)).rate(x, u, task.time_s + t)
    steps = (rate * weights).reshape(n, -1, _NODES).sum(axis=2)
    at = flight.states(edges)
    check_close(f"{what}: motion under its command", np.diff(at, axis=1), steps, unit, tol)
    return flight


def _nodes(edges: Array) -> tuple[Array, Array]:
    """Return nodes and weights of Gauss quadrature between the edges."""
    place, weight = np.polynomial.legendre.leggauss(_NODES)
    half = 0.5 * np.diff(edges)[:, None]
    return (edges[:-1, None] + half * (1.0 + place)).ravel(), (half * weight).ravel()
