"""Live operation: measurements in, commands to the antenna out.

- `measurements`: readers of angles, line by line.
- `clock`, `feed`: real time or a replay, and what has been measured so far.
- `rotctl`, `rotator`: an antenna behind rotctld, and what keeps it connected.
- `session`: one pass.
- `setup`, `command`: what ``hillsphere track`` is told.
"""
