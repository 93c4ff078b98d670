"""What an Orbit Comprehensive Message holds: histories of states and covariances, manoeuvres.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 6 (OCM).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hillsphere.base.arrays import Array
from hillsphere.base.time import Epoch
from hillsphere.formats.opm_content import Manoeuvre

__all__ = ["Ocm", "OcmCovariances", "OcmManoeuvres", "OcmText", "OcmTrajectory"]


@dataclass(frozen=True)
class OcmTrajectory:
    """One history of states.

    Parameters
    ----------
    metadata : mapping of str to str
        All keywords of the block.
    center_name, frame : str
        Origin and registered frame.
    t_s : ndarray, shape (K,)
        Times, s after the epoch of the message, rising.
    x : ndarray, shape (6, K) or (3, K), optional
        Positions, m, and velocities, m/s, or positions alone. None for elements.
    accelerations_m_s2 : ndarray, shape (3, K), optional
        Accelerations.
    elements : ndarray, shape (6, K), optional
        Osculating elements: semi-major axis, m, eccentricity, inclination, node, argument of the
        pericentre and true anomaly, rad.
    frame_epoch : Epoch, optional
        Epoch of the frame.
    comments : tuple of str
        Lines of text.
    """

    metadata: Mapping[str, str]
    center_name: str
    frame: str
    t_s: Array
    x: Array | None = None
    accelerations_m_s2: Array | None = None
    elements: Array | None = None
    frame_epoch: Epoch | None = None
    comments: tuple[str, ...] = ()


@dataclass(frozen=True)
class OcmCovariances:
    """One history of covariances of a state.

    Parameters
    ----------
    metadata : mapping of str to str
        All keywords of the block. Its scale factors, if any, are not applied.
    frame : str
        Frame of the axes: a registered one, or one that moves with the object.
    t_s : ndarray, shape (K,)
        Times, s after the epoch of the message, rising.
    matrices : ndarray, shape (6, 6, K)
        Of position (m) and velocity (m/s).
    frame_epoch : Epoch, optional
        Epoch of the frame.
    comments : tuple of str
        Lines of text.
    """

    metadata: Mapping[str, str]
    frame: str
    t_s: Array
    matrices: Array
    frame_epoch: Epoch | None = None
    comments: tuple[str, ...] = ()


@dataclass(frozen=True)
class OcmManoeuvres:
    """One block of manoeuvres whose changes of velocity are stated.

    Parameters
    ----------
    metadata : mapping of str to str
        All keywords of the block.
    manoeuvres : tuple of Manoeuvre
        In order of time. The change of mass is NaN where the block does not state it; the duration
        is 0 where it does not.
    fields : tuple of mapping of str to str
        All that each line states, by the words of MAN_COMPOSITION.
    comments : tuple of str
        Lines of text.
    """

    metadata: Mapping[str, str]
    manoeuvres: tuple[Manoeuvre, ...]
    fields: tuple[Mapping[str, str], ...]
    comments: tuple[str, ...] = ()


@dataclass(frozen=True)
class OcmText:
    """A block that is kept as it stands.

    Parameters
    ----------
    kind : str
        ``"PHYS"``, ``"PERT"``, ``"USER"``, or ``"TRAJ"``, ``"COV"``, ``"MAN"``.
    place : str
        File and line.
    entries : tuple of (str, str)
        Keywords with values, units in brackets, comments among them, in order.
    lines : tuple of str
        Rows of numbers.
    reason : str
        Why it is not read.
    """

    kind: str
    place: str
    entries: tuple[tuple[str, str], ...]
    lines: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class Ocm:
    """An Orbit Comprehensive Message [1]_.

    Parameters
    ----------
    metadata : mapping of str to str
        All keywords of the metadata, in order.
    epoch : Epoch
        EPOCH_TZERO, from which times count, in the time system of the message.
    trajectories, covariances, manoeuvres : tuple
        The blocks that were read, in order.
    orbit_determination : mapping of str to str
        Keywords of the block on orbit determination; empty if there is none.
    texts : tuple of OcmText
        All other blocks, in order.
    header : mapping of str to str
        Keywords of the header.
    comments : tuple of str
        Of header, metadata and orbit determination.
    warnings : tuple of str
        What a reader noticed and did not refuse.
    """

    metadata: Mapping[str, str]
    epoch: Epoch
    trajectories: tuple[OcmTrajectory, ...] = ()
    covariances: tuple[OcmCovariances, ...] = ()
    manoeuvres: tuple[OcmManoeuvres, ...] = ()
    orbit_determination: Mapping[str, str] = field(default_factory=dict)
    texts: tuple[OcmText, ...] = ()
    header: Mapping[str, str] = field(default_factory=dict)
    comments: tuple[str, ...] = ()
    warnings: tuple[str, ...] = field(default=(), compare=False)
