"""Specs of the plants: the keys of ``[plant.NAME]`` in a mission."""

from __future__ import annotations

from math import pi
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Ref, Spec, option, quantity, reference, rule

__all__ = ["HillSpec", "ThreeBodySpec"]


class HillSpec(Spec):
    """Circular Hill problem about a moon, with any gravity model."""

    examples = ({"body": "phobos", "gravity": "phobos"},)

    body: Ref = reference("body", "the moon that the motion is about: gives the mean motion")
    gravity: Ref = reference("gravity", "gravity of the moon, in its body-fixed frame")
    prime_meridian_rad: float = quantity(
        "angle",
        "angle about +z from +x (away from the primary) to the moon's longitude 0; "
        "the IAU convention puts longitude 0 of a locked moon under the primary, that is at 180°",
        default=pi,
    )
    escape_radius_m: float | None = quantity(
        "length", "distance from the moon at which a flight ends as escaped", default=None, gt=0
    )


class ThreeBodySpec(Spec):
    """Motion about a moon with its primary at its true distance, on a circle or an ellipse."""

    examples = (
        {"body": "phobos", "gravity": "phobos"},
        {"body": "phobos", "gravity": "phobos", "orbit": "elliptic", "rotation": "uniform"},
        {"body": "asteroid", "gravity": "eros", "orbit": "elliptic", "rotation": "spin"},
    )

    body: Ref = reference("body", "the moon that the motion is about: gives orbit and libration")
    gravity: Ref = reference("gravity", "gravity of the moon, in its body-fixed frame")
    orbit: Literal["circular", "elliptic"] = option(
        "path of the body: a circle whatever its eccentricity (states in the frame hill:BODY), or "
        "its ellipse (true anomaly as seventh state, the rotation angle of a spin of its own as "
        "eighth, frame body:BODY)",
        default="circular",
    )
    rotation: Literal["locked", "uniform", "libration", "spin"] = option(
        "how the body turns, on an ellipse: with the line to the primary; uniformly, once in a "
        "revolution; so with the body's libration in longitude; or uniformly at the body's own "
        "rotation rate, as an asteroid does. On a circle it is locked",
        default="locked",
    )
    prime_meridian_rad: float = quantity(
        "angle",
        "angle about +z from away from the primary to the body's longitude 0, in the mean, or with "
        "a spin of its own where true anomaly and rotation angle are 0; the IAU convention puts "
        "longitude 0 of a locked moon under the primary, that is at 180°",
        default=pi,
    )
    escape_radius_m: float | None = quantity(
        "length", "distance from the moon at which a flight ends as escaped", default=None, gt=0
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.orbit == "circular" and self.rotation != "locked":
            text = "on a circle the moon is locked; leave it out, or give orbit = 'elliptic'"
            raise rule("rotation", text)
        return self
