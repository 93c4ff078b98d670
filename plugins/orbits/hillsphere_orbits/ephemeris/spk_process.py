"""The process in which SPICE writes SPK kernels: `spk_files`, beside it, starts it.

The request is a line of JSON on stdin, followed, for each segment of each kernel, by its times
(K,), s after J2000 TDB, and states (K, 6), km and km/s. The answer is a line of JSON on stdout,
followed by the kernels.

References
----------
.. [1] NAIF, "SPK Required Reading": segments of types 9 (Lagrange) and 13 (Hermite), whose states
   are unevenly spaced in time.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

__all__ = ["main", "write"]


def main() -> None:
    """Answer the request on stdin."""
    asked = json.loads(sys.stdin.buffer.readline())
    answered, content = write(asked, sys.stdin.buffer.read())
    sys.stdout.buffer.write(json.dumps(answered).encode() + b"\n" + content)


def write(asked: dict[str, Any], content: bytes) -> tuple[dict[str, Any], bytes]:
    """Return SPK kernels, or a fault.

    Parameters
    ----------
    asked : dict
        ``"centre"``, its name, ``"code"``, its number or None, the ``"type"`` of the segments, and
        ``"kernels"``: each the ``"code"``, ``"name"``, ``"comments"`` and ``"segments"`` of a
        spacecraft, each of which has a ``"label"``, a ``"degree"`` and a ``"count"`` of states.
    content : bytes
        Times and states.

    Returns
    -------
    dict
        ``"fault"``, or ``"code"`` of the centre, whether SPICE ``"knows"`` it, and ``"names"`` and
        ``"sizes"`` of the kernels.
    bytes
        The kernels.
    """
    import spiceypy as spice

    spice.errprt("SET", 10, "NONE")
    built_in = _code(spice, asked["centre"])
    code = built_in if asked["code"] is None else asked["code"]
    if code is None or (built_in is not None and built_in != code):
        return {"code": built_in, "knows": built_in is not None, "fault": "centre"}, b""
    numbers = np.frombuffer(content, dtype=float).copy()  # spiceypy takes none read-only
    writers = {9: spice.spkw09, 13: spice.spkw13}
    names, kernels = [], []
    with TemporaryDirectory() as directory:
        path = Path(directory) / "kernel.bsp"
        for kernel in asked["kernels"]:
            name = kernel["name"]
            if _code(spice, name) not in (None, kernel["code"]):
                name = f"{name[:30]} CRAFT"  # SPICE has another body of this name
            names.append(name)
            length = sum(len(line) + 1 for line in kernel["comments"])
            handle = spice.spkopn(str(path), name[:60], length)
            for segment in kernel["segments"]:
                count = segment["count"]
                t, x = numbers[:count], numbers[count : 7 * count].reshape(count, 6)
                numbers = numbers[7 * count :]
                writers[asked["type"]](
                    handle, kernel["code"], code, "J2000", t[0], t[-1], segment["label"],
                    segment["degree"], count, np.ascontiguousarray(x), np.ascontiguousarray(t),
                )  # fmt: skip
            spice.dafac(handle, kernel["comments"])
            spice.spkcls(handle)
            kernels.append(path.read_bytes())
            path.unlink()
    return {
        "code": code, "knows": built_in is not None, "names": names,
        "sizes": [len(kernel) for kernel in kernels],
    }, b"".join(kernels)  # fmt: skip


def _code(spice: Any, name: str) -> int | None:
    """Return the number of a body that SPICE knows by its name."""
    try:
        return int(spice.bods2c(name))
    except spice.utils.exceptions.NotFoundError:
        return None
