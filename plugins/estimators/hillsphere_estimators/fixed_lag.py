"""A filter with a memory of its last steps, which takes measurements that arrive late.

The belief before each of the last L sets of measurements is kept with the sets and controls. A late
set is inserted in the order of time, and all that follows is filtered again. The result is that of
the filter with all sets in order, bit for bit, for nonlinear models and behind gates as well; its
cost is that of the steps that are repeated. Methods that correct the present belief alone [1]_ are
cheaper, but for linear models only, and approximate for more than one step.

References
----------
.. [1] Bar-Shalom (2002), Update with out-of-sequence measurements in tracking: exact solution, IEEE
   Transactions on Aerospace and Electronic Systems 38(3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Estimator, Integers
from hillsphere_estimators.innovations import SAME_TIME

__all__ = ["FixedLag", "LagStep", "LaggedBelief"]


@dataclass(frozen=True)
class LagStep:
    """A set of measurements in the memory.

    Parameters
    ----------
    model : EstimationModel
        Model of the motion to this time, and of the measurements.
    control : ndarray, shape (p, N)
        Controls of the motion to this time.
    measured : MeasurementSet
        The measurements.
    belief : Belief
        After them.
    innovation : Innovation
        Their innovation.
    """

    model: EstimationModel
    control: Array
    measured: MeasurementSet
    belief: Belief
    innovation: Innovation


@dataclass(frozen=True)
class LaggedBelief:
    """A belief with its memory.

    Parameters
    ----------
    oldest : Belief
        Before the first step: the prior, or the belief after the last step that was dropped.
    steps : tuple of LagStep
        At most L, in the order of time.
    dropped : int
        Number of steps that were dropped.
    """

    oldest: Belief
    steps: tuple[LagStep, ...] = ()
    dropped: int = 0

    @property
    def belief(self) -> Belief:
        """The belief after all measurements, at the time of the latest."""
        return self.steps[-1].belief if self.steps else self.oldest


class FixedLag:
    """An estimator that takes sets of measurements in any order within its memory.

    Parameters
    ----------
    estimator : Estimator
        The filter; also for a batch of cases.
    model : EstimationModel
        Its model.
    steps : int
        L: sets in the memory. A set is taken if fewer than L later ones have been.

    Raises
    ------
    InputError
        If the memory holds no step.
    """

    def __init__(self, estimator: Estimator, model: EstimationModel, steps: int) -> None:
        if steps < 1:
            raise InputError(f"the memory must hold at least one step, got steps = {steps}")
        self.estimator, self.model, self.steps = estimator, model, steps

    def start(self, prior: Belief) -> LaggedBelief:
        """Return the memory of a prior, before any measurement."""
        return LaggedBelief(prior)

    def add(
        self,
        lagged: LaggedBelief,
        measured: MeasurementSet,
        control: Array | None = None,
        model: EstimationModel | None = None,
    ) -> LaggedBelief:
        """Take a set of measurements, late or not.

        A set of the time and blocks of one in the memory is merged with it: its rows take the place
        of rows that are missing there. Of N cases with different delays, give the rows that arrive
        later as sets of their own, NaN in the other cases.

        Parameters
        ----------
        lagged : LaggedBelief
            The memory.
        measured : MeasurementSet
            Measurements at a time that is not before the memory; for all cases between the same two
            steps.
        control : ndarray, shape (p, N), optional
            Control of the motion until this time; if it is late, by default that of the step which
            it divides, else none.
        model : EstimationModel, optional
            Model with the scene of this time; by default the common one.

        Returns
        -------
        LaggedBelief
            With the set; the oldest step is dropped if there are more than L.

        Raises
        ------
        InputError
            If the set is older than the memory, between different steps in different cases, has a
            row that has been measured at this time, or does not fit the beliefs.
        """
        steps = lagged.steps
        place, same = _find_place(lagged, measured)
        if same:
            old = steps[place]
            first = (old.model, old.control, _merge(old.measured, measured))
        else:
            if control is None:
                late = place < len(steps)
                control = steps[place].control if late else np.zeros((0, len(measured.t_s)))
            first = (self.model if model is None else model, control, measured)
        after = [(s.model, s.control, s.measured) for s in steps[place + same :]]
        done = list(steps[:place])
        belief = done[-1].belief if done else lagged.oldest
        for step in (first, *after):
            done.append(self._filter(belief, *step))
            belief = done[-1].belief
        over = max(len(done) - self.steps, 0)
        oldest = done[over - 1].belief if over else lagged.oldest
        return LaggedBelief(oldest, tuple(done[over:]), lagged.dropped + over)

    def _filter(
        self, belief: Belief, model: EstimationModel, control: Array, measured: MeasurementSet
    ) -> LagStep:
        """Return the step of a set from the belief of the step before."""
        if _compare(measured.t_s, belief.t_s).any():
            belief = self.estimator.predict(model, belief, measured.t_s, control)
        after, innovation = self.estimator.update(model, belief, measured)
        return LagStep(model, control, measured, after, innovation)


def _compare(one: Array, other: Array) -> Integers:
    """Return 1 where times (N,) are later than others, −1 where earlier, 0 where equal."""
    if np.shape(one) != np.shape(other):
        raise InputError(f"the belief has {len(other)} cases, the measurements have {len(one)}")
    off = one - other
    return np.asarray(np.where(np.abs(off) <= SAME_TIME * (1.0 + np.abs(other)), 0, np.sign(off)))


def _find_place(lagged: LaggedBelief, measured: MeasurementSet) -> tuple[int, bool]:
    """Return the index of a set among the steps, and whether there is one of its time."""
    since = _compare(measured.t_s, lagged.oldest.t_s)
    if (since < (1 if lagged.dropped else 0)).any():
        case = int(np.argmin(since))
        raise InputError(
            f"measurements of {measured.t_s[case]:.12g} s in case {case} are older than the "
            f"memory, which has dropped {lagged.dropped} steps and begins after "
            f"{lagged.oldest.t_s[case]:.12g} s; take more steps, or leave the set out"
        )
    for k, step in enumerate(lagged.steps):
        order = _compare(measured.t_s, step.measured.t_s)
        if (order != order[0]).any():
            case = int(np.argmax(order != order[0]))
            raise InputError(
                f"measurements of {measured.t_s[0]:.12g} s in case 0 and of "
                f"{measured.t_s[case]:.12g} s in case {case} lie on different sides of a step in "
                "the memory; give them as two sets, with NaN in the other cases"
            )
        if order[0] <= 0:
            return k, bool(order[0] == 0)
    return len(lagged.steps), False


def _merge(old: MeasurementSet, late: MeasurementSet) -> MeasurementSet:
    """Return one set of two of the same time, the errors of one independent of the other's."""
    if old.blocks != late.blocks:
        raise InputError(
            f"there is a set of {late.t_s[0]:.12g} s with other blocks; measurements of a time in "
            "the memory must come in its blocks, NaN where there are none"
        )
    twice = old.present & late.present
    if twice.any():
        row, case = np.argwhere(twice)[0]
        raise InputError(
            f"row {row} of case {case} has been measured at {late.t_s[case]:.12g} s already"
        )
    new = late.present
    correlation = None
    if old.correlation is not None or late.correlation is not None:
        one = np.eye(len(new))
        of_old, of_late = (one if s.correlation is None else s.correlation for s in (old, late))
        both = new.T[:, :, None] & new.T[:, None]
        neither = ~new.T[:, :, None] & ~new.T[:, None]
        correlation = np.where(both, of_late, np.where(neither, of_old, 0.0))
    return MeasurementSet(
        old.t_s,
        np.where(new, late.values, old.values),
        np.where(new, late.sigma, old.sigma),
        old.blocks,
        old.present | new,
        correlation,
    )
