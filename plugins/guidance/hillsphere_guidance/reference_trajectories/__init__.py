"""The stage ``reference_trajectories``: descents planned by guidance, flown again, handed on."""
