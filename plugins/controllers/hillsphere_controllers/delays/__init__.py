"""Linear systems with delays, which feedback may hold: responses, stability, norms, covers."""
