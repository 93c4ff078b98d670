"""Measures of a case of assisted tracking, and the names of its metrics."""

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

- ``error_max``: largest √(ΔA² + Δh²) between the prediction, with the biases removed, and the true
  direction of the satellite;
- ``sky_error_max``: the same as an arc on the sky, √((ΔA cos h)² + Δh²) for small errors;
- ``encoder_error_max``: largest √(ΔA² + Δh²) between the prediction with its biases and the angles
  that the antenna's encoders would show without noise; it decides about the reacquisition;
- ``time_outside``: time for which the arc between prediction and encoder angles exceeds the lock
  angle;
- ``nees``: normalised estimation error squared (two degrees of freedom) of the prediction in the
  middle of the outage, relative to the encoder angles;
- ``time_to_reacquire``: time from the return of the signal until the search finds the satellite (it
  runs back and forth), or until the set if it never does; only with a search;
- ``found``: 1 if the satellite is found before it sets, else 0; only with a search;
- ``found_at_once``: 1 if it is found at the prediction, else 0; only with a search.
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
        """Split a name into its parts; return None if it is not the name of a metric."""
        parts = name.split(".")
        return cls(*parts) if len(parts) == 4 else None


def outage_name(outage_s: float) -> str:
    """Return the name of an outage from its beginning, such as ``"60s"``."""
    return f"{outage_s:g}s".replace(".", "_")
