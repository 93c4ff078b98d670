"""The sample with the largest norm among many systems, such as samples of an uncertain one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm

__all__ = ["WorstSample", "hinf_value", "worst_sample"]


@dataclass(frozen=True)
class WorstSample:
    """The worst sample and all values.

    Parameters
    ----------
    value : float
        The largest value; infinite as soon as one sample is not stable.
    index : int
        Which sample has it: the first of them.
    system : LtiSystem
        That sample.
    values : ndarray, shape (N,)
        Of all samples, in their order.
    """

    value: float
    index: int
    system: LtiSystem
    values: Array


def hinf_value(system: LtiSystem) -> float:
    """Return the H∞ norm of a system, the number alone.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time; the norm of an unstable one is infinite.

    Returns
    -------
    float
        The norm.

    Raises
    ------
    InputError
        If rounding can change it by more than a hundredth: see `HinfNorm`.
    """
    norm = hinf_norm(system)
    if norm.doubt:
        raise InputError(f"the system's entries do not determine its norm: {norm.doubt}")
    return norm.value


def worst_sample(
    samples: Iterable[LtiSystem], measure: Callable[[LtiSystem], float] = hinf_value
) -> WorstSample:
    """Return the sample of the largest measure.

    It bounds the worst case from below: between the samples there may be worse.

    Parameters
    ----------
    samples : iterable of LtiSystem
        Taken one at a time; only the worst one is kept.
    measure : callable
        From a system to a number, such as `hinf_value`, `h2_norm` or `spectral_abscissa`.

    Returns
    -------
    WorstSample
        The sample, its number and its measure.

    Raises
    ------
    InputError
        If there is no sample, or a measure is not a number.
    """
    worst: tuple[float, int, LtiSystem] | None = None
    values = []
    for index, system in enumerate(samples):
        value = float(measure(system))
        if np.isnan(value):
            raise InputError(f"the measure of sample {index} is not a number")
        values.append(value)
        if worst is None or value > worst[0]:
            worst = (value, index, system)
    if worst is None:
        raise InputError("no samples to take the worst of")
    return WorstSample(*worst, np.array(values))
