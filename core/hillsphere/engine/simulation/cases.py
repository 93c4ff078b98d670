"""Cases of a closed-loop simulation, and their validation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import spread
from hillsphere.engine.dynamics.lanes import per_lane
from hillsphere.interfaces.quantities import Parameter

__all__ = ["Batch", "Cases", "batch_of"]


@dataclass(frozen=True)
class Cases:
    """Initial states and per-case inputs of N cases.

    Parameters
    ----------
    x0 : array_like, shape (n, N)
        True states at the start, SI; a case that starts with a NaN ends as ``diverged``.
    p : array_like, shape (k, N) or (k,), optional
        Run-time parameters of the plant in the order of the simulator's `run_time`, SI; by default
        nominal.
    gain : array_like, shape (r, r, N), optional
        Effectiveness of the actuator, constant over a flight: executed is gain · command.
    numbers : array_like of int, shape (N,), optional
        Number of each case, by which limits and references identify it; by default 0 … N − 1.
    draws : array_like of int, shape (N,), optional
        Number by which the noise of each case is drawn: cases with equal numbers have equal noise.
        By default `numbers`.
    t0_s : float or array_like, shape (N,)
        Time at the start.
    period_s : float or array_like, shape (N,), optional
        Sampling period of each case, for a law without states of its own; by default the law's.
    dv_budget_m_s : float or array_like, shape (N,), optional
        Available Δv; by default unlimited.
    """

    x0: Any
    p: Any = None
    gain: Any = None
    numbers: Any = None
    draws: Any = None
    t0_s: Any = 0.0
    period_s: Any = None
    dv_budget_m_s: Any = None


@dataclass(frozen=True)
class Batch:
    """Cases as validated arrays, whose last axis is that of the cases."""

    x0: Array
    p: Array
    gain: Array | None
    numbers: Integers
    draws: Integers
    t0: Array
    period: Array
    budget: Array
    samples: Integers

    def __len__(self) -> int:
        return len(self.numbers)

    def lanes(self, which: Integers) -> Batch:
        """Return some of the cases, in contiguous arrays."""
        return replace(
            self,
            x0=np.ascontiguousarray(self.x0[:, which]),
            p=np.ascontiguousarray(self.p[:, which]),
            gain=None if self.gain is None else np.ascontiguousarray(self.gain[:, :, which]),
            numbers=self.numbers[which],
            draws=self.draws[which],
            t0=self.t0[which],
            period=self.period[which],
            budget=self.budget[which],
            samples=self.samples[which],
        )


def batch_of(
    cases: Cases,
    samples: int | ArrayLike,
    *,
    states: int,
    parameters: tuple[Parameter, ...],
    rows: int,
    period_s: float,
    memory: bool,
) -> Batch:
    """Validate cases for a simulator.

    Parameters
    ----------
    cases : Cases
        The cases as given by the caller.
    samples : int or array_like of int, shape (N,)
        Numbers of samples.
    states, rows : int
        Number of the plant's states and of components of a command.
    parameters : tuple of Parameter
        The k run-time parameters.
    period_s : float
        Sampling period of the law, s.
    memory : bool
        Whether the law has states of its own.

    Returns
    -------
    Batch
        The validated arrays.

    Raises
    ------
    InputError
        If a shape or a value is invalid; the message names the field.
    """
    x0 = np.array(cases.x0, dtype=float)
    if x0.ndim != 2 or len(x0) != states:
        raise InputError(f"x0 must be ({states}, N), got {x0.shape}")
    total = x0.shape[1]
    p = [q.value for q in parameters] if cases.p is None else cases.p
    gain = cases.gain
    if gain is not None:
        gain = np.array(gain, dtype=float)
        if gain.shape != (rows, rows, total) or not np.isfinite(gain).all():
            raise InputError(f"gain must be {(rows, rows, total)} and finite, got {gain.shape}")
    if cases.period_s is not None and memory:
        raise InputError(
            f"the law has states of its own, made for its period of {period_s:g} s; leave "
            "Cases.period_s out"
        )
    period = per_lane(period_s if cases.period_s is None else cases.period_s, total, "period_s")
    if not (period > 0).all():
        raise InputError(f"period_s must be positive, got {cases.period_s}")
    budget = np.asarray(np.inf if cases.dv_budget_m_s is None else cases.dv_budget_m_s, dtype=float)
    if budget.shape not in ((), (total,)) or not (budget >= 0).all():
        raise InputError(
            f"dv_budget_m_s must be ≥ 0, a number or ({total},), got {cases.dv_budget_m_s}"
        )
    numbers = np.arange(total) if cases.numbers is None else cases.numbers
    return Batch(
        x0,
        spread(p, len(parameters), total, "p"),
        gain,
        _whole(numbers, total, "numbers"),
        _whole(numbers if cases.draws is None else cases.draws, total, "draws"),
        per_lane(cases.t0_s, total, "t0_s"),
        period,
        np.broadcast_to(budget, (total,)),
        _whole(samples, total, "samples"),
    )


def _whole(value: ArrayLike, total: int, name: str) -> Integers:
    array = np.asarray(value)
    fits = array.shape == (total,) or (array.shape == () and name == "samples")
    if array.size == 0 and fits:
        return np.zeros(total, dtype=np.int64)
    if not fits or array.dtype.kind not in "iu" or array.min() < 0:
        raise InputError(f"{name} must be ({total},) whole numbers ≥ 0, got {value!r}")
    return np.broadcast_to(array, (total,)).astype(np.int64)
