"""Dispersion of an initial state by the covariance that its message states."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.interfaces.dispersion import StartedStage
from hillsphere.uncertainty.copula import covariance_factor
from hillsphere.uncertainty.distribution import PROBABILITIES, multiply_lower
from hillsphere.uncertainty.specs import StartCovarianceSpec

__all__ = ["StartCovariance"]


class StartCovariance:
    """Normal distribution of the six states of a start, with the covariance of ``start.message``.

    The covariance is that of the message, in the plant's frame; see
    `hillsphere.engine.start_messages.start_of_message`. It is known once the distribution is bound
    to the repeated stage.

    Parameters
    ----------
    spec : StartCovarianceSpec
        Names and scale.
    covariance : ndarray, shape (6, 6), optional
        Of position and velocity, SI; None before `bind_to`.
    """

    def __init__(self, spec: StartCovarianceSpec, covariance: Array | None = None) -> None:
        self.of, self.keys, self.unit, self._spec = spec.of, spec.parameters, "", spec
        self._covariance = None if covariance is None else spec.scale**2 * covariance
        self._lower = None if covariance is None else spec.scale * covariance_factor(covariance)

    def bind_to(self, stage: object) -> StartCovariance:
        """Return the distribution of the start of a stage.

        Raises
        ------
        InputError
            If the stage has no start of which a message states the covariance.
        """
        if not isinstance(stage, StartedStage):
            raise InputError(
                f"of: {type(stage).__name__} has no start that a message states; expected a stage "
                "with start.message, such as closed_loop"
            )
        return StartCovariance(self._spec, stage.start_covariance())

    def quantiles(self, u: Array, nominal: Array) -> Array:
        """Return values (6, N), SI, for independent uniform numbers u (6, N) in (0, 1).

        Parameters
        ----------
        u : ndarray, shape (6, N)
            One row per state.
        nominal : ndarray, shape (6,)
            Nominal values, which are the means.
        """
        self._check(nominal)
        assert self._lower is not None
        z = ndtri(np.clip(u, *PROBABILITIES))
        return np.asarray(nominal[:, None] + multiply_lower(self._lower, z))

    def mean(self, nominal: Array) -> Array:
        """Return the nominal values (6,), SI."""
        self._check(nominal)
        return np.array(nominal)

    def covariance(self, nominal: Array) -> Array:
        """Return the covariance (6, 6), SI."""
        self._check(nominal)
        assert self._covariance is not None
        return np.array(self._covariance)

    def bounds(self, nominal: Array, sigmas: float) -> tuple[Array, Array]:
        """Return mean ∓ `sigmas` standard deviations (6,), SI."""
        if self._covariance is None:
            return np.array(nominal), np.array(nominal)
        reach = sigmas * np.sqrt(np.diag(self._covariance))
        return nominal - reach, nominal + reach

    def _check(self, nominal: Array) -> None:
        if len(nominal) != 6:
            raise InputError(
                f"parameters: expected six states, position and velocity, got {len(nominal)}"
            )
        if self._covariance is None:
            raise InputError("of: the covariance is that of a start; name the stage that has it")
