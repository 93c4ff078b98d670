"""Orbits of earlier stages, propagated over one period with this stage's equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.dynamics import StepMap
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Variable
from hillsphere.products import PeriodicOrbits
from hillsphere_orbits.stability import multipliers

__all__ = ["SampledOrbits", "require_states", "retrace"]

_STATES = ("x", "y", "z", "vx", "vy", "vz")
_SAME_EQUATIONS = 1e-7
"""Largest closure beside the growth of errors over a period, natural units, of orbits that count as
solutions of this plant's equations. It also bounds the error of the samples, which the step below
keeps well under it."""
_STEP = 0.05
"""Of a unit of time: for the eighth-order map well below `_SAME_EQUATIONS` about a moon that
fills a good part of its Hill sphere, where the shortest period is about 3."""
_LEAST = 240
"""Least number of steps of a period: the amplitude is the largest of the samples, right to 1e-4."""
_DOUBLINGS = 4
"""Times that the steps are tried, doubled each time, before the orbits count as those of other
equations."""


@dataclass(frozen=True, eq=False)
class SampledOrbits:
    """M orbits along one period, normalised.

    Parameters
    ----------
    way : ndarray, shape (6, K + 1, M)
        States at equal steps of each orbit's own period, ends included.
    period : ndarray, shape (M,)
        Periods.
    """

    way: Array
    period: Array

    @property
    def amplitude(self) -> Array:
        """Largest |x|, |y| and |z| along each orbit, shape (3, M).

        By a parabola through the highest sample and its neighbours: the number of samples, which
        the other orbits may raise, then hardly matters.
        """
        place = np.abs(self.way[:3, :-1])  # the last state is the first one again
        top = np.argmax(place, axis=1)[:, None]
        count = place.shape[1]
        before, here, after = (
            np.take_along_axis(place, (top + step) % count, axis=1)[:, 0] for step in (-1, 0, 1)
        )
        bend = 2.0 * here - before - after
        rise = 0.125 * (after - before) ** 2 / np.where(bend > 0.0, bend, 1.0)
        return np.asarray(here + np.where(bend > 0.0, rise, 0.0))


def require_states(states: Sequence[Variable], what: str) -> None:
    """Raise `InputError` unless the states are position and velocity in space."""
    names = tuple(v.name for v in states)
    if names != _STATES:
        raise InputError(
            f"{what} needs a plant with states {', '.join(_STATES)}; this one has "
            f"{', '.join(names)}"
        )


def retrace(stepper: StepMap, orbits: PeriodicOrbits, step: float = _STEP) -> SampledOrbits:
    """Propagate orbits over one period and check that they close.

    Parameters
    ----------
    stepper : StepMap
        Of the normalised system, without derivatives.
    orbits : PeriodicOrbits
        M orbits.
    step : float
        Longest step wanted, normalised; the accuracy may ask for a shorter one.

    Returns
    -------
    SampledOrbits
        Their states on the way.

    Raises
    ------
    StageError
        If there is no orbit, or one does not close: it belongs to other equations.
    """
    system = stepper.system
    x = orbits.x0 / system.unit[:, None]
    period = orbits.period_s / system.time_unit_s
    if not period.size:
        raise StageError("the stages named in needs hand on no orbit; ask them for members")
    # an unstable orbit magnifies the rounding of its start by its largest multiplier
    growth = np.maximum(1.0, np.abs(multipliers(orbits.monodromy)[0]))
    steps = max(_LEAST, int(np.ceil(np.max(period) / min(step, _STEP))))
    for _ in range(_DOUBLINGS):
        way = stepper.trajectory(x, period, steps, strict=False)
        error = np.max(np.abs(way[:, -1] - x), axis=0) / growth
        error = np.where(np.isfinite(error), error, np.inf)
        if np.max(error) <= _SAME_EQUATIONS:
            break
        steps *= 2  # orbits close to a small moon, with far shorter periods
    worst = int(np.argmax(error))
    if orbits.frame != system.frame or not error[worst] <= _SAME_EQUATIONS:
        raise StageError(
            f"the orbits (frame {orbits.frame}) do not solve the equations of this stage's plant "
            f"(frame {system.frame}; {orbits.labels[worst]!r} closes to {error[worst]:.1e}); give "
            "the plant with which they were computed"
        )
    return SampledOrbits(way, period)
