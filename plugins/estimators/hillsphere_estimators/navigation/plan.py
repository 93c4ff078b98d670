"""The plan that all flights along one reference share: start, reference and first belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.engine.course import Course, Rows, course_along, course_at
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array, Integers, Plant
from hillsphere.products import FlightSet
from hillsphere_estimators.navigation.parts import InitialBeliefs, prior_root, usable_beliefs
from hillsphere_estimators.navigation.specs import NavigationSpec
from hillsphere_estimators.plant_model import PlantModel

__all__ = ["Plan", "check_step", "plan_of", "read_start"]

_MOST_SAMPLES = 12
"""Intervals of the reference at which the step is checked, spread evenly. Each costs two short
flights from 2n points; far fewer might miss the fastest part of the reference."""

_NEGLIGIBLE = 1e-3
"""Error of the step map, as a part of the first belief, that is always accepted: its square adds a
millionth to the variance."""


@dataclass(frozen=True)
class Plan:
    """Plan of flights along one reference.

    Parameters
    ----------
    start : ndarray, shape (n,)
        Planned state at the start, SI.
    goal : ndarray, shape (n, K)
        Reference at the measurements, SI.
    root : ndarray, shape (n, n)
        Lower root of the covariance of the start, SI.
    begin_s : float
        Time of the plant at the start.
    beliefs : ndarray of int
        Cases of an earlier stage's beliefs with which flights begin in turn; empty without.
    """

    start: Array
    goal: Array
    root: Array
    begin_s: float
    beliefs: Integers

    @property
    def sigma(self) -> Array:
        """Standard deviations of the start (n,), SI."""
        return np.asarray(np.linalg.norm(self.root, axis=1))


def plan_of(
    spec: NavigationSpec,
    plant: Plant,
    rows: Rows,
    since_s: Array,
    product: FlightSet | None,
    belief: InitialBeliefs | None,
    stated: Array | None = None,
) -> Plan:
    """Return the plan of the flights.

    Parameters
    ----------
    spec : NavigationSpec
        Start, belief, and the trajectory that is followed.
    plant : Plant
        The plant of the filter's model.
    rows : Rows
        Its positions and velocities.
    since_s : ndarray, shape (K,)
        Times of the measurements since the start, s.
    product : FlightSet, optional
        Trajectories of which one is the reference; without it the start is held.
    belief : InitialBeliefs, optional
        Beliefs at the start.
    stated : ndarray, shape (6, 6), optional
        Covariance of the start that its message states, SI.

    Returns
    -------
    Plan
        In the states and the frame of the plant, SI.

    Raises
    ------
    InputError
        If the start has another number of components than the plant, or the beliefs do not fit.
    """
    given = read_start(spec, rows)
    begin_s, cases = spec.start.time_s, np.zeros(0, dtype=np.int64)
    if belief is not None:
        begin_s, cases = belief.t_s, usable_beliefs(spec, plant, belief)
        if product is None:
            given[rows.positions] = belief.means[:, cases].mean(axis=1)[rows.positions]
            given[rows.velocities] = 0.0
    course: Course = (
        course_at(rows, given)
        if product is None
        else course_along(plant, rows, product, spec.follow)
    )
    start = np.where(np.isnan(given), course.start, given)
    # a reference and what is believed count time from the same zero
    goal = np.array(course.at(since_s + (0.0 if belief is None else begin_s)))
    return Plan(start, goal, prior_root(spec, rows, start, stated), begin_s, cases)


def read_start(spec: NavigationSpec, rows: Rows) -> Array:
    """Return the start of the Spec (n,); NaN where the reference gives it.

    Raises
    ------
    InputError
        If it has another number of components than the plant.
    """
    given = np.full(len(rows.names), np.nan)
    if spec.start.position_m is not None:
        given[rows.positions] = _check_length(spec.start.position_m, "position_m", rows)
        given[rows.velocities] = 0.0
    if spec.start.velocity_m_s is not None:
        given[rows.velocities] = _check_length(spec.start.velocity_m_s, "velocity_m_s", rows)
    return given


def check_step(
    plan: Plan, rows: Rows, model: PlantModel, finer: PlantModel, since_s: Array
) -> None:
    """Raise `InputError` if the step of the model is too long for the motion about the plan.

    From states one standard deviation of the first belief off the reference, on either side of each
    axis, the flight over one interval is computed with the model's step and with half of it. The
    difference estimates the error of the step map, which is no noise of the filter's model. It may
    be as large as the process noise of that interval, or a thousandth of the first belief,
    whichever is larger. (For a velocity, the latter is at least the thousandth that moves the
    position by its own thousandth in one interval.)

    Parameters
    ----------
    plan : Plan
        Reference and first belief.
    rows : Rows
        Positions and velocities of the plant.
    model, finer : PlantModel
        With the step of the Spec, and with half of it; without biases.
    since_s : ndarray, shape (K,)
        Times of the measurements since the start, s.

    Raises
    ------
    InputError
        If they differ by more.
    """
    last = len(since_s) - 1
    if last < 1 or not plan.sigma.any():
        return
    n = len(plan.sigma)
    samples = np.unique(np.linspace(0, last - 1, min(last, _MOST_SAMPLES)).astype(int))
    off = np.diag(plan.sigma)
    off = np.concatenate([off, -off], axis=1)
    goal, t0, t1 = plan.goal[:, samples], since_s[samples], since_s[samples + 1]
    there = (goal, plan.begin_s + t0, plan.begin_s + t1)
    roots = model.process_noise(*there, _model_control(model, goal, goal))
    added = np.repeat(np.sqrt(np.sum(roots**2, axis=2)).T, 2 * n, axis=1)
    goal, t0, t1 = (np.repeat(one, 2 * n, axis=-1) for one in there)
    x = goal + np.tile(off, len(samples))
    flown = (x, t0, t1, _model_control(model, x, goal), np.zeros(x.shape[1], dtype=np.int64))
    try:
        difference = np.abs(model.advance(*flown) - finer.advance(*flown))
    except PropagationError:  # a state within the belief cannot be flown: the flights report it
        return
    scale = plan.sigma.copy()
    crossing = np.max(scale[rows.positions]) / (since_s[1] - since_s[0])
    scale[rows.velocities] = np.maximum(scale[rows.velocities], crossing)
    allowed = np.maximum(added, _NEGLIGIBLE * scale[:, None])
    worst = np.unravel_index(np.argmax(difference / np.maximum(allowed, 1e-300)), difference.shape)
    if difference[worst] > allowed[worst]:
        unit = "m/s" if model.plant.states[worst[0]].time else "m"
        raise InputError(
            f"step_s: {model.step_s:g} s is too long: from states one standard deviation off the "
            f"reference the step map errs by {difference[worst]:.2g} {unit} within one interval of "
            f"{t1[worst[1]] - t0[worst[1]]:g} s, where the process noise adds "
            f"{added[worst]:.2g} {unit}; take a shorter one"
        )


def _model_control(model: PlantModel, estimate: Array, goal: Array) -> Array:
    """Return the controls of the motion model: estimate and reference of the law, if any."""
    return np.zeros((0, goal.shape[1])) if model.law is None else np.concatenate([estimate, goal])


def _check_length(given: tuple[float, ...], key: str, rows: Rows) -> Array:
    """Return the numbers of a key of the start, one for each position, or raise `InputError`."""
    count = len(rows.positions)
    if len(given) != count:
        raise InputError(f"start.{key}: {len(given)} numbers, the plant has {count}")
    return np.array(given)
