"""Checks of the start of a flight that need no product of an earlier stage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.course import Course, Rows, course_at
from hillsphere.engine.plant_events import events_at
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces.control import Compensator, SynthesisedLaw
from hillsphere.interfaces.plant import Plant
from hillsphere.simulation import ContinuousLaw
from hillsphere_flight.checks import format_end_at_start
from hillsphere_flight.limits import limits_of
from hillsphere_flight.specs import ClosedLoopSpec

__all__ = ["check_first_step", "check_start"]


def check_start(
    plant: Plant,
    spec: ClosedLoopSpec,
    rows: Rows,
    x: Array,
    t_s: float,
    values: Mapping[str, float],
    course: Course | None,
) -> None:
    """Raise if a flight has ended where it begins.

    Parameters
    ----------
    plant : Plant
        The plant.
    spec : ClosedLoopSpec
        The Spec, with its limits.
    rows : Rows
        Rows of the plant's positions and velocities.
    x : ndarray, shape (n,)
        State at the start, SI; NaN where it is that of a reference.
    t_s : float
        Time there, s.
    values : mapping of str to float
        Parameters of the plant that differ from nominal, SI.
    course : Course or None
        The reference; None if an earlier stage yields it.

    Raises
    ------
    InputError
        If an event of the plant or a limit ends the flight at its start. The message begins with
        the key of the Spec that gives the start.
    """
    key = "target" if spec.start.position_m is None and spec.target is not None else "start"
    if not np.isfinite(x[rows.positions]).all():
        return
    for name, value in events_at(plant, x[:, None], np.array([t_s]), values).items():
        if value[0] < 0.0:
            raise InputError(format_end_at_start(key, name))
    # An unknown reference is taken to pass through the start, so that only the limits on the
    # distance from the centre can be exceeded.
    held = course_at(rows, x) if course is None else course
    for limit in limits_of(spec.limits, rows, held, np.array([t_s])):
        value = limit.value(np.array([t_s]), x[:, None], np.zeros(1, dtype=np.int64))[0]
        if value < 0.0:
            raise InputError(format_end_at_start(key, limit.name))


def check_first_step(
    law: Compensator | ContinuousLaw, seen: Array, t_s: float, commands: int
) -> None:
    """Raise if the input or the command of a law has another size than the plant.

    Parameters
    ----------
    law : Compensator or ContinuousLaw
        The control law.
    seen : ndarray, shape (q,)
        States that it sees at the start, SI.
    t_s : float
        Time there, s.
    commands : int
        Number of rows of a command.

    Raises
    ------
    InputError
        If it does not fit.
    """
    if isinstance(law, SynthesisedLaw) and not law.complete:
        return
    name = type(law).__name__
    if isinstance(law, ContinuousLaw):
        if law.inputs != len(seen):
            raise InputError(f"law: {name} takes {law.inputs} inputs, it sees {len(seen)}")
        return
    y = np.array(seen)[:, None]
    try:
        with np.errstate(all="ignore"):
            u, _ = law.step(0, np.array([t_s]), y, y, law.initial(1))
    except InputError as error:
        raise InputError(f"law: {error}") from error
    except HillsphereError:
        return  # the law cannot act at this state; the flight reports it with its time
    if len(u) != commands:
        raise InputError(f"law: {name} commands {len(u)} values, the plant takes {commands}")
