"""CCSDS Orbit Comprehensive Messages: reading text (KVN) and XML.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, sections 6 (OCM) and 8 (XML).
"""

from __future__ import annotations

from hillsphere.base.errors import InputError
from hillsphere.formats.ccsds_entries import Leniency
from hillsphere.formats.ocm_content import (
    Ocm,
    OcmCovariances,
    OcmManoeuvres,
    OcmText,
    OcmTrajectory,
)
from hillsphere.formats.ocm_encodings import take_apart
from hillsphere.formats.ocm_reading import ocm_of_blocks
from hillsphere.formats.oem_segments import OemSegment

__all__ = [
    "Ocm",
    "OcmCovariances",
    "OcmManoeuvres",
    "OcmText",
    "OcmTrajectory",
    "ephemeris_segments",
    "read_ocm",
]


def read_ocm(text: str, where: str = "OCM", *, lenient: bool = False) -> Ocm:
    """Read an Orbit Comprehensive Message: text (KVN) or XML, version 3.0.

    Read are osculating states (TRAJ_TYPE CARTP, CARTPV, CARTPVA and KEPLERIAN), covariances
    (COV_TYPE CARTPV, ordered LTM, UTM or FULL), manoeuvres whose changes of velocity are stated
    (DC_TYPE CONTINUOUS, with DV_X, DV_Y and DV_Z) and the block on orbit determination. All other
    blocks are kept as text.

    Parameters
    ----------
    text : str
        The message.
    where : str
        Name of the file, used in error messages.
    lenient : bool
        Whether harmless departures from the standard become warnings of the message: an unknown
        keyword, the order of keywords and blocks, a header without originator or date, a customary
        name of a registered frame.

    Returns
    -------
    Ocm
        The message.

    Raises
    ------
    InputError
        Naming the line and the keyword, if the message departs from the standard or uses a time
        system that `Epoch` does not have.
    """
    leniency = Leniency.collecting(lenient)
    return ocm_of_blocks(take_apart(text, where, leniency), leniency)


def ephemeris_segments(ocm: Ocm) -> list[OemSegment]:
    """Return the histories of states of a message as segments of an ephemeris.

    Parameters
    ----------
    ocm : Ocm
        The message.

    Returns
    -------
    list of OemSegment
        One for each history with velocities, in order.

    Raises
    ------
    InputError
        If there is none.
    """
    name = ocm.metadata.get("OBJECT_NAME", "UNKNOWN")
    segments = [
        OemSegment(
            object_name=name,
            object_id=ocm.metadata.get("INTERNATIONAL_DESIGNATOR")
            or ocm.metadata.get("OBJECT_DESIGNATOR", "UNKNOWN"),
            center_name=one.center_name,
            ref_frame=one.frame,
            epoch=ocm.epoch,
            t_s=one.t_s,
            x=one.x,
            accelerations_m_s2=one.accelerations_m_s2,
            ref_frame_epoch=one.frame_epoch,
        )
        for one in ocm.trajectories
        if one.x is not None and one.x.shape[0] == 6
    ]
    if not segments:
        raise InputError(f"{name}: the message has no history of positions with velocities")
    return segments
