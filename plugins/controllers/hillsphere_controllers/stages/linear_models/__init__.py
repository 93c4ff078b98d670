"""The stage ``linear_models``: linear systems by their matrices, connected by their signals."""
