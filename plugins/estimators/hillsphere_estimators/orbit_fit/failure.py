"""Fits that lead nowhere: when to end them, and what to say of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.engine.plant_events import events_at
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array, Plant
from hillsphere_estimators.fixed_steps import FixedStepModel
from hillsphere_estimators.orbit_fit.records import Arc
from hillsphere_estimators.orbit_fit.surroundings import Surroundings

__all__ = ["Patience", "check_above_ground", "describe_trajectory"]

_LEAST_SHARE = 2.0**-10
"""Share of a Gauss-Newton step below which it has been halved to nothing: one of a thousand such
steps does not lead to a minimum that the linearisation points to."""
_LEAST_FALL = 1e-2
"""Relative fall of the sum of squares by a halved step that counts as progress."""
_PATIENCE = 3
"""Halved steps in a row without progress after which a fit ends."""
_SEEN_FROM = np.radians(-5.0)
"""Elevation from which a station may see a spacecraft: refraction and hills leave it some degrees
about the horizon."""
_REMEDY = (
    "give a nearer start (start.file: TLE, OMM, OPM or OEM), and check its date, the stations and "
    "the plant"
)


class Patience:
    """Ends fits whose steps are halved to nothing, or no longer reduce the sum of squares.

    A `hillsphere_estimators.batch_least_squares.GiveUp` of one case.
    """

    def __init__(self) -> None:
        self._idle = 0

    def __call__(self, before: Array, after: Array, share: Array) -> NDArray[np.bool_]:
        """Return whether to give up, (1,)."""
        halved = share < 1.0
        slow = halved & ~(after < (1.0 - _LEAST_FALL) * before)
        self._idle = self._idle + 1 if slow.any() else 0
        return np.asarray((share < _LEAST_SHARE) | (self._idle >= _PATIENCE))


def check_above_ground(plant: Plant, x: Array, t_s: float, key: str) -> None:
    """Refuse a first guess at the centre or below the ground.

    Parameters
    ----------
    plant : Plant
        Gives the surface, as its event ``impact``.
    x : ndarray, shape (6,)
        State in its frame, SI.
    t_s : float
        Time, s.
    key : str
        The key that gives it.

    Raises
    ------
    InputError
        If it is there.
    """
    distance = float(np.linalg.norm(x[:3]))
    with np.errstate(all="ignore"):
        height = events_at(plant, x[:, None], np.array([t_s])).get("impact")
    if distance == 0.0 or (height is not None and not height[0] > 0.0):
        raise InputError(
            f"{key}: expected a position above the ground, got one {distance / 1e3:.6g} km from "
            f"the origin of {plant.frame}, which is below it"
        )


def describe_trajectory(
    model: FixedStepModel,
    plant: Plant,
    surroundings: Surroundings,
    craft: str,
    paths: Sequence[tuple[str, ...]],
    arc: Arc,
    x: Array,
    t_s: float,
) -> tuple[str, ...]:
    """Return what is wrong with the trajectory of a fit that has failed, and what to do.

    Parameters
    ----------
    model : FixedStepModel
        Motion.
    plant : Plant
        Gives the surface.
    surroundings : Surroundings
        Gives the horizons of stations.
    craft : str
        Name of the spacecraft.
    paths : sequence of tuple of str
        Of each record.
    arc : Arc
        The data.
    x : ndarray, shape (n,)
        States at the start.
    t_s : float
        Time there.

    Returns
    -------
    tuple of str
        Sentences without their beginning and their full stop; the remedy is the last one.
    """
    found, none, case = [], np.zeros((0, 1)), np.zeros(1, dtype=int)
    times = np.array([one.t_s[0] for one in arc.sets])
    now, t = x[:, None], np.array([t_s])
    states = []
    with np.errstate(all="ignore"):
        try:
            for one in times:
                now, t = model.advance(now, t, np.array([one]), none, case), np.array([one])
                states.append(now[:6, 0])
        except (InputError, PropagationError):
            states = []
        way = np.array(states).T if len(states) == len(times) else np.full((6, len(times)), np.nan)
        if not np.isfinite(way).all():
            return "its trajectory is not finite over the data", _REMEDY
        height = events_at(plant, way, times).get("impact")
    if height is not None and (below := int((height <= 0.0).sum())):
        found.append(f"its trajectory is below the ground at {below} of {len(times)} times")
    hidden = np.zeros(len(arc.row), dtype=bool)
    stations = np.zeros(len(arc.row), dtype=bool)
    for number, path in enumerate(paths):
        own, name = arc.record == number, path[-1]
        if not surroundings.is_station(name):
            continue
        at = arc.at[own]
        near = surroundings.is_near([name])
        there = surroundings.craft(way[:, at], times[at], near)
        line = there[:3] - surroundings.observer(name, times[at], near)[:3]
        up = surroundings.horizon(name, line, times[at])[2] / np.linalg.norm(line, axis=0)
        hidden[own], stations[own] = np.arcsin(np.clip(up, -1.0, 1.0)) < _SEEN_FROM, True
    if hidden.any():
        found.append(
            f"{craft} is below the horizon of its station at {int(hidden.sum())} of "
            f"{int(stations.sum())} values"
        )
    return *found, _REMEDY
