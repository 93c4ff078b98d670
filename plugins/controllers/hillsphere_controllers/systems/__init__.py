"""Linear systems: algebra, interconnection, scaling, conversion."""
