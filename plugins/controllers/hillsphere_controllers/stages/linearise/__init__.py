"""The stage ``linearise``: a plant's motion near points of a trajectory, to first order."""
