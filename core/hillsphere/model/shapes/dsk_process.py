"""The process in which SPICE reads a DSK file: `hillsphere.model.shapes.dsk` starts it.

The request is JSON on stdin. The answer is a line of JSON on stdout, followed by three doubles for
each vertex and three 64-bit integers for each plate.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import numpy as np

__all__ = ["main", "read_segment"]

_MOST_SHOWN = 9
"""Segments that a message lists."""


def main() -> None:
    """Answer the request on stdin."""
    asked = json.loads(sys.stdin.buffer.readline())
    answer, vertices, plates = read_segment(asked["file"], asked["segment"])
    sys.stdout.buffer.write(
        json.dumps(answer).encode() + b"\n" + vertices.tobytes() + plates.tobytes()
    )


def read_segment(file: str, segment: int | None) -> tuple[dict[str, Any], Any, Any]:
    """Return the vertices and plates of a segment, or a fault.

    Parameters
    ----------
    file : str
        Path of the file.
    segment : int or None
        Which, counted from 1.

    Returns
    -------
    dict
        ``"fault"``, or the numbers of ``"vertices"`` and ``"plates"``.
    ndarray, shape (V, 3)
        Vertices, km.
    ndarray of int64, shape (F, 3)
        Numbers of vertices, counted from 1.
    """
    import spiceypy as spice

    none = np.zeros(0)
    try:
        handle = spice.dasopr(file)
        segments = [spice.dlabfs(handle)]
        while True:
            try:
                segments.append(spice.dlafns(handle, segments[-1]))
            except spice.utils.exceptions.NotFoundError:
                break
        choice = 1 if segment is None else segment
        if segment is None and len(segments) > 1:
            described = [spice.dskgd(handle, one) for one in segments[:_MOST_SHOWN]]
            bodies = ", ".join(
                f"{k}: body {one.center}, surface {one.surfce}"
                for k, one in enumerate(described, start=1)
            )
            text = f"it has {len(segments)} segments ({bodies}); choose one by the key segment"
            return {"fault": text}, none, none
        if choice > len(segments):
            return {"fault": f"segment must be ≤ {len(segments)}, got {choice}"}, none, none
        chosen = segments[choice - 1]
        kind = int(spice.dskgd(handle, chosen).dtype)
        if kind != 2:
            return {"fault": f"segment {choice} is of type {kind}; only 2 is read"}, none, none
        many, plates = (int(count) for count in spice.dskz02(handle, chosen))
        corners = np.ascontiguousarray(spice.dskv02(handle, chosen, 1, many), dtype=float)
        faces = np.ascontiguousarray(spice.dskp02(handle, chosen, 1, plates), dtype=np.int64)
    except spice.utils.exceptions.NotFoundError:
        return {"fault": "it has no segment"}, none, none
    except spice.utils.exceptions.SpiceyError as error:
        lines = [line.strip(" =") for line in str(error).splitlines()]
        said = next((line for line in lines if line and "Toolkit version" not in line), "no reason")
        return {"fault": f"cannot be read as a DSK file: {said}"}, none, none
    return {"vertices": many, "plates": plates}, corners, faces
