"""The conformance kit finds what is broken in an estimator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Estimator
from hillsphere.testing import ContractViolation, check_estimator, example


class Wrapped:
    """A sound estimator whose answers pass through functions."""

    def __init__(self) -> None:
        self._sound: Estimator = example("estimator", "unscented")

    def predict(
        self, model: EstimationModel, belief: Belief, t_to_s: Array, control: Array
    ) -> Belief:
        return self.ahead(self._sound.predict(model, belief, t_to_s, control), belief)

    def update(
        self, model: EstimationModel, belief: Belief, measurements: MeasurementSet
    ) -> tuple[Belief, Innovation]:
        after, brought = self._sound.update(model, belief, self.given(measurements))
        return self.known(after, belief), self.told(brought)

    def ahead(self, later: Belief, belief: Belief) -> Belief:
        return later

    def given(self, measurements: MeasurementSet) -> MeasurementSet:
        return measurements

    def known(self, after: Belief, belief: Belief) -> Belief:
        return after

    def told(self, brought: Innovation) -> Innovation:
        return brought


class Unmoved(Wrapped):
    def ahead(self, later: Belief, belief: Belief) -> Belief:
        return replace(later, t_s=belief.t_s)


class Full(Wrapped):
    def known(self, after: Belief, belief: Belief) -> Belief:
        return replace(after, root=np.linalg.qr(after.root)[0] @ after.root)


class Certain(Wrapped):
    def known(self, after: Belief, belief: Belief) -> Belief:
        root = after.root.copy()
        root[:, 3] = 0.0
        return replace(after, root=root)


class Noiseless(Wrapped):
    def ahead(self, later: Belief, belief: Belief) -> Belief:
        return replace(later, root=0.9 * belief.root)


class Mixed(Wrapped):
    def known(self, after: Belief, belief: Belief) -> Belief:
        weights = 1.0 + 1e-4 * np.arange(after.x.shape[1])
        return replace(after, x=after.x * weights)


class Careless(Wrapped):
    def known(self, after: Belief, belief: Belief) -> Belief:
        return replace(after, root=0.99 * after.root)


class Straight(Wrapped):
    def given(self, measurements: MeasurementSet) -> MeasurementSet:
        if len(measurements.blocks) == 1:
            return measurements
        # angles taken for numbers
        first = measurements.blocks[0]
        blocks = ((replace(first[0], kind="linear"), first[1]), *measurements.blocks[1:])
        return replace(measurements, blocks=blocks)


class Boastful(Wrapped):
    def told(self, brought: Innovation) -> Innovation:
        return replace(brought, used=np.ones_like(brought.used))


class Decorrelated(Wrapped):
    def given(self, measurements: MeasurementSet) -> MeasurementSet:
        return replace(measurements, correlation=None)


class Absent(Wrapped):
    def given(self, measurements: MeasurementSet) -> MeasurementSet:
        sigma = np.where(np.isfinite(measurements.sigma), measurements.sigma, 1.0)
        values = np.where(np.isfinite(measurements.values), measurements.values, 0.5)
        return replace(
            measurements, values=values, sigma=sigma, present=np.ones_like(measurements.present)
        )


class Spoiling(Wrapped):
    def known(self, after: Belief, belief: Belief) -> Belief:
        belief.x[0] += 1.0
        return after


class Random(Wrapped):
    def __init__(self) -> None:
        super().__init__()
        self.random = np.random.default_rng(1)

    def known(self, after: Belief, belief: Belief) -> Belief:
        return replace(after, x=after.x + 1e-12 * self.random.normal(size=after.x.shape))


def test_a_sound_one_passes() -> None:
    check_estimator(Wrapped())


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (Unmoved(), "not at the time asked for"),
        (Full(), "not lower triangular"),
        (Certain(), "lost its rank"),
        (Noiseless(), "known better after a prediction"),
        (Mixed(), "off by"),
        (Careless(), "off by"),
        (Straight(), "revolution off"),
        (Boastful(), "hold nothing"),
        (Absent(), "hold nothing"),
        (Decorrelated(), "of a linear problem is off by"),
        (Spoiling(), "changes an argument"),
        (Random(), "same call of update differs"),
        (object(), "is no Estimator"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_broken(broken: Any, message: str) -> None:
    with pytest.raises(ContractViolation, match=message):
        check_estimator(broken)
