"""The antenna as ``hillsphere track`` is told of it: which mount, its limits, its axes' names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, radians

from hillsphere.errors import InputError
from hillsphere_tracking.pointing.mounts import AxisLimits, Mount, azimuth_elevation, x_y

__all__ = ["MOUNTS", "Antenna", "antenna_of"]

MOUNTS = {"az_el": ("azimuth", "elevation"), "x_y": ("x", "y")}
"""Kinds of mounts, and what their axes are called."""

_USUAL = {"azimuth": (0.0, 450.0), "elevation": (0.0, 90.0), "x": (-90.0, 90.0), "y": (-90.0, 90.0)}


@dataclass(frozen=True)
class Antenna:
    """An antenna.

    Parameters
    ----------
    mount : Mount
        With the limits of its axes.
    axes : tuple of two str
        What they are called.
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
    """Return an antenna.

    Parameters
    ----------
    kind : str
        One of `MOUNTS`.
    stops_deg : mapping
        Stops of axes by their names; None, or left out, for the usual ones.
    rate_deg_s, acceleration_deg_s2 : float
        Largest, of both axes.
    axis_azimuth_deg : float or None
        Where the X axis of an X/Y mount points.

    Raises
    ------
    InputError
        If there is no such mount, something given belongs to another one, or limits are none.
    """
    if kind not in MOUNTS:
        raise InputError(f"--mount must be one of {', '.join(MOUNTS)}, got {kind!r}")
    axes = MOUNTS[kind]
    for axis, given in stops_deg.items():
        if given is not None and axis not in axes:
            raise InputError(f"--{axis}-limits: a mount {kind} has the axes {' and '.join(axes)}")
    if kind != "x_y" and axis_azimuth_deg is not None:
        raise InputError("--axis-azimuth is that of the X axis: it needs --mount x_y")
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
    try:
        return AxisLimits(radians(low), radians(high), rate, acceleration)
    except InputError as error:
        raise InputError(f"--{axis}-limits: {error}") from error
