"""Flights in space as a declared figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.show.charts import Chart, Space
from hillsphere.show.solids import Path

__all__ = ["flights_chart"]

_NAMED = 10
"""Most flights that a legend names: beyond, neighbouring colours are no longer told apart."""


def flights_chart(frame: str, labels: Sequence[str], t_s: Array, x: Array) -> Chart:
    """Return the paths of flights.

    Parameters
    ----------
    frame : str
        Frame of the states.
    labels : sequence of str
        One name per flight.
    t_s : ndarray, shape (K, N)
        Times, NaN beyond a flight's end.
    x : ndarray, shape (n, K, N)
        States, positions in m first.

    Returns
    -------
    Chart
        Paths in km; named if they are few.

    Raises
    ------
    InputError
        If there is no flight.
    """
    if not labels:
        raise InputError("there is no flight to draw")
    named = len(labels) <= _NAMED
    paths = []
    for k, label in enumerate(labels):
        there = np.isfinite(t_s[:, k])
        paths.append(Path(x[:3, there, k] / 1e3, label=label if named else ""))
    count = f"{len(labels)} flights" if len(labels) > 1 else "A flight"
    return Chart("Flights", [Space(paths)], f"{count} in the frame {frame!r}.")
