"""Flights sample by sample, under the names by which a campaign asks for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from hillsphere.campaign.cases import Histories, kept_histories
from hillsphere.closed_loop.course import Rows
from hillsphere.interfaces import Array
from hillsphere.simulation import History
from hillsphere.simulation.flow import thrust_vectors

__all__ = ["histories_of"]


def histories_of(
    history: History,
    rows: Rows,
    goal: Array,
    seen: Sequence[int],
    commands: Sequence[str],
    state_units: Sequence[str],
    command_units: Sequence[str],
    wanted: bool | Sequence[str],
) -> Histories:
    """Return what is wanted of the histories of N flights.

    Parameters
    ----------
    history : History
        All that was kept.
    rows : Rows
        Of the plant.
    goal : ndarray, shape (n, K + 1)
        The reference.
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
        ``command``; and the Δv spent until then, ``dv``.
    """
    states = rows.names
    made: dict[str, tuple[str, Callable[[], Array]]] = {
        name: (unit, partial(np.asarray, history.x[i]))
        for i, (name, unit) in enumerate(zip(states, state_units, strict=True))
    }
    for kind, values in (("seen", history.y), ("ref", history.ref)):
        for row, i in zip(values, seen, strict=True):
            made[f"{kind}.{states[i]}"] = state_units[i], partial(_whole, row)
    for kind, values in (("u", history.u), ("law", history.own)):
        for row, name, unit in zip(values, commands, command_units, strict=True):
            made[f"{kind}.{name}"] = unit, partial(_whole, row)
    made["position_error"] = "m", partial(_away, rows.distance, history.x, goal)
    made["velocity_error"] = "m/s", partial(_away, rows.speed, history.x, goal)
    made["command"] = command_units[0], partial(_size, history.own)
    made["dv"] = "m/s", partial(np.asarray, history.dv_m_s)
    names = kept_histories(wanted, tuple(made))
    return Histories(
        history.time_s,
        names,
        tuple(made[name][0] for name in names),
        np.array([made[name][1]() for name in names]),
    )


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
