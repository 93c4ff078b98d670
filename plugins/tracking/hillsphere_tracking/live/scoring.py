"""Scores of a session: errors of the prediction after losses that happened, and after others."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from typing import Any

import numpy as np

from hillsphere.interfaces import Tracker
from hillsphere_tracking.pointing.pass_log import PassLog
from hillsphere_tracking.pointing.replay import Score, score

__all__ = ["losses_of", "score_lines"]

_USUAL_S = (60.0, 120.0, 300.0)
"""Losses (s after the first measurement) that every pass is scored for, so that passes can be
compared with each other."""
_HAIR_S = 1e-3
"""Added to the time of the last measurement before a loss (s), so that this measurement still
counts as before it."""
_MOST = 10
"""Losses of a pass that are scored: a signal that comes and goes would fill the screen."""


def losses_of(log: PassLog, lost_after_s: float) -> list[float]:
    """Return the losses to be scored, in seconds after the first measurement.

    Parameters
    ----------
    log : PassLog
        Log of the pass.
    lost_after_s : float
        Time without a measurement after which the signal counts as lost.

    Returns
    -------
    list of float
        The first ten losses that happened, and assumed losses after 1, 2 and 5 minutes if there are
        measurements before and after them; in increasing order.
    """
    times = log.times_s[log.locked]
    if times.size < 2:
        return []
    since = times - times[0]
    happened = since[:-1][np.diff(since) > lost_after_s][:_MOST] + _HAIR_S
    usual = [t for t in _USUAL_S if t < since[-1]]
    # assumed and real losses with the same number of measurements before them are one loss
    by_count = {int(np.searchsorted(since, t - 1e-6)): t for t in (*usual, *happened.tolist())}
    return sorted(by_count.values())


def score_lines(
    trackers: Mapping[str, tuple[Tracker[Any], Any]],
    log: PassLog | None,
    lost_after_s: float,
    beam_rad: float,
) -> list[str]:
    """Return a table of scores as lines of text.

    Parameters
    ----------
    trackers : mapping of str to (Tracker, state)
        Trackers by name, each with its state before the pass.
    log : PassLog or None
        Log of the pass.
    lost_after_s : float
        Time without a measurement after which the signal counts as lost.
    beam_rad : float
        Radius of the beam.

    Returns
    -------
    list of str
        A heading and a line for each loss and tracker, or one line with the reason why there is no
        score.
    """
    losses = [] if log is None else losses_of(log, lost_after_s)
    if log is None or not losses:
        return ["no score: it needs measurements before and after a loss, 60 s after the first"]
    head = (
        "errors of the prediction from a loss to the end of the pass, against the measurements "
        f"(beam ±{degrees(beam_rad):g}°)"
    )
    names = f"{'locked':>8}  {'tracker':<16} {'measured':>8} {'compared':>8}"
    names += f" {'largest':>9} {'rms':>9} {'outside':>8}"
    return [head, names, *(_line(row) for row in score(trackers, log, losses, beam_rad))]


def _line(row: Score) -> str:
    return (
        f"{row.locked_s:6.0f} s  {row.tracker:<16} {row.measurements:8d} "
        f"{row.predictions:8d} {degrees(row.largest_rad):8.3f}° {degrees(row.rms_rad):8.3f}° "
        f"{row.outside_s:6.0f} s"
    )
