"""What an Orbit Ephemeris Message holds: states, covariances, and how they are interpolated.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 5 (OEM) and annex B.
.. [2] SANA registries "Celestial Body Reference Frames" and "Orbit-Relative Reference Frames".
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.time import Epoch

__all__ = [
    "COVARIANCE_FRAMES",
    "FRAMES",
    "INERTIAL_FRAMES",
    "INTERPOLATIONS",
    "OemCovariance",
    "OemSegment",
    "is_covariance_frame",
    "is_frame",
    "least_eigenvalue",
    "states_needed",
]

INERTIAL_FRAMES = ("ICRF", "EME2000", "GCRF", "TEME")
"""Frames in which the framework writes its own ephemerides; a rotating one is refused."""

FRAMES = (
    *INERTIAL_FRAMES, "ALIGN_CB", "ALIGN_EARTH", "B1950", "EFG", "FIXED_CB", "FIXED_EARTH", "GRC",
    "GTOD", "ITRF", "J2000", "MCI", "MOD_CB", "MOD_EARTH", "MOD_MOON", "MOE_CB", "MOE_EARTH",
    "MOE_MOON", "MOON_ME", "MOON_MEIAUE", "TDR", "TEMEOFDATE", "TEMEOFEPOCH", "TIRF", "TOD",
    "TOD_CB", "TOD_EARTH", "TOD_MOON", "TOE_CB", "TOE_EARTH", "TOE_MOON", "TRUE_ECLIPTIC",
    "UVW_GO_INERTIAL", "WGS84",
)  # fmt: skip
"""Registered reference frames [2]_, and those of annex B of older issues of the standard [1]_."""

_REALISATIONS = re.compile(r"(ITRF|DTRF)-?(\d{2}|\d{4})|(ICRF|GCRF)\d|MOON_PA\d{2,4}", re.ASCII)

COVARIANCE_FRAMES = (
    "RSW", "RTN", "TNW", "EQW_INERTIAL", "PQW_INERTIAL",
    *(f"{axes}_{motion}" for axes in ("LVLH", "NSW", "NTW", "RSW", "SEZ", "TNW", "VNC")
      for motion in ("INERTIAL", "ROTATING")),
)  # fmt: skip
"""Frames that move with the object, in which only covariances are given."""

INTERPOLATIONS = ("HERMITE", "LAGRANGE", "LINEAR", "PROPAGATE")
"""Methods that a message may recommend."""


@dataclass(frozen=True)
class OemCovariance:
    """Covariance of a state.

    Parameters
    ----------
    t_s : float
        Time, counted as those of the segment.
    matrix : ndarray, shape (6, 6)
        Of position (m) and velocity (m/s).
    ref_frame : str
        Frame of its axes; empty for that of the segment.
    """

    t_s: float
    matrix: Array
    ref_frame: str = ""


@dataclass(frozen=True)
class OemSegment:
    """Part of an ephemeris between two manoeuvres.

    Parameters
    ----------
    object_name, object_id : str
        Of the spacecraft.
    center_name : str
        Origin, e.g. ``"MARS"``.
    ref_frame : str
        One of `INERTIAL_FRAMES`, or another registered frame.
    epoch : Epoch
        From which times count, in the time system of the message.
    t_s : ndarray, shape (K,)
        Times, rising.
    x : ndarray, shape (6, K)
        Positions, m, and velocities, m/s.
    comment : str
        One line, may be empty.
    passed_over : tuple of str
        What else the message states of it, in words.
    accelerations_m_s2 : ndarray, shape (3, K), optional
        Accelerations.
    covariances : tuple of OemCovariance
        In order of time.
    start_s, stop_s : float, optional
        Span that the message states; by default from the first state to the last.
    useable_start_s, useable_stop_s : float, optional
        Span in which the states may be interpolated; by default all of it.
    interpolation : str, optional
        One of `INTERPOLATIONS`, or ``""`` if the message recommends none. None leaves the
        recommendation to the writer.
    interpolation_degree : int, optional
        Degree of the recommended interpolation.
    ref_frame_epoch : Epoch, optional
        Epoch of the frame, where its definition leaves that open.
    time_digits : int
        Decimals of the seconds in which times are written, up to 9.
    warnings : tuple of str
        What a lenient reader did not refuse.
    """

    object_name: str
    object_id: str
    center_name: str
    ref_frame: str
    epoch: Epoch
    t_s: Array
    x: Array
    comment: str = ""
    passed_over: tuple[str, ...] = field(default=(), compare=False)
    accelerations_m_s2: Array | None = None
    covariances: tuple[OemCovariance, ...] = ()
    start_s: float | None = None
    stop_s: float | None = None
    useable_start_s: float | None = None
    useable_stop_s: float | None = None
    interpolation: str | None = None
    interpolation_degree: int | None = None
    ref_frame_epoch: Epoch | None = None
    time_digits: int = 6
    warnings: tuple[str, ...] = field(default=(), compare=False)


def is_frame(name: str) -> bool:
    """Return whether a name is that of a registered frame or of a realisation of one."""
    return name in FRAMES or _REALISATIONS.fullmatch(name) is not None


def is_covariance_frame(name: str) -> bool:
    """Return whether a covariance may be given in a frame."""
    return is_frame(name) or name in COVARIANCE_FRAMES


def states_needed(method: str, degree: int) -> int:
    """Return the number of states through which a polynomial of a degree passes.

    Hermite's takes two conditions from each state, so an even degree is raised by one.
    """
    return degree // 2 + 1 if method == "HERMITE" else degree + 1


def least_eigenvalue(matrix: Array) -> float:
    """Return the least eigenvalue of the matrix of correlations of a covariance.

    It is free of units, so that rounding in metres and in metres a second weigh the same. A
    variance that is zero admits no covariance; then, and for a negative one, it is −1.

    Parameters
    ----------
    matrix : ndarray, shape (6, 6)
        A symmetric matrix.
    """
    variance = np.diag(matrix)
    positive = variance > 0.0
    if np.any(variance < 0.0) or np.any(matrix[~positive]):
        return -1.0
    if not np.any(positive):
        return 0.0
    sigma = np.sqrt(variance[positive])
    with np.errstate(all="ignore"):
        correlation = matrix[np.ix_(positive, positive)] / sigma[:, None] / sigma
    # Above 1 in magnitude no correlation exists; that also keeps infinite ones from the solver.
    if not np.all(np.abs(correlation) <= 2.0):
        return -1.0
    return float(np.linalg.eigvalsh(correlation)[0])
