"""The body ``planet``, with ground stations on its ellipsoid."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from hillsphere.base.contracts import Contract
from hillsphere.base.geodetic import Ellipsoid
from hillsphere.base.orientation import ConstantOrientation, EarthOrientation, OrientationTable
from hillsphere.model.earth.specs import PlanetSpec

__all__ = ["Planet", "StationedPlanet"]


@runtime_checkable
class StationedPlanet(Contract, Protocol):
    """Interface of a planet with an ellipsoid for ground stations, such as `Planet`.

    The rotation rate is in rad/s; ``None`` is that of the Earth.
    """

    ellipsoid: Ellipsoid
    orientation: EarthOrientation
    rotation_rate_rad_s: float | None


class Planet:
    """A planet with an ellipsoid for ground stations and the rotation of the Earth.

    Parameters
    ----------
    spec : PlanetSpec
        Its parameters.

    Raises
    ------
    InputError
        If the table of its orientation cannot be read.
    """

    def __init__(self, spec: PlanetSpec) -> None:
        self.name = spec.name
        self.gm_m3_s2 = spec.gm_m3_s2
        self.ellipsoid = Ellipsoid(spec.equatorial_radius_m, spec.inverse_flattening)
        self.rotation_rate_rad_s = spec.rotation_rate_rad_s
        self.orientation: EarthOrientation = _orientation(spec)


def _orientation(spec: PlanetSpec) -> EarthOrientation:
    if spec.orientation == "constant":
        return ConstantOrientation(spec.ut1_minus_utc_s)
    if spec.orientation_file is not None:
        return OrientationTable.read(spec.orientation_file)
    return OrientationTable.installed()
