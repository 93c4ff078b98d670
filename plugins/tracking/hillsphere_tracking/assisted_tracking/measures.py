"""What a case of assisted tracking is measured by, and how the metrics are called."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["MEASURES", "MetricName", "outage_name"]

MEASURES = {
    "error_max": "rad",
    "sky_error_max": "rad",
    "encoder_error_max": "rad",
    "time_outside": "s",
    "nees": "-",
    "time_to_reacquire": "s",
    "found": "-",
    "found_at_once": "-",
}
"""Measure of an outage → its unit.

- ``error_max``: largest √(ΔA² + Δh²) of the predictions, biases taken off, against where the
  satellite truly is;
- ``sky_error_max``: the same as an arc on the sky, √((ΔA cos h)² + Δh²) for small errors;
- ``encoder_error_max``: largest √(ΔA² + Δh²) of the predictions with their biases against what the
  antenna's encoders would show without noise: what reacquisition needs;
- ``time_outside``: for how long the arc between prediction and antenna's angles exceeds the lock
  angle;
- ``nees``: normalised error squared (two degrees of freedom) of the prediction in the middle of the
  outage, against the antenna's angles;
- ``time_to_reacquire``: from the signal's return until the search finds the satellite (the search
  goes back and forth until it does); the time to the set if it never does; only with a search;
- ``found``: 1 if the satellite is found before it sets, else 0; only with a search;
- ``found_at_once``: 1 if it is found where it is predicted, else 0; only with a search.
"""


class MetricName(NamedTuple):
    """The parts of a metric's name, ``PASS.OUTAGE.TRACKER.MEASURE``."""

    pass_: str
    outage: str
    tracker: str
    measure: str

    def __str__(self) -> str:
        """Return the name."""
        return ".".join(self)

    @classmethod
    def parse(cls, name: str) -> MetricName | None:
        """Return the parts of a name, None if it is none."""
        parts = name.split(".")
        return cls(*parts) if len(parts) == 4 else None


def outage_name(outage_s: float) -> str:
    """Return the name of an outage by its beginning, such as ``"60s"``."""
    return f"{outage_s:g}s".replace(".", "_")
