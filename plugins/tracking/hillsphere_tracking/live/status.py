"""Status line of a session, shown to the operator once per second."""

from __future__ import annotations

from math import degrees
from typing import NamedTuple

import numpy as np

from hillsphere.time import Epoch
from hillsphere_tracking.live.offsets import Offsets

__all__ = ["Status", "status_line"]

_WORDS = {"locked": "", "predicting": "NO SIGNAL", "searching": "NO SIGNAL, SEARCHING"}


class Status(NamedTuple):
    """Predicted direction of the satellite with its accuracy, and state of the antenna.

    `outlier_share` is the share of outliers among the last measurements; `state` is ``locked``,
    ``predicting`` or ``searching``; `hidden_by` names the obstacle before the satellite, or is
    empty; `beside_rad` are the arcs, rightwards and upwards, by which the search leaves the
    prediction.
    """

    t_s: float
    azimuth_rad: float
    elevation_rad: float
    sigma_rad: float
    offsets: Offsets
    taken: int
    outlier_share: float
    state: str
    hidden_by: str
    beside_rad: tuple[float, float]


def status_line(status: Status, start: Epoch) -> str:
    """Return a status as a line of text."""
    when = start.isot(np.array([status.t_s]), 0)[0]
    early, left = status.offsets
    time = f"{abs(early):.3f} s {'early' if early > 0 else 'late'}"
    side = f"{degrees(abs(left)):.3f}° {'left' if left > 0 else 'right'}"
    angles = f"az {degrees(status.azimuth_rad):8.3f}°  el {degrees(status.elevation_rad):7.3f}°"
    parts = [
        f"{when}  {angles}  ±{degrees(status.sigma_rad):.3f}°", time, side,
        f"{status.taken} measurements",
    ]  # fmt: skip
    if status.outlier_share > 0.5:
        parts.append(
            f"{100.0 * status.outlier_share:.0f} % OUTLIERS: side lobe, or sigma too small"
        )
    if word := _WORDS[status.state]:
        parts.append(word)
    if status.state == "searching":
        right, up = (degrees(arc) for arc in status.beside_rad)
        parts.append(f"{right:+.2f}° across {up:+.2f}° up")
    if status.hidden_by:
        parts.append(f"BEHIND: {status.hidden_by}")
    return "  ".join(parts)
