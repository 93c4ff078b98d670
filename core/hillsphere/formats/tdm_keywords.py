"""Keywords of Tracking Data Messages: their order, units, and what their values may be.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, tables 3-2, 3-3 and 3-5.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf
from types import MappingProxyType
from typing import NamedTuple

from hillsphere.formats.tdm_segments import TdmMeta

__all__ = ["DATA", "HEADER", "METADATA", "UNITS", "VERSIONS", "WORDS", "Quantity", "power_of"]

VERSIONS = ("1.0", "2.0")
"""Versions of the message that are read. The second only adds keywords."""
HEADER = ("CREATION_DATE", "ORIGINATOR", "MESSAGE_ID")
"""Keywords of the header after the version, in order."""


def _index_keys(key: str) -> tuple[str, ...]:
    return tuple(f"{key}_{n}" for n in range(1, 6))


METADATA = (
    "TRACK_ID", "DATA_TYPES", "TIME_SYSTEM", "START_TIME", "STOP_TIME",
    *_index_keys("PARTICIPANT"), "MODE", "PATH", "PATH_1", "PATH_2", *_index_keys("EPHEMERIS_NAME"),
    "TRANSMIT_BAND", "RECEIVE_BAND", "TURNAROUND_NUMERATOR", "TURNAROUND_DENOMINATOR",
    "TIMETAG_REF", "INTEGRATION_INTERVAL", "INTEGRATION_REF", "FREQ_OFFSET", "RANGE_MODE",
    "RANGE_MODULUS", "RANGE_UNITS", "ANGLE_TYPE", "REFERENCE_FRAME", "INTERPOLATION",
    "INTERPOLATION_DEGREE", "DOPPLER_COUNT_BIAS", "DOPPLER_COUNT_SCALE", "DOPPLER_COUNT_ROLLOVER",
    *_index_keys("TRANSMIT_DELAY"), *_index_keys("RECEIVE_DELAY"), "DATA_QUALITY",
    *(f"CORRECTION_{what}" for what in (
        "ANGLE_1", "ANGLE_2", "DOPPLER", "MAG", "RANGE", "RCS", "RECEIVE", "TRANSMIT",
        "ABERRATION_YEARLY", "ABERRATION_DIURNAL",
    )),
    "CORRECTIONS_APPLIED",
)  # fmt: skip
"""Keywords of the metadata, in order."""

WORDS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "MODE": ("SEQUENTIAL", "SINGLE_DIFF"),
        "TIMETAG_REF": ("RECEIVE", "TRANSMIT"),
        "INTEGRATION_REF": ("START", "MIDDLE", "END"),
        "RANGE_MODE": ("COHERENT", "CONSTANT", "ONE_WAY"),
        "RANGE_UNITS": ("km", "s", "RU"),
        "ANGLE_TYPE": ("AZEL", "RADEC", "XEYN", "XSYE"),
        "INTERPOLATION": ("HERMITE", "LAGRANGE", "LINEAR"),
        "DOPPLER_COUNT_ROLLOVER": ("YES", "NO"),
        "DATA_QUALITY": ("RAW", "VALIDATED", "DEGRADED"),
        "CORRECTIONS_APPLIED": ("YES", "NO"),
    }
)
"""Values of keywords of the metadata that have lists of them; case does not matter."""


class Quantity(NamedTuple):
    """What a keyword of the data measures.

    A value in SI is that of the message times ten to the `power`, except for angles, which are in
    degrees in the message. `least` and `most` are limits of the value of the message; `is_above`
    says that it must exceed the first. `is_count` marks whole or long numbers, whose digits are
    kept.
    """

    unit: str
    si: str
    power: int = 0
    least: float = -inf
    most: float = inf
    is_above: bool = False
    is_count: bool = False


_FREQUENCY = Quantity("Hz", "Hz")
_PHASE = Quantity("", "1", is_count=True)

DATA: Mapping[str, Quantity] = MappingProxyType(
    {
        # the standard allows angles from -180° to less than 360°
        "ANGLE_1": Quantity("deg", "rad", least=-180.0, most=360.0),
        "ANGLE_2": Quantity("deg", "rad", least=-180.0, most=360.0),
        "CARRIER_POWER": Quantity("dBW", "dBW"),
        "CLOCK_BIAS": Quantity("s", "s"),
        "CLOCK_DRIFT": Quantity("s/s", "1"),
        "DOPPLER_COUNT": Quantity("", "1", least=0.0, is_count=True),
        "DOPPLER_INSTANTANEOUS": Quantity("km/s", "m/s", 3),
        "DOPPLER_INTEGRATED": Quantity("km/s", "m/s", 3),
        "DOR": Quantity("s", "s"),
        "MAG": Quantity("", "mag"),
        "PC_N0": Quantity("dBHz", "dBHz"),
        "PR_N0": Quantity("dBHz", "dBHz"),
        "PRESSURE": Quantity("hPa", "Pa", 2),
        "RANGE": Quantity("km", "m", 3),
        "RCS": Quantity("m**2", "m^2", least=0.0, is_above=True),
        "RECEIVE_FREQ": _FREQUENCY,
        **dict.fromkeys(_index_keys("RECEIVE_FREQ"), _FREQUENCY),
        **dict.fromkeys(_index_keys("RECEIVE_PHASE_CT"), _PHASE),
        "RHUMIDITY": Quantity("%", "1", -2, least=0.0, most=100.0),
        "STEC": Quantity("TECU", "1/m^2", 16, least=0.0),
        "TEMPERATURE": Quantity("K", "K", least=0.0, is_above=True),
        **dict.fromkeys(
            _index_keys("TRANSMIT_FREQ"), Quantity("Hz", "Hz", least=0.0, is_above=True)
        ),
        **dict.fromkeys(_index_keys("TRANSMIT_FREQ_RATE"), Quantity("Hz/s", "Hz/s")),
        **dict.fromkeys(_index_keys("TRANSMIT_PHASE_CT"), _PHASE),
        "TROPO_DRY": Quantity("m", "m", least=0.0),
        "TROPO_WET": Quantity("m", "m", least=0.0),
        "VLBI_DELAY": Quantity("s", "s"),
    }
)
"""Keywords of the data. Humidity becomes a fraction of 1, electron contents a number per m²."""

UNITS: Mapping[str, str] = MappingProxyType({key: what.si for key, what in DATA.items()})
"""Units of the series of a segment; that of ``"RANGE"`` if `TdmMeta.range_units` is ``"km"``."""


def power_of(key: str, meta: TdmMeta) -> int:
    """Return the power of ten between a value of the data in the message and in SI."""
    if key == "RANGE" and meta.range_units != "km":
        return 0
    return DATA[key].power
