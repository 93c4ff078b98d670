"""Live operation: measurements in, commands to the antenna out.

- `measurements`: readers of angles, line by line.
- `clock`, `feed`, `inputs`: real time or a replay, and what has been measured so far.
- `rotctl`, `rotator`, `targets`: an antenna behind rotctld, and what keeps it connected.
- `setup`, `antenna`, `sky`, `atmosphere`: satellite, station, mount, and what is in the way.
- `coming_pass`, `session`, `status`, `offsets`: one pass.
- `calibration`, `logbook`, `scoring`: what is kept of it.
- `command`, `help_groups`: ``hillsphere track``.
"""
