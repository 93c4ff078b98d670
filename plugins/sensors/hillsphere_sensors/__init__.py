"""Built-in sensors plugin: measurements of states, with errors."""

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
            "hillsphere_sensors.antenna_specs:AntennaSpec",
            "azimuth and elevation of a ground antenna: noise, biases, outliers, dropouts",
        ),
        Component(
            "sensor",
            "camera",
            "hillsphere_sensors.camera:Camera",
            "hillsphere_sensors.spacecraft_specs:CameraSpec",
            "where a camera sees an asteroid: its centre, visible points or disc",
        ),
        Component(
            "sensor",
            "lidar",
            "hillsphere_sensors.lidar:Lidar",
            "hillsphere_sensors.spacecraft_specs:LidarSpec",
            "range to the surface of an asteroid, and the direction of the spot",
        ),
        Component(
            "sensor",
            "inter_satellite",
            "hillsphere_sensors.inter_satellite:InterSatellite",
            "hillsphere_sensors.spacecraft_specs:InterSatelliteSpec",
            "range and direction of another spacecraft, blinded by the Sun",
        ),
        Component(
            "sensor",
            "deep_space_station",
            "hillsphere_sensors.deep_space_station:DeepSpaceStation",
            "hillsphere_sensors.spacecraft_specs:DeepSpaceStationSpec",
            "range, range-rate or direction of a spacecraft from the turning Earth",
        ),
        Component(
            "sensor",
            "sun_doppler",
            "hillsphere_sensors.sun_sensors:SunDoppler",
            "hillsphere_sensors.spacecraft_specs:SunDopplerSpec",
            "radial velocity against the Sun, by the Doppler shift of its light",
        ),
        Component(
            "sensor",
            "sun_sensor",
            "hillsphere_sensors.sun_sensors:SunSensor",
            "hillsphere_sensors.spacecraft_specs:SunSensorSpec",
            "direction of the Sun",
        ),
        Component(
            "sensor",
            "star_tracker",
            "hillsphere_sensors.star_tracker:StarTracker",
            "hillsphere_sensors.spacecraft_specs:StarTrackerSpec",
            "attitude of a spacecraft, as a small turn from the commanded one",
        ),
    ]
