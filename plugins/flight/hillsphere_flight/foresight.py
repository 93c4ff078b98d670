"""What can be told of a flight from its start alone, before any stage runs."""

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
    """Return the events of a plant at one state.

    Parameters
    ----------
    plant : Plant
        Whose events.
    x : ndarray, shape (n,)
        The state, SI.
    t_s : float
        Time.
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
        What flies.
    spec : ClosedLoopSpec
        With the limits.
    rows : Rows
        Of the plant.
    x : ndarray, shape (n,)
        State at the start, SI; NaN where it is that of a reference.
    t_s : float
        Time there.
    values : mapping of str to float
        Parameters of the plant that differ from nominal, SI.
    course : Course or None
        What is followed; None for the product of an earlier stage.

    Raises
    ------
    InputError
        If an event of the plant, or a limit, ends the flight at its start. It begins with the key
        that says where that is.
    """
    key = "target" if spec.start.position_m is None and spec.target is not None else "start"
    if not np.isfinite(x[rows.positions]).all():
        return
    for name, value in events_at(plant, x, t_s, values).items():
        if value < 0.0:
            raise InputError(format_end_at_start(key, name))
    # Of an unknown reference only the distances from the centre count: the errors are zero here.
    held = course_at(rows, x) if course is None else course
    for limit in limits_of(spec.limits, rows, held, np.array([t_s])):
        value = limit.value(np.array([t_s]), x[:, None], np.zeros(1, dtype=np.int64))[0]
        if value < 0.0:
            raise InputError(format_end_at_start(key, limit.name))


def check_first_step(
    law: Compensator | ContinuousLaw, seen: Array, t_s: float, commands: int
) -> None:
    """Raise if a law does not take what it sees, or commands other rows than there are.

    Parameters
    ----------
    law : Compensator or ContinuousLaw
        What commands.
    seen : ndarray, shape (q,)
        What it sees at the start.
    t_s : float
        Time there.
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
        return  # of this one state; the flight tells it with its time
    if len(u) != commands:
        raise InputError(f"law: {name} commands {len(u)} values, the plant takes {commands}")
