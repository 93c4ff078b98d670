"""The process in which SPICE reads a kernel: `hillsphere.model.spice` starts it and asks it once.

The request is a line of JSON on stdin, followed by one double per time. The answer is a line of
JSON on stdout, followed by six doubles per time if there are states.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

__all__ = ["answer", "main"]


def main() -> None:
    """Answer the request on stdin."""
    asked = json.loads(sys.stdin.buffer.readline())
    times = np.frombuffer(sys.stdin.buffer.read(), dtype=float)
    answered, states = answer(asked["kernel"], asked["target"], asked["centre"], times)
    sys.stdout.buffer.write(json.dumps(answered).encode() + b"\n" + states.tobytes())


def answer(kernel: str, target: str, centre: str, times: Any) -> tuple[dict[str, Any], Any]:
    """Return the states of a body from a kernel, or a fault.

    Parameters
    ----------
    kernel, target, centre : str
        Path of the kernel, names or numbers of the bodies.
    times : ndarray, shape (N,)
        Seconds after J2000 TDB.

    Returns
    -------
    dict
        ``"fault"`` and ``"text"`` of an error, or ``"spans"``, the intervals that the kernel
        covers, and ``"bodies"``.
    ndarray, shape (N, 6) or (0,)
        States, km and km/s, in the axes of ecliptic and equinox J2000; empty after an error, or if
        a time is not covered.
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
        coverage = {"spans": spans, "bodies": sorted(int(i) for i in spice.spkobj(kernel))}
        held = np.zeros(times.shape, dtype=bool)
        for begin, end in spans:
            held |= (times >= begin) & (times <= end)
        if not held.all():
            return coverage, none
        fault = "states"
        states, _ = spice.spkezr(target, times, "ECLIPJ2000", "NONE", centre)
    except spice.utils.exceptions.SpiceyError as error:
        return {"fault": fault, "text": _first_line(error)}, none
    return coverage, np.ascontiguousarray(states, dtype=float)


def _first_line(error: Exception) -> str:
    """Return the first line of a SPICE error message, without its banner."""
    lines = [line.strip(" =") for line in str(error).splitlines()]
    return next((line for line in lines if line and "Toolkit version" not in line), "no reason")
