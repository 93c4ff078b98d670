r"""Poles of a system with delays on the right of the imaginary axis, counted with proof.

The poles are the zeros of an entire function, the determinant of the pencil

.. math::

    P(s) = \begin{bmatrix} s I - A & -B E(s) \\ -C & I - D E(s) \end{bmatrix}, \quad
    \det P(s) = \det(I - D E) \, s^n \det(I - X(s) / s), \quad
    X = A + B E (I - D E)^{-1} C .

Where :math:`|X| \le \bar X` entry by entry for Re s ≥ 0, no pole there is larger than the spectral
radius R of :math:`\bar X`. The argument principle along the axis from −jR to jR and a half circle
gives their number. On the circle the change of the argument is known in closed form,
:math:`n π + 2 \arg\det(I - D E) + 2 \arg\det(I - X/s)` at s = jR, since all eigenvalues of the two
products are less than one. The axis is covered by intervals on which `expansion` proves that P is
not singular; there the change of the argument is that of eigenvalues in the right half-plane. No
sample decides anything.

A neutral system, with D ≠ 0, has chains of infinitely many poles. They stay on the left, whatever
small changes of the delays do, just if the spectral radius of D diag(e^{jθ}) is below one for all
phases θ [1]_, chapter 6 of [2]_; this is the structured singular value of D for complex scalars.

References
----------
.. [1] J. K. Hale, S. M. Verduyn Lunel (1993), Introduction to Functional Differential Equations,
   Springer, section 9.6.
.. [2] W. Michiels, S.-I. Niculescu (2007), Stability and Stabilization of Time-Delay Systems, SIAM.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.delays.direct_loop import DirectLoop, bound_direct_loop
from hillsphere_controllers.delays.expansion import Pencil, spectral_radius_bounded
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["DelayStability", "balance_pencil", "bound_frequency", "cover_axis", "judge_stability"]

_BEYOND = 1.01
"""Radius of the half circle relative to the bound of the poles: the eigenvalues of X/s are below
one by as much."""
_RAISES = 50
"""Steps of 5 % by which the bound of the poles is raised until it is proved; beyond, a norm is."""
_MOST = 200_000
"""Intervals at most: some seconds to a minute. More are needed where delays are longer than all
time constants by some 1e4, or where the neutral part is nearly not stable."""
_NARROW = 1e-10
"""Width of an interval relative to its frequency below which a root is taken to be on the axis, as
far as double precision can tell: a damping ratio of 1e-10."""
_INTEGER = 0.02
"""Distance of the computed number of poles from an integer at most; rounding makes it 1e-10."""


@dataclass(frozen=True)
class DelayStability:
    """Number of poles on the right, and how it was found.

    Parameters
    ----------
    stable : bool or None
        Whether all poles are on the left of the axis, by more than any positive number; None if it
        is undecided.
    unstable_poles : float or None
        Number of poles on the right or, if they are known exactly, on the axis; infinite where a
        neutral chain of poles is on the right; None if it is undecided.
    reason : str
        Why it is undecided or not stable, in words.
    intervals_rad_s : ndarray, shape (K, 2)
        Intervals of the axis on which the proof was made, of all parts one after the other.
    bound_rad_s : float
        No pole on the right or on the axis is larger than this.
    """

    stable: bool | None
    unstable_poles: float | None
    reason: str = ""
    intervals_rad_s: Array = field(default_factory=lambda: np.zeros((0, 2)), repr=False)
    bound_rad_s: float = 0.0


def judge_stability(
    system: DelaySystem, abscissa_1_s: float = 0.0, *, most_intervals: int = _MOST
) -> DelayStability:
    """Count the poles on the right of the imaginary axis, or of a line parallel to it.

    Parameters
    ----------
    system : DelaySystem
        Any. Poles that no input reaches or no output shows are counted too. Delays of equal length
        count as one: a neutral system that is stable for these may not be so for slightly different
        ones.
    abscissa_1_s : float
        Real part of the line, 1/s: "stable" then means that all poles are on the left of it.
    most_intervals : int
        Intervals at most, after which the question is left undecided.

    Returns
    -------
    DelayStability
        The number of poles, with the intervals of the proof.

    Raises
    ------
    InputError
        If the abscissa is not finite, or so far to the left that e^{-sT} is no number.
    """
    pencil = _shift(balance_pencil(system), abscissa_1_s)
    # a part of the graph of which each reaches each has its own factor of the determinant
    graph = np.block([[pencil.a, pencil.b], [pencil.c, pencil.d]]) != 0.0
    count, labels = connected_components(graph, directed=True, connection="strong")
    total, doubt, intervals, radius = 0.0, list[str](), [np.zeros((0, 2))], 0.0
    fault = ""
    for k in range(count):
        part = pencil.part(np.flatnonzero(labels == k))
        made = _count_part(part, most_intervals)
        intervals.append(made.intervals_rad_s)
        radius = max(radius, made.bound_rad_s)
        if made.unstable_poles is None:
            doubt.append(made.reason)
        else:
            total += made.unstable_poles
            fault = fault or made.reason
    used = np.concatenate(intervals)
    if total:
        # other parts cannot make it stable, but their number of poles stays unknown
        known = total if not doubt or np.isinf(total) else None
        return DelayStability(False, known, "; ".join([fault, *doubt]), used, radius)
    if doubt:
        return DelayStability(None, None, "; ".join(dict.fromkeys(doubt)), used, radius)
    return DelayStability(True, 0.0, "", used, radius)


def balance_pencil(system: DelaySystem) -> Pencil:
    """Return the matrices of a system, its states scaled by powers of two.

    Parameters
    ----------
    system : DelaySystem
        Any.

    Returns
    -------
    Pencil
        The same transfer matrix to the last digit.
    """
    made = system.system
    if made.order and 0 not in made.shape:
        made, _ = balance_states(made)
    return Pencil.of(replace(system, system=made))


def _shift(pencil: Pencil, abscissa: float) -> Pencil:
    """Return the pencil of P(s + abscissa)."""
    if not np.isfinite(abscissa):
        raise InputError(f"an abscissa must be finite, got {abscissa}")
    if abscissa == 0.0:
        return pencil
    with np.errstate(over="ignore", invalid="ignore"):
        grow = np.exp(-abscissa * pencil.times)
        made = replace(
            pencil, a=pencil.a - abscissa * np.eye(len(pencil.a)), b=pencil.b * grow,
            d=pencil.d * grow,
        )  # fmt: skip
    if not (np.isfinite(made.b).all() and np.isfinite(made.d).all()):
        raise InputError(f"e^{{-sT}} is no number at the real part {abscissa} 1/s")
    return made


def _count_part(part: Pencil, most: int) -> DelayStability:
    """Count the poles of one part, in which each state and delay reaches each."""
    n, q = len(part.a), len(part.times)
    if n == 1 and q == 0:
        # exact, and an integrator is no matter of rounding
        pole = float(part.a[0, 0])
        reason = f"a pole at {pole:.6g} 1/s" if pole >= 0.0 else ""
        return DelayStability(pole < 0.0, float(pole >= 0.0), reason)
    direct = bound_direct_loop(part.d, part.times)
    if direct.inverse_bound is None:
        poles = np.inf if direct.stable is False else None
        return DelayStability(direct.stable, poles, direct.reason)
    if n == 0:
        return DelayStability(True, 0.0)
    radius = _BEYOND * bound_frequency(part, direct)
    intervals, reason = cover_axis(part, radius, most=most)
    if reason:
        return DelayStability(None, None, reason, intervals, radius)
    turned = _axis_turn(part, intervals)
    on_circle = 0.5 * np.pi * n + _circle_turn(part, radius)
    value = (on_circle - turned) / np.pi
    poles = float(np.round(value))
    if abs(value - poles) > _INTEGER or poles < 0.0:
        reason = f"rounding left the number of poles at {value:.3g}"
        return DelayStability(None, None, reason, intervals, radius)
    reason = f"{poles:.0f} poles on the right of the line" if poles else ""
    reason = reason.replace("1 poles", "1 pole") if poles == 1.0 else reason
    return DelayStability(poles == 0.0, poles, reason, intervals, radius)


def bound_frequency(pencil: Pencil, direct: DirectLoop) -> float:
    """Return the spectral radius of the bound of |X|, which no pole on the right exceeds.

    Parameters
    ----------
    pencil : Pencil
        Of a system.
    direct : DirectLoop
        Bound of its direct loop.

    Returns
    -------
    float
        The bound, 1/s, rounding included.
    """
    bound = direct.inverse_bound
    assert bound is not None
    bar = np.abs(pencil.a) + np.abs(pencil.b) @ bound @ np.abs(pencil.c)
    computed = float(np.abs(np.linalg.eigvals(bar)).max(initial=0.0))
    size = max(computed * (1.0 + 1e-6), float(np.finfo(float).tiny))
    # eigenvalues are rounded, a positive vector with X̄ v < R v is a proof
    for _ in range(_RAISES):
        if spectral_radius_bounded(bar[None] / size).all():
            return size
        size *= 1.05
    return max(size, float(np.linalg.norm(bar, np.inf)) * (1.0 + 1e-6))


def cover_axis(
    pencil: Pencil,
    radius: float,
    *,
    spread: Array | None = None,
    most: int = _MOST,
) -> tuple[Array, str]:
    """Cover the axis from 0 to jR by intervals on which the pencil is proved not to be singular.

    Parameters
    ----------
    pencil : Pencil
        Of a system.
    radius : float
        R, rad/s.
    spread : ndarray, shape (q,), optional
        The proof is for all delays that differ from those of the pencil by no more, s.
    most : int
        Intervals at most.

    Returns
    -------
    intervals : ndarray, shape (K, 2)
        Their ends in order; those that were proved until it was given up, else.
    reason : str
        Why it was given up; empty otherwise.
    """
    done: list[Array] = []
    lo, hi = np.array([0.0]), np.array([radius])
    count = 0
    while lo.size:
        middle, half = 0.5 * (lo + hi), 0.5 * (hi - lo)
        # the centre is rounded too
        half = half + 2.0 * np.finfo(float).eps * hi
        proved = np.zeros(lo.size, dtype=bool)
        singular = np.zeros(lo.size, dtype=bool)
        for at in pencil.chunks(middle):
            e = pencil.expand(middle[at])
            turn = pencil.turn(middle[at], half[at], spread)
            proved[at] = spectral_radius_bounded(e.residual + e.h_bound * turn[:, None, :])
            singular[at] = ~spectral_radius_bounded(e.residual)
        done.append(np.column_stack([lo, hi])[proved])
        count += int(proved.sum())
        lo, hi, middle, singular = lo[~proved], hi[~proved], middle[~proved], singular[~proved]
        narrow = hi - lo <= _NARROW * lo
        if (narrow | singular).any():
            place = float(middle[narrow | singular][0])
            return _sort_intervals(
                done
            ), f"a pole within rounding of the axis near {place:.6g} rad/s"
        if count + lo.size > most:
            return _sort_intervals(done), f"more than {most} intervals of the axis are needed"
        # the halves of what is left
        lo, hi = np.concatenate([lo, middle]), np.concatenate([middle, hi])
    return _sort_intervals(done), ""


def _sort_intervals(done: list[Array]) -> Array:
    intervals = np.concatenate(done)
    return np.asarray(intervals[np.argsort(intervals[:, 0])])


def _axis_turn(pencil: Pencil, intervals: Array) -> float:
    """Return the change of the argument of the determinant along intervals of a proof."""
    middle = 0.5 * (intervals[:, 0] + intervals[:, 1])
    total = 0.0
    for at in pencil.chunks(middle):
        z = pencil.expand(middle[at]).z
        for end, sign in ((1, 1.0), (0, -1.0)):
            # Z P = I − Y with ρ(Y) < 1 on the whole interval
            values = np.linalg.eigvals(z @ pencil.matrices(intervals[at, end]))
            total += sign * float(np.angle(values).sum())
    return total


def _circle_turn(pencil: Pencil, radius: float) -> float:
    """Return arg det(I − D E) + arg det(I − X/s) at s = jR, zero where D and X are."""
    late = pencil.late(np.array([radius]))[0]
    loop = pencil.d * late
    x = pencil.a + (pencil.b * late) @ np.linalg.solve(np.eye(len(late)) - loop, pencil.c + 0j)
    values = np.concatenate([np.linalg.eigvals(loop), np.linalg.eigvals(x) / (1j * radius)])
    return float(np.angle(1.0 - values).sum())
