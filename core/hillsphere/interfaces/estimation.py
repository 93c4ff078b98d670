"""Estimators, and the models that they are told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.interfaces.beliefs import Belief, Innovation, MeasurementSet

__all__ = ["ConsiderModel", "EstimationModel", "Estimator", "LinearisedModel"]


class EstimationModel(Protocol):
    """What an estimator believes of the world: motion, its noise, and what sensors would show.

    Pure functions of columns, each of which belongs to a case: K columns hold, for instance, the
    sigma points of all cases, and `case` (K,) says which column is whose. States are SI.
    """

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Return the states (n, K) at times t1_s (K,) of those x (n, K) at t0_s (K,), s.

        control (p, K) is that of the case of each column; p may be zero.
        """
        ...

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return roots G (N, n, r) of the covariance G Gᵀ that noise adds meanwhile.

        x (n, N), t0_s and t1_s (N,), control (p, N): one column a case.
        """
        ...

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return what perfect sensors show of x (n, K) at t_s (K,), SI, (m, K).

        In the order of the rows of a `hillsphere.estimation.MeasurementSet`; what is not measured
        may be anything.
        """
        ...


@runtime_checkable
class LinearisedModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` that knows its derivatives; else they are taken by differences."""

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the derivatives (N, n, n) of `advance` by the states x (n, N)."""
        ...

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        """Return the derivatives (N, m, n) of `observe` by the states x (n, N)."""
        ...


@runtime_checkable
class ConsiderModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` some of whose states are not estimated, only reckoned with."""

    @property
    def considered(self) -> NDArray[np.bool_]:
        """Which states no measurement may change, (n,)."""
        ...


@runtime_checkable
class Estimator(Contract, Protocol):
    """From measurements to a belief of the states, N independent cases at once.

    Pure functions of frozen beliefs; streaming is N = 1.
    """

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times t_to_s (N,), s, under the controls (p, N)."""
        ...

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after the measurements, taken at its own time, and what they brought.

        Rows that are not present change nothing.
        """
        ...
