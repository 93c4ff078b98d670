"""The command ``hillsphere track``: tracks one pass live, or replays an earlier one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from math import degrees, inf, radians
from pathlib import Path
from typing import Annotated, Any

import typer

from hillsphere.base.constants import DAY_S
from hillsphere.cli.streams import say
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Tracker
from hillsphere.mission import load_mission
from hillsphere.time import Epoch
from hillsphere_tracking.ephemeris_orbit import EphemerisOrbit
from hillsphere_tracking.live.antenna import antenna_of
from hillsphere_tracking.live.atmosphere import ThroughAir
from hillsphere_tracking.live.calibration import StationMemory
from hillsphere_tracking.live.checks import (
    air_of,
    check_apart,
    check_positive,
    check_writable,
    random_walk_of,
)
from hillsphere_tracking.live.coming_pass import next_pass, plan_of, stream_of
from hillsphere_tracking.live.help_groups import GroupedCommand
from hillsphere_tracking.live.inputs import input_of, orientation_of
from hillsphere_tracking.live.logbook import Logbook
from hillsphere_tracking.live.scoring import score_lines
from hillsphere_tracking.live.session import Outputs, SearchRules, Session, run_session
from hillsphere_tracking.live.setup import orbit_of, place_of, tracker_of
from hillsphere_tracking.live.status import status_line
from hillsphere_tracking.live.targets import target_of
from hillsphere_tracking.passes.sources import element_warnings
from hillsphere_tracking.passes.specs import OLDEST_ELEMENTS_S
from hillsphere_tracking.trackers.specs import TableSpec
from hillsphere_tracking.trackers.table import Table

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_SATELLITE = "Satellite and station"
_MEASURED = "Measurements"
_TRACKER = "Prediction"
_ANTENNA = "Antenna"
_SEARCH = "Search after a loss"
_KEPT = "What is kept"


@app.command(cls=GroupedCommand)
def track(
    source: Annotated[
        str,
        typer.Argument(
            metavar="MEASUREMENTS",
            help="Angles: a CSV table (time, azimuth, elevation[, sigma] in degrees), a pass log "
            "or a CCSDS tracking data message; '-' for stdin.",
        ),
    ] = "-",
    mission: Annotated[
        str,
        typer.Option(
            help="Take satellite, station and [tracker.NAME] from a mission.",
            rich_help_panel=_SATELLITE,
        ),
    ] = "",
    elements: Annotated[
        str,
        typer.Option(
            metavar="FILE",
            help="Elements of the satellite (TLE, OMM), or its ephemeris (OEM, SPK of SPICE).",
            rich_help_panel=_SATELLITE,
        ),
    ] = "",
    satellite: Annotated[
        str, typer.Option(metavar="NAME", help="Which satellite.", rich_help_panel=_SATELLITE)
    ] = "",
    lenient: Annotated[
        bool,
        typer.Option(
            "--lenient",
            help="Harmless departures of --elements from the CCSDS standard are warnings.",
            rich_help_panel=_SATELLITE,
        ),
    ] = False,
    checksum: Annotated[
        str,
        typer.Option(
            metavar="refuse|warn|ignore",
            help="What a wrong checksum of a two-line element set is.",
            rich_help_panel=_SATELLITE,
        ),
    ] = "refuse",
    oldest: Annotated[
        float,
        typer.Option(
            metavar="DAYS",
            help="Age of elements from which a warning is given.",
            rich_help_panel=_SATELLITE,
        ),
    ] = OLDEST_ELEMENTS_S / DAY_S,
    station: Annotated[
        str, typer.Option(metavar="NAME", help="Which station.", rich_help_panel=_SATELLITE)
    ] = "",
    latitude: Annotated[
        float | None, typer.Option(help="Geodetic latitude, degrees.", rich_help_panel=_SATELLITE)
    ] = None,
    longitude: Annotated[
        float | None, typer.Option(help="East longitude, degrees.", rich_help_panel=_SATELLITE)
    ] = None,
    height: Annotated[
        float, typer.Option(help="Height above the ellipsoid, m.", rich_help_panel=_SATELLITE)
    ] = 0.0,
    mask: Annotated[
        float | None,
        typer.Option(
            help="Elevation of rise and set, degrees; left out: the mask of the mission's station, "
            "else 0.",
            rich_help_panel=_SATELLITE,
        ),
    ] = None,
    within: Annotated[
        float,
        typer.Option(
            help="Time in which the satellite must rise, h; of an ephemeris the part that it "
            "covers is searched.",
            rich_help_panel=_SATELLITE,
        ),
    ] = 24.0,
    ut1_minus_utc: Annotated[
        float | None,
        typer.Option(
            help="UT1 - UTC, s; left out: the installed table.", rich_help_panel=_SATELLITE
        ),
    ] = None,
    epoch: Annotated[
        str,
        typer.Option(help="Epoch (UTC) of times given in seconds.", rich_help_panel=_MEASURED),
    ] = "",
    sigma: Annotated[
        float,
        typer.Option(
            help="Standard deviation of angles without one, degrees.",
            rich_help_panel=_MEASURED,
        ),
    ] = 0.1,
    replay: Annotated[
        bool,
        typer.Option(
            "--replay", help="Use the times of the measurements.", rich_help_panel=_MEASURED
        ),
    ] = False,
    speed: Annotated[
        float,
        typer.Option(help="Speed of a replay; 0: without waiting.", rich_help_panel=_MEASURED),
    ] = 1.0,
    tracker: Annotated[
        str,
        typer.Option(
            help="Type of tracker, or name of the mission's table.", rich_help_panel=_TRACKER
        ),
    ] = "least_squares",
    refraction: Annotated[
        bool,
        typer.Option(
            "--refraction",
            help="Measured and commanded elevations are apparent (with refraction).",
            rich_help_panel=_TRACKER,
        ),
    ] = False,
    pressure: Annotated[
        float | None,
        typer.Option(help="Pressure of the air, hPa; default: 1010.", rich_help_panel=_TRACKER),
    ] = None,
    temperature: Annotated[
        float | None,
        typer.Option(help="Temperature of the air, °C; default: 10.", rich_help_panel=_TRACKER),
    ] = None,
    mount: Annotated[
        str, typer.Option(metavar="az_el|x_y", help="Kind of mount.", rich_help_panel=_ANTENNA)
    ] = "az_el",
    axis_azimuth: Annotated[
        float | None,
        typer.Option(
            help="Azimuth of an X/Y mount's X axis, degrees; left out: 0.",
            rich_help_panel=_ANTENNA,
        ),
    ] = None,
    azimuth_limits: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Stops, degrees; left out: 0 450.", rich_help_panel=_ANTENNA),
    ] = None,
    elevation_limits: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Stops, degrees; left out: 0 90.", rich_help_panel=_ANTENNA),
    ] = None,
    x_limits: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Stops, degrees; left out: -90 90.", rich_help_panel=_ANTENNA),
    ] = None,
    y_limits: Annotated[
        tuple[float, float] | None,
        typer.Option(help="Stops, degrees; left out: -90 90.", rich_help_panel=_ANTENNA),
    ] = None,
    rate: Annotated[
        float,
        typer.Option(help="Largest rate of both axes, degrees/s.", rich_help_panel=_ANTENNA),
    ] = 10.0,
    acceleration: Annotated[
        float,
        typer.Option(
            help="Largest acceleration of both axes, degrees/s².", rich_help_panel=_ANTENNA
        ),
    ] = 10.0,
    period: Annotated[
        float, typer.Option(help="Interval between commands, s.", rich_help_panel=_ANTENNA)
    ] = 0.1,
    rotator: Annotated[
        str,
        typer.Option(
            metavar="HOST[:PORT]",
            help="Drive this rotctld (hamlib) instead of writing CSV.",
            rich_help_panel=_ANTENNA,
        ),
    ] = "",
    rotator_timeout: Annotated[
        float,
        typer.Option(
            help="Longest wait for the connection to rotctld and for each of its answers, s.",
            rich_help_panel=_ANTENNA,
        ),
    ] = 2.0,
    lost_after: Annotated[
        float,
        typer.Option(
            help="Time without a measurement after which the signal counts as lost, s.",
            rich_help_panel=_SEARCH,
        ),
    ] = 3.0,
    lock_angle: Annotated[
        float,
        typer.Option(
            help="Largest pointing error at which the signal is received, degrees: the half-width "
            "of the beam.",
            rich_help_panel=_SEARCH,
        ),
    ] = 0.5,
    dwell: Annotated[
        float,
        typer.Option(
            help="Time for which the signal must be in the beam to be found, s.",
            rich_help_panel=_SEARCH,
        ),
    ] = 1.0,
    search: Annotated[
        bool,
        typer.Option(
            help="Search around the prediction after a loss.",
            rich_help_panel=_SEARCH,
        ),
    ] = True,
    memory: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Station memory: begin with the biases of earlier passes, store them at the end.",
            rich_help_panel=_KEPT,
        ),
    ] = None,
    forget: Annotated[
        tuple[float, float],
        typer.Option(
            help="Random walk of biases (degrees) and of the time offset (s) in a day.",
            rich_help_panel=_KEPT,
        ),
    ] = (0.01, 0.01),
    log: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write measurements, commands and predictions to a pass log.",
            rich_help_panel=_KEPT,
        ),
    ] = None,
    score: Annotated[
        bool,
        typer.Option(
            "--score",
            help="Report the errors of predictions after losses at the end.",
            rich_help_panel=_KEPT,
        ),
    ] = False,
) -> None:
    """Point an antenna at a satellite, using the antenna's measurements.

    Commands go to stdout as CSV, or to a rotator. stderr shows time, angles and the offsets of the
    satellite from its nominal track. Without measurements the prediction continues, and the antenna
    searches around it if its error may exceed the beam.

    Exit codes: 0 the pass is over; 1 no connection to the rotator; 2 an argument cannot be used;
    130 interrupted.
    """
    check_positive(
        sigma=sigma, lost_after=lost_after, within=within, rate=rate, acceleration=acceleration,
        rotator_timeout=rotator_timeout, oldest=oldest,
    )  # fmt: skip
    if not 0.01 <= period <= 10.0:
        raise InputError(f"--period must be from 0.01 to 10 s, got {period:g}")
    if not 0.0 < lock_angle <= 90.0:
        raise InputError(f"--lock-angle must be > 0 and at most 90°, got {lock_angle:g}")
    if not 0.0 <= dwell < inf:
        raise InputError(f"--dwell must be ≥ 0, got {dwell:g}")
    if not 0.0 <= speed < inf or (speed != 1.0 and not replay):
        raise InputError("--speed must be ≥ 0, and is for --replay only")
    check_writable("--memory", memory)
    check_writable("--log", log)
    check_apart(log, source)
    if memory and latitude is not None and not station:
        raise InputError("--memory keeps biases by the station's name: give --station NAME")
    loaded = load_mission(mission) if mission else None
    orbit = orbit_of(loaded, elements, satellite, lenient=lenient, checksum=checksum)
    place = place_of(loaded, station, (latitude, longitude, height), mask)
    air = air_of(refraction, pressure, temperature)
    inner = tracker_of(loaded, tracker)
    stops = {"azimuth": azimuth_limits, "elevation": elevation_limits, "x": x_limits, "y": y_limits}
    antenna = antenna_of(mount, stops, rate, acceleration, axis_azimuth)
    walk = random_walk_of(forget)
    kept = StationMemory(memory, place.station.name, walk, say) if memory else None
    counted_from = Epoch.parse(epoch, "UTC") if epoch else None
    beam = radians(lock_angle)
    # memory, log and scores are written after the rotator has been stopped
    with ExitStack() as afterwards, ExitStack() as stack:
        feed, clock = input_of(stack, source, counted_from, replay, speed)
        start = clock.start
        orientation = orientation_of(ut1_minus_utc, start)
        if isinstance(orbit, EphemerisOrbit):
            orbit = orbit.turned_by(orientation)
        try:
            seen = next_pass(orbit, place, start, orientation, period, 3600.0 * within, air)
        except PropagationError as error:  # the elements are not valid at this time
            raise InputError(str(error)) from error
        clock.skip_to(float(seen.times_s[0]))
        end_s = float(seen.times_s[-1])
        for sentence in element_warnings([orbit], start, end_s, DAY_S * oldest):
            say(sentence)
        if seen.cut:
            say(f"the orbit of {orbit.name} ends before the satellite sets, and with it the pass")

        def streamed(method: Tracker[Any]) -> Any:
            through = method if air is None else ThroughAir(method, air)
            return stream_of(through, orbit, place, seen, start, orientation, radians(sigma))

        stream = streamed(inner)
        if kept:
            stream.state = kept.begin(inner, stream.state, start)
        begun = stream.state
        position, point = target_of(stack, rotator, rotator_timeout, start, antenna.axes)
        session = Session(
            stream, plan_of(seen, antenna.mount, position), place, seen.rise_s, period,
            lost_after, SearchRules(beam, dwell) if search else None,
        )  # fmt: skip
        name = place.station.name
        say(f"{orbit.name} over {name}, until {start.isot(seen.times_s[-1:], 0)[0]} UTC")
        if (miss := degrees(float(session.plan.error_rad[seen.up].max()))) > 0.1:
            say(f"the limits of the mount will cause errors of up to {miss:.1f}° in this pass")
        book = Logbook(start, antenna.mount, radians(sigma), log, say)
        if score:
            table = streamed(Table(TableSpec()))
            rivals = {tracker: (stream.tracker, begun), "(table)": (table.tracker, table.state)}
            afterwards.callback(
                lambda: _print_lines(score_lines(rivals, book.pass_log(), lost_after, beam))
            )
        if kept:
            afterwards.callback(
                lambda: kept.end(inner, stream.state, start, float(stream.state.t_s[0]))
            )
        afterwards.callback(book.save)
        outputs = Outputs(
            _call_all(point, book.note_command), book.note_measurement,
            lambda status: say(status_line(status, start)), say,
        )  # fmt: skip
        run_session(session, clock, feed, position, outputs)


def _call_all(*takers: Callable[[Any], None]) -> Callable[[Any], None]:
    def take(command: Any) -> None:
        for taker in takers:
            taker(command)

    return take


def _print_lines(lines: list[str]) -> None:
    for line in lines:
        say(line)
