"""Specs of the plants: what a mission may write in ``[plant.NAME]``."""

from __future__ import annotations

from math import pi

from hillsphere.spec import Ref, Spec, quantity, reference

__all__ = ["HillSpec"]


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
