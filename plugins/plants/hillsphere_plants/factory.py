"""Which plant a mission's ``type = "three_body"`` means."""

from __future__ import annotations

from hillsphere.gravity import AnyGravityModel, is_array_model
from hillsphere_plants.moon_centred import MoonCentred
from hillsphere_plants.specs import ThreeBodySpec
from hillsphere_plants.spinning import ArraySpinningBody, SpinningBody
from hillsphere_plants.three_body import (
    ArrayCircularThreeBody,
    ArrayEllipticThreeBody,
    CircularThreeBody,
    EllipticThreeBody,
)

__all__ = ["three_body"]


def three_body(spec: ThreeBodySpec) -> MoonCentred:
    """Make the plant: circular, elliptic or spinning, of expressions or with array gravity."""
    gravity: AnyGravityModel = spec.gravity.get()
    arrays = is_array_model(gravity)
    if spec.orbit == "circular":
        return ArrayCircularThreeBody(spec) if arrays else CircularThreeBody(spec)
    if spec.rotation == "spin":
        return ArraySpinningBody(spec) if arrays else SpinningBody(spec)
    return ArrayEllipticThreeBody(spec) if arrays else EllipticThreeBody(spec)
