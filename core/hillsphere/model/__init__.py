"""Physical models: bodies and their orbits, ephemerides, reference frames, shapes, the Earth."""
