"""Distributions of uncertain quantities."""

from __future__ import annotations

from typing import Protocol

from hillsphere.base.arrays import Array

__all__ = ["Dispersion"]


class Dispersion(Protocol):
    """How some quantities of a mission are distributed about their nominal values."""

    @property
    def of(self) -> str:
        """Table of the mission that they belong to, ``"gravity.phobos"``."""
        ...

    @property
    def keys(self) -> tuple[str, ...]:
        """Their names there: parameters of a model, ``"state.x"``; ``*`` is any characters."""
        ...

    @property
    def unit(self) -> str:
        """SI unit that its quantities must have, as `Parameter.unit`; ``""`` for any."""
        ...

    def quantiles(self, u: Array, nominal: Array) -> Array:
        """Return values (k, N), SI, for numbers u (k, N) in (0, 1), independent and uniform.

        nominal (k,) are the nominal values. Correlation is brought in here.
        """
        ...

    def mean(self, nominal: Array) -> Array:
        """Return the mean values (k,), SI."""
        ...

    def covariance(self, nominal: Array) -> Array:
        """Return the covariance (k, k), SI: for filters."""
        ...

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return least and largest values (k,), SI, at so many standard deviations: for LFTs.

        A distribution of bounded support never exceeds it.
        """
        ...
