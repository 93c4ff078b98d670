"""Antenna of ``hillsphere track``: kind of mount, limits and names of its axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, radians

from hillsphere.errors import InputError
from hillsphere_tracking.pointing.mounts import AxisLimits, Mount, azimuth_elevation, x_y

__all__ = ["MOUNTS", "Antenna", "antenna_of"]

MOUNTS = {"az_el": ("azimuth", "elevation"), "x_y": ("x", "y")}
"""Kinds of mounts, with the names of their axes."""

_USUAL = {"azimuth": (0.0, 450.0), "elevation": (0.0, 90.0), "x": (-90.0, 90.0), "y": (-90.0, 90.0)}
_RANGE = {"azimuth": (-1080.0, 1080.0), "elevation": (-90.0, 180.0),
          "x": (-1080.0, 1080.0), "y": (-90.0, 180.0)}  # fmt: skip
"""Where stops may lie, degrees: three turns of a primary axis either way are more than any cable
allows; a secondary axis has passed over the top at 180°. As in the Specs of mounts."""


@dataclass(frozen=True)
class Antenna:
    """An antenna: mount and names of its axes.

    Parameters
    ----------
    mount : Mount
        The mount, with the limits of its axes.
    axes : tuple of two str
        Names of the primary and the secondary axis.
    """

    mount: Mount
    axes: tuple[str, str]


def antenna_of(
    kind: str,
    stops_deg: Mapping[str, tuple[float, float] | None],
    rate_deg_s: float,
    acceleration_deg_s2: float,
    axis_azimuth_deg: float | None,
) -> Antenna:
    """Return the antenna that the options of the command describe.

    Parameters
    ----------
    kind : str
        Kind of mount, one of `MOUNTS`.
    stops_deg : mapping
        Stops by names of axes; the default stops for axes that are missing or None.
    rate_deg_s, acceleration_deg_s2 : float
        Largest rate and acceleration of both axes.
    axis_azimuth_deg : float or None
        Azimuth of the X axis of an X/Y mount.

    Raises
    ------
    InputError
        If the kind is unknown, an option belongs to another kind, or limits are out of range.
    """
    if kind not in MOUNTS:
        raise InputError(f"--mount must be one of {', '.join(MOUNTS)}, got {kind!r}")
    axes = MOUNTS[kind]
    for axis, given in stops_deg.items():
        if given is not None and axis not in axes:
            raise InputError(f"--{axis}-limits: a mount {kind} has the axes {' and '.join(axes)}")
    if kind != "x_y" and axis_azimuth_deg is not None:
        raise InputError("--axis-azimuth is the azimuth of the X axis: it needs --mount x_y")
    rate, acceleration = radians(rate_deg_s), radians(acceleration_deg_s2)
    primary, secondary = (_limits(axis, stops_deg.get(axis), rate, acceleration) for axis in axes)
    if kind == "az_el":
        return Antenna(azimuth_elevation(primary, secondary), axes)
    if not isfinite(towards := axis_azimuth_deg or 0.0):
        raise InputError(f"--axis-azimuth must be finite, got {towards}")
    return Antenna(x_y(primary, secondary, radians(towards)), axes)


def _limits(
    axis: str, stops_deg: tuple[float, float] | None, rate: float, acceleration: float
) -> AxisLimits:
    low, high = stops_deg or _USUAL[axis]
    least, most = _RANGE[axis]
    if not least <= low < high <= most:  # written so that nan is refused, too
        raise InputError(
            f"--{axis}-limits: the lower stop must be below the upper one, and both of this axis "
            f"({axis}) from {least:g}° to {most:g}°, got {low:g}° and {high:g}°"
        )
    return AxisLimits(radians(low), radians(high), rate, acceleration)
