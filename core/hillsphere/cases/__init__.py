"""Many cases of one stage: planned, computed in blocks by an executor, and kept."""
