"""The lowest layer: files, signals, seeds, time, constants, errors; it imports no other room."""
