"""Live tracking: measurements as input, commands to the antenna as output.

- `measurements`: readers of measured angles, line by line.
- `clock`, `feed`, `inputs`, `gate`: time and measurements, live or replayed.
- `rotctl`, `rotator`, `targets`: commands to an antenna behind rotctld, and its connection.
- `setup`, `antenna`, `sky`, `atmosphere`, `checks`: satellite, station, mount, obstacles.
- `coming_pass`, `session`, `status`, `offsets`: tracking of one pass.
- `calibration`, `logbook`, `scoring`: station memory, pass log and scores of a pass.
- `command`, `help_groups`: the command ``hillsphere track``.
"""
