"""Continuation of members from one set of parameters to another at a held quantity.

Natural steps advance all members in lockstep; pseudo-arclength follows each by itself, through the
folds at which the parameters turn back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere_orbits.continuation import Boundary, StepControl, follow
from hillsphere_orbits.correction import Constraint, Correction, correct
from hillsphere_orbits.parameter_continuation import HeldQuantity, ParameterProblem

__all__ = ["ContinuedOrbits", "HeldProblem", "Method", "carry", "refine_orbits"]

Method: TypeAlias = Literal["arclength", "natural"]

_REACHED = "reached"
_CONTROL = StepControl(first=0.05, smallest=1e-7, largest=0.25, members=400)
_FIRST, _LARGEST, _SMALLEST = 0.1, 0.25, 1e-5  # natural steps, parts of the path
_ASTRAY = 0.05  # of a chord: how far it may be from the mean of the slopes at its ends


@dataclass(frozen=True)
class HeldProblem:
    """The orbits of a `ParameterProblem` with a quantity held: a curve.

    Parameters
    ----------
    problem : ParameterProblem
        The equations.
    held : callable
        The quantity.
    value : float
        Its value.
    """

    problem: ParameterProblem
    held: HeldQuantity
    value: float

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return self.problem.unknowns

    def residual(self, z: Array) -> tuple[Array, Array]:
        """Return the equations and the condition, and their derivatives."""
        values, slopes = self.problem.residual(z)
        held, gradient = self.held(z)
        return (
            np.concatenate([values, (held - self.value)[None]]),
            np.concatenate([slopes, gradient[None]]),
        )


@dataclass(frozen=True)
class ContinuedOrbits:
    """Orbits at the end of a path of parameters.

    Parameters
    ----------
    z : ndarray, shape (m, N)
        Last orbit found on each way, with its fraction.
    status : tuple of str
        ``"reached"``, or why the way ends before.
    ways : tuple of ndarray, shape (m, K_i)
        All orbits on each way, the first one included.
    """

    z: Array
    status: tuple[str, ...]
    ways: tuple[Array, ...]

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Which orbits are at the end of the path, (N,)."""
        return np.array([status == _REACHED for status in self.status], dtype=bool)


def carry(
    problem: ParameterProblem,
    z: Array,
    held: HeldQuantity,
    *,
    method: Method = "arclength",
    advance: Callable[[int], None] | None = None,
) -> ContinuedOrbits:
    """Carry members of a family along a path of parameters.

    Parameters
    ----------
    problem : ParameterProblem
        The equations and the path.
    z : ndarray, shape (m − 1, N)
        Members at the start of the path: unknowns of the shooting problem.
    held : callable
        Quantity that keeps its value on the way.
    method : {"arclength", "natural"}
        Pseudo-arclength, or steps of the fraction, which end at a fold.
    advance : callable, optional
        Called with 1 for every member that is done.

    Returns
    -------
    ContinuedOrbits
        A member that does not arrive is classified, not raised.

    Raises
    ------
    InputError
        If the method is unknown or the shape does not fit.
    ConvergenceError
        If a member is no orbit of the equations at the start of the path.
    """
    if method not in ("arclength", "natural"):
        raise InputError(f"method must be 'arclength' or 'natural', got {method!r}")
    if z.ndim != 2 or len(z) != len(problem.unknowns) - 1:
        raise InputError(f"z must be ({len(problem.unknowns) - 1}, N), got {z.shape}")
    start = np.concatenate([z, np.zeros((1, z.shape[1]))])
    wanted, _ = held(start)
    names = [str(k) for k in range(z.shape[1])]
    start = correct(problem, start, _both(held, wanted, 0.0)).require_converged(
        "start of the path", names
    )
    if method == "natural":
        return _natural(problem, start, held, wanted, advance)
    ends, status, ways = [], [], []
    for k in range(z.shape[1]):
        end, reason, way = _follow_by_arclength(problem, start[:, k], held, float(wanted[k]))
        ends.append(end)
        status.append(reason)
        ways.append(way)
        if advance is not None:
            advance(1)
    return ContinuedOrbits(
        np.array(ends).reshape(len(ends), len(start)).T, tuple(status), tuple(ways)
    )


def _follow_by_arclength(
    problem: ParameterProblem, start: Array, held: HeldQuantity, wanted: float
) -> tuple[Array, str, Array]:
    """Follow one orbit by pseudo-arclength; return its end, the reason, and the way."""
    curve = HeldProblem(problem, held, wanted)
    boundaries = [
        Boundary(_REACHED, lambda z: 1.0 - z[-1]),
        Boundary("the parameters turn back and return to their start", lambda z: z[-1]),
        Boundary("the period shrinks to nothing", lambda z: z[-2] - 1e-3 * start[-2]),
    ]
    direction = np.eye(len(start))[-1]
    try:
        branch = follow(curve, start, direction, boundaries=boundaries, control=_CONTROL)
    except (ConvergenceError, PropagationError) as error:
        return start, f"not followed: {error}", start[:, None]
    way, reason = branch.z, branch.ends[1]
    if reason == _REACHED:
        # the boundary is located to rounding of the fraction; set it to 1 exactly and correct once
        # more
        last = way[:, -1:].copy()
        last[-1] = 1.0
        corrected = correct(problem, last, _both(held, np.array([wanted]), 1.0))
        way[:, -1:] = corrected.z
        if not corrected.converged[0]:
            reason = f"not_converged: residual {corrected.error[0]:.1e} at the end of the path"
    else:
        reason += f" (last fraction {way[-1, -1]:.4g}, largest {way[-1].max():.4g})"
    return way[:, -1], reason, way


def _natural(
    problem: ParameterProblem,
    start: Array,
    held: HeldQuantity,
    wanted: Array,
    advance: Callable[[int], None] | None,
) -> ContinuedOrbits:
    """Carry all orbits in common steps of the fraction; one that fails stays behind."""
    z, here, step = start.copy(), 0.0, _FIRST
    slopes = _slopes(problem, z, held)
    ways = [[column] for column in start.T]
    status = [_REACHED] * z.shape[1]
    active = np.arange(z.shape[1])
    while active.size and here < 1.0:
        # a remainder of less than a hundredth of a step is added to this one
        there = 1.0 if here + 1.01 * step >= 1.0 else here + step
        old, slope = z[:, active], slopes[:, active]
        # Euler predictor along dz/ds; the fraction itself is prescribed
        guess = old + (there - here) * slope
        guess[-1] = there
        corrected, good = _correct_lanes(problem, guess, held, wanted[active], there)
        new = slope.copy()
        if good.any():
            new[:, good] = _slopes(problem, corrected[:, good], held)
        # Newton's method may have met another family: then its slopes do not fit the chord
        # trapezoidal rule with the slopes at both ends against the step taken
        chord, mean = corrected - old, 0.5 * (there - here) * (slope + new)
        good &= np.linalg.norm(chord - mean, axis=0) <= _ASTRAY * np.linalg.norm(chord, axis=0)
        if not good.all() and step > _SMALLEST:
            step *= 0.5
            continue
        for k in active[~good]:
            status[k] = f"not_converged: no orbit beyond the fraction {here:.6g} (a fold?)"
            if advance is not None:
                advance(1)
        active = active[good]
        z[:, active], slopes[:, active] = corrected[:, good], new[:, good]
        for k in active:
            ways[k].append(z[:, k].copy())
        here, step = there, min(_LARGEST, 2.0 * step)
    if advance is not None:
        advance(active.size)
    return ContinuedOrbits(z, tuple(status), tuple(np.array(way).T for way in ways))


def _slopes(problem: ParameterProblem, z: Array, held: HeldQuantity) -> Array:
    """Return dz/ds (m, N) at constant held quantity; its last row is one."""
    _, slopes = problem.residual(z)
    matrix = np.concatenate([slopes, held(z)[1][None]])
    # implicit function theorem: dz/ds = −(∂G/∂z)⁻¹ ∂G/∂s with the held quantity among G
    inner, along = np.moveaxis(matrix[:, :-1], 2, 0), matrix[:, -1].T[:, :, None]
    change = -(np.linalg.pinv(inner) @ along)[:, :, 0].T
    return np.concatenate([change, np.ones((1, z.shape[1]))])


def _correct_lanes(
    problem: ParameterProblem, guess: Array, held: HeldQuantity, wanted: Array, fraction: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Correct lanes at a fraction; one that leaves the domain of the equations just fails."""

    def attempt(lanes: NDArray[np.intp]) -> Correction | None:
        try:
            return correct(problem, guess[:, lanes], _both(held, wanted[lanes], fraction))
        except PropagationError:
            return None

    lanes = np.arange(guess.shape[1])
    if (together := attempt(lanes)) is not None:
        return together.z, together.converged
    z, good = guess.copy(), np.zeros(guess.shape[1], dtype=bool)
    for k in lanes:
        if (one := attempt(lanes[k : k + 1])) is not None:
            z[:, k], good[k] = one.z[:, 0], one.converged[0]
    return z, good


def _both(held: HeldQuantity, wanted: Array, fraction: float) -> Constraint:
    """Return the constraint that holds the quantity and the fraction."""

    def constraint(z: Array) -> tuple[Array, Array]:
        values, slopes = held(z)
        along = np.zeros_like(z)
        along[-1] = 1.0
        return np.array([values - wanted, z[-1] - fraction]), np.array([slopes, along])

    return constraint


def refine_orbits(problem: ParameterProblem, z: Array, held: HeldQuantity, values: Array) -> Array:
    """Correct orbits (m, N) at the end of the path, on a problem with more sub-steps.

    Raises
    ------
    ConvergenceError
        If one does not converge.
    """
    names = [str(k) for k in range(z.shape[1])]
    return correct(problem, z, _both(held, values, 1.0)).require_converged("end of the path", names)
