"""One pass, live: measurements update the tracker, the tracker points the antenna."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import degrees, sqrt
from typing import NamedTuple

import numpy as np

from hillsphere.time import Epoch
from hillsphere_tracking.live.clock import Clock
from hillsphere_tracking.live.feed import Feed
from hillsphere_tracking.live.measurements import Measurement
from hillsphere_tracking.live.offsets import Offsets, offsets_of
from hillsphere_tracking.pointing.commands import advance_pointing, begin
from hillsphere_tracking.pointing.planning import PassPlan
from hillsphere_tracking.trackers.streaming import StreamingTracker

__all__ = ["Command", "Session", "Status", "run_session", "status_line"]

_STEP_S = 0.5
_FAR_OFF_S = 60.0


class Command(NamedTuple):
    """Where the antenna is sent, for a time: axis angles, and the prediction behind them."""

    t_s: float
    primary_rad: float
    secondary_rad: float
    azimuth_rad: float
    elevation_rad: float
    is_locked: bool


class Status(NamedTuple):
    """What an operator wants to see once a second."""

    t_s: float
    azimuth_rad: float
    elevation_rad: float
    sigma_rad: float
    offsets: Offsets
    taken: int
    is_locked: bool


@dataclass(frozen=True)
class Session:
    """What does not change during a pass.

    Parameters
    ----------
    tracker : StreamingTracker
        Its times count from the start of the clock.
    plan : PassPlan
        Of the axes; the session ends with it.
    period_s : float
        Between commands.
    lost_after_s : float
        Without a measurement for so long the signal counts as lost.
    """

    tracker: StreamingTracker
    plan: PassPlan
    period_s: float
    lost_after_s: float


def run_session(
    session: Session,
    clock: Clock,
    feed: Feed,
    position: tuple[float, float] | None,
    point: Callable[[Command], None],
    show: Callable[[Status], None],
    say: Callable[[str], None],
) -> None:
    """Track one pass to its end.

    Parameters
    ----------
    session : Session
        What is tracked, and how.
    clock : Clock
        What time it is.
    feed : Feed
        What is measured.
    position : tuple of two floats or None
        Where the axes stand, rad; None: where the plan begins.
    point : callable
        Is given each command, one period before its time.
    show : callable
        Is given a status once a second.
    say : callable
        Is given a line whenever something happens.
    """
    tracker, plan, period = session.tracker, session.plan, session.period_s
    nominal = tracker.state
    taken, heard, shown = 0, -np.inf, -np.inf
    tracker.lost()
    if position is None:
        position = float(plan.primary_rad[0]), float(plan.secondary_rad[0])
    state = begin(plan, clock.now_s(), *position)
    while state.time_s < plan.times_s[-1]:
        for found in feed.until(clock.start, state.time_s):
            t_s = found.epoch.seconds_since(clock.start)
            if _is_usable(found, t_s, state.time_s, clock.start, say):
                if not tracker.is_locked:
                    tracker.locked()
                    say("the signal is there")
                tracker.update(t_s, found.azimuth_rad, found.elevation_rad, found.sigma_rad)
                taken, heard = taken + 1, max(heard, t_s)
        if tracker.is_locked and state.time_s - heard > session.lost_after_s:
            tracker.lost()
            say(f"no measurement for {session.lost_after_s:g} s: the prediction goes on alone")
        now = state.time_s
        times = now + np.array([-_STEP_S, 0.0, period, _STEP_S + period])
        azimuth, elevation, covariance = tracker.predict(times)
        state = advance_pointing(plan, state, (times, azimuth, elevation), period)
        angles = (float(state.primary.angle_rad[0]), float(state.secondary.angle_rad[0]))
        predicted = (float(azimuth[2]), float(elevation[2]))
        point(Command(state.time_s, *angles, *predicted, tracker.is_locked))
        if now - shown >= 1.0 - 1e-6:
            shown = now
            around = now + _STEP_S * np.array([-1.0, 0.0, 1.0])
            az0, el0, _ = tracker.tracker.predict(nominal, around)
            here = (float(azimuth[1]), float(elevation[1]))
            offsets = offsets_of((az0[:, 0], el0[:, 0]), here, _STEP_S)
            sigma = sqrt(max(float(np.trace(covariance[:, :, 1])), 0.0))
            show(Status(now, *here, sigma, offsets, taken, tracker.is_locked))
        clock.wait_until(state.time_s)
        if (late := clock.now_s() - state.time_s) > 1.0:
            # the computer slept, or is too slow: commands for the past are of no use to anybody
            say(f"{late:.1f} s behind the clock: commands left out")
            rest = (float(state.primary.angle_rad[0]), float(state.secondary.angle_rad[0]))
            state = begin(plan, clock.now_s(), *rest)


def _is_usable(
    found: Measurement, t_s: float, now_s: float, start: Epoch, say: Callable[[str], None]
) -> bool:
    if abs(t_s - now_s) <= _FAR_OFF_S:
        return True
    when = start.isot(np.array([t_s]), 0)[0]
    say(
        f"passed over: {found.place}: a measurement of {when}, {abs(t_s - now_s):.0f} s "
        f"{'after' if t_s > now_s else 'before'} now; an earlier pass is tracked with --replay"
    )
    return False


def status_line(status: Status, start: Epoch) -> str:
    """Return a status as a line of text."""
    when = start.isot(np.array([status.t_s]), 0)[0]
    early, left = status.offsets
    time = f"{abs(early):.3f} s {'early' if early > 0 else 'late'}"
    side = f"{degrees(abs(left)):.3f}° {'left' if left > 0 else 'right'}"
    angles = f"az {degrees(status.azimuth_rad):8.3f}°  el {degrees(status.elevation_rad):7.3f}°"
    lock = "" if status.is_locked else "  NO SIGNAL"
    return (
        f"{when}  {angles}  ±{degrees(status.sigma_rad):.3f}°  {time}  {side}  "
        f"{status.taken} measurements{lock}"
    )
