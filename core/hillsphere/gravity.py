"""Evaluation of gravity models: on arrays of points, at shifted positions, and their gradients.

The public names of `hillsphere.engine.gravity`.
"""

from hillsphere.engine.gravity import (
    AnyGravityModel,
    GravityField,
    acceleration_at,
    acceleration_within,
    field_of,
    gravity_gradient,
    is_array_model,
    model_parameters,
    potential_at,
    whole_gravity,
)

__all__ = [
    "AnyGravityModel",
    "GravityField",
    "acceleration_at",
    "acceleration_within",
    "field_of",
    "gravity_gradient",
    "is_array_model",
    "model_parameters",
    "potential_at",
    "whole_gravity",
]
