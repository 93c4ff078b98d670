"""Requirements on a closed loop as matrix inequalities, and their verification on the loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import SingularProblemError, SynthesisFailedError
from hillsphere_controllers.lmi.regions import regions
from hillsphere_controllers.lmi.solving import cp
from hillsphere_controllers.structured.requirements import Channel, PoleRegion

__all__ = [
    "VerifiedNorm",
    "check_direct",
    "indices",
    "norm_inequalities",
    "region_inequalities",
    "scale_limit",
    "verify_norms",
]  # fmt: skip

_BEYOND = 1e-4
"""Relative excess at which a norm or a pole contradicts the inequalities. Clarabel keeps
constraints to about 1e-8, and the change of variables amplifies that; 1e-4 is still below what a
design notices."""
_ROUNDING = 1e-9
"""A direct term below this share of max |C| · max |B| is what rounding leaves of D11 + D12 D_K D21
= 0; it would make the H2 norm infinite."""


@dataclass(frozen=True)
class VerifiedNorm:
    """A norm of a closed loop, verified against the bound of the inequalities.

    Parameters
    ----------
    channel : Channel
        Part of the transfer from w to z.
    norm : float
        Its weighted norm, computed from the closed loop; the largest if there are several loops.
    bound : float
        Bound by the inequalities.
    """

    channel: Channel
    norm: float
    bound: float


def indices(channel: Channel, outputs: int, inputs: int) -> tuple[Integers, Integers]:
    """Return the rows of z and columns of w of a channel.

    Raises
    ------
    InputError
        If there are no such.
    """
    made = []
    for what, chosen, count in (
        ("output", channel.outputs, outputs), ("input", channel.inputs, inputs),
    ):  # fmt: skip
        places = np.arange(count) if chosen is None else np.array(chosen, dtype=np.int64)
        if not places.size or places.min() < 0 or places.max() >= count:
            raise InputError(f"a channel needs {what}s from 0 to {count - 1}, got {chosen}")
        made.append(places)
    return made[0], made[1]


def check_direct(d11: Array, channel: Channel) -> None:
    """Check that a channel with an H2 norm has no direct term.

    Raises
    ------
    SingularProblemError
        If it has.
    """
    if channel.norm == "h2" and d11.any():
        raise SingularProblemError(
            "white noise in w passes to z through D11 with infinite power; put a lag on the "
            "disturbance or the weight, or leave the entry out of the channel"
        )


def scale_limit(channel: Channel, unit: float) -> Channel:
    """Return a channel whose limit is in units of a gain."""
    return channel if channel.limit is None else replace(channel, limit=channel.limit / unit)


def norm_inequalities(
    channel: Channel, square: Any, a: Any, b: Any, c: Any, d: Any, x: Any
) -> list[Any]:
    """Return the inequalities that keep a weighted norm below the root of `square`.

    Parameters
    ----------
    channel : Channel
        Norm and weight.
    square : expression
        Of the bound.
    a, b, c, d, x : expression
        Closed loop A X, B, C X, D and the Lyapunov matrix X, or their congruent images.
    """
    limit = square / channel.weight**2
    (p, m) = d.shape
    if channel.norm == "hinf":
        # bounded real lemma, with γ² in the last block
        whole = cp.bmat([[a + a.T, b, c.T], [b.T, -np.eye(m), d.T], [c, d, -limit * np.eye(p)]])
        return [whole << 0]
    power = cp.Variable((p, p), symmetric=True)
    return [
        # controllability Gramian below X, and tr(C X Cᵀ) below the limit by a slack matrix
        cp.bmat([[a + a.T, b], [b.T, -np.eye(m)]]) << 0,
        cp.bmat([[power, c], [c.T, x]]) >> 0,
        cp.trace(power) <= limit,
    ]


def region_inequalities(region: PoleRegion, a: Any, x: Any) -> list[Any]:
    """Return the inequalities that keep poles in a region, for A X and X."""
    made = []
    for one in regions(region):
        moved = cp.kron(one.m, a)
        made.append(cp.kron(one.level, x) + moved + moved.T << 0)
    return made


def verify_norms(
    loops: Sequence[LtiSystem],
    channels: Sequence[Channel],
    bounds: Sequence[float],
    region: PoleRegion,
) -> tuple[VerifiedNorm, ...]:
    """Verify poles and norms of closed loops by methods other than the inequalities.

    Raises
    ------
    SynthesisFailedError
        If a loop is not stable, a pole is outside of the region, or a norm above its bound.
    """
    for loop in loops:
        if not loop.is_stable:
            raise SynthesisFailedError("the closed loop is not stable")
        excess, _ = region.excess(loop.poles)
        if loop.dt_s is None and excess.max(initial=-np.inf) > _BEYOND:
            worst = loop.poles[int(np.argmax(excess.max(axis=0)))]
            raise SynthesisFailedError(f"the closed loop's pole {worst:.6g} is outside the region")
    made = []
    for channel, bound in zip(channels, bounds, strict=True):
        norms = [channel.weight * _norm(loop, channel) for loop in loops]
        if not max(norms) <= bound * (1.0 + _BEYOND):
            raise SynthesisFailedError(
                f"the closed loop has a norm of {max(norms):.6g} where the inequalities promise "
                f"{bound:.6g}"
            )
        made.append(VerifiedNorm(channel, max(norms), bound))
    return tuple(made)


def _norm(loop: LtiSystem, channel: Channel) -> float:
    rows, columns = indices(channel, *loop.shape)
    d = loop.d[np.ix_(rows, columns)]
    part = LtiSystem(loop.a, loop.b[:, columns], loop.c[rows], d, loop.dt_s)
    if channel.norm == "hinf":
        norm = hinf_norm(part)
        if norm.doubt:
            raise SynthesisFailedError(
                f"the entries of the closed loop do not determine its norm: {norm.doubt}"
            )
        return norm.value
    size = np.abs(part.c).max(initial=0.0) * np.abs(part.b).max(initial=0.0)
    if np.abs(d).max(initial=0.0) <= _ROUNDING * max(size, 1e-300):
        part = replace(part, d=np.zeros_like(d))
    return h2_norm(part)
