"""Passes over ground stations, assisted antenna tracking and pointing."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "stage",
            "passes",
            "hillsphere_tracking.passes.stage:PassesStage",
            "hillsphere_tracking.passes.specs:PassesSpec",
            "passes of satellites over ground stations, eclipses and ground tracks",
        ),
        Component(
            "stage",
            "pointing",
            "hillsphere_tracking.pointing.stage:PointingStage",
            "hillsphere_tracking.pointing.specs:PointingSpec",
            "antenna mounts that follow passes: turns, flips, keyholes, rates and errors",
        ),
        Component(
            "stage",
            "assisted_tracking",
            "hillsphere_tracking.assisted_tracking.stage:AssistedTrackingStage",
            "hillsphere_tracking.assisted_tracking.specs:AssistedTrackingSpec",
            "passes with a loss of signal, tracked by several trackers, case by case",
        ),
        Component(
            "stage",
            "tracking_comparison",
            "hillsphere_tracking.tracking_comparison.stage:TrackingComparisonStage",
            "hillsphere_tracking.tracking_comparison.specs:TrackingComparisonSpec",
            "comparison of trackers over many cases, with a baseline and published values",
        ),
        Component(
            "tracker",
            "table",
            "hillsphere_tracking.trackers.table:Table",
            "hillsphere_tracking.trackers.specs:TableSpec",
            "stored table of the nominal orbit, never updated",
        ),
        Component(
            "tracker",
            "circular",
            "hillsphere_tracking.trackers.average:Circular",
            "hillsphere_tracking.trackers.specs:AverageSpec",
            "running means of the node and the true anomaly of a circular orbit",
        ),
        Component(
            "tracker",
            "average",
            "hillsphere_tracking.trackers.average:Average",
            "hillsphere_tracking.trackers.specs:AverageSpec",
            "running means of the node and the mean anomaly, assisted tracking of 1990",
        ),
        Component(
            "tracker",
            "least_squares",
            "hillsphere_tracking.trackers.least_squares:LeastSquares",
            "hillsphere_tracking.trackers.specs:LeastSquaresSpec",
            "recursive least squares on mean elements, with angle and time biases",
        ),
        Component(
            "command",
            "passes",
            "hillsphere_tracking.passes.command:app",
            "",
            "list the passes of a satellite over a ground station",
        ),
        Component(
            "command",
            "track",
            "hillsphere_tracking.live.command:app",
            "",
            "point an antenna at a satellite, using the antenna's measurements",
        ),
        Component(
            "format",
            "tle",
            "hillsphere_tracking.element_formats:TleFile",
            "hillsphere.formats.specs:FileFormatSpec",
            "two-line element sets (.tle)",
        ),
        Component(
            "format",
            "omm",
            "hillsphere_tracking.element_formats:OmmFile",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "CCSDS Orbit Mean-Elements Messages as text (.omm)",
        ),
        Component(
            "format",
            "omm_xml",
            "hillsphere_tracking.element_formats:OmmXml",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "CCSDS Orbit Mean-Elements Messages as XML (.xml)",
        ),
        Component(
            "format",
            "omm_json",
            "hillsphere_tracking.element_formats:OmmJson",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "mean elements of CelesTrak and Space-Track in JSON (.json)",
        ),
        Component(
            "format",
            "omm_csv",
            "hillsphere_tracking.element_formats:OmmCsv",
            "hillsphere.formats.specs:OrbitMessageSpec",
            "mean elements of CelesTrak and Space-Track in CSV (.csv)",
        ),
    ]
