r"""Rational scalings that prove a bound of µ at many frequencies at once.

At each frequency ω of a set a level b is asked for, a little above the square of µ's bound there.
With t b in the place of β², rational D and G (`multipliers`) prove it where

.. math::

    F = t b D - M^\mathsf{H} D M - (jG M + (jG M)^\mathsf{H}) \succ 0, \quad D \succ 0

at every one. t is lowered towards one by the method of centres, as for a matrix, except that one
set of parameters serves all frequencies, and that

.. math::

    -\log\det F - \log\det D + \operatorname{tr} D_*^{-1} D

is minimised, summed over the set: the last two terms are least where D is D∗, the centre of the
scalings that prove b at the frequency alone. The sum is convex in the matrices in which D and G are
linear; the poles are moved along by the same Gauss-Newton steps. The bound itself is fitted, not a
curve, so that phase and repeated blocks are no special case.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_triangular

from hillsphere.interfaces import Array
from hillsphere_controllers.dk.multipliers import Multiplier

__all__ = [
    "FittedMultipliers",
    "Goal",
    "fit_multipliers",
    "lift_multiplier",
    "negative_frequencies",
    "relative_levels",
]

Complex = NDArray[np.complex128]

_LOWERED = 0.1
"""Share of the gap between the level and the one reached that the next level keeps, as in
`mu.upper_bound`."""
_MOST_LEVELS = 25
"""Levels at most: each takes off up to nine tenths of the gap, so that about ten reach
`_STALLED`."""
_MOST_NEWTON = 25
"""Damped Newton steps for one centre at most; the problem is not convex in the poles, and an
unfinished centre is a valid fit."""
_DECREMENT = 0.3
"""Newton decrement at which a centre is near enough for the next level."""
_PRIOR = np.array([0.02, 0.2])
"""Curvature, per frequency of the set, that holds a pole's rate and damping where they are."""
_STALLED = 1e-3
"""Relative gap between the level and the one reached at which a lower level gains too little."""
_DAMPED, _LEAST_DAMPED, _MOST_DAMPED = 1e-4, 1e-13, 1e8
"""First, least and largest damping of a step (Levenberg and Marquardt), in units in which each
parameter's curvature is one. If even a step with the largest damping gains nothing, the point is a
minimum to rounding."""
_ENOUGH = 0.1
"""Share of the predicted decrease that a step must reach to be taken (Armijo's rule)."""
_LOOKED_AT = 400
"""Frequencies at which D must be positive, over the range of the goal; besides those near its own
poles, where it dips."""


@dataclass(frozen=True, eq=False)
class Goal:
    """Goal of a fit: the bounds that rational scalings must prove.

    Parameters
    ----------
    omega_rad_s : ndarray, shape (K,)
        Frequencies; zero and infinity included.
    matrices : ndarray, shape (K, n, n)
        M there, squared.
    levels : ndarray, shape (K,)
        The squares of the bounds.
    weights : ndarray, shape (K, n, n)
        The inverses of D∗.
    """

    omega_rad_s: Array
    matrices: Complex
    levels: Array
    weights: Complex

    @property
    def sizes(self) -> Array:
        """Sizes (n,) of the diagonal of D∗, mean over the frequencies."""
        inverse = np.diagonal(self.weights, axis1=1, axis2=2).real
        return np.asarray(np.exp(-np.mean(np.log(inverse), axis=0)))

    @property
    def range(self) -> tuple[float, float]:
        """Logarithms of the frequencies between which poles may lie."""
        inner = self.omega_rad_s[(self.omega_rad_s > 0.0) & np.isfinite(self.omega_rad_s)]
        return float(np.log(inner.min())), float(np.log(inner.max()))


@dataclass(frozen=True, eq=False)
class FittedMultipliers:
    """Rational scalings and the bound of µ that they prove.

    Parameters
    ----------
    multipliers : tuple of Multiplier
        One per block.
    ratios : ndarray, shape (K,)
        Of what they prove to what is asked for, squares; all ≤ 1 if the goal is met.
    """

    multipliers: tuple[Multiplier, ...]
    ratios: Array


def fit_multipliers(goal: Goal, start: Sequence[Multiplier]) -> FittedMultipliers:
    """Fit scalings to a goal, of the same orders as the initial ones.

    Parameters
    ----------
    goal : Goal
        What to prove.
    start : sequence of Multiplier
        One per block.
    """
    x = tuple(start)
    ratios = relative_levels(goal, x)
    best, least = x, float(ratios.max())
    t = 1.3 * least
    for _ in range(_MOST_LEVELS):
        x = _centre(goal, x, max(t, 1.0))
        reached = float(relative_levels(goal, x).max())
        if reached < least:
            best, least = x, reached
        if reached <= 1.0 or t - reached <= _STALLED * t:
            break
        t = reached + _LOWERED * (t - reached)
    return FittedMultipliers(best, relative_levels(goal, best))


def relative_levels(goal: Goal, multipliers: Sequence[Multiplier]) -> Array:
    """Return the squares (K,) of the bounds that scalings prove, relative to those asked for.

    Infinite where D is not positive.
    """
    d, g = _values(goal, multipliers)
    made = np.full(len(d), np.inf)
    good = np.linalg.eigvalsh(d)[:, 0] > 0.0
    root = np.linalg.inv(np.linalg.cholesky(d[good]))
    # D = K Kᴴ: the bound is the largest eigenvalue of K⁻¹ (MᴴDM + …) K⁻ᴴ
    inside = root @ _dg_form(goal.matrices[good], d[good], g[good]) @ root.conj().swapaxes(1, 2)
    made[good] = np.linalg.eigvalsh(inside)[:, -1] / goal.levels[good]
    return made


def negative_frequencies(multipliers: Sequence[Multiplier], omega_rad_s: Array) -> Array:
    """Return frequencies at which D is not positive, one per block, where it is least.

    Looked at are many more than those of a set (K,) at which it is positive.
    """
    frequencies = []
    for one in multipliers:
        omega, least = _sample_least_eigenvalues(one, omega_rad_s)
        if least.min() <= 0.0:
            frequencies.append(float(omega[np.argmin(least)]))
    return np.array(frequencies)


def lift_multiplier(multiplier: Multiplier, omega_rad_s: Array) -> Multiplier:
    """Return scalings whose D is positive on a fine grid, by adding a constant if necessary."""
    _, least = _sample_least_eigenvalues(multiplier, omega_rad_s)
    if least.min() > 0.0:
        return multiplier
    x = multiplier.x.copy()
    x[0] += 1.1 * abs(least.min()) * np.eye(len(x[0]))
    return replace(multiplier, x=x)


def _sample_least_eigenvalues(one: Multiplier, omega_rad_s: Array) -> tuple[Array, Array]:
    inner = omega_rad_s[(omega_rad_s > 0.0) & np.isfinite(omega_rad_s)]
    own = np.exp(one.pairs[:, 0])
    near = np.outer(own, np.linspace(0.8, 1.25, 19)).ravel()
    omega: Array = np.concatenate([np.geomspace(inner.min(), inner.max(), _LOOKED_AT), near])
    return omega, np.asarray(np.linalg.eigvalsh(one.values(omega)[0])[:, 0], dtype=float)


def _values(goal: Goal, multipliers: Sequence[Multiplier]) -> tuple[Complex, Complex]:
    n = goal.matrices.shape[1]
    d, g = np.zeros((2, goal.omega_rad_s.size, n, n), dtype=complex)
    for span, one in zip(_spans(multipliers), multipliers, strict=True):
        d[:, span, span], g[:, span, span] = one.values(goal.omega_rad_s)
    return d, g


def _spans(multipliers: Sequence[Multiplier]) -> list[slice]:
    sizes = [max(m.block.rows, m.block.columns) for m in multipliers]
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(a, b) for a, b in pairwise(ends)]


def _dg_form(m: Complex, d: Complex, g: Complex) -> Complex:
    """Return Mᴴ D M + jG M + (jG M)ᴴ."""
    gm = g @ m
    return np.asarray(m.conj().swapaxes(1, 2) @ d @ m + gm + gm.conj().swapaxes(1, 2))


def _potential(goal: Goal, multipliers: Sequence[Multiplier], t: float) -> float:
    d, g = _values(goal, multipliers)
    f = (t * goal.levels)[:, None, None] * d - _dg_form(goal.matrices, d, g)
    try:
        low_f, low_d = np.linalg.cholesky(f), np.linalg.cholesky(d)
    except np.linalg.LinAlgError:
        return np.inf
    whole = np.log(np.diagonal(low_f, axis1=1, axis2=2).real).sum()
    whole += np.log(np.diagonal(low_d, axis1=1, axis2=2).real).sum()
    return float(np.sum(goal.weights.conj() * d).real - 2.0 * whole)


def _centre(goal: Goal, x: tuple[Multiplier, ...], t: float) -> tuple[Multiplier, ...]:
    value = _potential(goal, x, t)
    if not np.isfinite(value) or sum(one.size for one in x) == 0:
        return x
    low, high = goal.range
    ends = np.cumsum([one.size for one in x])[:-1]
    damping = _DAMPED
    for _ in range(_MOST_NEWTON):
        gradient, rows = _derivatives(goal, x, t)
        # by orthogonal factors: the Hessian itself has the square of their condition
        scale = np.linalg.norm(rows, axis=0)
        scale = np.maximum(scale, 1e-12 * scale.max())
        r = np.linalg.qr(rows / scale, mode="r")
        while True:
            # Levenberg-Marquardt: (JᵀJ + damping I) step = −gradient, by the QR factor of [J;
            # √damping I]
            both = np.vstack([r, np.sqrt(damping) * np.eye(scale.size)])
            damped = np.linalg.qr(both, mode="r")
            step = solve_triangular(damped, -gradient / scale, trans="T", check_finite=False)
            step = solve_triangular(damped, step, check_finite=False) / scale
            decrement = float(-gradient @ step)
            parts = np.split(step, ends)
            there = tuple(one.step(part, low, high) for one, part in zip(x, parts, strict=True))
            new = _potential(goal, there, t)
            if new < value - _ENOUGH * decrement:
                break
            damping *= 8.0
            if damping > _MOST_DAMPED:
                return x
        x, value = there, new
        damping = max(damping / 10.0, _LEAST_DAMPED)
        if np.sqrt(decrement) < _DECREMENT:
            return x
    return x


def _derivatives(goal: Goal, x: Sequence[Multiplier], t: float) -> tuple[Array, Array]:
    """Return the potential's gradient (size,) and rows J, Jᵀ J being its Gauss-Newton Hessian."""
    d, g = _values(goal, x)
    m, mh = goal.matrices, goal.matrices.conj().swapaxes(1, 2)
    levels = (t * goal.levels)[:, None, None]
    root = np.linalg.inv(np.linalg.cholesky(levels * d - _dg_form(m, d, g)))
    roots = root[:, None]
    gradient, of_f, of_d, prior = [], [], [], []
    for span, one in zip(_spans(x), x, strict=True):
        if one.size == 0:
            continue
        dd, dg = one.tangents(goal.omega_rad_s)
        inner = m[:, None, span, :]
        # dF = t b dD − Mᴴ dD M − (jdG M + (jdG M)ᴴ) for each parameter
        lifted = -(mh[:, None, :, span] @ dd @ inner)
        lifted[:, :, span, span] += levels[:, None] * dd
        if one.y is not None:
            turned = dg @ inner
            lifted[:, :, span, :] -= turned
            lifted[:, :, :, span] -= turned.conj().swapaxes(2, 3)
        change = roots @ lifted @ roots.conj().swapaxes(2, 3)
        own = np.linalg.inv(np.linalg.cholesky(d[:, span, span]))[:, None]
        change_d = own @ dd @ own.conj().swapaxes(2, 3)
        # d(−log det F) = −tr F⁻¹ dF, likewise for D
        slope = -np.trace(change, axis1=2, axis2=3).real - np.trace(change_d, axis1=2, axis2=3).real
        slope += np.sum(goal.weights[:, None, span, span].conj() * dd, axis=(2, 3)).real
        gradient.append(slope.sum(axis=0))
        of_f.append(_rows(change))
        of_d.append(_rows(change_d))
        held = np.zeros(one.size)
        if one.order:
            poles = np.tile(_PRIOR, len(one.pairs))
            held[-one.order :] = poles if one.single is None else np.append(poles, _PRIOR[0])
        prior.append(held * len(d))
    rows = [np.vstack(of_f).T, block_diag(*[part.T for part in of_d])]
    return np.hstack(gradient), np.vstack([*rows, np.diag(np.sqrt(np.hstack(prior)))])


def _rows(change: Complex) -> Array:
    """Return one real row per parameter, whose products are the traces of products."""
    count = change.shape[1]
    flat = np.ascontiguousarray(change.swapaxes(0, 1)).reshape(count, -1)
    return np.hstack([flat.real, flat.imag])
