"""Periodic orbits of one plant as periodic orbits of another, where its equations allow them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.dynamics import Taylor
from hillsphere.errors import PropagationError
from hillsphere.interfaces import Array
from hillsphere.products import PeriodicOrbits
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.fidelity_ladder.rung import Rung
from hillsphere_orbits.flow import XY_MIRROR, Flow, flow_of
from hillsphere_orbits.shooting import PeriodicShooting, Shooting, SymmetricShooting

__all__ = ["PeriodicCounterparts", "periodic_on"]

_ZERO = 1e-9
"""Normalised components below which a state lies in a plane: first states of given orbits lie there
to rounding."""
_CLOSED = 1e-9
"""Closure, natural units, beside the growth over a period."""
_MIRRORS = ((1, -1, 1, -1, 1, -1), (1, -1, -1, -1, 1, 1))
"""Signs of x, y, z, vx, vy, vz under time reversal: the mirror plane xz, and the half turn about
x."""


@dataclass(frozen=True, eq=False)
class PeriodicCounterparts:
    """Orbits of a plant that close.

    Parameters
    ----------
    x0 : ndarray, shape (6, N)
        First states, SI, in the frame hill:BODY; NaN where there is none.
    period_s, closure : ndarray, shape (N,)
        Periods, and distances of states a period apart, natural units.
    status : tuple of str
        ``"periodic"``, or why not.
    """

    x0: Array
    period_s: Array
    closure: Array
    status: tuple[str, ...]


def periodic_on(rung: Rung, orbits: PeriodicOrbits, guess: Array) -> PeriodicCounterparts:
    """Find the periodic orbits of a plant that begin where given ones do.

    The amplitude is kept: z at the start of an orbit in space that begins off the plane, else x
    (or y of one that begins on the y axis).

    Parameters
    ----------
    rung : Rung
        The plant. One that moves its moon on an ellipse has no such orbits.
    orbits : PeriodicOrbits
        Orbits of a plant much like it.
    guess : ndarray, shape (6, N)
        States, SI, of flights of this plant near the first states of the orbits, from which the
        search begins: an unstable orbit is not found from one of other equations. NaN where there
        is none.

    Returns
    -------
    PeriodicCounterparts
        The status gives the reason where no periodic orbit was found.
    """
    cases = len(orbits.labels)
    periodic = PeriodicCounterparts(
        np.full((6, cases), np.nan),
        np.full(cases, np.nan),
        np.full(cases, np.nan),
        ("the equations are not autonomous",) * cases,
    )
    if rung.anomaly is not None:
        return periodic
    flow = flow_of(rung.plant)
    unit = flow.system.unit[:, None]
    x, period = orbits.x0 / unit, orbits.period_s / flow.system.time_unit_s
    begin = np.where(np.isfinite(guess), guess, orbits.x0) / unit
    groups: dict[tuple[Shooting, str], list[int]] = {}
    status = [""] * cases
    for i in range(cases):
        group = _problem(flow, x[:, i])
        if group is None:
            status[i] = "begins on neither axis"
        else:
            groups.setdefault(group, []).append(i)
    for (problem, held), lanes in groups.items():
        try:
            _correct(periodic, problem, held, x[:, lanes], begin[:, lanes], period[lanes], lanes)
        except PropagationError:
            # one of the group has left; each is tried alone
            for lane in lanes:
                try:
                    one = [lane]
                    _correct(periodic, problem, held, x[:, one], begin[:, one], period[one], one)
                except PropagationError:
                    status[lane] = "the correction leaves every bound"
    # closure is judged beside the magnification of rounding over one period
    growth = np.maximum(1.0, np.max(np.abs(orbits.monodromy), axis=(0, 1)))
    for i in range(cases):
        if not status[i]:
            good = periodic.closure[i] <= _CLOSED * growth[i]
            status[i] = "periodic" if good else "the correction does not converge"
            if not good:
                periodic.x0[:, i], periodic.period_s[i], periodic.closure[i] = (
                    np.nan,
                    np.nan,
                    np.nan,
                )
    return PeriodicCounterparts(periodic.x0, periodic.period_s, periodic.closure, tuple(status))


def _problem(flow: Flow, x: Array) -> tuple[Shooting, str] | None:
    """Return equations for an orbit from its first state, and the coordinate that is kept."""
    samples = _samples(x)
    planar = abs(x[2]) < _ZERO and abs(x[5]) < _ZERO
    flat = planar and flow.keeps(XY_MIRROR, samples, reverses_time=False)
    frozen = ("z", "vz") if flat else ()
    for mirror in _MIRRORS:
        on_it = all(abs(x[i]) < _ZERO for i in range(6) if mirror[i] < 0)
        if on_it and flow.keeps(mirror, samples, reverses_time=True):
            held = "z" if mirror[2] > 0 and abs(x[2]) > _ZERO else "x"
            return SymmetricShooting(flow, mirror, frozen), held
    for section, held in (("y", "x"), ("x", "y")):
        if abs(x[flow.names.index(section)]) < _ZERO:
            off = abs(x[2]) > _ZERO
            return PeriodicShooting(flow, section, frozen), "z" if off else held
    return None


def _samples(x: Array) -> Array:
    """States about as far out as a state, at which mirrors are tried, shape (6, 24)."""
    rng = np.random.default_rng(6)
    place, speed = np.linalg.norm(x[:3]), np.linalg.norm(x[3:])
    states = rng.normal(size=(6, 24))
    # random directions at the orbit's own distance and speed
    states[:3] *= place / np.linalg.norm(states[:3], axis=0)
    states[3:] *= speed / np.linalg.norm(states[3:], axis=0)
    return np.asarray(states)


def _correct(
    periodic: PeriodicCounterparts,
    problem: Shooting,
    held: str,
    x: Array,
    begin: Array,
    period: Array,
    lanes: list[int],
) -> None:
    """Correct orbits of one kind and write those that result."""
    flow = problem.flow
    at = problem.unknowns.index(held)
    amplitude = problem.unknowns_at(x, period)[at]
    z = problem.unknowns_at(begin, period)
    problem = problem.with_steps(flow.steps_for(problem.state(z), z[-1], 1e-10))
    # the nearest member of the family first, then along it to the amplitude
    nearest = correct(problem, z)
    made = correct(problem, nearest.z, fix_component(at, amplitude), tolerance=1e-12)
    start, span = problem.state(made.z), problem.period(made.z)
    if flow.system.external is None:
        end = Taylor(flow.system).fly(start, span, strict=False).x
    else:
        end = flow.adaptive.propagate(start, span, 1, strict=False)
    periodic.x0[:, lanes] = start * flow.system.unit[:, None]
    periodic.period_s[lanes] = span * flow.system.time_unit_s
    periodic.closure[lanes] = np.linalg.norm(end - start, axis=0)
