"""Named reference frames, each with its centre and axes."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.base.errors import InputError

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
        Whether the axes do not rotate relative to the stars.
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

_OTHERS = {
    "ecliptic": Frame("ecliptic", "centre of the Sun", "ecliptic and equinox of J2000", True)
} | {
    name: Frame(name, "centre of mass of the Earth", axes, inertial)
    for name, axes, inertial in (
        ("teme", "true equator and mean equinox (of date; over an arc taken as inertial)", True),
        ("gcrs", "those of the ICRF", True),
        ("itrf", "fixed in the Earth: x towards longitude 0, z along its axis", False),
    )
}


def frame(name: str) -> Frame:
    """Return the frame of this name.

    Parameters
    ----------
    name : str
        ``"hill:BODY"``, ``"body:BODY"``, ``"ecliptic"``, ``"teme"``, ``"gcrs"`` or ``"itrf"``.

    Returns
    -------
    Frame
        The frame, with centre and axes in words.

    Raises
    ------
    InputError
        If the frame is unknown.
    """
    if name in _OTHERS:
        return _OTHERS[name]
    family, _, body = name.partition(":")
    if family not in _FAMILIES or not body:
        known = ", ".join([*(f + ":BODY" for f in _FAMILIES), *_OTHERS])
        raise InputError(f"no frame {name!r}; known: {known}")
    centre, axes = (text.format(body=body) for text in _FAMILIES[family])
    return Frame(name, centre, axes)
