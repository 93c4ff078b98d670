"""A suite of several sensors, whose measurements form one set.

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
