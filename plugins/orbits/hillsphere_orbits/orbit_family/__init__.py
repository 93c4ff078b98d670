"""The stage ``orbit_family``: any family followed, its members carried along other parameters."""
