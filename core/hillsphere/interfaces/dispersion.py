"""Distributions of uncertain quantities."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract

__all__ = ["Dispersion", "StageDispersion", "StartedStage"]


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


@runtime_checkable
class StageDispersion(Contract, Protocol):
    """A `Dispersion` whose numbers the repeated stage gives."""

    def bind_to(self, stage: object) -> Dispersion:
        """Return the distribution with the numbers of a stage.

        Raises
        ------
        InputError
            If the stage does not give them; the message begins with a key.
        """
        ...


@runtime_checkable
class StartedStage(Contract, Protocol):
    """A stage whose start a message may state, with a covariance."""

    def start_covariance(self) -> Array:
        """Return the covariance (6, 6) of position and velocity in the plant's frame, SI.

        Raises
        ------
        InputError
            If no message states one.
        """
        ...
