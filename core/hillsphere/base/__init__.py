"""Ground: arrays, files, signals, seeds, time, problems; nothing above it is imported."""
