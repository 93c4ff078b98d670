"""Navigation in a closed loop: sensors and a filter say where spacecraft are, a law acts on it."""
