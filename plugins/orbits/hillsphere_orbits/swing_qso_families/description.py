"""Description of orbits of several revolutions: states, stability, extent, checks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products import PeriodicOrbits
from hillsphere.symbolic import gradient
from hillsphere_orbits.continuation import Branch
from hillsphere_orbits.members import Quantity, coordinate
from hillsphere_orbits.shooting import Shooting, SymmetricShooting
from hillsphere_orbits.stability import stability_indices
from hillsphere_orbits.survey import Surveyor
from hillsphere_orbits.swing_qso_families.families import integration_time

__all__ = [
    "concatenate",
    "distances",
    "errors",
    "integral_of",
    "largest_multiplier",
    "orbits_of",
    "period_of",
    "position_on",
    "spectrum_of",
    "stable",
    "tracks_of",
]

_HALF_TRACK = 600
"""Sub-steps of half a track: an orbit of several revolutions needs more points than a simple
one."""
_CIRCLE = 1e-8  # of an index: orbits with two mirrors touch −2 and turn back


def period_of(problem: Shooting) -> Quantity:
    """Return the full period of the orbits of a problem, normalised."""
    last = len(problem.unknowns) - 1
    return coordinate(last, float(problem.period(np.ones((last + 1, 1)))[0]))


def integral_of(problem: Shooting) -> Quantity:
    """Return the integral of motion of the orbits of a problem, normalised."""
    system = problem.flow.system
    if system.integral is None:
        raise InputError("the plant has no integral of motion as an expression; ask by periods")
    compiled = system.function(system.integral, *gradient(system.integral, system.x))
    rows = [1 + problem.flow.names.index(name) for name in problem.unknowns[:-1]]

    def quantity(z: Array) -> tuple[Array, Array]:
        values = compiled(problem.state(z), system.parameters(None, z.shape[1]))
        return values[0], np.concatenate([values[rows], np.zeros((1, z.shape[1]))])

    return quantity


def position_on(branch: Branch, z: Array) -> float:
    """Return the position on a chain of the orbit z (m,), which lies between two of its orbits."""
    chord = np.diff(branch.z, axis=1)
    # foot of the perpendicular on each chord; the nearest chord wins
    part = np.sum(chord * (z[:, None] - branch.z[:, :-1]), axis=0) / np.sum(chord**2, axis=0)
    part = np.clip(part, 0.0, 1.0)
    away = np.linalg.norm(branch.z[:, :-1] + part * chord - z[:, None], axis=0)
    k = int(np.argmin(away))
    return float(k + part[k])


def concatenate(parts: Sequence[Array]) -> Array:
    """Return the concatenation of arrays (N,); empty without any."""
    return np.concatenate(parts) if parts else np.empty(0)


def errors(surveyor: Surveyor, problem: Shooting, z: Array) -> tuple[Array, Array]:
    """Return half-period residual and closure (N,), by the surveyor's propagator."""
    x, period = problem.state(z), problem.period(z)
    end = surveyor.propagate(x, integration_time(problem, z))
    if not isinstance(problem, SymmetricShooting):
        change = end - x
        return np.max(np.abs(change), axis=0), np.linalg.norm(change, axis=0)
    # a symmetric orbit meets the mirror perpendicularly: states with sign −1 vanish there
    odd = np.array(problem.mirror) == -1
    half = np.max(np.abs(end[odd]), axis=0)
    return half, np.linalg.norm(surveyor.propagate(end, 0.5 * period) - x, axis=0)


def orbits_of(
    surveyor: Surveyor,
    problems: Sequence[Shooting],
    z: Sequence[Array],
    labels: Sequence[str],
    closure: Sequence[Array] | None = None,
    monodromy: Sequence[Array] | None = None,
) -> PeriodicOrbits:
    """Return the orbits z[i] (m, N) of problems[i] as one set."""
    system, scales = surveyor.system, surveyor.plant.scales
    n = len(system.states)
    pairs = [(p, each) for p, each in zip(problems, z, strict=True) if each.shape[1]]
    x = np.concatenate([np.empty((n, 0)), *(p.state(each) for p, each in pairs)], axis=1)
    period = concatenate([p.period(each) for p, each in pairs])
    if closure is None:
        closure = [errors(surveyor, p, each)[1] for p, each in pairs]
    if monodromy is None:
        monodromy = [p.monodromy(each) for p, each in pairs]
    return PeriodicOrbits(
        frame=system.frame,
        states=surveyor.problem.flow.names,
        x0=x * system.unit[:, None],
        period_s=period * system.time_unit_s,
        integral=surveyor.integral(x) if x.shape[1] else np.empty(0),
        monodromy=np.concatenate([np.empty((n, n, 0)), *monodromy], axis=2),
        residual=concatenate(closure),
        labels=tuple(labels),
        length_m=scales.length_m,
        time_s=scales.time_s,
    )


def largest_multiplier(monodromy: Array) -> Array:
    """Return the largest modulus of a multiplier (N,), from the indices of both planes."""
    return np.asarray(np.max(np.abs(spectrum_of(monodromy)), axis=0))


def spectrum_of(monodromy: Array) -> NDArray[np.complex128]:
    """Return λ, 1/λ in the plane, those out of it, and 1, 1: (6, N), |λ| ≥ 1.

    From traces: four multipliers that are nearly 1 are scattered by an eigenvalue solver.
    """
    b = np.array(stability_indices(monodromy), dtype=complex)
    # λ² − b λ + 1 = 0; the larger root without cancellation
    root = np.sqrt(b * b - 4.0)
    outer = 0.5 * np.where(np.abs(b + root) >= np.abs(b - root), b + root, b - root)
    ones = np.ones((2, b.shape[1]), dtype=complex)
    return np.concatenate([outer[:1], 1.0 / outer[:1], outer[1:], 1.0 / outer[1:], ones])


def stable(monodromy: Array) -> NDArray[np.bool_]:
    """Whether no multiplier lies off the unit circle, (N,), from the indices of both planes."""
    indices = np.array(stability_indices(monodromy))
    return np.asarray(np.all(np.abs(indices) <= 2.0 + _CIRCLE, axis=0))


def distances(problem: Shooting, z: Array) -> tuple[Array, Array]:
    """Return least and largest distance from the centre (N,) along each orbit, normalised."""
    way = problem.flow.trajectory(problem.state(z), integration_time(problem, z), problem.steps)
    radius = np.sqrt(np.sum(way[:3] ** 2, axis=0))
    return np.min(radius, axis=0), np.max(radius, axis=0)


def tracks_of(problems: Sequence[Shooting], z: Sequence[Array]) -> Array:
    """Return normalised positions (3, P, N) along one period, ends included."""
    ways = [_track(p, each)[:3] for p, each in zip(problems, z, strict=True)]
    return np.concatenate([np.empty((3, 2 * _HALF_TRACK + 1, 0)), *ways], axis=2)


def _track(problem: Shooting, z: Array) -> Array:
    """Return states (n, P, N) over the time that the problem integrates."""
    points = _HALF_TRACK if isinstance(problem, SymmetricShooting) else 2 * _HALF_TRACK
    thin = -(-problem.steps // points)
    way = problem.flow.trajectory(problem.state(z), integration_time(problem, z), thin * points)[
        :, ::thin
    ]
    if not isinstance(problem, SymmetricShooting):
        return way
    # the second half is the mirror image of the first, run backwards
    sign = np.array(problem.mirror, dtype=float)[:, None, None]
    return np.concatenate([way, (sign * way)[:, -2::-1]], axis=1)
