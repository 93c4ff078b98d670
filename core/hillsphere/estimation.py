"""Data of estimators: beliefs, sets of measurements, and innovations.

The public names of `hillsphere.interfaces.beliefs`.
"""

from hillsphere.interfaces.beliefs import (
    Belief,
    Innovation,
    MeasurementSet,
)

__all__ = [
    "Belief",
    "Innovation",
    "MeasurementSet",
]
