"""Many cases of one stage: drawn, computed in blocks by an executor, kept, and summed up."""
