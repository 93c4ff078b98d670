"""Flights as SPK kernels of SPICE, through spiceypy (the extra ``spice``).

References
----------
.. [1] NAIF, "SPK Required Reading": segments of types 9 and 13.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import erfa
import numpy as np

from hillsphere.base.constants import DAY_S, J2000_JD
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment
from hillsphere.formats.oem_interpolation import OemInterpolant
from hillsphere.interfaces import Array
from hillsphere.model.spice_calls import run_spice
from hillsphere.time import Epoch

__all__ = ["SpkKernel", "body_code", "choose_degree", "spk_times", "write_spk"]

_LIMIT_S = 300.0
"""Time limit of SPICE, s: two million states take some 10 s, on a machine under load far longer."""
_NAME = 36
"""Letters of a name that SPICE accepts."""
_LABEL = 40
"""Letters of the identifier of a segment [1]_."""
_DEGREES = {13: (3, 7, 11, 15), 9: (3, 5, 7, 9, 11, 13, 15)}
"""Degrees that are tried by type, for which the interval lies in the middle of its window of
states; 3 follows flights whose acceleration jumps, 15 needs the fewest states."""
_METHODS = {13: "HERMITE", 9: "LAGRANGE"}
"""How SPICE interpolates segments of each type."""
_WANTED_M = 1e-4
"""Error between states, m, from which a lower degree is preferred: a tenth of what is promised."""


@dataclass(frozen=True)
class SpkKernel:
    """The kernel of a spacecraft.

    Parameters
    ----------
    content : bytes
        The file.
    name : str
        Name of the spacecraft.
    code : int
        Its number.
    centre_code : int
        Number of the centre.
    is_known : bool
        Whether SPICE knows the centre by its name.
    degrees : tuple of int
        Degree of each segment.
    deviation_m : float
        Estimated largest error between states; NaN where there are too few to tell.
    begin_s, end_s : float
        Coverage, s after J2000 TDB.
    """

    content: bytes
    name: str
    code: int
    centre_code: int
    is_known: bool
    degrees: tuple[int, ...]
    deviation_m: float
    begin_s: float
    end_s: float


def body_code(centre: str, code: int | None) -> None:
    """Check the number of a centre before any work is done; the errors are those of `write_spk`."""
    _run({"centre": centre, "code": code, "type": 13, "kernels": []}, b"")


def write_spk(
    flights: Sequence[Sequence[OemSegment]],
    codes: Sequence[int],
    *,
    centre: str,
    centre_code: int | None,
    kind: int,
    comments: Sequence[str],
) -> list[SpkKernel]:
    """Return a kernel for each flight, in which each coast of two or more states is a segment.

    States are given at the nearest time that a kernel can hold, 0.06 µs away at most, where their
    own velocity leads; a low orbit moves on by 0.5 mm meanwhile.

    Parameters
    ----------
    flights : sequence of sequence of OemSegment
        The coasts of each, in ICRF or GCRF.
    codes : sequence of int
        Numbers of the spacecraft, negative.
    centre : str
        Name of the centre.
    centre_code : int, optional
        Its number; by default that which SPICE knows by its name.
    kind : int
        Type of the segments: 13 (Hermite) or 9 (Lagrange).
    comments : sequence of str
        Lines for the comment area.

    Raises
    ------
    InputError
        If spiceypy is not installed, the centre has no number or another one, a flight has no coast
        of two states, or its times do not rise by what a kernel can tell apart.
    """
    kernels, numbers, made = [], [], []
    for segments, code in zip(flights, codes, strict=True):
        described, degrees, deviations, spans = [], [], [0.0], []
        for segment in segments:
            if segment.t_s.size < 2:
                continue
            et, shift = spk_times(segment.epoch, segment.t_s)
            if not np.all(np.diff(et) > 0.0):
                raise InputError(
                    f"{segment.object_name}: expected times that rise by 0.2 µs at least, which a "
                    "kernel can tell apart, got nearer ones"
                )
            x = segment.x.copy()
            x[:3] += x[3:] * shift
            degree, deviation = choose_degree(segment, kind)
            numbers += [et, 1e-3 * x.T.ravel()]
            described.append(
                {"label": _ascii(segment.comment, _LABEL), "degree": degree, "count": et.size}
            )
            degrees.append(degree)
            deviations.append(deviation)
            spans += [float(et[0]), float(et[-1])]
        name = _ascii(segments[0].object_name.upper(), _NAME)
        if not described:
            raise InputError(f"{name}: a kernel needs a coast of two states, got single ones")
        told = [f"Spacecraft {code} ({name})", *comments]
        kernels.append(
            {"code": code, "name": name, "segments": described,
             "comments": [_ascii(line, 900) for line in told]}
        )  # fmt: skip
        made.append((tuple(degrees), float(np.max(deviations)), min(spans), max(spans)))
    request = {"centre": centre, "code": centre_code, "type": kind, "kernels": kernels}
    content = np.concatenate(numbers).tobytes() if numbers else b""
    answer, files = _run(request, content)
    written = []
    for k, (degrees_of, deviation, begin, end) in enumerate(made):
        size = answer["sizes"][k]
        written.append(
            SpkKernel(
                files[:size], answer["names"][k], codes[k], answer["code"], answer["knows"],
                degrees_of, deviation, begin, end,
            )
        )  # fmt: skip
        files = files[size:]
    return written


def spk_times(epoch: Epoch, t_s: Array) -> tuple[Array, Array]:
    """Return times of a kernel, and how much later they are than those meant.

    Parameters
    ----------
    epoch : Epoch
        Origin, in TDB, TT, TAI or UTC.
    t_s : ndarray, shape (K,)
        Seconds after it, in its scale (of UTC: of TAI).

    Returns
    -------
    times : ndarray, shape (K,)
        Seconds after J2000 TDB, rounded to doubles, 0.12 µs apart in this decade.
    shift : ndarray, shape (K,)
        What rounding added, s.
    """
    origin = epoch if epoch.scale == "TDB" else epoch.to("TT")
    whole = (origin.day - J2000_JD) * DAY_S
    part = origin.fraction * DAY_S + t_s
    if epoch.scale != "TDB":
        days = origin.fraction + t_s / DAY_S
        part = part + erfa.dtdb(origin.day, days, 0.0, 0.0, 0.0, 0.0)
    et = whole + part
    return et, (et - whole) - part


def choose_degree(segment: OemSegment, kind: int) -> tuple[int, float]:
    """Return the degree of the polynomials of a segment, and their error between states.

    The error is estimated from the states themselves: those of every second one are interpolated
    from the others, those of three in four likewise, and the ratio of both errors tells how fast it
    falls with the interval.

    Parameters
    ----------
    segment : OemSegment
        With two states at least.
    kind : int
        Type of the segment, 13 or 9.

    Returns
    -------
    degree : int
        The lowest one of an error below 0.1 mm, else that of the least error.
    error_m : float
        NaN if there are too few states to tell.
    """
    count = segment.t_s.size
    best, least = 0, np.inf
    for degree in _DEGREES[kind]:
        twice = _error(segment, kind, degree, 2)
        if twice is None:
            break
        fourfold = _error(segment, kind, degree, 4)
        ratio = 1.0 if fourfold is None or not twice else fourfold / twice
        error = twice / min(max(ratio, 1.0), 2.0 ** (degree + 1))
        if error < least:
            best, least = degree, error
        if error <= _WANTED_M:
            break
    if best:
        return best, float(least)
    most = min(7, 2 * count - 1) if kind == 13 else min(7, count - 1 - count % 2)
    return max(most, 1), np.nan


def _error(segment: OemSegment, kind: int, degree: int, every: int) -> float | None:
    """Return the largest error, m, at states left out; None if too few are left."""
    method, count = _METHODS[kind], segment.t_s.size
    kept = np.unique([*range(0, count, every), count - 1])
    left = np.setdiff1d(np.arange(count), kept)
    needed = (degree + 1) // 2 if method == "HERMITE" else degree + 1
    if kept.size < needed or not left.size:
        return None
    t, x = segment.t_s, segment.x
    part = OemSegment("", "", "", "ICRF", segment.epoch, t[kept], x[:, kept])
    off = OemInterpolant(part, method, degree, False)(t[left]) - x[:, left]
    return float(np.linalg.norm(off[:3], axis=0).max())


def _run(request: Mapping[str, Any], content: bytes) -> tuple[dict[str, Any], bytes]:
    answer, files = run_spice(
        "hillsphere_orbits.ephemeris.spk_process", request, content, file="an SPK kernel",
        user="format: 'spk'", limit_s=_LIMIT_S,
    )  # fmt: skip
    if answer.get("fault"):
        name, known = request["centre"], answer["code"]
        if known is None:
            raise InputError(
                f"body_id: SPICE knows no body {name!r}; give the NAIF number of the centre, such "
                "as 2000433"
            )
        raise InputError(
            f"body_id: expected {known}, by which SPICE knows {name!r}, got {request['code']}; "
            "leave it out or name the body otherwise"
        )
    return answer, files


def _ascii(text: str, length: int) -> str:
    """Return a text in the letters of a kernel, shortened."""
    plain = re.sub(r"[^ -~]", "?", text)
    return plain[:length].strip() or "FLIGHT"
