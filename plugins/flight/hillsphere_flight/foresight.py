"""Checks of the start of a flight that need no product of an earlier stage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.dynamics import ArrayFunction
from hillsphere.engine.course import Course, Rows, course_at
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces.control import Compensator, SynthesisedLaw
from hillsphere.interfaces.plant import ExternalEvents, Plant
from hillsphere.simulation import ContinuousLaw
from hillsphere.symbolic import constant, time, variable
from hillsphere_flight.checks import format_end_at_start
from hillsphere_flight.limits import limits_of
from hillsphere_flight.specs import ClosedLoopSpec

__all__ = ["check_first_step", "check_start", "events_at"]


def events_at(plant: Plant, x: Array, t_s: float, values: Mapping[str, float]) -> dict[str, float]:
    """Return the event functions of a plant at one state.

    Parameters
    ----------
    plant : Plant
        The plant.
    x : ndarray, shape (n,)
        State in the frame of the plant, SI.
    t_s : float
        Time, s.
    values : mapping of str to float
        Parameters of the plant that differ from nominal, SI.

    Returns
    -------
    dict of str to float
        Positive while a flight may go on; NaN where it depends on a state that is NaN.
    """
    parameters = plant.parameters()
    p = {q.name: values.get(q.name, q.value) for q in parameters}
    states = tuple(variable(v.name) for v in plant.states)
    events = plant.events(states, time, {name: constant(value) for name, value in p.items()})
    if not events:
        return {}
    terms = None
    if isinstance(plant, ExternalEvents) and plant.event_terms:
        outside, row = plant, np.array([*p.values()])[:, None]
        terms = (
            [variable(v.name) for v in plant.event_terms],
            lambda x, t, _: np.asarray(outside.event_terms_array(x, t, row)),
        )
    function = ArrayFunction(list(events.values()), states, terms=terms)
    return dict(zip(events, function(x[:, None], t=t_s)[:, 0].tolist(), strict=True))


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
    for name, value in events_at(plant, x, t_s, values).items():
        if value < 0.0:
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
