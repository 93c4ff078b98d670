"""Models of the world: bodies, frames, ephemerides, shapes, the Earth."""
