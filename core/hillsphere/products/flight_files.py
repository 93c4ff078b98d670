"""Flights in the frame of any plant as states in inertial axes, and as messages of other programs.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 3 (OPM) and 5 (OEM).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch
from hillsphere.formats.oem import OemSegment, write_oem
from hillsphere.formats.opm import Manoeuvre, Opm
from hillsphere.interfaces.plant import Plant
from hillsphere.model.frame_motion import FrameMotion, craft_rows, epoch_of, frame_motion

__all__ = ["Coast", "Craft", "in_inertial_axes", "opm_of", "write_coasts"]

_INERTIAL = {"teme": "TEME", "gcrs": "GCRF"}
"""Frames of states that are written without a plant, and what a message calls them. Both have their
origin in the Earth."""
_SAME_S = 1e-6
"""Coasts that are nearer in time than this, s, follow each other: the digits of a message."""
_SAME_M = 1.0
"""Coasts whose places differ by less than this, m, where they meet are joined by an impulse.
Flights that are shot to meet do so far better; a larger gap is another flight."""


class Coast(NamedTuple):
    """A flight without a manoeuvre: its name, times (K,), s, and states (n, K), SI."""

    label: str
    t_s: Array
    x: Array


class Craft(NamedTuple):
    """The coasts of one spacecraft in inertial axes: its name, origin, axes, and coasts (6, K)."""

    name: str
    origin: str
    axes: str
    coasts: list[Coast]


def in_inertial_axes(
    coasts: Sequence[Coast],
    *,
    frame: str,
    states: Sequence[str],
    name: str,
    epoch: Epoch,
    plant: Plant | None,
    centre: str | None = None,
) -> list[Craft]:
    """Return the flights of a plan in inertial axes, for each spacecraft.

    Parameters
    ----------
    coasts : sequence of Coast
        In the order of time.
    frame : str
        Frame of their states.
    states : sequence of str
        Names of the states.
    name : str
        Name of the plan.
    epoch : Epoch
        From which times count.
    plant : Plant, optional
        Equations of motion; needed for states that are not in ``teme`` or ``gcrs``.
    centre : str, optional
        Name of the body at the origin of what is returned; by default the origin of the states.

    Returns
    -------
    list of Craft
        One for each spacecraft among the states; of several, names end with their own or number.

    Raises
    ------
    InputError
        If the plant is missing, is written in another frame, has no centre of that name, or does
        not know its frame among the stars: the message names the missing key.
    """
    rows = craft_rows(tuple(states))
    whole_t = np.concatenate([coast.t_s for coast in coasts])
    whole_x = np.concatenate([coast.x for coast in coasts], axis=1)
    if plant is None and frame in _INERTIAL:
        still = np.zeros((3, whole_t.size))
        axes = np.repeat(np.eye(3)[:, :, None], whole_t.size, axis=2)
        motion = FrameMotion(axes, still, {"Earth": np.concatenate([still] * 2)}, _INERTIAL[frame])
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
        moving = {row for of_one in rows for row in of_one}
        others = {q: whole_x[i] for i, q in enumerate(states) if i not in moving}
        # the coasts of a plan share one orientation of the frame, that of its first state
        motion = frame_motion(plant, epoch, whole_t, others)
    if centre is not None and frame in _INERTIAL and centre.lower() != "earth":
        raise InputError(f"centre: the states in {frame} refer to the Earth, not to {centre}")
    origin = motion.centre(centre)
    own = getattr(plant, "spacecraft", None) or getattr(plant, "bodies", None) or ()
    crafts = []
    ends = np.cumsum([coast.t_s.size for coast in coasts])[:-1]
    for k, of_one in enumerate(rows):
        called = name
        if len(rows) > 1:
            called = f"{name} {own[k] if len(own) == len(rows) else k + 1}"
        parts = np.split(motion.to_inertial(whole_x[of_one], origin), ends, axis=1)
        turned = [Coast(c.label, c.t_s, x) for c, x in zip(coasts, parts, strict=True)]
        crafts.append(Craft(called, origin, motion.axes_name, turned))
    return crafts


def opm_of(craft: Craft, epoch: Epoch, object_id: str) -> Opm | None:
    """Return an Orbit Parameter Message with the start of a flight and its impulses.

    The impulses are the changes of velocity where one coast meets the next in time and place.

    Parameters
    ----------
    craft : Craft
        Flight of one spacecraft.
    epoch : Epoch
        From which times count.
    object_id : str
        Identifier of the spacecraft.

    Returns
    -------
    Opm or None
        None if there is no impulse.
    """
    impulses = []
    for one, other in zip(craft.coasts, craft.coasts[1:], strict=False):
        apart = np.linalg.norm(other.x[:3, 0] - one.x[:3, -1])
        if abs(other.t_s[0] - one.t_s[-1]) < _SAME_S and apart < _SAME_M:
            dv = other.x[3:, 0] - one.x[3:, -1]
            ignition = _at(epoch, float(other.t_s[0]))
            impulses.append(Manoeuvre(ignition, 0.0, 0.0, craft.axes, dv, (other.label,)))
    if not impulses:
        return None
    first = craft.coasts[0]
    return Opm(
        object_name=craft.name.upper(), object_id=object_id, center_name=craft.origin.upper(),
        frame=craft.axes, epoch=_at(epoch, float(first.t_s[0])), x=first.x[:, 0],
        manoeuvres=tuple(impulses),
    )  # fmt: skip


def _at(epoch: Epoch, t_s: float) -> Epoch:
    return epoch.after(t_s).to(epoch.scale)


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
    coasts, frame, states, name, plant, centre
        As for `in_inertial_axes`.
    epoch : Epoch or str
        From which times count; a text is a date and time in TDB; by default the epoch of the
        plant's clock, if it has one.
    object_id : str
        Identifier of the object.

    Raises
    ------
    InputError
        As for `in_inertial_axes`; if no epoch is known, there are several spacecraft, or there is
        no state to write.
    """
    start = epoch_of(plant, epoch)
    crafts = in_inertial_axes(
        coasts, frame=frame, states=states, name=name, epoch=start, plant=plant, centre=centre
    )
    if len(crafts) > 1:
        raise InputError(
            f"a message holds one object, here are {len(crafts)} spacecraft; write them by the "
            "stage ephemeris, a file for each"
        )
    (craft,) = crafts
    segments = [
        OemSegment(name, object_id, craft.origin.upper(), craft.axes, start, c.t_s, c.x, c.label)
        for c in craft.coasts
    ]
    Path(path).write_text(write_oem(segments), "utf-8")
