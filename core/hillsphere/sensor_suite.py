"""Several sensors as one: what they show together, and sets of their measurements.

The public names of `hillsphere.engine.sensor_suite`.
"""

from hillsphere.engine.sensor_suite import (
    CommonScene,
    SensorSuite,
)

__all__ = [
    "CommonScene",
    "SensorSuite",
]
