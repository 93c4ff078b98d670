"""Antenna pointing: from predicted directions to commands of the axes.

- `interpolation`: directions between predictions, at the rate of the commands.
- `mounts`: conversion of directions to axis angles.
- `pass_plan`, `route`, `keyhole`: turn, flip and pre-slewed ramps of a whole pass.
- `commands`, `axis_motion`: commands within the limits of the axes.
- `search`, `reacquisition`: search after a loss of signal, and the time that it takes.
- `pass_log`, `replay`: logs of tracked passes, and scores of trackers on them.
- `stage`, `following`: mounts that follow the passes of a mission, with a plan and without.
"""
