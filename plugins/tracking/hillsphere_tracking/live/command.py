"""``hillsphere track``: one pass live, or a replay of an earlier one."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from math import degrees, radians
from typing import Annotated

import numpy as np
import typer

from hillsphere.cli.streams import say
from hillsphere.earth.orientation import (
    ConstantOrientation,
    EarthOrientation,
    EarthOrientationWarning,
    OrientationTable,
)
from hillsphere.errors import InputError
from hillsphere.mission import load_mission
from hillsphere.time import Epoch
from hillsphere_tracking.live.clock import Clock, RealTime, Replay
from hillsphere_tracking.live.feed import Arriving, Feed, Recorded
from hillsphere_tracking.live.measurements import measurements
from hillsphere_tracking.live.rotator import RotatorLink
from hillsphere_tracking.live.rotctl import PORT, Rotctl
from hillsphere_tracking.live.session import Command, run_session, status_line
from hillsphere_tracking.live.setup import (
    MountLimits,
    next_pass,
    orbit_of,
    session_of,
    site_of,
    tracker_of,
)

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_HEADER = "utc,azimuth_deg,elevation_deg,predicted_azimuth_deg,predicted_elevation_deg,locked"


@app.command()
def track(
    source: Annotated[
        str,
        typer.Argument(
            metavar="MEASUREMENTS",
            help="Angles: a CSV table (time, azimuth, elevation[, sigma] in degrees) or a CCSDS "
            "tracking data message; '-' for stdin.",
        ),
    ] = "-",
    mission: Annotated[
        str, typer.Option(help="Take satellite, station and [tracker.NAME] from a mission.")
    ] = "",
    elements: Annotated[
        str, typer.Option(metavar="FILE", help="Elements of the satellite: TLE or OMM.")
    ] = "",
    satellite: Annotated[str, typer.Option(metavar="NAME", help="Which satellite.")] = "",
    station: Annotated[str, typer.Option(metavar="NAME", help="Which station.")] = "",
    latitude: Annotated[float | None, typer.Option(help="Geodetic latitude, degrees.")] = None,
    longitude: Annotated[float | None, typer.Option(help="East longitude, degrees.")] = None,
    height: Annotated[float, typer.Option(help="Height above the ellipsoid, m.")] = 0.0,
    tracker: Annotated[
        str, typer.Option(help="Type of tracker, or name of the mission's table.")
    ] = "least_squares",
    sigma: Annotated[
        float, typer.Option(help="Standard deviation of angles that come without, degrees.")
    ] = 0.1,
    epoch: Annotated[str, typer.Option(help="Date in UTC from which times in seconds count.")] = "",
    ut1_minus_utc: Annotated[
        float | None, typer.Option(help="UT1 - UTC, s; left out: the installed table.")
    ] = None,
    mask: Annotated[float, typer.Option(help="Elevation of rise and set, degrees.")] = 0.0,
    within: Annotated[float, typer.Option(help="How far ahead to look for a rise, h.")] = 24.0,
    azimuth_limits: Annotated[
        tuple[float, float], typer.Option(help="Stops of the azimuth axis, degrees.")
    ] = (0.0, 450.0),
    elevation_limits: Annotated[
        tuple[float, float], typer.Option(help="Stops of the elevation axis, degrees.")
    ] = (0.0, 90.0),
    rate: Annotated[float, typer.Option(help="Largest rate of both axes, degrees/s.")] = 10.0,
    acceleration: Annotated[
        float, typer.Option(help="Largest acceleration of both axes, degrees/s².")
    ] = 10.0,
    period: Annotated[float, typer.Option(help="Between commands, s.")] = 0.1,
    lost_after: Annotated[
        float, typer.Option(help="Without a measurement for so long the signal is lost, s.")
    ] = 3.0,
    rotator: Annotated[
        str,
        typer.Option(
            metavar="HOST[:PORT]", help="Drive this rotctld (hamlib) instead of writing CSV."
        ),
    ] = "",
    replay: Annotated[
        bool, typer.Option("--replay", help="Let time run as in the measurements.")
    ] = False,
    speed: Annotated[
        float, typer.Option(help="Of a replay, in real seconds; 0: do not wait.")
    ] = 1.0,
) -> None:
    """Point an antenna at a satellite, with the help of what the antenna measures.

    Commands go to stdout as CSV, or to a rotator; stderr shows time, angles and by how much the
    satellite is early and beside its nominal track. Where measurements stop the prediction goes on.
    """
    _check(sigma=sigma, period=period, lost_after=lost_after, within=within)
    if not 0.01 <= period <= 10.0:
        raise InputError(f"--period must be from 0.01 to 10 s, got {period:g}")
    if speed < 0.0 or (speed != 1.0 and not replay):
        raise InputError("--speed must be ≥ 0, and is for --replay only")
    loaded = load_mission(mission) if mission else None
    orbit = orbit_of(loaded, elements, satellite)
    place = site_of(loaded, station, latitude, longitude, height)
    method = tracker_of(loaded, tracker)
    counted_from = Epoch.parse(epoch, "UTC") if epoch else None
    limits = MountLimits(azimuth_limits, elevation_limits, rate, acceleration)
    with ExitStack() as stack:
        feed, clock = _input(stack, source, counted_from, replay, speed)
        start = clock.start
        orientation = _orientation(ut1_minus_utc, start)
        seen = next_pass(
            orbit, place, start, orientation, period,
            mask_rad=radians(mask), within_s=3600.0 * within,
        )  # fmt: skip
        position, point = _output(stack, rotator, start)
        session = session_of(
            orbit, place, method, seen, start, orientation, limits,
            position_rad=position, sigma_rad=radians(sigma), period_s=period,
            lost_after_s=lost_after,
        )  # fmt: skip
        say(f"{orbit.name} over {place.name}, until {start.isot(seen.times_s[-1:], 0)[0]} UTC")
        if (miss := degrees(float(session.plan.error_rad.max()))) > 0.1:
            say(f"the limits of the mount will cost up to {miss:.1f}° in this pass")
        run_session(
            session, clock, feed, position, point,
            lambda status: say(status_line(status, start)), say,
        )  # fmt: skip


def _check(**positive: float) -> None:
    for name, value in positive.items():
        if not 0.0 < value < float("inf"):
            raise InputError(f"--{name.replace('_', '-')} must be > 0, got {value:g}")


def _input(
    stack: ExitStack, source: str, epoch: Epoch | None, replay: bool, speed: float
) -> tuple[Feed, Clock]:
    """Return what is measured and what time it is."""
    if source == "-":
        descriptor, where = sys.stdin.fileno(), "stdin"
    else:
        try:
            descriptor, where = os.open(source, os.O_RDONLY), source
        except OSError as error:
            raise InputError(f"{source}: cannot be read: {error.strerror or error}") from error
        stack.callback(os.close, descriptor)
    if not replay:
        arriving = Arriving(descriptor, where, epoch, say)
        stack.callback(arriving.close)
        return arriving, RealTime()
    lines = stack.enter_context(
        os.fdopen(descriptor, encoding="utf-8", errors="replace", closefd=False)
    )
    recorded = Recorded(measurements(_stripped(lines), where, epoch))
    return recorded, Replay(recorded.first.epoch, speed)


def _stripped(lines: Iterator[str]) -> Iterator[str]:
    try:
        yield from lines
    except OSError as error:
        raise InputError(f"measurements cannot be read: {error.strerror or error}") from error


def _orientation(ut1_minus_utc_s: float | None, start: Epoch) -> EarthOrientation:
    if ut1_minus_utc_s is not None:
        return ConstantOrientation(ut1_minus_utc_s)
    table = OrientationTable.installed()
    lapse = table.lapse(start, np.array([86400.0]))
    if lapse is None:
        return table
    say(f"{lapse}, or --ut1-minus-utc")
    with warnings.catch_warnings():
        # said once, not at every command: the last values as constants
        warnings.simplefilter("ignore", EarthOrientationWarning)
        held = table.at(start, np.zeros(1))
    tai = start.to("TAI")
    tai_minus_utc = 86400.0 * ((tai.day - start.day) + (tai.fraction - start.fraction))
    return ConstantOrientation(
        float(held.ut1_minus_tai_s[0]) + tai_minus_utc,
        float(held.x_pole_rad[0]),
        float(held.y_pole_rad[0]),
    )


def _output(
    stack: ExitStack, rotator: str, start: Epoch
) -> tuple[tuple[float, float] | None, Callable[[Command], None]]:
    """Return where the axes stand, rad, if that is known, and what takes commands."""
    if not rotator:
        sys.stdout.write(f"{_HEADER}\n")

        def write(command: Command) -> None:
            when = start.isot(np.array([command.t_s]), 3)[0]
            cells = ",".join(f"{degrees(angle):.4f}" for angle in command[1:5])
            sys.stdout.write(f"{when},{cells},{int(command.is_locked)}\n")
            sys.stdout.flush()

        return None, write
    host, colon, port = rotator.rpartition(":")
    if not colon:
        host, port = rotator, str(PORT)
    if not (host and port.isdigit() and 0 < int(port) < 65536):
        raise InputError(f"--rotator must be HOST or HOST:PORT, got {rotator!r}")
    link = RotatorLink(lambda: Rotctl(host, int(port)), say)
    azimuth, elevation = link.start()
    stack.callback(link.end)
    return (radians(azimuth), radians(elevation)), lambda command: link.point(
        degrees(command.primary_rad), degrees(command.secondary_rad)
    )
