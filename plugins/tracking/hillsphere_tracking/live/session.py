"""Tracking of one pass, live or replayed: measurements update the prediction of the pointing.

Without measurements for some time the signal counts as lost. The prediction then continues without
updates. If its error may exceed the beam and the satellite is not hidden, the antenna searches
around the prediction until it receives measurements again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import degrees, sqrt
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_tracking.live.clock import Clock
from hillsphere_tracking.live.feed import Feed
from hillsphere_tracking.live.gate import Gate
from hillsphere_tracking.live.measurements import Measurement
from hillsphere_tracking.live.offsets import offsets_of
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.live.status import Status
from hillsphere_tracking.pointing.commands import PointingState, advance_pointing, begin
from hillsphere_tracking.pointing.pass_plan import PassPlan
from hillsphere_tracking.pointing.search import Search, search_now, search_speed
from hillsphere_tracking.pointing.sky import parallel_transport
from hillsphere_tracking.trackers.streaming import StreamingTracker

__all__ = ["Command", "Outputs", "SearchRules", "Session", "SignalState", "run_session"]

SignalState: TypeAlias = Literal["locked", "predicting", "searching"]

_STEP_S = 0.5
"""Interval (s) on both sides of now over which rates and offsets are central differences. Larger,
and the curvature of a pass near the zenith shows in them; predictions are smooth, so that it need
not be."""


class Command(NamedTuple):
    """Command of the antenna for a time: axis angles, predicted direction and state of signal."""

    t_s: float
    primary_rad: float
    secondary_rad: float
    azimuth_rad: float
    elevation_rad: float
    state: SignalState


class SearchRules(NamedTuple):
    """Parameters of a search: radius of the beam, and dwell time of the signal in it."""

    beam_rad: float
    dwell_s: float


class Outputs(NamedTuple):
    """Receivers of the outputs of a session.

    `point` receives each command, one period before its time; `note` each measurement that is used,
    with its time; `show` a status once per second; `say` a line for each event.
    """

    point: Callable[[Command], None]
    note: Callable[[float, Measurement], None]
    show: Callable[[Status], None]
    say: Callable[[str], None]


@dataclass(frozen=True)
class Session:
    """Configuration of the tracking of one pass.

    Parameters
    ----------
    tracker : StreamingTracker
        Tracker whose times count from the start of the clock.
    plan : PassPlan
        Plan of the axes; the session ends with it.
    place : Place
        Station with its horizon mask and blind sectors.
    rise_s : float
        Time of the rise by the elements. Until then, or until the first measurement, the antenna
        waits where the satellite will rise.
    period_s : float
        Interval between commands.
    lost_after_s : float
        Time without a measurement after which the signal counts as lost.
    search : SearchRules or None
        Parameters of the search after a loss; None for no search.
    """

    tracker: StreamingTracker
    plan: PassPlan
    place: Place
    rise_s: float
    period_s: float
    lost_after_s: float
    search: SearchRules | None


def run_session(
    session: Session,
    clock: Clock,
    feed: Feed,
    position: tuple[float, float] | None,
    outputs: Outputs,
) -> None:
    """Track one pass to its end.

    Parameters
    ----------
    session : Session
        Configuration.
    clock : Clock
        Clock of the session.
    feed : Feed
        Measurements.
    position : tuple of two floats or None
        Angles of the axes, rad; None for the beginning of the plan.
    outputs : Outputs
        Receivers of commands, measurements, status and events.
    """
    tracker, plan, period, place = session.tracker, session.plan, session.period_s, session.place
    elements = tracker.nominal_orbit()
    taken, heard, shown = 0, -np.inf, -np.inf
    gate = Gate(clock.start, outputs.say)
    search: Search | None = None
    turned = 0.0
    tracker.mark_lost()
    if position is None:
        position = float(plan.primary_rad[0]), float(plan.secondary_rad[0])
    state = begin(plan, clock.now_s(), *position)
    while state.time_s < plan.times_s[-1]:
        for t_s, measurement in gate.admit(feed.until(clock.start, state.time_s), state.time_s):
            if not tracker.is_locked:
                tracker.mark_locked()
                outputs.say("the signal is there")
            tracker.update(
                t_s, measurement.azimuth_rad, measurement.elevation_rad, measurement.sigma_rad
            )
            outputs.note(t_s, measurement)
            taken, heard = taken + 1, max(heard, min(t_s, state.time_s))
        # loss of signal: predictions continue from the last estimate
        if tracker.is_locked and state.time_s - heard > session.lost_after_s:
            tracker.mark_lost()
            outputs.say(f"no measurement for {session.lost_after_s:g} s: the prediction goes on")
        now = state.time_s
        times = now + np.array([-_STEP_S, 0.0, period, _STEP_S + period])
        azimuth, elevation, covariance = tracker.predict(times)
        here = (float(azimuth[1]), float(elevation[1]))
        hidden_by = place.hidden_by(*here)
        if tracker.is_locked or not taken or hidden_by:
            search = None
        elif session.search is not None:
            new = _update_search(session, search, turned, covariance[:, :, 1], state, outputs.say)
            search, turned = new, turned if new is search else 0.0
        doing: SignalState = "predicting" if search is None else "searching"
        doing = "locked" if tracker.is_locked else doing
        # Near the zenith the axes "right" and "up" rotate, whereas the search path does not.
        turns = turned + parallel_transport(azimuth[1:3], elevation[1:3])
        beside = None if search is None else partial(_beside, search, times[1:3], turns)
        aim = azimuth, elevation
        if not taken and now + period < session.rise_s:
            aim = tracker.predict(np.full(times.shape, session.rise_s))[:2]
        state = advance_pointing(plan, state, (times, *aim), period, beside)
        # one command per period, one period ahead of its time
        predicted, turned = (float(azimuth[2]), float(elevation[2])), float(turns[1])
        outputs.point(Command(state.time_s, *_angles(state), *predicted, doing))
        if now - shown >= 1.0 - 1e-6:
            shown = now
            # without the biases of the angles, which would pass for a motion along the track
            offsets = offsets_of(elements, tracker.true_direction(now), now)
            sigma = sqrt(max(float(np.trace(covariance[:, :, 1])), 0.0))
            arcs = np.ravel((0.0, 0.0) if beside is None else beside(times[1:2]))
            aside = (float(arcs[0]), float(arcs[1]))
            outputs.show(
                Status(
                    now,
                    *here,
                    sigma,
                    offsets,
                    taken,
                    tracker.outlier_share,
                    doing,
                    hidden_by,
                    aside,
                )
            )
        clock.wait_until(state.time_s)
        if (late := clock.now_s() - state.time_s) > 1.0:
            # The computer was suspended or is too slow: skip commands for the past.
            outputs.say(f"{late:.1f} s behind the clock: commands left out")
            state = begin(plan, clock.now_s(), *_angles(state))
    gate.end()


def _update_search(
    session: Session,
    search: Search | None,
    turned_rad: float,
    covariance: Array,
    state: PointingState,
    say: Callable[[str], None],
) -> Search | None:
    """Return the search at the present time, and report its beginning or end."""
    assert session.search is not None
    beam, dwell = session.search
    speed = search_speed(session.plan.mount, float(state.secondary.angle_rad[0]), beam)
    left = float(session.plan.times_s[-1]) - state.time_s
    new = search_now(
        search, covariance, beam, speed, state.time_s,
        within_s=left, dwell_s=dwell, turned_rad=turned_rad,
    )  # fmt: skip
    if new is not None and new is not search:
        size = new.sigmas * sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
        say(
            f"searching up to {degrees(size):.2f}° around the prediction, in {new.duration_s:.0f} s"
        )
    if new is None and search is not None:
        say("the beam at the prediction covers its error: the search ends")
    return new


def _beside(search: Search, times: Array, turns: Array, at: Array) -> tuple[Array, Array]:
    return search.at(at, np.interp(at, times, turns))


def _angles(state: PointingState) -> tuple[float, float]:
    return float(state.primary.angle_rad[0]), float(state.secondary.angle_rad[0])
