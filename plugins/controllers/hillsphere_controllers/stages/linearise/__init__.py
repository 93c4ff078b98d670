"""The stage ``linearise``: linearisation of a plant's motion at points of a trajectory."""
