"""Flights sample by sample, under the names by which a campaign asks for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.engine.course import Rows
from hillsphere.engine.simulation.flow import thrust_vectors
from hillsphere.interfaces.cases import Histories, histories_to_keep
from hillsphere.simulation import Flights

__all__ = ["NOWHERE", "histories_of", "with_rows"]

NOWHERE = ("diverged", "step_size", "unresolved", "time_limit")
"""Statuses of flights that came to no end of their own: where they were last is no place."""


def histories_of(
    flights: Flights,
    rows: Rows,
    goal: Array,
    goal_end: Array,
    seen: Sequence[int],
    commands: Sequence[str],
    state_units: Sequence[str],
    command_units: Sequence[str],
    wanted: bool | Sequence[str],
) -> Histories:
    """Return what is wanted of the histories of N flights.

    Parameters
    ----------
    flights : Flights
        With all that was kept.
    rows : Rows
        Of the plant.
    goal : ndarray, shape (n, K + 1)
        The reference at the samples.
    goal_end : ndarray, shape (n, N)
        And when each flight ended.
    seen : sequence of int
        States that the law sees.
    commands, command_units : sequence of str
        Rows of a command.
    state_units : sequence of str
        Of the plant's states.
    wanted : bool or sequence of str
        All, or names and patterns.

    Returns
    -------
    Histories
        The states by their names; ``seen.STATE`` and ``ref.STATE``; what is done, ``u.ROW``, and
        what the law commands by itself, ``law.ROW``; the distance and the speed from the reference,
        ``position_error`` and ``velocity_error``; the size of what the law commands by itself,
        ``command``; and the Δv spent until then, ``dv``. A flight that an event or a limit ended
        between two samples has an end, with its states, deviations and Δv then.
    """
    history = flights.history
    assert history is not None
    states = rows.names
    final = dict(zip(states, flights.x, strict=True))
    gap = flights.x - goal_end
    final |= {
        "position_error": rows.distance(gap),
        "velocity_error": rows.speed(gap),
        "dv": flights.dv_m_s,
    }
    made: dict[str, tuple[str, Callable[[], Array]]] = {
        name: (unit, partial(np.asarray, history.x[i]))
        for i, (name, unit) in enumerate(zip(states, state_units, strict=True))
    }
    for kind, values in (("seen", history.y), ("ref", history.ref)):
        for row, i in zip(with_rows(values, len(seen)), seen, strict=True):
            made[f"{kind}.{states[i]}"] = state_units[i], partial(_whole, row)
    own = with_rows(history.own, len(commands))
    for kind, values in (("u", with_rows(history.u, len(commands))), ("law", own)):
        for row, name, unit in zip(values, commands, command_units, strict=True):
            made[f"{kind}.{name}"] = unit, partial(_whole, row)
    made["position_error"] = "m", partial(_away, rows.distance, history.x, goal)
    made["velocity_error"] = "m/s", partial(_away, rows.speed, history.x, goal)
    made["command"] = command_units[0], partial(_size, own)
    made["dv"] = "m/s", partial(np.asarray, history.dv_m_s)
    names = histories_to_keep(wanted, tuple(made))
    ended = _ended_between(flights, history.time_s)
    nothing = np.full(len(ended), np.nan)
    ends = np.array([final.get(name, nothing) for name in names]).reshape(len(names), len(ended))
    return Histories(
        history.time_s,
        names,
        tuple(made[name][0] for name in names),
        np.array([made[name][1]() for name in names]),
        np.where(ended, flights.time_s, np.nan),
        np.where(ended, ends, np.nan),
    )


def with_rows(values: Array, rows: int) -> Array:
    """Return what was kept at the samples (rows, K, …): NaN if no flight lived to see one.

    Parameters
    ----------
    values : ndarray, shape (rows, K, …) or (0, K, …)
        Of `hillsphere.simulation.History`, which learns the number of rows at the first sample.
    rows : int
        How many there are.
    """
    return values if len(values) else np.full((rows, *values.shape[1:]), np.nan)


def _ended_between(flights: Flights, time_s: Array) -> NDArray[np.bool_]:
    """Return which (N,) flights an event or a limit ended after their last sample.

    Parameters
    ----------
    flights : Flights
        How they ended.
    time_s : ndarray, shape (K + 1, N)
        Times of their samples; NaN after the end.
    """
    sound = np.array([status not in NOWHERE for status in flights.status], dtype=np.bool_)
    last = np.fmax.reduce(time_s, axis=0, initial=-np.inf)
    return np.asarray(sound & np.isfinite(last) & (flights.time_s > last))


def _whole(values: Array) -> Array:
    """Return values (K, N) with a row of NaN for the end, where nothing acts."""
    return np.concatenate([values, np.full((1, values.shape[1]), np.nan)])


def _away(size: Callable[[Array], Array], x: Array, goal: Array) -> Array:
    """Return how far (K, N) states (n, K, N) are from the reference."""
    gap = x - goal[:, :, None]
    return size(gap.reshape(len(gap), -1)).reshape(gap.shape[1:])


def _size(command: Array) -> Array:
    """Return the size (K + 1, N) of commands (p, K, N): that of the largest thrust vector."""
    each = command.reshape(thrust_vectors(len(command)), -1, *command.shape[1:])
    return _whole(np.sqrt(np.sum(each * each, axis=1)).max(axis=0))
