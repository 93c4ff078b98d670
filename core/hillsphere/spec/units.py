"""Unit suffixes of keys in a mission, and their factors to SI."""

from __future__ import annotations

from collections.abc import Mapping

from hillsphere.base.constants import ARCSECOND_RAD, AU_M, DAY_S, HOUR_S, MINUTE_S
from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean

__all__ = ["UNITS", "unit_keys", "unit_text", "units_of"]

UNITS: Mapping[str, Mapping[str, float]] = {
    "length": {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "au": AU_M},
    "time": {"s": 1.0, "min": MINUTE_S, "h": HOUR_S, "d": DAY_S},
    "angle": {"rad": 1.0, "deg": 0.017453292519943295, "arcsec": ARCSECOND_RAD},
    "speed": {"m_s": 1.0, "km_s": 1e3, "cm_s": 1e-2, "mm_s": 1e-3},
    "acceleration": {"m_s2": 1.0, "km_s2": 1e3, "mm_s2": 1e-3},
    "angular_rate": {
        "rad_s": 1.0,
        "deg_s": 0.017453292519943295,
        "deg_h": ARCSECOND_RAD,  # a degree per hour is an arcsecond per second
        "deg_d": 2.0200570046230665e-07,
    },
    "angular_acceleration": {"rad_s2": 1.0, "deg_s2": 0.017453292519943295},
    "specific_energy": {"m2_s2": 1.0, "km2_s2": 1e6},  # J/kg; also a potential, a Jacobi constant
    "gravitational_parameter": {"m3_s2": 1.0, "km3_s2": 1e9},
    "density": {"kg_m3": 1.0, "g_cm3": 1e3},
    "mass": {"kg": 1.0, "t": 1e3},
    "area_to_mass": {"m2_kg": 1.0},
    "frequency": {"hz": 1.0},
}
"""All unit suffixes: dimension → suffix → factor to SI; the first suffix is the SI unit."""

_SUPERSCRIPTS = str.maketrans("23", "²³")


def units_of(dimension: str) -> Mapping[str, float]:
    """Return the unit suffixes of a dimension with their factors to SI, the SI unit first.

    Parameters
    ----------
    dimension : str
        A key of `UNITS`.

    Raises
    ------
    InputError
        If there is no such dimension; the message names the nearest one, or all.
    """
    if dimension not in UNITS:
        raise InputError(f"unknown dimension {dimension!r}{did_you_mean(dimension, UNITS)}")
    return UNITS[dimension]


def unit_keys(name: str, dimension: str) -> dict[str, float]:
    """Return every key that a mission may write for an SI field, with its factor to SI.

    Parameters
    ----------
    name : str
        Field name, ending in the dimension's SI suffix.
    dimension : str
        A key of `UNITS`.

    Returns
    -------
    dict of str to float
        ``{"axes_m": 1.0, "axes_km": 1000.0, …}``.

    Raises
    ------
    InputError
        If there is no such dimension.
    """
    units = units_of(dimension)
    stem = name.removesuffix(next(iter(units)))
    return {stem + suffix: factor for suffix, factor in units.items()}


def unit_text(suffix: str) -> str:
    """Write a unit suffix as a unit: ``"km3_s2"`` → ``"km³/s²"``."""
    return suffix.replace("_", "/").translate(_SUPERSCRIPTS)
