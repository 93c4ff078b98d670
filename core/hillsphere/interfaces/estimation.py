"""Estimators, and the models of motion and measurement that they use."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.interfaces.beliefs import Belief, Innovation, MeasurementSet

__all__ = ["AngularModel", "ConsiderModel", "EstimationModel", "Estimator", "LinearisedModel"]


class EstimationModel(Protocol):
    """The estimator's model: state transition, process noise, and measurement function.

    Pure functions of K columns, for instance the sigma points of all cases; `case` (K,) gives the
    case of each column. States are SI.
    """

    def advance(self, x: Array, t0_s: Array, t1_s: Array, control: Array, case: Integers) -> Array:
        """Propagate the states x (n, K) from times t0_s (K,) to t1_s (K,), s.

        control (p, K) is the held control of each column; p may be zero.
        """
        ...

    def process_noise(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return factors G (N, n, r) of the covariance G Gᵀ of the process noise from t0 to t1.

        x (n, N), t0_s and t1_s (N,), control (p, N): one column a case.
        """
        ...

    def observe(self, x: Array, t_s: Array, case: Integers) -> Array:
        """Return the error-free measurements (m, K) of x (n, K) at t_s (K,), SI.

        Rows are those of a `hillsphere.estimation.MeasurementSet`; rows that are not measured hold
        arbitrary values.
        """
        ...


@runtime_checkable
class LinearisedModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` with analytic derivatives; without them differences are used."""

    def transition(self, x: Array, t0_s: Array, t1_s: Array, control: Array) -> Array:
        """Return the derivatives (N, n, n) of `advance` by the states x (n, N)."""
        ...

    def sensitivity(self, x: Array, t_s: Array) -> Array:
        """Return the derivatives (N, m, n) of `observe` by the states x (n, N)."""
        ...


@runtime_checkable
class ConsiderModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` with consider states, whose uncertainty counts but is not reduced."""

    @property
    def considered(self) -> NDArray[np.bool_]:
        """Mask of the consider states, bool (n,): measurements do not change them."""
        ...


@runtime_checkable
class AngularModel(EstimationModel, Contract, Protocol):
    """An `EstimationModel` with states that are angles, of which whole turns make no difference."""

    @property
    def angles(self) -> Sequence[int]:
        """Rows of the states that are angles, rad; their differences go the short way round."""
        ...


@runtime_checkable
class Estimator(Contract, Protocol):
    """An estimator (filter): from measurements to beliefs, for N independent cases at once.

    Pure functions of frozen beliefs. For a single stream of measurements, N = 1.

    An estimator whose update refuses models with consider states (see `ConsiderModel`) says so by
    an attribute ``considers`` that is False: a mission that asks for both is then refused before it
    runs.
    """

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        """Return the belief at later times t_to_s (N,), s, under the controls (p, N).

        Earlier times are refused unless there is no process noise.
        """
        ...

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        """Return the belief after measurements at its own time, and their innovation.

        Rows that are not present have no effect. A case whose prediction is no number is marked by
        a belief of NaN and leaves the others as they are; a single case raises.
        """
        ...
