"""Trajectories of spacecraft from SPK kernels of SPICE, read through spiceypy (extra ``spice``).

A kernel is read once, in a process of its own, into states through which polynomials follow it to
0.1 mm; from there on it is an ephemeris like that of any message.

References
----------
.. [1] NAIF, "SPK Required Reading" and "Kernel Required Reading".
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from hillsphere.base.constants import DAY_S, J2000_JD
from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import open_regular
from hillsphere.base.time import Epoch
from hillsphere.formats.oem_segments import OemSegment
from hillsphere.model.spice_calls import run_spice
from hillsphere.model.spice_kernel import checked_kernel, checked_text_kernel, is_text_kernel
from hillsphere.model.spk_sampling import DEGREE

__all__ = ["is_daf", "read_spk", "tdb_after_j2000"]

_LIMIT_S = 300.0
"""Time limit, s. The most states that are read take some 30 s; a machine under load may be ten
times slower."""
_TOLD_M = 1e-3
"""Departure of the polynomials from the kernel, m, from which a warning is given: that which is
promised of an exchange."""


def is_daf(path: str | os.PathLike[str]) -> bool:
    """Return whether a file begins as SPICE's binary kernels of states, or their transfer files."""
    try:
        with open_regular(path) as stream:
            return stream.read(8).startswith((b"DAF", b"NAIF/DAF"))
    except OSError:
        return False  # the reader that opens it says why it cannot be read


def tdb_after_j2000(seconds: float) -> Epoch:
    """Return the epoch (TDB) a number of seconds after J2000, to 0.01 ns."""
    days, rest = divmod(seconds + 0.5 * DAY_S, DAY_S)
    return Epoch(J2000_JD - 0.5 + days, rest / DAY_S, "TDB")


def read_spk(
    path: str | os.PathLike[str],
    name: str = "",
    *,
    centres: Sequence[str],
    kernels: Sequence[str] = (),
) -> list[OemSegment]:
    """Return the trajectory of one spacecraft or body of a kernel.

    Parameters
    ----------
    path : str or path
        Binary SPK kernel, with segments of any type that SPICE reads.
    name : str
        Name or NAIF number of the spacecraft; may be empty if the file holds one only.
    centres : sequence of str
        Bodies by name, in the order of preference. States refer to the first one that is the
        centre of the segment, else to the first one to which kernels lead.
    kernels : sequence of str
        Further kernels: binary SPK, and text kernels of names, frames and orientations.

    Returns
    -------
    list of OemSegment
        In ICRF (``J2000`` of SPICE), in the order of time, times in TDB: one for each segment of
        the kernel where it prevails, since a manoeuvre may lie between two.

    Raises
    ------
    InputError
        If spiceypy is not installed; a kernel cannot be read or is damaged; the spacecraft is not
        in it, or not chosen; a frame is not known; or no kernel leads to a centre.
    """
    path = Path(path)
    with ExitStack() as stack:
        file, held = stack.enter_context(checked_kernel(str(path)))
        descriptors = list(held)
        texts: list[str] = []
        others: list[str] = []
        for kernel in kernels:
            check, into = (
                (checked_text_kernel, texts) if is_text_kernel(kernel) else (checked_kernel, others)
            )
            one, held = stack.enter_context(check(kernel))
            into.append(one)
            descriptors += held
        answer, content = run_spice(
            "hillsphere.model.spk_process",
            {"file": file, "kernels": others, "texts": texts, "object": name,
             "centres": list(centres)},
            file=f"{path.name}: the kernel", user=f"{path.name}: an SPK kernel",
            limit_s=_LIMIT_S, descriptors=descriptors,
        )  # fmt: skip
    if text := answer.get("text"):
        raise InputError(f"{path.name}: {_hint(answer['fault'], text, name)}")
    numbers = np.frombuffer(content, dtype=float)
    segments = []
    for span in answer["spans"]:
        count = span["count"]
        t, x = numbers[:count], numbers[count : 7 * count].reshape(count, 6).T
        numbers = numbers[7 * count :]
        if x.shape != (6, count):
            raise InputError(f"{path.name}: the kernel is damaged: SPICE gives too few numbers")
        zero = np.floor(t[0])
        epoch = tdb_after_j2000(float(zero))
        segment = OemSegment(
            answer["name"], str(answer["id"]), span["centre"].upper(), "ICRF", epoch, t - zero,
            np.ascontiguousarray(x), time_digits=9,
        )  # fmt: skip
        segments.append(_with_method(segment, span["method"], span["deviation_m"], path.name))
    return segments


def _with_method(segment: OemSegment, method: str, deviation_m: float, where: str) -> OemSegment:
    """Return a segment with the interpolation that was compared with the kernel."""
    warnings: tuple[str, ...] = ()
    if deviation_m > _TOLD_M:
        (when,) = segment.epoch.isot(segment.t_s[:1], 0)
        warnings = (
            f"{where}: states of {segment.object_name} jump within the span from {when} TDB on, "
            f"where they are followed to {deviation_m:.3g} m only.",
        )
    most = 2 * segment.t_s.size - 1 if method == "HERMITE" else segment.t_s.size - 1
    return replace(
        segment, interpolation=method, interpolation_degree=min(DEGREE, most), warnings=warnings
    )


def _hint(fault: str, text: str, name: str) -> str:
    """Return a fault in words, with what mends it."""
    if fault == "object" and not name:
        return f"expected one spacecraft; {text}; choose one by its name or number"
    hints = {
        "kernels": "a further kernel cannot be read by SPICE: {}",
        "file": "cannot be read as an SPK kernel: {}",
        "states": "{}",
        "object": "{}",
        "centre": "{}; give the kernels that say so by the key kernels",
        "frame": "{}; give its frame and orientation kernels by the key kernels",
    }
    return hints[fault].format(text)
