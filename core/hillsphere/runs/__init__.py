"""Running of missions: check, assembly, pipeline, run directory, cache, resume and rerun."""
