"""Reference trajectories of a formation near an asteroid."""
