"""Specs of the estimators: the keys of ``[estimator.NAME]`` in a mission."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from hillsphere.spec import Spec, option

__all__ = [
    "BatchedUnscentedSpec",
    "GaussianSumSpec",
    "InformationSpec",
    "IteratedExtendedSpec",
    "SequentialExtendedSpec",
    "SequentialUnscentedSpec",
]

_GATE = (
    "gate: a block of measurements is rejected if its innovation is as improbable as a normal "
    "number beyond this many standard deviations; left out: no gate"
)


class _SigmaPointSpec(Spec):
    """Parameters of scaled sigma points."""

    alpha: float = option("scale of the sigma points", default=1.0, gt=0, le=2)
    beta: float = option(
        "weight of the curvature in the covariance: at least the square of alpha; 2 is best for "
        "normal distributions",
        default=2.0, ge=0, le=100,
    )  # fmt: skip
    kappa: float = option("second scale, above minus the number of states", default=0.0, le=1000)

    @model_validator(mode="after")
    def _positive(self) -> Self:
        if self.beta < self.alpha**2:
            raise PydanticCustomError(
                "rule",
                "{text}",
                {"text": "must be at least alpha squared: else a covariance may be negative",
                 "key": "beta"},
            )  # fmt: skip
        return self


class BatchedUnscentedSpec(_SigmaPointSpec):
    """An unscented Kalman filter in square-root form on all cases at once."""

    examples = (
        {},
        {"update": "tempered", "powers": 8, "gate_sigmas": 5},
        {"update": "iterated", "iterations": 8, "alpha": 0.5},
    )

    update: Literal["plain", "tempered", "iterated"] = option(
        "'plain': one linear update; 'tempered': the likelihood in several powers, with new sigma "
        "points for each; 'iterated': linearised about the posterior, repeatedly",
        default="plain",
    )
    powers: int = option(
        "most powers, with 'tempered' and where 'iterated' diverges. Each is so small that the "
        "curvature stays below its noise, except the last one, which is the rest",
        default=64, ge=2, le=1000,
    )  # fmt: skip
    iterations: int = option(
        "with 'iterated': most iterations; a case whose last step is longer than one standard "
        "deviation takes the tempered update",
        default=10, ge=1, le=200,
    )  # fmt: skip
    tolerance_sigmas: float = option(
        "with 'iterated': a case has converged when its mean moves by less, in standard deviations",
        default=1e-3, gt=0,
    )  # fmt: skip
    gate_sigmas: float | None = option(
        f"{_GATE}. Where the curvature of the predicted measurement exceeds its noise (a wide "
        "belief) a block is accepted without a test",
        default=None, gt=0, le=30,
    )  # fmt: skip


class GaussianSumSpec(Spec):
    """A Gaussian-sum filter on all cases at once, for wide priors and ambiguous measurements."""

    examples = ({}, {"components": 200, "curvature": 0.1, "gate_sigmas": 5})

    components: int = option(
        "most components of a case; where they do not suffice, curvature counts as noise and the "
        "belief says so (`unresolved`)",
        default=200, ge=1, le=2000,
    )  # fmt: skip
    curvature: float = option(
        "largest variance that the curvature across a component may add to its measurements, in "
        "units of the noise's variance; a component that exceeds it is split",
        default=0.05, gt=0, le=10,
    )  # fmt: skip
    gate_sigmas: float | None = option(
        f"{_GATE}. A block is accepted without a test while the components are spread or curved by "
        "more than its noise",
        default=None, gt=0, le=30,
    )  # fmt: skip


class IteratedExtendedSpec(Spec):
    """A damped iterated extended Kalman filter on all cases at once."""

    examples = ({}, {"iterations": 30, "gate_sigmas": 5})

    iterations: int = option("most iterations; 1: the extended Kalman filter", default=20, ge=1)
    tolerance_sigmas: float = option(
        "a case has converged when its mean moves by less, in standard deviations",
        default=1e-8,
        gt=0,
    )
    gate_sigmas: float | None = option(_GATE, default=None, gt=0, le=30)


class InformationSpec(Spec):
    """A square-root information filter on all cases at once."""

    examples = ({}, {"iterations": 30})

    iterations: int = option("most relinearisations", default=20, ge=1)
    tolerance_sigmas: float = option(
        "a case has converged when its mean moves by less, in standard deviations",
        default=1e-8,
        gt=0,
    )


class SequentialUnscentedSpec(_SigmaPointSpec):
    """FilterPy's unscented Kalman filter, case by case."""

    examples = ({}, {"alpha": 0.5, "kappa": 1})


class SequentialExtendedSpec(Spec):
    """FilterPy's extended Kalman filter, case by case."""

    examples = ({},)
