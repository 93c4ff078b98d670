"""The types of distributions of a ``[dispersions.NAME]`` table."""

from __future__ import annotations

from math import erf, exp, pi, sqrt

import numpy as np
from scipy.special import ndtr, ndtri

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.uncertainty.distribution import Distribution
from hillsphere.uncertainty.specs import (
    ChoiceSpec,
    IntervalSpec,
    LogNormalSpec,
    NormalSpec,
)

__all__ = ["Choice", "LogNormal", "Normal", "Triangular", "Uniform"]


class Normal(Distribution):
    """Normal distribution about nominal + offset, optionally truncated symmetrically.

    With standard deviation σ and truncation at ±c σ the variance is
    σ² (1 − 2 c φ(c) / (2 Φ(c) − 1)) ([1]_, chapter 13, §10.1).

    Parameters
    ----------
    spec : NormalSpec
        Sizes.

    References
    ----------
    .. [1] N. L. Johnson, S. Kotz, N. Balakrishnan (1994), Continuous Univariate Distributions,
       vol. 1, 2nd ed.
    """

    def __init__(self, spec: NormalSpec) -> None:
        super().__init__(spec)
        self._spec, self._cut = spec, spec.truncate_sigmas

    def _sigma(self, nominal: Array) -> Array:
        return self._width(self._spec.sigma, self._spec.sigma_relative, nominal, "sigma")

    def _at(self, z: Array, nominal: Array) -> Array:
        if self._cut is not None:
            # Truncation maps Φ(z) to Φ(−c) + (1 − 2 Φ(−c)) Φ(z). It is evaluated in the lower tail,
            # where Φ has small relative errors, and mirrored for z > 0.
            below = ndtr(-self._cut)
            inside = ndtri(below + (1.0 - 2.0 * below) * ndtr(-np.abs(z)))
            z = np.copysign(np.clip(inside, -self._cut, 0.0), z)
        return np.asarray(self.mean(nominal)[:, None] + self._sigma(nominal)[:, None] * z)

    def mean(self, nominal: Array) -> Array:
        """Return nominal + offset (k,), SI."""
        return self._shifted(self._spec.offset, nominal)

    def _deviation(self, nominal: Array) -> Array:
        if self._cut is None:
            return self._sigma(nominal)
        # The variance in the class docstring, with 2 Φ(c) − 1 = erf(c/√2).
        density = exp(-0.5 * self._cut**2) / sqrt(2.0 * pi)
        share = 1.0 - 2.0 * self._cut * density / erf(self._cut / sqrt(2.0))
        return np.asarray(self._sigma(nominal) * sqrt(share))

    def _support(self, nominal: Array) -> tuple[Array, Array]:
        mean = self.mean(nominal)
        reach = np.full_like(mean, np.inf)
        if self._cut is not None:
            reach = self._cut * self._sigma(nominal)
        return mean - reach, mean + reach

    def _joint(self, correlation: Array, nominal: Array) -> Array:
        if self._cut is not None:
            return super()._joint(correlation, nominal)
        sigma = self._sigma(nominal)
        return np.asarray(correlation * np.outer(sigma, sigma))


class _Interval(Distribution):
    """A distribution in an interval about nominal + offset, or between fixed limits."""

    def __init__(self, spec: IntervalSpec) -> None:
        super().__init__(spec)
        self._spec = spec
        lower, upper = spec.lower, spec.upper
        if isinstance(lower, tuple) and isinstance(upper, tuple) and len(lower) != len(upper):
            raise InputError(
                f"lower is given for {len(lower)} quantities, upper for {len(upper)}; they go "
                "together"
            )
        if lower is not None and (np.array(lower) > np.array(upper)).any():
            raise InputError(f"lower must not be above upper, got {lower} and {upper}")

    def _centre(self, nominal: Array) -> Array:
        """Return nominal + offset (k,), SI."""
        return self._shifted(self._spec.offset, nominal)

    def _ends(self, nominal: Array) -> tuple[Array, Array] | None:
        """Return the fixed limits (k,), SI, before they are scaled; None if there are none."""
        if self._spec.lower is None or self._spec.upper is None:
            return None
        lower = self._factor * self._sizes(self._spec.lower, nominal, "lower")
        return lower, self._factor * self._sizes(self._spec.upper, nominal, "upper")

    def _about(self, centre: Array, nominal: Array) -> tuple[Array, Array]:
        half = self._width(
            self._spec.half_width, self._spec.half_width_relative, nominal, "half_width"
        )
        return centre - half, centre + half

    def _stretched(self, ends: tuple[Array, Array], fixed: Array) -> tuple[Array, Array]:
        """Return limits scaled about a value (k,); as they are for a scale of 1."""
        if self._scale == 1.0:
            return ends
        lower, upper = (fixed + self._scale * (end - fixed) for end in ends)
        return lower, upper


class Uniform(_Interval):
    """Uniform distribution in an interval about nominal + offset, or between fixed limits.

    The variance is (upper − lower)² / 12.

    Parameters
    ----------
    spec : hillsphere.uncertainty.specs.UniformSpec
        Sizes.

    Raises
    ------
    InputError
        If a lower end is above its upper one.
    """

    def _support(self, nominal: Array) -> tuple[Array, Array]:
        ends = self._ends(nominal)
        if ends is None:
            return self._about(self._centre(nominal), nominal)
        return self._stretched(ends, 0.5 * (ends[0] + ends[1]))

    def _at(self, z: Array, nominal: Array) -> Array:
        lower, upper = (end[:, None] for end in self._support(nominal))
        values = 0.5 * (lower + upper) + 0.5 * (upper - lower) * (2.0 * ndtr(z) - 1.0)
        return np.asarray(np.clip(values, lower, upper))

    def mean(self, nominal: Array) -> Array:
        """Return the middle of the interval (k,), SI."""
        lower, upper = self._support(nominal)
        return np.asarray(0.5 * (lower + upper))

    def _deviation(self, nominal: Array) -> Array:
        lower, upper = self._support(nominal)
        return np.asarray((upper - lower) / sqrt(12.0))


class Triangular(_Interval):
    """Triangular distribution with its mode at nominal + offset.

    With lower end a, mode c and upper end b the mean is (a + b + c) / 3, the variance
    (a² + b² + c² − ab − ac − bc) / 18. Given limits are scaled about the mode.

    Parameters
    ----------
    spec : hillsphere.uncertainty.specs.TriangularSpec
        Sizes.

    Raises
    ------
    InputError
        If a lower end is above its upper one; at use, if a nominal value is not between them.
    """

    def _support(self, nominal: Array) -> tuple[Array, Array]:
        mode, ends = self._centre(nominal), self._ends(nominal)
        if ends is None:
            return self._about(mode, nominal)
        outside = (mode < ends[0]) | (mode > ends[1])
        if outside.any():
            at = int(np.argmax(outside))
            raise InputError(
                f"the nominal value {mode[at]:.12g}, the most probable one, must lie between lower "
                f"and upper, {ends[0][at]:.12g} and {ends[1][at]:.12g} (SI)"
            )
        return self._stretched(ends, mode)

    def _at(self, z: Array, nominal: Array) -> Array:
        lower, upper = (end[:, None] for end in self._support(nominal))
        mode, width = self._centre(nominal)[:, None], upper - lower
        # Inverse of the distribution function, (x − a)²/((b − a)(c − a)) below the mode c and
        # 1 − (b − x)²/((b − a)(b − c)) above it.
        rising = lower + np.sqrt(ndtr(z) * width * (mode - lower))
        falling = upper - np.sqrt(ndtr(-z) * width * (upper - mode))
        values = np.where(ndtr(z) * width < mode - lower, rising, falling)
        return np.asarray(np.clip(values, lower, upper))

    def mean(self, nominal: Array) -> Array:
        """Return the mean (k,), SI; it equals the mode if the interval is symmetric about it."""
        lower, upper = self._support(nominal)
        mode = self._centre(nominal)
        return np.asarray(mode + ((upper - mode) - (mode - lower)) / 3.0)

    def _deviation(self, nominal: Array) -> Array:
        lower, upper = self._support(nominal)
        mode = self._centre(nominal)
        # The variance in the class docstring, by the distances of the ends from the mode.
        left, right = mode - lower, upper - mode
        return np.asarray(np.sqrt((left**2 + right**2 + left * right) / 18.0))


class LogNormal(Distribution):
    """Log-normal distribution: nominal value times exp(s z), with s = `scale` · ln(`factor`).

    The median is the nominal value, the mean exp(s²/2) times it, the covariance of two quantities
    mean_i mean_j (exp(ρ s_i s_j) − 1).

    Parameters
    ----------
    spec : LogNormalSpec
        Sizes.
    """

    def __init__(self, spec: LogNormalSpec) -> None:
        super().__init__(spec)
        self._spec = spec

    def _log(self, nominal: Array) -> Array:
        return self._scale * np.log(self._sizes(self._spec.factor, nominal, "factor"))

    def _at(self, z: Array, nominal: Array) -> Array:
        return np.asarray(nominal[:, None] * np.exp(self._log(nominal)[:, None] * z))

    def mean(self, nominal: Array) -> Array:
        """Return the mean (k,), SI."""
        return np.asarray(nominal * np.exp(0.5 * self._log(nominal) ** 2))

    def _deviation(self, nominal: Array) -> Array:
        return np.asarray(np.abs(self.mean(nominal)) * np.sqrt(np.expm1(self._log(nominal) ** 2)))

    def _support(self, nominal: Array) -> tuple[Array, Array]:
        away = np.where(self._log(nominal) > 0.0, np.copysign(np.inf, nominal), nominal)
        near = np.where(self._log(nominal) > 0.0, 0.0, nominal)
        return np.minimum(near, away), np.maximum(near, away)

    def _joint(self, correlation: Array, nominal: Array) -> Array:
        mean, log = self.mean(nominal), self._log(nominal)
        return np.asarray(np.outer(mean, mean) * np.expm1(correlation * np.outer(log, log)))

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return the median divided and multiplied by factor^sigmas (k,), SI."""
        ends = self._at(np.tile([-sigmas, sigmas], (len(nominal), 1)), nominal)
        return ends.min(axis=1), ends.max(axis=1)


class Choice(Distribution):
    """Discrete distribution: one of several values, each with its probability.

    Parameters
    ----------
    spec : ChoiceSpec
        Values and weights.
    """

    def __init__(self, spec: ChoiceSpec) -> None:
        super().__init__(spec)
        values = self._factor * np.array(spec.values, dtype=float)
        weights = np.ones(len(values)) if spec.weights is None else np.array(spec.weights)
        order = np.argsort(values, kind="stable")
        self._share = (weights / weights.sum())[order]
        self._mean = float(self._share @ values[order])
        values = values[order]
        if self._scale != 1.0:
            values = self._mean + self._scale * (values - self._mean)
        self._values = values
        # Thresholds between neighbouring values. The last sum is 1 but for rounding and is no
        # threshold.
        self._steps = np.cumsum(self._share)[:-1]

    def _at(self, z: Array, nominal: Array) -> Array:
        return np.asarray(self._values[np.searchsorted(self._steps, ndtr(z), side="right")])

    def mean(self, nominal: Array) -> Array:
        """Return the weighted mean of the values (k,), SI."""
        return np.full(nominal.shape, self._mean)

    def _deviation(self, nominal: Array) -> Array:
        deviation = sqrt(float(self._share @ (self._values - self._mean) ** 2))
        return np.full(nominal.shape, deviation)

    def _support(self, nominal: Array) -> tuple[Array, Array]:
        possible = self._values[self._share > 0.0]
        return np.full(nominal.shape, possible[0]), np.full(nominal.shape, possible[-1])
