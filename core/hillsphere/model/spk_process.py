"""The process in which SPICE reads a spacecraft's trajectory: `hillsphere.model.spk` starts it.

The request is a line of JSON on stdin. The answer is a line of JSON on stdout, followed, for each
span without a break, by its times (K,), s after J2000 TDB, and states (K, 6), m and m/s.

References
----------
.. [1] NAIF, "SPK Required Reading": of segments that overlap the later one in a file prevails.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.model.spk_sampling import METHODS, sample, velocities_are_derivatives

__all__ = ["main", "own_spans", "read"]

_MOST_STATES = 1_000_000
"""Most states of a trajectory: 56 MB; a low orbit of three years."""
_OF_FORMULAS = frozenset({5, 10, 15, 17})
"""Types of segments that hold elements, from which few numbers give any span of time [1]_."""
_PER_NUMBER = 2
"""Most states for each number that another segment holds. A low orbit takes 0.1 to 0.3, a jump
between two records of a short polynomial one to two; damaged states, which jump by their size at
every scale, would take all that are allowed."""
_AT_LEAST = 2000
"""States that are allowed to the smallest segment: its ends may be steep."""
_MOST_LISTED = 30
"""Bodies that a message lists."""
_LONGEST_S = 1e12
"""Time from J2000, s, beyond which no kernel reaches: 30 000 years."""
_TO_INERTIAL = 1
"""Class of SPICE's inertial frames, whose rotation to each other is constant."""


class _FaultError(Exception):
    """A reason why there are no states: a kind, and a text."""


class _Segment(NamedTuple):
    """A segment: its summary, span, s after J2000 TDB, centre, frame, and most states to take."""

    summary: Any
    begin: float
    end: float
    centre: int
    frame: int
    most: int


def main() -> None:
    """Answer the request on stdin."""
    answered, content = read(json.loads(sys.stdin.buffer.readline()))
    sys.stdout.buffer.write(json.dumps(answered).encode() + b"\n" + content)


def read(asked: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
    """Return the spans of a spacecraft with their states, or a fault.

    Parameters
    ----------
    asked : dict
        ``"file"``, the paths of further SPK ``"kernels"`` and of ``"texts"``, the ``"object"``
        (empty for the only one) and names of possible ``"centres"``.

    Returns
    -------
    dict
        ``"fault"`` and ``"text"``, or ``"name"``, ``"id"`` and ``"spans"``.
    bytes
        Times and states of each span.
    """
    import spiceypy as spice

    # SPICE's own default, to stdout, would mix its reports with the answer
    spice.errprt("SET", 10, "NONE")
    kind = "kernels"
    try:
        for path in asked["texts"]:
            spice.ldpool(path)  # unlike furnsh it follows no KERNELS_TO_LOAD
        for path in asked["kernels"]:
            spice.furnsh(path)
        kind = "file"
        spice.furnsh(asked["file"])
        target = _target(spice, asked["file"], asked["object"])
        codes = _centres(spice, asked["centres"])
        handle = spice.dafopr(asked["file"])
        spans = own_spans(_segments(spice, handle, target))
        if not spans:
            raise _FaultError("file", f"it has no span of {_name(spice, target)}")
        described, content, left = [], [], _MOST_STATES
        for segment, begin, end in spans:
            kind = "states"
            centre = _centre(spice, segment, begin, codes)
            evaluate = _evaluator(spice, handle, segment, codes[centre])
            is_smooth = velocities_are_derivatives(evaluate, begin, end)
            for method in METHODS if is_smooth else METHODS[1:]:
                sampled = sample(evaluate, begin, end, method, min(left, segment.most))
                if sampled is not None:
                    break
            else:
                name = _name(spice, target)
                if segment.most < left:
                    raise _FaultError("file", f"its states of {name} jump too often; it is damaged")
                raise _FaultError(
                    "states", f"its states of {name} need more than {_MOST_STATES} nodes to be "
                    "followed to 0.1 mm; cut it to the span that is needed",
                )  # fmt: skip
            left -= sampled.t_s.size
            content += [sampled.t_s.tobytes(), np.ascontiguousarray(sampled.x.T).tobytes()]
            described.append(
                {
                    "centre": centre, "count": int(sampled.t_s.size), "method": sampled.method,
                    "deviation_m": sampled.deviation_m,
                }
            )  # fmt: skip
    except _FaultError as fault:
        return {"fault": fault.args[0], "text": fault.args[1]}, b""
    except spice.utils.exceptions.SpiceyError as error:
        return {"fault": kind, "text": _reason(error)}, b""
    return {"name": _name(spice, target), "id": target, "spans": described}, b"".join(content)


def own_spans(segments: list[Any]) -> list[tuple[Any, float, float]]:
    """Return the spans in which each segment holds: of those that overlap the later one does.

    Parameters
    ----------
    segments : list
        In the order of the file, with attributes ``begin`` and ``end``.

    Returns
    -------
    list of tuple
        Segment, begin and end, in the order of time.
    """
    taken: list[tuple[float, float]] = []
    own = []
    for segment in reversed(segments):
        at = segment.begin
        for begin, end in taken:
            if end <= at:
                continue
            if begin >= segment.end:
                break
            if begin > at:
                own.append((segment, at, begin))
            at = end
        if at < segment.end:
            own.append((segment, at, segment.end))
        taken = _union_of([*taken, (segment.begin, segment.end)])
    return sorted(own, key=lambda one: one[1])


def _union_of(spans: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the union of spans, in order."""
    union: list[tuple[float, float]] = []
    for begin, end in sorted(spans):
        if union and begin <= union[-1][1]:
            union[-1] = (union[-1][0], max(union[-1][1], end))
        else:
            union.append((begin, end))
    return union


def _target(spice: Any, file: str, name: str) -> int:
    """Return the number of the spacecraft."""
    held = sorted(int(one) for one in spice.spkobj(file))
    listed = ", ".join(
        f"{one} ({known})" if (known := _name(spice, one)) != str(one) else known
        for one in held[:_MOST_LISTED]
    ) or "none"  # fmt: skip
    listed += " …" if len(held) > _MOST_LISTED else ""
    if not name:
        if len(held) != 1:
            raise _FaultError("object", f"it holds {listed}")
        return held[0]
    try:
        target = int(spice.bods2c(name))
    except spice.utils.exceptions.NotFoundError:
        raise _FaultError("object", f"SPICE knows no {name!r}; it holds {listed}") from None
    if target not in held:
        raise _FaultError("object", f"it does not hold {name!r}; it holds {listed}")
    return target


def _name(spice: Any, code: int) -> str:
    try:
        return str(spice.bodc2n(code))
    except spice.utils.exceptions.NotFoundError:
        return str(code)


def _centres(spice: Any, names: list[str]) -> dict[str, int]:
    """Return the numbers of those centres that SPICE knows."""
    codes = {}
    for name in names:
        try:
            codes[name] = int(spice.bods2c(name))
        except spice.utils.exceptions.NotFoundError:
            continue
    if not codes:
        raise _FaultError("centre", f"SPICE knows no body {' or '.join(map(repr, names))}")
    return codes


def _segments(spice: Any, handle: int, target: int) -> list[_Segment]:
    segments = []
    spice.dafbfs(handle)
    while spice.daffna():
        summary = spice.dafgs(5)
        span, numbers = spice.dafus(summary, 2, 6)
        begin, end = map(float, span)
        if int(numbers[0]) != target:
            continue
        if not (-_LONGEST_S < begin <= end < _LONGEST_S):
            raise _FaultError("file", f"a segment is said to hold from {begin:g} to {end:g} s")
        _, centre, frame, kind, first, last = map(int, numbers)
        held = max(_AT_LEAST, _PER_NUMBER * (last - first + 1))
        most = _MOST_STATES if kind in _OF_FORMULAS else min(held, _MOST_STATES)
        segments.append(_Segment(summary, begin, end, centre, frame, most))
    return segments


def _centre(spice: Any, segment: _Segment, begin: float, codes: dict[str, int]) -> str:
    """Return that of the wanted centres which is the segment's, or to which kernels lead."""
    for name, code in codes.items():
        if code == segment.centre:
            return name
    for name, code in codes.items():
        try:
            spice.spkgeo(segment.centre, begin, "J2000", code)
        except spice.utils.exceptions.SpiceyError:
            continue
        return name
    raise _FaultError(
        "centre", f"it is about {_name(spice, segment.centre)}, and no kernel leads from there to "
        f"{' or '.join(codes)}"
    )  # fmt: skip


def _evaluator(spice: Any, handle: int, segment: _Segment, code: int) -> Callable[[Array], Array]:
    """Return a function of times (K,) that gives states (6, K), m and m/s, about a centre."""
    frame = spice.frmnam(segment.frame)
    if not frame:
        raise _FaultError("frame", f"SPICE knows no frame of number {segment.frame}")
    is_inertial = spice.frinfo(segment.frame)[1] == _TO_INERTIAL
    turn = np.array(spice.pxform(frame, "J2000", 0.0)) if is_inertial else None

    def evaluate(t_s: Array) -> Array:
        if not t_s.size:
            return np.zeros((6, 0))
        x = np.array([spice.spkpvn(handle, segment.summary, float(t))[1] for t in t_s]).T
        if turn is None:
            try:
                moving = np.array([spice.sxform(frame, "J2000", float(t)) for t in t_s])
            except spice.utils.exceptions.SpiceyError as error:
                raise _FaultError("frame", _reason(error)) from None
            x = np.einsum("kij,jk->ik", moving, x)
        elif frame != "J2000":
            x = np.concatenate([turn @ x[:3], turn @ x[3:]])
        if code != segment.centre:
            try:
                centre, _ = spice.spkezr(str(segment.centre), t_s, "J2000", "NONE", str(code))
            except spice.utils.exceptions.SpiceyError as error:
                raise _FaultError("centre", _reason(error)) from None
            x = x + np.asarray(centre).T
        if not np.isfinite(x).all():
            raise _FaultError("file", "it gives states that are no numbers")
        return np.asarray(1e3 * x)

    return evaluate


def _reason(error: Exception) -> str:
    """Return the first line of a SPICE error message, without its banner."""
    lines = [line.strip(" =") for line in str(error).splitlines()]
    return next((line for line in lines if line and "Toolkit version" not in line), "no reason")
