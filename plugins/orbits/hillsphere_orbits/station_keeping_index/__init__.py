"""The analytic station-keeping index."""
