"""The first guess of a fitted state, from whatever form it is given in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hillsphere.engine.start_messages import epoch_of_message, start_of_message
from hillsphere.engine.start_specs import MessageStartSpec
from hillsphere.engine.start_states import TimedFrame, place_start
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.reading import place_of
from hillsphere_estimators.orbit_fit.specs import FitStartSpec

__all__ = ["FirstGuess", "first_guess", "start_epoch"]


_SAME_S = 1.0
"""Dates of one start may differ by this: in a second axes of date turn by 1e-11 rad."""


@dataclass(frozen=True, eq=False)
class FirstGuess:
    """A state near which a fit begins.

    Parameters
    ----------
    x : ndarray, shape (6,)
        In the plant's frame, SI.
    covariance : ndarray, shape (6, 6), or None
        That its message states.
    key : str
        The key that gives it, for messages.
    """

    x: Array
    covariance: Array | None
    key: str


def start_epoch(start: FitStartSpec) -> Epoch:
    """Return the date of the first guess.

    Raises
    ------
    InputError
        If it is no date, or its file cannot be read.
    """
    message = _message(start)
    if message is None:
        form = start.inertial or start.elements
        if form is None or form.epoch is None:
            return _date(start)
        of_axes = Epoch.parse(form.epoch, "TDB")
        if start.epoch and abs(_date(start).seconds_since(of_axes)) > _SAME_S:
            key = "inertial" if start.inertial else "elements"
            raise InputError(
                f"start.epoch: expected the instant of start.{key}.epoch, {form.epoch} TDB, got "
                f"{start.epoch} {start.time_scale}; leave one of the two out"
            )
        return _date(start) if start.epoch else of_axes
    try:
        return epoch_of_message(message.path, **message.options)
    except InputError as error:
        raise InputError(f"{message.key}: {error}") from error


def first_guess(start: FitStartSpec, plant: Plant, t_s: float) -> FirstGuess:
    """Return the first guess in the plant's frame.

    Parameters
    ----------
    start : FitStartSpec
        Its form.
    plant : Plant
        Gives the frame.
    t_s : float
        Its time, after the plant's epoch.

    Raises
    ------
    InputError
        If it cannot be given in the plant's frame.
    """
    if start.position_m is not None and start.velocity_m_s is not None:
        x = np.array([*start.position_m, *start.velocity_m_s])
        return FirstGuess(x, None, "start.position")
    message = _message(start)
    if message is None:
        frame: object = plant.turning_frame(t_s) if isinstance(plant, TimedFrame) else plant
        placed = place_start(start, frame, {}, "start")
        assert placed is not None
        key = "start.inertial" if start.inertial else "start.elements"
        return FirstGuess(np.concatenate(placed), None, key)
    try:
        read = start_of_message(message.path, plant, time_s=t_s, **message.options)
    except InputError as error:
        raise InputError(f"{message.key}: {error}") from error
    return FirstGuess(read.x, read.covariance, message.key)


def _date(start: FitStartSpec) -> Epoch:
    try:
        return Epoch.parse(start.epoch, start.time_scale)
    except InputError as error:
        raise InputError(f"start.epoch: {error}") from error


@dataclass(frozen=True)
class _Message:
    """A file with the start, and the keys that say how to read it."""

    key: str
    path: Path
    options: dict[str, Any]


def _message(start: FitStartSpec) -> _Message | None:
    if start.file is not None:
        epoch: str | Epoch = _date(start) if start.epoch else ""
        options: dict[str, Any] = {"epoch": epoch, "lenient": start.lenient}
        return _Message("start.file", place_of(start.file), options)
    given: MessageStartSpec | None = start.message
    if given is None:
        return None
    options = {"name": given.object, "epoch": given.epoch, "lenient": given.lenient}
    options["kernels"] = [str(place_of(one)) for one in given.kernels]
    return _Message("start.message", place_of(given.file), options)
