"""Ranges of physical quantities, by which values in a wrong unit are refused.

A range holds all values that are possible in the framework's applications, not only likely ones; a
value outside it is a mistake, most often of the unit. A component whose quantity is narrower (the
radius of a body, the density of rock) gives its own bounds; those that several components share
are given here.
"""

from __future__ import annotations

from collections.abc import Mapping

__all__ = [
    "BODY_RADIUS_M",
    "DENSITY_KG_M3",
    "GM_M3_S2",
    "LARGEST",
    "ORBIT_RADIUS_M",
    "PLANET_GM_M3_S2",
    "PLANET_RADIUS_M",
    "PRESSURE_HPA",
    "ROTATION_RAD_S",
    "STAR_GM_M3_S2",
    "STATION_HEIGHT_M",
    "within_largest",
]

LARGEST: Mapping[str, float] = {
    "length": 1e15,  # 6 700 au, seven times the aphelion of Sedna
    "time": 1e12,  # 32 000 years
    "angle": 100.0,  # 16 turns; degrees under a key in radians are seen from 100° on
    "speed": 299_792_458.0,  # of light
    "acceleration": 1e6,  # at the surface of a white dwarf
    "angular_rate": 1e12,  # also bandwidths of weights, which may be far beyond any loop
    "angular_acceleration": 1e6,
    "specific_energy": 299_792_458.0**2,  # the rest energy of matter
    "gravitational_parameter": 1e28,  # 75 million Suns, for limits in which the primary is large
    "density": 30_000.0,
    "mass": 1e35,  # 50 000 Suns
    "area_to_mass": 1e3,  # a grain of dust of 1 µm
    "frequency": 1e12,
}
"""Largest magnitude of a quantity of each dimension, SI."""

# `gt` first, for the plain message on a sign.
DENSITY_KG_M3: Mapping[str, float] = {"gt": 0, "ge": 1.0, "le": LARGEST["density"]}
"""A heap of the lightest dust, to somewhat more than osmium's 22 600. 1470 g/cm³ is 1470 kg/m³."""

GM_M3_S2: Mapping[str, float] = {
    "gt": 0, "ge": 1e-20, "le": 1e25,
}  # fmt: skip
"""A grain of 0.1 mm, to more than any star."""

STAR_GM_M3_S2: Mapping[str, float] = {
    "gt": 0, "ge": 1e18, "le": 1e25,
}  # fmt: skip
"""Central bodies of planets: from a tenth of the lightest star (0.08 Suns is 1.06e19) upwards.
The Sun's 1.327e11 km³/s² under a key in m³/s² lies below."""

PLANET_GM_M3_S2: Mapping[str, float] = {"gt": 0, "ge": 1e9, "le": 1e18}
"""A dwarf planet (Ceres 6.3e10), to five times Jupiter (1.3e17). Numbers of km³/s² under a key in
m³/s² lie below for all bodies up to Saturn."""

PLANET_RADIUS_M: Mapping[str, float] = {"gt": 0, "ge": 1e5, "le": 2e8}
"""A dwarf planet (Ceres 4.7e5 m), to more than Jupiter (7.1e7 m). Kilometres lie below."""

BODY_RADIUS_M: Mapping[str, float] = {"gt": 0, "ge": 1e-3, "le": 1e9}
"""A pebble, to the Sun (6.96e8 m)."""

ORBIT_RADIUS_M: Mapping[str, float] = {"gt": 0, "ge": 1.0, "le": LARGEST["length"]}
"""A pair of boulders, and up: the components of small binary asteroids are 1 km apart."""

ROTATION_RAD_S: Mapping[str, float] = {"gt": 0, "ge": 1e-10, "le": 10.0}
"""A turn in 2 000 years, to one in 0.6 s; the fastest asteroid known, 2020 HS7, takes 3 s."""

STATION_HEIGHT_M: Mapping[str, float] = {"ge": -500.0, "le": 9000.0}
"""Dry land: the shore of the Dead Sea lies at −430 m, Mount Everest at 8849 m."""

PRESSURE_HPA: Mapping[str, float] = {"ge": 300.0, "le": 1100.0}
"""The top of Mount Everest (337 hPa), to the record at sea level (1085 hPa). Pascal and bar lie
outside."""


def within_largest(dimension: str, bounds: Mapping[str, float]) -> dict[str, float]:
    """Return bounds completed by `LARGEST` on the sides that have none.

    Parameters
    ----------
    dimension : str
        Dimension of the quantity, a key of `LARGEST`.
    bounds : mapping
        ``gt``, ``ge``, ``lt``, ``le`` that it has already, SI; they come first in what is checked.

    Returns
    -------
    dict
        These, and ±`LARGEST` on the side where there is none.
    """
    completed = dict(bounds)
    if "le" not in completed and "lt" not in completed:
        completed["le"] = LARGEST[dimension]
    if "ge" not in completed and "gt" not in completed:
        completed["ge"] = -LARGEST[dimension]
    return completed
