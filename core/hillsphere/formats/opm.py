"""CCSDS Orbit Parameter Messages: reading and writing text (KVN) and XML.

A message holds one state of one object, and perhaps its covariance and the manoeuvres that follow.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 3 (OPM) and 8 (XML).
"""

from __future__ import annotations

from datetime import datetime

from hillsphere.base.errors import InputError
from hillsphere.formats.ccsds_entries import Leniency
from hillsphere.formats.opm_content import Manoeuvre, Opm, OsculatingElements
from hillsphere.formats.opm_encodings import take_apart
from hillsphere.formats.opm_reading import opm_of_blocks
from hillsphere.formats.opm_writing import write_message

__all__ = ["Manoeuvre", "Opm", "OsculatingElements", "read_opm", "write_opm"]


def read_opm(text: str, where: str = "OPM", *, lenient: bool = False) -> Opm:
    """Read an Orbit Parameter Message: text (KVN) or XML, version 1.0, 2.0 or 3.0.

    Parameters
    ----------
    text : str
        The message.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether harmless departures from the standard become warnings of the message: an unknown
        keyword, the order of keywords, a header without originator or date, a customary name of a
        registered frame.

    Returns
    -------
    Opm
        The message. If its elements, where they state GM, differ from the state by more than the
        rounding of their digits, its warnings say so; the state counts.

    Raises
    ------
    InputError
        Naming the line and the keyword, if the message departs from the standard or uses a time
        system that `Epoch` does not have.
    """
    leniency = Leniency(not lenient)
    return opm_of_blocks(take_apart(text, where, leniency), leniency)


def write_opm(
    opm: Opm,
    *,
    originator: str = "HILLSPHERE",
    created: datetime | None = None,
    encoding: str = "kvn",
) -> str:
    """Return an Orbit Parameter Message, version 3.0.

    Parameters
    ----------
    opm : Opm
        What it states.
    originator : str
        Who made it.
    created : datetime, optional
        When; by default now.
    encoding : str
        ``"kvn"`` for text, ``"xml"`` for XML.

    Returns
    -------
    str
        The message. Numbers are the shortest that are read back as they are; times have as many
        decimals as they need, up to 1 ns.

    Raises
    ------
    InputError
        If the standard has no place for a value: an unregistered frame, a number that is not
        finite, a name of several lines.
    """
    text = write_message(opm, originator, created, encoding)
    try:
        read_opm(text, "the message")  # which checks frames, ranges and names
    except InputError as error:
        raise InputError(f"orbit parameter message to be written: {error}") from error
    return text
