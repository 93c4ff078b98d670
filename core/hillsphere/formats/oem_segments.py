"""What an Orbit Ephemeris Message holds: states, covariances, and how they are interpolated.

References
----------
.. [1] CCSDS 502.0-B-3, Orbit Data Messages, Blue Book, 2023, section 5 (OEM) and annex B.
.. [2] SANA registries "Celestial Body Reference Frames" and "Orbit-Relative Reference Frames".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.problems import did_you_mean
from hillsphere.base.time import Epoch

__all__ = [
    "ALIASES",
    "COVARIANCE_FRAMES",
    "FRAMES",
    "INERTIAL_FRAMES",
    "INTERPOLATIONS",
    "OemCovariance",
    "OemSegment",
    "hint_of_frame",
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

ALIASES = {
    "EME-2000": "EME2000", "EMEJ2000": "EME2000", "MEME2000": "EME2000", "MEMEJ2000": "EME2000",
    "J2000.0": "EME2000", "J2K": "EME2000", "EARTHMJ2000EQ": "EME2000",
    "GCRS": "GCRF", "ICRS": "ICRF", "ITRS": "ITRF",
}  # fmt: skip
"""Customary names of registered frames. A name that means different frames in different places
(ECI, ECEF) is not among them."""
_VAGUE = {
    **dict.fromkeys(("ECI", "EQUATORIAL", "INERTIAL"), ("EME2000", "GCRF", "TEME", "TOD_EARTH")),
    **dict.fromkeys(("ECEF", "ECF", "ECR"), ("ITRF", "WGS84", "TDR", "EFG")),
}
"""Names of no one frame, with the registered ones that are called so."""
_NEAR = 0.6
"""Similarity (0 to 1) from which two parts of names are the same with a slip, as for other
words."""
_SAME = 0.8
"""Similarity of names with another number of parts: a forgotten low line, not a forgotten body."""

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


def hint_of_frame(name: str, frames: Sequence[str] = FRAMES) -> str:
    """Return a hint to append to a message about an unknown frame.

    A customary name is told first. A similar name is told only if the slip leaves the body as it
    is: ``MOD_MARS`` is no slip of ``MOD_EARTH``, nor ``ECI`` (the Earth's) of ``MCI`` (of Mars).

    Parameters
    ----------
    name : str
        The name, in capitals.
    frames : sequence of str
        The frames that are known.
    """
    if name in ALIASES:
        return f"; did you mean {ALIASES[name]!r}?"
    if name in _VAGUE:
        *others, last = _VAGUE[name]
        return f"; different frames bear this name: say {', '.join(others)} or {last}"
    near = did_you_mean(name, [frame for frame in frames if _is_slip(name, frame)])
    return near if "did you mean" in near else did_you_mean("", frames, otherwise="known")


def _is_slip(name: str, frame: str) -> bool:
    """Return whether a slip may have made a name of a frame's: each part is similar."""
    parts, of_frame = name[:100].split("_"), frame.split("_")
    if len(parts) == 1 and len(of_frame) == 1:
        # three letters are body, centre and axes: the first must be right
        return len(frame) > 3 or name[:1] == frame[:1]
    if len(parts) != len(of_frame):
        return SequenceMatcher(None, "".join(parts), "".join(of_frame)).ratio() >= _SAME
    return all(
        SequenceMatcher(None, a, b).ratio() >= _NEAR for a, b in zip(parts, of_frame, strict=True)
    )


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
