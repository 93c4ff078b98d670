"""Interval bounds of events that are given as expressions, not by a plant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.enclosures import Bounded, LinearRows
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.dynamics.system import System
from hillsphere.symbolic.expressions import (
    Expr,
    jacobian,
    parameter_names,
    substitute,
    time,
    variable,
    variable_names,
)

__all__ = ["bounds_of_event"]


@dataclass(frozen=True, eq=False)
class _One:
    """One event of a system."""

    system: Bounded
    row: int
    linear: LinearRows | None = None

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the system's rates."""
        return self.system.rates(t, y, p)

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the one event."""
        return [self.system.events(t, y, p)[self.row]]


@dataclass(frozen=True, eq=False)
class _Quadratic:
    """The quadratic form ½ xᵀ H x + b·x; a constant does not affect its derivatives."""

    system: Bounded
    form: Array
    slope: Array
    linear: LinearRows | None = None

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the system's rates."""
        return self.system.rates(t, y, p)

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the form and its rate."""
        total = Bound.of(0.0)
        for i, one in enumerate(y[: len(self.slope)]):
            if self.slope[i]:
                total = total + float(self.slope[i]) * one
            for j in range(i + 1):
                if self.form[i, j]:
                    factor = float(self.form[i, j]) * (0.5 if i == j else 1.0)
                    total = total + factor * (one * y[j])
        return [total]


def bounds_of_event(system: System, event: str | Expr) -> Bounded | None:
    """Return interval bounds of an event of the system, or of a polynomial of degree ≤ 2.

    Parameters
    ----------
    system : System
        The equations.
    event : str or Expr
        Name, or an expression of its states, time and parameters.

    Returns
    -------
    Bounded or None
        None for other expressions, whose structure cannot be examined.
    """
    if system.bounded is None:
        return None
    if isinstance(event, str):
        return _One(system.bounded, list(system.events).index(event))
    when = variable("proof:when")
    if "proof:when" in variable_names(substitute([event], {time: when})):
        return None
    n = len(system.x)
    slopes = jacobian([event], system.x)[0]
    bends = [e for row in jacobian(slopes, system.x) for e in row]
    if variable_names(bends) or parameter_names([*slopes, *bends]):
        return None
    # The engine does not fold every constant, so that the numbers are evaluated.
    derivatives = ArrayFunction([*slopes, *bends], system.x)(np.zeros(n))
    return _Quadratic(system.bounded, derivatives[n:].reshape(n, n), derivatives[:n])
