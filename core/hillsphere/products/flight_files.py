"""Flights of any frame as an orbit ephemeris message, which needs inertial axes."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.formats.oem import OemSegment, write_oem
from hillsphere.interfaces.plant import Plant
from hillsphere.model.inertial import frame_about_moon

__all__ = ["Coast", "write_coasts"]

_INERTIAL = {"teme": "TEME", "gcrs": "GCRF"}
"""Frames of states that are written as they are, and what a message calls them. Both have their
origin in the Earth."""
_STATES = ("x", "y", "z", "vx", "vy", "vz")


class Coast(NamedTuple):
    """A flight without a manoeuvre: its name, times (K,), s, and states (n, K), SI."""

    label: str
    t_s: Array
    x: Array


def write_coasts(
    path: str | os.PathLike[str],
    coasts: Sequence[Coast],
    *,
    frame: str,
    states: Sequence[str],
    name: str,
    epoch: Epoch | str | None,
    plant: Plant | None,
    centre: str | None,
    object_id: str,
) -> None:
    """Write the coasts of one object as a CCSDS Orbit Ephemeris Message.

    Parameters
    ----------
    path : str or path
        The file.
    coasts : sequence of Coast
        In the order of time.
    frame : str
        Frame of their states.
    states : sequence of str
        Names of the states.
    name : str
        Name of the object.
    epoch : Epoch or str
        From which times count; a text is a date and time in TDB.
    plant : Plant, optional
        Equations of motion; needed for states in a rotating frame, which the plant's moon places
        among the stars. They are written in the ICRF.
    centre : str, optional
        Name of the body at the origin of what is written: the moon, or its primary. By default the
        origin of the states.
    object_id : str
        Identifier of the object.

    Raises
    ------
    InputError
        If an argument is missing that frame, centre or epoch of the message need (it is named), or
        contradicts the states; if there is no state to write.
    """
    if epoch is None:
        raise InputError(
            "epoch: the times of a flight count from an instant that it does not know; give it, "
            "such as epoch='2027-06-01T00:00:00' (TDB)"
        )
    start = Epoch.parse(epoch) if isinstance(epoch, str) else epoch
    if tuple(states[:6]) != _STATES:
        raise InputError(
            f"an ephemeris message needs the states {', '.join(_STATES)}, got {', '.join(states)}"
        )
    flights = [Coast(label, t, x[:6]) for label, t, x in coasts]
    if frame in _INERTIAL:
        if centre is not None and centre.lower() != "earth":
            raise InputError(f"centre: the states in {frame} refer to the Earth, not to {centre}")
        origin, axes = "earth", _INERTIAL[frame]
    elif plant is None:
        raise InputError(
            f"plant: the states are given in {frame}, and a message needs inertial axes; give the "
            "plant of the flight, whose moon says how its frame stands among the stars"
        )
    else:
        if plant.frame != frame:
            raise InputError(
                f"plant: it is written in {plant.frame}, the states are given in {frame}"
            )
        rotating, moon = frame_about_moon(plant, start)
        origin, axes = (centre or moon.name).lower(), "ICRF"
        if origin not in (bodies := [moon.name.lower(), moon.primary_name.lower()]):
            raise InputError(f"centre: must be {' or '.join(bodies)}, got {centre}")
        where = "moon" if origin == bodies[0] else "primary"
        flights = [Coast(label, t, rotating.to_inertial(x, t, where)) for label, t, x in flights]
    segments = [
        OemSegment(name, object_id, origin.upper(), axes, start, t, x, label)
        for label, t, x in flights
    ]
    Path(path).write_text(write_oem(segments), "utf-8")
