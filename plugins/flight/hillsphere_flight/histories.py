"""Quantities over time of flights, under the names by which a campaign asks for them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.engine.flight_metrics import FlightHistory
from hillsphere.simulation import Flights
from hillsphere_flight.flown_block import FlownBlock, append_end, fill_rows
from hillsphere_flight.metrics import HISTORIES, fit_units

__all__ = ["NOWHERE", "flight_histories", "late_ends"]

NOWHERE = ("diverged", "step_size", "unresolved", "time_limit")
"""Statuses of flights that came to no end of their own: their last state is no place."""


def flight_histories(
    states: Sequence[str],
    state_units: Sequence[str],
    seen: Sequence[int],
    commands: Sequence[str],
    command_units: Sequence[str],
) -> tuple[FlightHistory[FlownBlock], ...]:
    """Return the quantities of which the stage keeps histories.

    Parameters
    ----------
    states, state_units : sequence of str
        Names and units of the states of the plant.
    seen : sequence of int
        States that the law sees.
    commands, command_units : sequence of str
        Names and units of the rows of a command.

    Returns
    -------
    tuple of FlightHistory
        The states by their names; ``seen.STATE`` and ``ref.STATE``, measured and reference states;
        ``u.ROW``, the command as the actuator executes it, and ``law.ROW``, that of the law alone;
        then `hillsphere_flight.metrics.HISTORIES`.
    """
    made = [
        FlightHistory(name, unit, partial(_state, row=i), partial(_end_state, row=i))
        for i, (name, unit) in enumerate(zip(states, state_units, strict=True))
    ]
    for kind, source in (("seen", "y"), ("ref", "ref")):
        made += [
            FlightHistory(
                f"{kind}.{states[i]}",
                state_units[i],
                partial(_row_at_samples, source=source, rows=len(seen), row=row),
            )
            for row, i in enumerate(seen)
        ]
    for kind, source in (("u", "u"), ("law", "own")):
        made += [
            FlightHistory(
                f"{kind}.{name}",
                unit,
                partial(_row_at_samples, source=source, rows=len(commands), row=row),
            )
            for row, (name, unit) in enumerate(zip(commands, command_units, strict=True))
        ]
    return (*made, *fit_units(HISTORIES, command_units[0]))


def late_ends(flights: Flights) -> Array:
    """Return when (N,) flights ended that an event or a limit ended after their last sample.

    NaN for a flight whose last sample was its end, and for one without an end of its own.
    """
    assert flights.history is not None
    sound: NDArray[np.bool_] = np.array([s not in NOWHERE for s in flights.status], dtype=np.bool_)
    last = np.fmax.reduce(flights.history.time_s, axis=0, initial=-np.inf)
    late = sound & np.isfinite(last) & (flights.time_s > last)
    return np.where(late, flights.time_s, np.nan)


def _state(block: FlownBlock, row: int) -> Array:
    assert block.flights.history is not None
    return np.asarray(block.flights.history.x[row])


def _end_state(block: FlownBlock, row: int) -> Array:
    return np.asarray(block.flights.x[row])


def _row_at_samples(block: FlownBlock, source: str, rows: int, row: int) -> Array:
    """Return a row (K + 1, N) of something that acts at samples."""
    values: Array = getattr(block.flights.history, source)
    return append_end(fill_rows(values, rows)[row])
