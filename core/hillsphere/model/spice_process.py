"""The process in which SPICE reads a kernel: `hillsphere.model.spice` starts it and asks it once.

CSPICE believes what stands in a kernel; at some damaged ones it reads beyond its arrays, which ends
the process, or does not come to an end. Here that costs nobody anything.

The question is a line of JSON on stdin, with as many doubles behind it as there are times; the
answer a line of JSON on stdout, with six doubles behind it for each time, if there are states.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

__all__ = ["answer", "main"]


def main() -> None:
    """Answer the question on stdin."""
    asked = json.loads(sys.stdin.buffer.readline())
    times = np.frombuffer(sys.stdin.buffer.read(), dtype=float)
    found, states = answer(asked["kernel"], asked["target"], asked["centre"], times)
    sys.stdout.buffer.write(json.dumps(found).encode() + b"\n" + states.tobytes())


def answer(kernel: str, target: str, centre: str, times: Any) -> tuple[dict[str, Any], Any]:
    """Return what a kernel says of a body.

    Parameters
    ----------
    kernel, target, centre : str
        Path of the kernel, names or numbers of the bodies.
    times : ndarray, shape (N,)
        Seconds after J2000 TDB.

    Returns
    -------
    dict
        ``"fault"`` and ``"text"`` of what went wrong, or ``"spans"``, the intervals that the kernel
        holds, and ``"bodies"``.
    ndarray, shape (N, 6) or (0,)
        States, km and km/s, in the axes of ecliptic and equinox J2000; none if something is wrong,
        or a time is in no interval.
    """
    import spiceypy as spice

    fault = "kernel"
    none = np.zeros(0)
    try:
        spice.furnsh(kernel)
        fault = "body"
        number = int(spice.bods2c(target))
        fault = "coverage"
        window = spice.spkcov(kernel, number)
        spans = [list(map(float, spice.wnfetd(window, i))) for i in range(spice.wncard(window))]
        found = {"spans": spans, "bodies": sorted(int(i) for i in spice.spkobj(kernel))}
        held = np.zeros(times.shape, dtype=bool)
        for begin, end in spans:
            held |= (times >= begin) & (times <= end)
        if not held.all():
            return found, none
        fault = "states"
        states, _ = spice.spkezr(target, times, "ECLIPJ2000", "NONE", centre)
    except spice.utils.exceptions.SpiceyError as error:
        return {"fault": fault, "text": _first_line(error)}, none
    return found, np.ascontiguousarray(states, dtype=float)


def _first_line(error: Exception) -> str:
    """Return what SPICE says of an error, without its banner."""
    lines = [line.strip(" =") for line in str(error).splitlines()]
    return next((line for line in lines if line and "Toolkit version" not in line), "no reason")
