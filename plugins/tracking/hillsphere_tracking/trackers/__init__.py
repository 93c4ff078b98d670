"""Trackers: orbit estimators that predict pointing angles from a nominal orbit and measured angles.

- `table`: the nominal orbit without updates; the baseline of every comparison.
- `average`: running means of the node and the anomaly (trackers ``circular`` and ``average``).
- `least_squares`: recursive least squares on two, three or all elements, with biases.
- `nominal`: initial mean elements of a tracker, from any orbit.
- `streaming`: a tracker of one antenna that takes single measurements.
"""
