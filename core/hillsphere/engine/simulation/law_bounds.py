"""Interval bounds of a plant with a continuous law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.enclosures import LinearRows
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.dynamics.system import PlantBounds
from hillsphere.engine.simulation.command_bounds import AffineLaw
from hillsphere.interfaces.loop import ContinuousLaw, JointLaw
from hillsphere.symbolic.expressions import norm

__all__ = ["LawBounds", "WithoutEffort", "law_matrix"]


@dataclass(frozen=True, eq=False)
class LawBounds:
    """The system of `hillsphere.engine.simulation.flow.closed_system` in interval arithmetic, SI.

    Parameters
    ----------
    plant : PlantBounds
        The plant, SI.
    law : ContinuousLaw
        The law.
    run_time : int
        Number of run-time parameters of the plant.
    vectors : int
        Number of thrust vectors of the command.
    linear : LinearRows or None
        Rows of the law's states, if its equations are linear in them.
    affine : AffineLaw or None
        The law in affine form, for faster bounds of its command, if its measurement is held.
    """

    plant: PlantBounds
    law: ContinuousLaw
    run_time: int
    vectors: int
    linear: LinearRows | None
    affine: AffineLaw | None = None

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the rates of the plant's states, the law's and the effort."""
        law, n = self.law, len(self.plant.unit)
        own, first = y[n:-1], self.run_time
        count, q = len(self.plant.plant.controls), self.law.inputs
        rows = [Bound(row) for row in p]
        feed = rows[first : first + count]
        gain = rows[first + count : first + count + count**2]
        begin = first + count + count**2
        ref, seen = rows[begin : begin + q], rows[begin + q : begin + 2 * q]
        sees = tuple(seen if law.measurement == "held" else y[:n])
        told = (tuple(own), sees, tuple(ref), t)
        if isinstance(law, JointLaw) and _gives_both(law):
            changes, own_command = law.rates_and_command(*told)
        else:
            changes, own_command = law.derivative(*told), law.control(*told)
        command = [Bound.of(c) + f for c, f in zip(own_command, feed, strict=True)]
        done = [
            _sum([g * c for g, c in zip(gain[i * count : (i + 1) * count], command, strict=True)])
            for i in range(count)
        ]
        inner = [Bound.of(change) for change in changes]
        size = count // self.vectors if count else 0
        effort = [norm(done[i : i + size]) for i in range(0, count, size or 1)]
        return [*self.plant.rates(t, y, p, done), *inner, _sum([Bound.of(part) for part in effort])]

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the plant's events."""
        return self.plant.events(t, y, p)


@dataclass(frozen=True, eq=False)
class WithoutEffort:
    """The same system without the effort, its last state, on which nothing else depends."""

    whole: LawBounds

    @property
    def linear(self) -> LinearRows | None:
        """Rows of a linear law's states, or None."""
        return self.whole.linear

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the rates of the plant's states and the law's."""
        return self.whole.rates(t, [*y, Bound.of(0.0)], p)[:-1]

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the plant's events."""
        return self.whole.events(t, [*y, Bound.of(0.0)], p)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def law_matrix(law: ContinuousLaw, inputs: int) -> Array | None:
    """Return A (m, m) of a law ẋ_c = A x_c + b(y, r, t); None if it is not of this form.

    The equations are differentiated in interval arithmetic for unbounded states and inputs. A
    derivative that is then a single number is constant.
    """
    m = len(law.states)
    if not m:
        return None
    anything = [Bound(iv.EVERYTHING) for _ in range(inputs)]
    columns = np.eye(m)
    states = [Bound(iv.EVERYTHING, iv.point(columns[i])) for i in range(m)]
    try:
        rates = [
            Bound.of(rate)
            for rate in law.derivative(
                tuple(states),
                tuple(anything),
                tuple(anything),
                Bound(iv.EVERYTHING),
            )
        ]
    except TypeError:
        return None
    matrix, error = np.zeros((m, m)), 0.0
    for i, rate in enumerate(rates):
        if rate.rate is not None:
            low, high = rate.rate
            matrix[i] = 0.5 * (low + high)
            error = max(error, float(np.max(high - low)))
    # Rounding of the sums alone makes the slopes of a linear law intervals.
    small = 1e-12 * float(np.max(np.abs(matrix), initial=0.0))
    return matrix if np.isfinite(matrix).all() and error <= small else None


def _sum(items: Sequence[Bound]) -> Bound:
    total = Bound.of(0.0)
    for item in items:
        total = total + item
    return total


def _gives_both(law: JointLaw) -> bool:
    """Say whether `rates_and_command` is of the law as it flies.

    A class that is derived from the law may replace its command or its rates alone, which are what
    is compiled: bounds of the former ones would prove nothing.
    """
    for kind in type(law).__mro__:
        if "rates_and_command" in vars(kind):
            return True
        if {"control", "derivative"} & vars(kind).keys():
            return False
    return False
