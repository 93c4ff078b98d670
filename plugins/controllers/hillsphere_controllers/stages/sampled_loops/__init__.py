"""The stage ``sampled_loops``: stability and margins of loops at their sample rates, exactly."""
