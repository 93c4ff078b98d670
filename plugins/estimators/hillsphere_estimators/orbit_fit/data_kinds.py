"""What becomes of each kind of data of a tracking data message.

References
----------
.. [1] CCSDS 503.0-B-2, Tracking Data Message, Blue Book, 2020, table 3-5.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

__all__ = ["FITTED", "MODELS", "reason_left_out"]

FITTED = ("ANGLE_1", "ANGLE_2", "DOPPLER_INSTANTANEOUS", "DOPPLER_INTEGRATED", "RANGE",
          "RECEIVE_FREQ")  # fmt: skip
"""Measurements that an observable expects; received frequencies with any number of a participant.
"""
MODELS = ("TRANSMIT_FREQ", "TRANSMIT_FREQ_RATE")
"""What these need of the transmitter."""
_LEFT_OUT: Mapping[str, str] = MappingProxyType(
    {
        "RECEIVE_PHASE_CT": "phase counts are not used",
        "TRANSMIT_PHASE_CT": "phase counts are not used",
        "DOPPLER_COUNT": "counts are not used",
        "DOR": "differenced data are not used",
        "VLBI_DELAY": "differenced data are not used",
        **dict.fromkeys(
            ("CLOCK_BIAS", "CLOCK_DRIFT"), "clocks are not corrected: correct the time tags"
        ),
        **dict.fromkeys(
            ("STEC", "TROPO_DRY", "TROPO_WET"), "delays of the atmosphere are not applied"
        ),
        **dict.fromkeys(("PRESSURE", "RHUMIDITY", "TEMPERATURE"), "the weather is not used"),
        **dict.fromkeys(
            ("CARRIER_POWER", "MAG", "PC_N0", "PR_N0", "RCS"), "says nothing of the orbit"
        ),
    }
)


def reason_left_out(keyword: str) -> str:
    """Return why the values of a keyword are not fitted; empty for those that are, or serve them.

    Parameters
    ----------
    keyword : str
        Of the data of a message, with the number of its participant.
    """
    return _LEFT_OUT.get(keyword) or _LEFT_OUT.get(keyword.rstrip("12345").rstrip("_"), "")
