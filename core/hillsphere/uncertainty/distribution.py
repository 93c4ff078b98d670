"""Base of marginal distributions whose correlation is a Gaussian copula.

Each quantity is a function of a standard normal number z: value = F⁻¹(Φ(z)). Random draws, designs
that fill the unit cube, correlation and bounds at a number of standard deviations all use it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from scipy.special import ndtri

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.spec.units import UNITS
from hillsphere.uncertainty.copula import copula_covariance, correlated_factor
from hillsphere.uncertainty.specs import ContinuousSpec, DispersionSpec

__all__ = [
    "PROBABILITIES", "Distribution", "Sizes", "multiply_lower", "require_count", "si_unit",
]  # fmt: skip

Sizes = float | tuple[float, ...]
"""One number for all quantities, or one per quantity."""

PROBABILITIES = 2.0**-54, 1.0 - 2.0**-53
"""Bounds of a probability whose normal quantile is finite: 0 and 1 would give −∞ and ∞. The upper
one is the largest float below one; the two quantiles are −8.3 and 8.2."""


def si_unit(unit: str) -> tuple[str, float]:
    """Return the SI unit of a unit's dimension, as models write it (``"m3/s2"``), and the factor.

    Parameters
    ----------
    unit : str
        A suffix of `hillsphere.spec.units.UNITS`, or ``""``.

    Returns
    -------
    tuple of str and float
        ``("", 1.0)`` if none is given: the numbers are SI, of any dimension.
    """
    for suffixes in UNITS.values():
        if unit in suffixes:
            return next(iter(suffixes)).replace("_", "/"), suffixes[unit]
    return "", 1.0


def require_count(given: int, wanted: int, key: str) -> None:
    """Raise `InputError` if a key has values for another number of quantities than wanted.

    Parameters
    ----------
    given : int
        How many values the key has.
    wanted : int
        How many quantities there are.
    key : str
        The key, for the message.

    Raises
    ------
    InputError
        If the numbers differ.
    """
    if given != wanted:
        raise InputError(
            f"{key} is given for {given} quantities, but parameters matches {wanted}; give one "
            "value for each, in the order in which parameters matches them"
        )


def multiply_lower(lower: Array, z: Array) -> Array:
    """Return L z, whose columns do not depend on each other's number.

    Parameters
    ----------
    lower : ndarray, shape (k, k)
        Lower triangular L.
    z : ndarray, shape (k, N)
        A column per case.

    Returns
    -------
    ndarray, shape (k, N)
        The products.

    Notes
    -----
    The last bits of NumPy's matrix product depend on N and on the number of threads. They must not
    here: a case must have the same value whatever other cases are drawn with it.
    """
    out = np.zeros_like(z)
    for j, row in enumerate(z):
        out[j:] += lower[j:, j, None] * row
    return out


class Distribution(ABC):
    """Base class of distributions, see `hillsphere.interfaces.Dispersion`.

    Parameters
    ----------
    spec : DispersionSpec
        Names, unit and sizes of the quantities.
    """

    def __init__(self, spec: DispersionSpec) -> None:
        self.of = spec.of
        self.keys = spec.parameters
        self.unit, self._factor = si_unit(spec.unit)
        self._scale = spec.scale
        given = spec.correlation if isinstance(spec, ContinuousSpec) else None
        self._correlation = None if given is None else np.array(given, dtype=float)
        self._lower = None if given is None else correlated_factor(np.array(given, dtype=float))

    @abstractmethod
    def _at(self, z: Array, nominal: Array) -> Array:
        """Return values (k, N) at standard normal numbers z (k, N)."""

    @abstractmethod
    def mean(self, nominal: Array) -> Array:
        """Return the mean values (k,), SI, for nominal values (k,)."""

    @abstractmethod
    def _deviation(self, nominal: Array) -> Array:
        """Return standard deviations (k,), SI."""

    @abstractmethod
    def _support(self, nominal: Array) -> tuple[Array, Array]:
        """Return least and largest possible values (k,), SI."""

    def quantiles(self, u: Array, nominal: Array) -> Array:
        """Return values (k, N), SI, for independent uniform numbers u (k, N) in (0, 1).

        Parameters
        ----------
        u : ndarray, shape (k, N)
            One row per quantity; 0 and 1 are replaced by the nearest numbers between them.
        nominal : ndarray, shape (k,)
            Nominal values, SI.

        Raises
        ------
        InputError
            If sizes or correlations are given for another number of quantities.
        """
        z = ndtri(np.clip(u, *PROBABILITIES))
        if self._lower is not None:
            require_count(len(self._lower), len(nominal), "correlation")
            z = multiply_lower(self._lower, z)
        return self._at(z, nominal)

    def covariance(self, nominal: Array) -> Array:
        """Return the covariance (k, k), SI.

        Variances are exact. Covariances follow from the Gaussian copula: exactly for `Normal`
        without truncation and for `LogNormal`, otherwise by a series
        (`hillsphere.uncertainty.copula.copula_covariance`).
        """
        deviation = self._deviation(nominal)
        if self._correlation is None:
            return np.diag(deviation**2)
        require_count(len(self._correlation), len(nominal), "correlation")
        covariance = self._joint(self._correlation, nominal)
        np.fill_diagonal(covariance, deviation**2)
        return covariance

    def _joint(self, correlation: Array, nominal: Array) -> Array:
        """Return the off-diagonal covariances (k, k); the diagonal is replaced."""
        return copula_covariance(lambda z: self._at(z, nominal), correlation)

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return mean ∓ `sigmas` standard deviations (k,), SI, limited to the support."""
        mean, reach = self.mean(nominal), sigmas * self._deviation(nominal)
        least, largest = self._support(nominal)
        return np.maximum(mean - reach, least), np.minimum(mean + reach, largest)

    def _sizes(self, given: Sizes, nominal: Array, key: str) -> Array:
        """Return one size per quantity (k,), in the given unit."""
        sizes = np.array(given, dtype=float)
        if sizes.ndim:
            require_count(len(sizes), len(nominal), key)
        return np.broadcast_to(sizes, nominal.shape)

    def _width(
        self,
        absolute: Sizes | None,
        relative: Sizes | None,
        nominal: Array,
        key: str,
    ) -> Array:
        """Return one width per quantity (k,), SI, times the scale."""
        if absolute is not None:
            return self._scale * self._factor * self._sizes(absolute, nominal, key)
        assert relative is not None
        sizes = self._sizes(relative, nominal, f"{key}_relative")
        return np.asarray(self._scale * sizes * np.abs(nominal))

    def _shifted(self, offset: Sizes, nominal: Array) -> Array:
        return nominal + self._factor * self._sizes(offset, nominal, "offset")
