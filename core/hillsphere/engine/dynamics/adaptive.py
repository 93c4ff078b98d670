"""Adaptive Runge–Kutta steps, for systems with terms that are functions of arrays.

One `advance` covers its whole step h by inner steps whose length, in each lane, follows from the
embedded error estimate. The class can replace `ArrayStages` as a `Stepper`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.stages import Advance
from hillsphere.engine.dynamics.system import System
from hillsphere.engine.dynamics.tableaux import Tableau
from hillsphere.engine.dynamics.variational import Derivatives

__all__ = ["AdaptiveStages"]

_SAFETY = 0.9
"""Safety factor of the step-size control, as in the code DOP853 [1]_."""
_LEAST, _MOST = 1.0 / 3.0, 6.0
"""Limits of the ratio of successive step sizes, as in the code DOP853 [1]_."""
_BETA = 0.04
"""Exponent β of the previous error in the PI control, of the size that [1]_ recommends (section
IV.2)."""
_POWERS = {8: 8, 6: 7}
"""Order of the formula → power q of the step with which `Tableau.step_error` decreases."""
_SMALLEST = 1e-10
"""Least ratio of an inner step to the whole step. A smaller one indicates a singularity, and the
lane becomes NaN."""
_ROUNDING = 10.0 * np.finfo(float).eps
"""Least relative tolerance: estimates below this part of a state are rounding."""


class AdaptiveStages:
    r"""A step that is divided adaptively, lane by lane, to meet a tolerance.

    With the embedded estimate e of the error of an inner step of length s, in units of the
    tolerance, the step is accepted if :math:`e \le 1`, and the next one is

    .. math:: s \cdot 0.9\, e^{-(1/q - 0.2\beta)}\, e_{before}^{\beta},\quad \beta = 0.04,

    where :math:`e \propto s^q` [1]_, [2]_.

    Parameters
    ----------
    system : System
        Equations with external terms; for others use `Taylor` or compiled steps.
    tableau : Tableau
        The formula.
    tolerance : float
        Largest estimate of the local error of an inner step: root mean square over the states, in
        units of ``system.scale``.

    Raises
    ------
    InputError
        If the tolerance is not positive.

    Notes
    -----
    All lanes are evaluated together until the last one is done, so that the bits of a lane do not
    depend on the others.

    References
    ----------
    .. [1] E. Hairer, S. P. Nørsett, G. Wanner (1993), Solving Ordinary Differential Equations I,
       2nd ed., Springer, sections II.4 (choice of the first step) and II.10.
    .. [2] K. Gustafsson (1991), Control theoretic techniques for stepsize selection in explicit
       Runge-Kutta methods, ACM Trans. Math. Softw. 17, p. 533.
    """

    needs_time = True

    def __init__(self, system: System, tableau: Tableau, tolerance: float) -> None:
        if not (np.isfinite(tolerance) and tolerance > 0):
            raise InputError(f"tolerance must be positive, got {tolerance}")
        self.rows = len(system.x)
        self._tableau, self._tolerance = tableau, tolerance
        self._power = _POWERS[tableau.order]
        self._scale = system.scale[:, None]
        self._functions = Derivatives(system)

    def bind(self, h: Array, p: Array) -> Advance:
        """Fix the steps h (N,) and run-time parameters p (k, N) of the lanes."""
        cover = self._bind(h, p)

        def advance(y: Array, out: Array, t: Array) -> None:
            cover(y, out, t)

        return advance

    def bind_measured(self, h: Array, p: Array) -> Advance:
        """Fix them for steps with an error estimate, which is the sum over the inner steps."""
        cover = self._bind(h, p)

        def advance(y: Array, out: Array, t: Array) -> None:
            out[-2], out[-1] = cover(y, out[:-2], t) ** 2, 0.0

        return advance

    def error(self, squares: Array) -> Array:
        """Return the errors of steps, see `hillsphere.engine.dynamics.stages.Stepper.error`."""
        return np.sqrt(squares[..., 0, :])

    def _bind(self, h: Array, p: Array) -> Callable[[Array, Array, Array], Array]:
        def rate(y: Array, t: Array) -> Array:
            return self._functions.rate(y, p, t)

        # the length of the last inner step, with which the next whole step begins
        length: list[Array] = []

        def cover(y: Array, out: Array, t: Array) -> Array:
            first = rate(y, t)
            trial = length[0] if length else self._first(rate, y, t, first, h)
            end, last, error = self._cover(rate, y, t, first, h, trial)
            np.copyto(out, end)
            length[:] = [last]
            # from root mean squares over the states to Euclidean lengths
            return np.asarray(error * self._tolerance * np.sqrt(self.rows))

        return cover

    def _size(self, y: Array) -> Array:
        return np.maximum(self._tolerance * self._scale, _ROUNDING * np.abs(y))

    def _first(
        self, rate: Callable[[Array, Array], Array], y: Array, t: Array, f: Array, h: Array
    ) -> Array:
        """Return the lengths (N,) of the first inner steps, by the rule of [1]_, section II.4."""
        size, way = self._size(y), np.sign(h)
        d1 = _rms(f / size)
        with np.errstate(divide="ignore", invalid="ignore"):
            small = np.where(d1 > 0, 0.01 * _rms(y / size) / d1, np.abs(h))
        small = np.minimum(np.where(np.isfinite(small) & (small > 0), small, np.abs(h)), np.abs(h))
        small = np.maximum(small, _SMALLEST * np.abs(h))
        # An explicit Euler step of length 0.01 |y|/|f| gives an estimate d2 of the second
        # derivative. The first step h then has h^q max(d1, d2) = 0.01 ([1]_, section II.4).
        there = rate(y + way * small * f, t + way * small)
        with np.errstate(divide="ignore", invalid="ignore"):
            d2 = _rms((there - f) / size) / small
            largest = np.maximum(d1, d2)
            good = (0.01 / largest) ** (1.0 / self._power)
        good = np.where(np.isfinite(good) & (good > 0), good, small)
        return np.minimum(np.minimum(100.0 * small, good), np.abs(h))

    def _cover(
        self,
        rate: Callable[[Array, Array], Array],
        y: Array,
        t: Array,
        first: Array,
        h: Array,
        trial: Array,
    ) -> tuple[Array, Array, Array]:
        """Return the states (n, N) after h, the next trial steps (N,) and the errors (N,).

        An error is the sum of the estimates of the inner steps, divided by the tolerance.
        """
        order = self._power
        way, whole = np.sign(h), np.abs(h)
        done, y = np.zeros_like(whole), y.copy()
        trial = np.minimum(trial, np.where(whole > 0, whole, trial))
        before = np.full_like(whole, 1e-4)  # error of the step before, as DOP853 begins
        slope, rejected = first, np.zeros(whole.shape, dtype=bool)
        flying, total = whole > 0, np.zeros_like(whole)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            while flying.any():
                left = whole - done
                last = trial >= left * (1.0 - 1e-12)
                # Two equal steps to the end avoid a long step followed by a tiny one.
                step = np.where(last, left, np.where(trial > 0.5 * left, 0.5 * left, trial))
                step = np.where(flying, step, 0.0)
                new, error = self._attempt(rate, y, t + way * done, slope, way * step)
                error = np.where(np.isfinite(error) & np.isfinite(new).all(axis=0), error, np.inf)
                taken = flying & (error <= 1.0)
                refused = flying & ~taken
                bounded = np.maximum(error, 1e-10)
                # PI control ([2]_, coefficients as in DOP853): the equation in the class docstring.
                # After a rejection the step may not grow, and the previous error is not used.
                factor = _SAFETY * bounded ** -(1.0 / order - 0.2 * _BETA)
                factor = np.where(taken, factor * before**_BETA, factor)
                factor = np.clip(factor, _LEAST, np.where(rejected, 1.0, _MOST))
                # A last step that the end of the interval has shortened must not shorten the next.
                wanted = np.where(taken & last, np.maximum(step * factor, trial), step * factor)
                trial = np.where(flying, wanted, trial)
                before = np.where(taken, np.maximum(error, 1e-4), before)
                rejected = refused
                y = np.where(taken, new, y)
                total = total + np.where(taken, error, 0.0)
                done = np.where(taken, np.where(last, whole, done + step), done)
                lost = refused & (trial < _SMALLEST * whole)
                y = np.where(lost, np.nan, y)
                flying = flying & (done < whole) & ~lost
                if taken.any() and flying.any():
                    slope = rate(y, t + way * done)
        return y, trial, total

    def _attempt(
        self,
        rate: Callable[[Array, Array], Array],
        y: Array,
        t: Array,
        slope: Array,
        step: Array,
    ) -> tuple[Array, Array]:
        """Return the states after a step of the formula and its error over the tolerance."""
        tableau, slopes = self._tableau, [slope]
        for i, node in enumerate(tableau.c.tolist()[1:], start=1):
            at = y.copy()
            for m, w in enumerate(tableau.a[i, :i].tolist()):
                if w:
                    at += (w * step) * slopes[m]
            slopes.append(rate(at, t + node * step))
        stages = np.stack(slopes)
        new = y + step * np.einsum("i,inN->nN", tableau.b, stages)
        size = self._size(np.maximum(np.abs(y), np.abs(new)))
        differences = np.einsum("ji,inN->jnN", np.stack(tableau.errors), stages)
        high, low = (_rms(step * d / size) ** 2 for d in differences)
        return new, tableau.step_error(high, low)


def _rms(values: Array) -> Array:
    """Return the root mean square (N,) over the states of values (n, N)."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
