"""Built-in sensors plugin: what is measured of a state, with errors."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "sensor",
            "antenna",
            "hillsphere_sensors.antenna:Antenna",
            "hillsphere_sensors.specs:AntennaSpec",
            "azimuth and elevation of a ground antenna: noise, biases, outliers, dropouts",
        ),
    ]
