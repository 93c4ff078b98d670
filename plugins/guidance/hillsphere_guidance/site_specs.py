"""Spec of a landing site, for plans and laws alike."""

from __future__ import annotations

from math import pi

from hillsphere.spec import Spec, quantity

__all__ = ["SiteSpec"]


class SiteSpec(Spec):
    """A place on the surface of the body."""

    examples = ({"latitude_deg": 12, "longitude_deg": 25},)

    latitude_rad: float = quantity("angle", "planetocentric latitude", ge=-pi / 2, le=pi / 2)
    longitude_rad: float = quantity("angle", "longitude on the body, to the east")
