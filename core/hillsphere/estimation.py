"""What estimators pass on: beliefs, sets of measurements, and what these brought.

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
