"""Named frames, each with its centre and axes stated."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.errors import InputError

__all__ = ["Frame", "frame"]


@dataclass(frozen=True)
class Frame:
    """A reference frame.

    Parameters
    ----------
    name : str
        E.g. ``"hill:phobos"``.
    centre : str
        Origin.
    axes : str
        Directions of x, y and z.
    inertial : bool
        Whether the axes keep their directions among the stars.
    """

    name: str
    centre: str
    axes: str
    inertial: bool = False


_FAMILIES = {
    "hill": (
        "centre of mass of {body}",
        "x away from the primary, y along the orbital velocity of {body}, z along its orbit normal",
    ),
    "body": (
        "centre of mass of {body}",
        "fixed in {body}: x towards longitude 0, z along the spin axis, y completing",
    ),
}


def frame(name: str) -> Frame:
    """Return the frame of this name.

    Parameters
    ----------
    name : str
        ``"hill:BODY"`` or ``"body:BODY"``.

    Returns
    -------
    Frame
        With centre and axes in words.

    Raises
    ------
    InputError
        If there is no such frame.
    """
    family, _, body = name.partition(":")
    if family not in _FAMILIES or not body:
        raise InputError(f"no frame {name!r}; known: {', '.join(f + ':BODY' for f in _FAMILIES)}")
    centre, axes = (text.format(body=body) for text in _FAMILIES[family])
    return Frame(name, centre, axes)
