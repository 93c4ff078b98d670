"""The stage ``orbit_fit``: recorded tracking data fitted by least squares, and filtered."""
