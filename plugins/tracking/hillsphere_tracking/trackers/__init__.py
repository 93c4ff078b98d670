"""Trackers: where to point an antenna, from a nominal orbit and the angles measured so far.

- `table`: the nominal orbit, never updated; the baseline of every comparison.
- `circular`, `average`: arithmetic means of the node and the anomaly that each measurement yields.
- `least_squares`: recursive least squares on two, three or all elements, with biases.
- `nominal`: the mean elements that they begin with, from any orbit.
- `streaming`: one antenna, measurement by measurement, over the same functions.
"""
