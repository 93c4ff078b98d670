r"""What would explain residuals that a fit cannot: a constant error of a row, or larger noise.

All values count here, those too that editing has left out: editing keeps what the first fit agrees
with, which may be the wrong ones. About the fit, with the rows A of the derivatives by the unknowns
δ, the direction d of a constant error b of one row, and weights W of the values, the minimum of

.. math:: |\delta - \delta_0|^2 + |W (r - A \delta - d\, b)|^2

is that of a fit with this error as one more state; δ₀ is the prior's mean. Values that are still
far off are left out of it step by step, as in `fit_and_edit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.orbit_fit.fitting import EditedFit
from hillsphere_estimators.orbit_fit.observables import Observable
from hillsphere_estimators.orbit_fit.records import Arc

__all__ = ["Hints", "explain_misfit"]

_BOUND_SIGMAS = 4.0
"""Residuals beyond it count as unexplained where nothing is edited: of normal ones 6e-5."""
_MOST_LEFT = 0.1
"""Share of the values of a row that may stay unexplained, as for the verdict on editing."""
_LEAST_GAIN = 25.0
"""Fall of the sum of squares by a constant error that counts: its square in standard deviations,
of which chance reaches 5 in one of a million rows."""
_NEARLY_AS_GOOD = 9.0
"""Difference of the sums of squares of two explanations that is no decision: three standard
deviations."""
_LARGER = 1.5
"""Scale of the noise from which it is told: editing at four standard deviations then still takes
less than one value in a hundred, and the verdict needs no other reason."""
_FEWEST = 8
"""Values of a row from which the scale of its noise is estimated: to a quarter of itself."""
_ROUNDS = 8
"""Refits in which far values are left out, or scales are estimated: each takes microseconds."""
_LEVEL = 0.001
"""Probability with which normal residuals of a row look correlated or off zero."""
_NORMAL_MAD = 1.4826
"""Standard deviation of normal numbers over the median of their absolute values."""


@dataclass(frozen=True)
class Hints:
    """What would explain a misfit.

    Parameters
    ----------
    sentences : tuple of str
        The explanations, the keys of a mission that state them included; empty without any.
    means : ndarray, shape (rows,)
        Mean residual of each row about a fit of all values, in the stated standard deviations.
    """

    sentences: tuple[str, ...]
    means: Array


@dataclass(frozen=True)
class _Problem:
    """The linear problem about a fit."""

    residual: Array
    rows: Array
    offset: Array
    row: Integers
    count: int
    bound: float

    def solve(self, weight: Array, direction: Array | None) -> tuple[Array, float, float]:
        """Return residuals (M,), and a constant error with its standard deviation."""
        n = self.rows.shape[1]
        extra = np.zeros((n + len(self.row), 0 if direction is None else 1))
        if direction is not None:
            extra[n:, 0] = weight * direction
        top = np.concatenate([np.eye(n), weight[:, None] * self.rows])
        matrix = np.concatenate([top, extra], axis=1)
        aim = np.concatenate([self.offset, weight * self.residual])
        # scaled columns: derivatives in units of a wide prior differ by many orders of magnitude
        size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        upper = np.asarray(np.linalg.qr(matrix / size, mode="r"))
        found = np.linalg.lstsq(matrix / size, aim, rcond=1e-14)[0]
        solution = found / size
        left = self.residual - self.rows @ solution[:n]
        if direction is None:
            return left, 0.0, 0.0
        # the last column of the triangle is what the states cannot take up
        sigma = 1.0 / max(abs(float(upper[-1, -1])) * size[-1], 1e-300)
        return left - direction * solution[-1], float(solution[-1]), sigma

    def trimmed(self, direction: Array | None) -> tuple[Array, float, float]:
        """Return `solve` after values that stay far off are left out, the worst first."""
        weight = np.ones(len(self.row))
        made = self.solve(weight, direction)
        for _ in range(_ROUNDS):
            size = np.abs(made[0])
            worst = float(np.max(size[weight > 0.0], initial=0.0))
            kept = size <= np.maximum(self.bound, 0.3 * worst)
            if kept.sum() <= self.rows.shape[1] + 1 or (kept == (weight > 0.0)).all():
                break
            weight = kept.astype(float)
            made = self.solve(weight, direction)
        return made

    def unexplained(self, residual: Array, scale: Array | None = None) -> Integers:
        """Return how many values of each row stay beyond the bound, (rows,)."""
        size = np.abs(residual) if scale is None else np.abs(residual) / scale[self.row]
        return np.asarray(np.bincount(self.row[size > self.bound], minlength=self.count))

    def explains(self, residual: Array, scale: Array | None = None) -> bool:
        """Return whether no row has more far values than editing may take."""
        number = np.bincount(self.row, minlength=self.count)
        few = np.maximum(2.0, _MOST_LEFT * number)
        return bool((self.unexplained(residual, scale) <= few).all())


def explain_misfit(
    edited: EditedFit,
    arc: Arc,
    prior: Belief,
    observables: Sequence[Observable],
    threshold: float | None,
    wanted: bool,
) -> Hints:
    """Look for one constant error, or scales of the noise, with which all values fit.

    Parameters
    ----------
    edited : EditedFit
        The fit.
    arc : Arc
        All data.
    prior : Belief
        At the start, N = 1.
    observables : sequence of Observable
        In the order of the rows.
    threshold : float or None
        Of the editing.
    wanted : bool
        Whether explanations are looked for; the means are always returned.

    Returns
    -------
    Hints
        Without sentences if neither explains the data.
    """
    about = edited.residuals
    offset = np.linalg.solve(prior.root[0], (prior.x - edited.fit.belief.x)[:, 0])
    names = [(o, k) for o in observables for k in range(len(o.names))]
    problem = _Problem(
        about.residual, about.rows, offset, arc.row, len(names), threshold or _BOUND_SIGMAS
    )
    plain = problem.solve(np.ones(len(arc.row)), None)[0]
    number = np.maximum(np.bincount(arc.row, minlength=len(names)), 1)
    means = np.bincount(arc.row, plain, minlength=len(names)) / number
    if not wanted:
        return Hints((), means)
    sentences = _constant_error(problem, arc, names) or _larger_noise(problem, names)
    return Hints(tuple(sentences), means)


def _constant_error(
    problem: _Problem, arc: Arc, names: Sequence[tuple[Observable, int]]
) -> list[str]:
    """Return sentences of the constant error of one row that explains all values; may be none."""
    before = problem.trimmed(None)[0]
    found: list[tuple[float, int, float, float, int]] = []
    for row in range(problem.count):
        direction = np.where(arc.row == row, 1.0 / arc.sigma, 0.0)
        if not direction.any():
            continue
        residual, value, sigma = problem.trimmed(direction)
        if (value / sigma) ** 2 < _LEAST_GAIN or not problem.explains(residual):
            continue
        inside = np.abs(residual) <= problem.bound
        cost = float(np.sum(np.where(inside, residual, problem.bound) ** 2))
        if np.sqrt(np.mean(residual[inside] ** 2)) < _LARGER:
            found.append((cost, row, value, sigma, int((~inside).sum())))
    if not found:
        return []
    found.sort()
    cost, row, value, sigma, left = found[0]
    observable, part = names[row]
    others = [names[one[1]] for one in found[1:] if one[0] < cost + _NEARLY_AS_GOOD]
    first = (
        f"A constant error of {_amount(value, observable)} of {_row_name(observable, part)} would "
        f'explain it: try biases = [{{ station = "{observable.receiver}", '
        f"{_bias_key(observable, part, value)} }}]."
    )
    detail = (
        f"With that error, estimated to {_amount(sigma, observable, signed=False)}, {left} of "
        f"{len(problem.row)} values stay beyond {problem.bound:g} standard deviations, without it "
        f"{int((np.abs(before) > problem.bound).sum())}."
    )
    if others:
        detail += (
            " One of " + ", ".join(_row_name(*one) for one in others)
            + " would explain it as well: the data do not tell them apart."
        )  # fmt: skip
    return [first, detail]


def _larger_noise(problem: _Problem, names: Sequence[tuple[Observable, int]]) -> list[str]:
    """Return a sentence of the scales of the noise with which all values fit; may be none."""
    scale = np.ones(problem.count)
    number = np.bincount(problem.row, minlength=problem.count)
    total = len(problem.row)
    if total <= problem.rows.shape[1] + _FEWEST:
        return []
    residual = problem.residual
    for _ in range(_ROUNDS):
        weight = 1.0 / scale[problem.row]
        far = np.abs(residual) * weight > 3.0 * problem.bound
        residual = problem.solve(np.where(far, 0.0, weight), None)[0]
        # a fit of n unknowns makes residuals smaller
        taken = np.sqrt(total / (total - problem.rows.shape[1]))
        for row in np.flatnonzero(number >= _FEWEST):
            own = np.abs(residual[problem.row == row])
            scale[row] = max(_NORMAL_MAD * float(np.median(own)) * taken, 1e-3)
    if scale.max() < _LARGER or not problem.explains(residual, scale):
        return []
    for row in np.flatnonzero(number >= _FEWEST):
        own = residual[problem.row == row] / scale[row]
        own = own[np.abs(own) <= problem.bound]
        bound = float(norm.isf(0.5 * _LEVEL / problem.count)) / np.sqrt(len(own))
        off = own - own.mean()
        correlation = np.sum(off[1:] * off[:-1]) / max(float(np.sum(off * off)), 1e-30)
        if abs(own.mean()) > bound or abs(correlation) > bound:
            return []
    told = [
        f"{scale[row]:.2g} × for {_row_name(*names[row])}"
        for row in np.flatnonzero((number >= _FEWEST) & (scale >= _LARGER)).tolist()
    ]
    least, most = scale[number >= _FEWEST].min(), scale[number >= _FEWEST].max()
    if most < 1.5 * least:
        # one scale explains all: tell it once
        mean = float(np.sqrt(np.mean(scale[problem.row] ** 2)))
        return [
            f"The residuals of all values are consistent with standard deviations of {mean:.2g} "
            "times the stated ones: check noise."
        ]
    return [
        "The residuals of all values are consistent with larger standard deviations than stated: "
        f"{'; '.join(told)}; check noise."
    ]


def _row_name(observable: Observable, part: int) -> str:
    return f"{observable.receiver}'s {observable.names[part]}"


def _bias_key(observable: Observable, part: int, value: float) -> str:
    """Return key and value of a prior that holds an error: twice its size, to one digit."""
    size = 2.0 * abs(value)
    if observable.kind == "angles":
        return f"angle_{part + 1}_deg = {np.degrees(size):.1g}"
    key = {"range": "range_m", "range_rate": "range_rate_m_s", "frequency": "frequency_hz"}
    return f"{key[observable.kind]} = {float(f'{size:.1g}'):g}"


def _amount(value: float, observable: Observable, *, signed: bool = True) -> str:
    """Return a value with its unit."""
    unit = {"angles": "°", "range": " m", "range_rate": " m/s", "frequency": " Hz"}
    shown = np.degrees(value) if observable.kind == "angles" else value
    return f"{shown:{'+' if signed else ''}.4g}{unit[observable.kind]}"
