"""Distributions of uncertain quantities."""

from __future__ import annotations

from typing import Protocol

from hillsphere.base.arrays import Array

__all__ = ["Dispersion"]


class Dispersion(Protocol):
    """Joint distribution of some quantities of a mission about their nominal values."""

    @property
    def of(self) -> str:
        """Table of the mission to which the quantities belong, ``"gravity.phobos"``."""
        ...

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the quantities in that table, ``"state.x"``; ``*`` matches any characters."""
        ...

    @property
    def unit(self) -> str:
        """SI unit that its quantities must have, as `Parameter.unit`; ``""`` for any."""
        ...

    def quantiles(self, u: Array, nominal: Array) -> Array:
        """Return values (k, N), SI, for independent uniform numbers u (k, N) in (0, 1).

        nominal (k,) are the nominal values. The values have the declared correlation.
        """
        ...

    def mean(self, nominal: Array) -> Array:
        """Return the mean values (k,), SI."""
        ...

    def covariance(self, nominal: Array) -> Array:
        """Return the covariance (k, k), SI, as filters use it."""
        ...

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return least and largest values (k,), SI, at `sigmas` standard deviations, for LFTs.

        They lie within the support of a bounded distribution.
        """
        ...
