"""Least speed change from one orbit to another through families of swing orbits.

A swing orbit that meets both the departure and the arrival orbit carries a transfer: an impulse
where it meets the first, a coast along it, an impulse where it meets the second. Along a family the
least cost is a function of the position u on it, smooth between the members at which the swing
orbit just touches one of the two: there meetings appear or vanish in pairs, and a minimum may lie
at such a member itself. Those members are found first, as roots; minima are then sought between
them. All families go in lockstep on orbits interpolated between their members, and what is found is
corrected in the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_orbits.swing_transfers.chains import (
    Chains,
    Scan,
    fly,
    interpolate_unknowns,
    least_of,
)
from hillsphere_orbits.swing_transfers.tangency import MARGIN, Tangency
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.meetings import meetings

__all__ = ["END", "INTERIOR", "Minimum", "minima"]

INTERIOR, END = "interior", "end of the family"
_GOLDEN = 0.6180339887498949
"""(√5 − 1)/2: each new point of a golden-section search divides the bracket in this ratio."""
_CLOSE = 2e-3  # of the cost, normalised: minima of one family this close are all looked into
_APART = 0.1  # distance in u of minima that are two
_ASIDE = 1e-3  # distance in u at which a touching member is compared with its neighbours
_TOUCH = 1e-6  # largest gap of interpolated members that touch
_FLAT = 1e-6  # of the cost: least gain for which a member replaces another
_NOISE = 2e-5  # the same right beside a touching member


@dataclass(frozen=True)
class Minimum:
    """A local minimum of the cost along a family.

    Parameters
    ----------
    family : int
        The family.
    u : float
        Position on it.
    dv : float
        Cost, normalised.
    kind : str
        ``"interior"``, ``"end of the family"``, or the name of the orbit that is just touched.
    """

    family: int
    u: float
    dv: float
    kind: str


def cost(
    chains: Chains,
    legs: tuple[PolarOrbit, PolarOrbit],
    family: NDArray[np.intp],
    u: Array,
    coarse: int,
) -> Array:
    """Return the least cost (K,) of a leg through interpolated orbits; infinite without one."""
    strands = fly(chains, family, interpolate_unknowns(chains, family, u), coarse)
    first, second = (least_of(meetings(orbit, strands, _TOUCH), u.size) for orbit in legs)
    return first + second


def minima(
    chains: Chains,
    scans: Sequence[Scan],
    names: tuple[str, str],
    orbits: Mapping[str, PolarOrbit],
    touches: Mapping[str, Sequence[Tangency]],
    width: float,
    coarse: int,
) -> list[Minimum]:
    """Find the least cost of a leg along every family.

    Parameters
    ----------
    chains : Chains
        The families.
    scans : sequence of Scan
        What their members meet.
    names : (str, str)
        Departure and arrival orbit.
    orbits : mapping of str to PolarOrbit
        Orbits by name.
    touches : mapping of str to sequence of Tangency
        The tangencies with both orbits, from `tangent_members`.
    width : float
        To which a minimum in u is narrowed; the cost is flat there, to the square of this.
    coarse : int
        Times fewer sub-steps than for rounding.

    Returns
    -------
    list of Minimum
        For each family with members that meet both orbits, on interpolated members: the least,
        and others so little above it that the interpolation may have put them in a wrong order.
    """
    pair = (orbits[names[0]], orbits[names[1]])
    lanes: list[_Candidate] = []
    for scanned in scans:
        lanes += _candidates(chains, scanned, names, pair, touches, coarse)
    if not lanes:
        return []
    family = np.array([lane.family for lane in lanes], dtype=np.intp)
    low, u, high, dv = np.array([[c.low, c.u, c.high, c.dv] for c in lanes]).T

    def function(at: Array, which: NDArray[np.intp]) -> Array:
        return cost(chains, pair, family[which], at, coarse)

    # beside a touching member: if the cost falls to one side, the minimum is there
    every = np.arange(u.size)
    aside = np.array([np.maximum(low, u - _ASIDE), np.minimum(high, u + _ASIDE)])
    falls = np.array([function(side, every) for side in aside]) < dv
    special = np.array([c.kind != INTERIOR for c in lanes])
    low = np.where(special & ~falls[0], u, low)
    high = np.where(special & ~falls[1], u, high)
    at, value = _golden(function, low, high, width)
    by_family: dict[int, list[Minimum]] = {}
    for k, c in enumerate(lanes):
        one = Minimum(c.family, c.u, c.dv, c.kind)
        # next to a tangent member a slightly lower cost is an error of the interpolation
        gain = _NOISE if c.kind != INTERIOR and abs(at[k] - c.u) <= 2.0 * width else _FLAT
        if value[k] < dv[k] - gain:
            one = Minimum(c.family, float(at[k]), float(value[k]), INTERIOR)
        by_family.setdefault(c.family, []).append(one)
    return [one for f in sorted(by_family) for one in _finalists(by_family[f])]


def _finalists(minima: list[Minimum]) -> list[Minimum]:
    """Return the least of a family's minima, and others that are hardly above and elsewhere."""
    kept: list[Minimum] = []
    for one in sorted(minima, key=lambda m: m.dv):
        if not kept or (
            one.dv < kept[0].dv + _CLOSE and all(abs(one.u - m.u) > _APART for m in kept)
        ):
            kept.append(one)
    return kept


@dataclass(frozen=True)
class _Candidate:
    """A sample no larger than its neighbours, which bracket a minimum."""

    family: int
    low: float
    u: float
    high: float
    dv: float
    kind: str


def _candidates(
    chains: Chains,
    scanned: Scan,
    names: tuple[str, str],
    pair: tuple[PolarOrbit, PolarOrbit],
    touches: Mapping[str, Sequence[Tangency]],
    coarse: int,
) -> list[_Candidate]:
    """Return every local minimum of the samples, members that just touch an orbit among them."""
    f = scanned.family
    u = np.arange(scanned.period.size, dtype=float)
    dv = scanned.least(names[0]) + scanned.least(names[1])
    kinds = [END, *[INTERIOR] * (u.size - 2), END]
    extra = [(t, name) for name in names for t in touches[name] if t.family == f]
    if extra:
        places = np.array([t.u for t, _ in extra])
        values = cost(chains, pair, np.full(places.size, f), places, coarse)
        u, dv = np.concatenate([u, places]), np.concatenate([dv, values])
        kinds += [name for _, name in extra]
        order = np.argsort(u, kind="stable")
        u, dv = u[order], dv[order]
        kinds = [kinds[k] for k in order.tolist()]
    least = float(np.min(dv))
    if not np.isfinite(least):
        return []
    # the ends of a family count as minima if their only neighbour is larger
    around = np.concatenate([[np.inf], dv, [np.inf]])
    # no larger than both neighbours, and not far above the least of the family
    bottom = (dv <= around[:-2]) & (dv <= around[2:]) & (dv <= MARGIN * least)
    low, high = np.concatenate([u[:1], u[:-1]]), np.concatenate([u[1:], u[-1:]])
    return [
        _Candidate(f, float(low[k]), float(u[k]), float(high[k]), float(dv[k]), kinds[k])
        for k in range(u.size)
        if bottom[k]
    ]


def _golden(
    function: Callable[[Array, NDArray[np.intp]], Array], low: Array, high: Array, width: float
) -> tuple[Array, Array]:
    """Minimise by golden section, lanes in lockstep; returns places and values."""
    low, high, every = low.copy(), high.copy(), np.arange(low.size)
    p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    fp, fq = function(p, every), function(q, every)
    while (wide := np.flatnonzero(high - low > width)).size:
        left, right = wide[fp[wide] < fq[wide]], wide[~(fp[wide] < fq[wide])]
        high[left], q[left], fq[left] = q[left], p[left], fp[left]
        low[right], p[right], fp[right] = p[right], q[right], fq[right]
        p[left] = high[left] - _GOLDEN * (high[left] - low[left])
        q[right] = low[right] + _GOLDEN * (high[right] - low[right])
        fresh = function(np.concatenate([p[left], q[right]]), np.concatenate([left, right]))
        fp[left], fq[right] = fresh[: left.size], fresh[left.size :]
    first = fp < fq
    return np.where(first, p, q), np.where(first, fp, fq)
