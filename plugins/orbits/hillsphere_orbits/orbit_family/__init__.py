"""The stage ``orbit_family``: a family and the continuation of its members in parameters."""
