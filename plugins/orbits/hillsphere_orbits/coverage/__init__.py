"""Coverage of the body's surface from an orbit, with eclipses and lighting."""
