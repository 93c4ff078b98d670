"""Norms of the closed loops of several plants, with a memory of the frequencies of their peaks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import Response
from hillsphere_controllers.analysis.hinf_norm import (
    hamiltonians_eigenvalues,
    hinf_norm,
    invert_frequency,
)
from hillsphere_controllers.structured.closed_loop import Closed, Open, OpenLoop
from hillsphere_controllers.structured.gradients import h2
from hillsphere_controllers.structured.peaks import (
    frequencies,
    gains,
    local_peaks,
    refine_peaks,
    responses,
)

__all__ = ["Loop", "PlantNorms", "closed_loop_part"]

Complex = NDArray[np.complex128]

_STABLE = 1e-11
"""Poles count as stable when their real part is below minus this share of the fastest."""
_NEAR = 0.6
"""Peaks of at least this share of the largest are remembered: those that may become the largest
within a step."""
_NEAR_LIMIT = -0.5
"""Logarithms of norms relative to their limits above this are known well."""
_REMEMBERED = 12
"""Frequencies remembered for each plant at most; each costs an evaluation of the response."""
_ROUNDING = 1e-9
"""Relative amount above the level at which crossings are searched, so that the peak at the level
itself is none."""
_SINGULAR = 1e-6
"""Relative distance of a level from the gain at infinity below which H is singular but for
rounding."""
_IMAGINARY = 1e-2
"""Eigenvalues this near the imaginary axis, relative to their size, are looked at."""


@dataclass
class Loop:
    """A stable closed loop and the peaks and norms known so far.

    Parameters
    ----------
    all : Closed
        Matrices of the closed loops of all plants of its size.
    place : int
        Its own place among them.
    response : Response
        From w to z.
    peaks : dict
        Frequencies, rad/s, and gains of the peaks of each channel with an H∞ norm; the last is the
        direct term, at infinity.
    levels : dict
        Logarithm of each channel's weighted norm.
    rough : dict
        Frequencies and gains of the channels whose peaks were not refined yet.
    direct : dict
        Gain of each channel's direct term.
    """

    all: Closed
    place: int
    response: Response
    peaks: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    levels: dict[int, float] = field(default_factory=dict)
    rough: dict[int, tuple[Array, Array]] = field(default_factory=dict)
    direct: dict[int, float] = field(default_factory=dict)

    @property
    def closed(self) -> Closed:
        """Its matrices."""
        return self.all.at(self.place)


@dataclass(frozen=True)
class _Group:
    """Plants of one size with the same channels, which are looked at together."""

    members: list[int]
    open: Open


class PlantNorms:
    """Norms of plants that are closed by a sequence of similar controllers.

    Parameters
    ----------
    plants : sequence of OpenLoop
        The plants.
    """

    def __init__(self, plants: Sequence[OpenLoop]) -> None:
        self.plants = list(plants)
        self.forget()
        alike: dict[tuple[object, ...], list[int]] = {}
        for j, plant in enumerate(self.plants):
            alike.setdefault(_group_key(plant), []).append(j)
        self._groups = [
            _Group(members, Open.stack([self.plants[j].open for j in members]))
            for members in alike.values()
        ]
        self.group = {j: k for k, group in enumerate(self._groups) for j in group.members}

    def close_loop(self, gains_: Array) -> list[Loop] | None:
        """Return the loops with K; None if one of them is not stable."""
        loops: dict[int, Loop] = {}
        for group in self._groups:
            closed = group.open.close_loop(gains_)
            if closed is None or not np.isfinite(closed.a).all():
                return None
            made = Response.of_many(closed.a, closed.b, closed.c, closed.d)
            for place, (j, response) in enumerate(zip(group.members, made, strict=True)):
                poles = response.poles
                if poles.size and not poles.real.max() < -_STABLE * np.abs(poles).max():
                    return None
                loops[j] = Loop(closed, place, response)
        return [loops[j] for j in range(len(self.plants))]

    def unstable(self, gains_: Array) -> list[int]:
        """Return the plants that are not stable with K, the worst first; all if none is sure."""
        excess = np.full(len(self.plants), -np.inf)
        for group in self._groups:
            closed = group.open.close_loop(gains_)
            if closed is None or not np.isfinite(closed.a).all():
                return list(range(len(self.plants)))
            poles = np.linalg.eigvals(closed.a)
            rates = np.array([self.plants[j].rate for j in group.members])
            excess[group.members] = poles.real.max(axis=1, initial=-np.inf) / rates
        order = np.argsort(-excess, kind="stable")
        bad = order[excess[order] >= 0.0]
        return [int(j) for j in (bad if bad.size else order)]

    def seen_above(self, loops: Sequence[Loop], level: float) -> bool:
        """Return whether a gain at a remembered peak already exceeds a level (a logarithm)."""
        if not np.isfinite(level):
            return False
        for group in self._groups:
            known = [self._remembered[j] for j in group.members]
            owner = np.repeat(np.arange(len(known)), [w.size for w in known])
            if not owner.size:
                continue
            systems = [loops[j].response for j in group.members]
            made = responses(systems, np.concatenate(known), owner)
            for c, (rows, columns, channel) in enumerate(self.plants[group.members[0]].channels):
                if channel.limit is None and channel.norm == "hinf":
                    weight = np.array([self.plants[j].weights[c] for j in group.members])
                    high = gains(made[:, rows][:, :, columns] * weight[owner, None, None]).max()
                    if high > 0.0 and np.log(high) > level:
                        return True
        return False

    def measure(self, loops: Sequence[Loop]) -> None:
        """Compute peaks and norms of all channels on a grid of frequencies, without refinement."""
        for group in self._groups:
            channels = self.plants[group.members[0]].channels
            here = [loops[j] for j in group.members]
            systems = [loop.response for loop in here]
            made: Complex | None = None
            for c, (rows, columns, channel) in enumerate(channels):
                if channel.norm == "h2":
                    for j, loop in zip(group.members, here, strict=True):
                        loop.levels[c] = self._level(j, c, h2(loop.closed, rows, columns))
                    continue
                if made is None:
                    poles = np.array([system.poles for system in systems])
                    remembered = [self._remembered[j] for j in group.members]
                    points, owner = frequencies(poles, remembered)
                    made = responses(systems, points, owner)
                    ends = np.searchsorted(owner, np.arange(len(here) + 1))
                values = gains(made[:, rows][:, :, columns], owner)
                for loop, first, last in zip(here, ends[:-1], ends[1:], strict=True):
                    loop.rough[c] = points[first:last], values[first:last]
                direct = here[0].all.d[:, rows][:, :, columns]
                if direct.any():
                    norms = np.linalg.norm(direct, 2, axis=(1, 2)).tolist()
                else:
                    norms = [0.0] * len(here)
                for loop, norm in zip(here, norms, strict=True):
                    loop.direct[c] = norm
                inner = local_peaks(values, owner)
                self._take(group.members, here, c, points[inner], values[inner], owner[inner])

    def highest(self, loops: Sequence[Loop]) -> float:
        """Return the logarithm of the largest weighted norm without a limit, −inf if none is."""
        return max(
            (level for j, loop in enumerate(loops) for c, level in loop.levels.items()
             if self.plants[j].channels[c][2].limit is None),
            default=-np.inf,
        )  # fmt: skip

    def refine(self, loops: Sequence[Loop], above: float) -> None:
        """Refine the peaks of channels whose weighted norm is roughly above a logarithm.

        Those with a limit are refined where they are near it.
        """
        for group in self._groups:
            for c, (rows, columns, channel) in enumerate(self.plants[group.members[0]].channels):
                least = above if channel.limit is None else _NEAR_LIMIT
                members = [
                    j for j in group.members if c in loops[j].rough and loops[j].levels[c] >= least
                ]
                if not members:
                    continue

                def part(g: Complex, rows: Integers = rows, columns: Integers = columns) -> Complex:
                    return g[:, rows][:, :, columns]

                here = [loops[j] for j in members]
                rough = [loop.rough.pop(c) for loop in here]
                points, values = (np.concatenate(one) for one in zip(*rough, strict=True))
                owner = np.repeat(np.arange(len(here)), [w.size for w, _ in rough])
                systems = [loop.response for loop in here]
                peaks = refine_peaks(systems, part, points, values, owner)
                self._take(members, here, c, *peaks)

    def _take(
        self,
        members: Sequence[int],
        loops: Sequence[Loop],
        c: int,
        at: Array,
        high: Array,
        owner: Integers,
    ) -> None:
        ends = np.searchsorted(owner, np.arange(len(loops) + 1)).tolist()
        for k, (j, loop) in enumerate(zip(members, loops, strict=True)):
            some = slice(ends[k], ends[k + 1])
            loop.peaks[c] = np.append(at[some], np.inf), np.append(high[some], loop.direct[c])
            loop.levels[c] = self._level(j, c, float(loop.peaks[c][1].max()))

    def _level(self, j: int, c: int, norm: float) -> float:
        return float(np.log(max(self.plants[j].weights[c] * norm, 1e-300)))

    def remember(self, loops: Sequence[Loop], more: bool) -> None:
        """Remember the loops' peaks, beside all earlier ones if `more`, or half of them."""
        for j, loop in enumerate(loops):
            if not loop.peaks:
                continue
            omega = np.concatenate([o[v >= _NEAR * v.max()] for o, v in loop.peaks.values()])
            fastest = float(np.abs(loop.response.poles).max(initial=0.0))
            omega = omega[omega < 10.0 * fastest]
            known = self._remembered[j]
            together = np.concatenate([omega, known if more else known[: _REMEMBERED // 2]])
            _, first = np.unique(np.round(np.log(together + 1e-300), 2), return_index=True)
            self._remembered[j] = together[np.sort(first)][:_REMEMBERED]

    def forget(self) -> None:
        """Forget all peaks, so that a search does not depend on those before it."""
        self._remembered = [np.zeros(0) for _ in self.plants]

    def memory(self, places: Iterable[int]) -> list[Array]:
        """Return the remembered frequencies of some plants, rad/s."""
        return [self._remembered[j] for j in places]

    def recall(self, memory: Sequence[Array], places: Iterable[int] | None = None) -> None:
        """Remember the frequencies (rad/s) that `memory` has given, of all plants or of some."""
        for j, known in zip(range(len(memory)) if places is None else places, memory, strict=True):
            self._remembered[j] = known

    def finds_higher_gain(self, loops: Sequence[Loop], above: float) -> bool:
        """Return whether the level-set method finds a higher gain, and remember its frequency.

        Parameters
        ----------
        loops : sequence of Loop
            The loops.
        above : float
            Logarithm of the level that weighted norms are tested against, or a channel's own where
            that is higher; of those with a limit, the limit.
        """
        is_higher = False
        for group in self._groups:
            for c, (_, _, channel) in enumerate(self.plants[group.members[0]].channels):
                if channel.norm == "h2":
                    continue
                least = above if channel.limit is None else 0.0
                for j, omega in self._higher(group, loops, c, least).items():
                    is_higher = True
                    kept = self._remembered[j][: _REMEMBERED - 1]
                    self._remembered[j] = np.insert(kept, 0, omega)
        return is_higher

    def _higher(
        self, group: _Group, loops: Sequence[Loop], c: int, least: float
    ) -> dict[int, float]:
        """Return a frequency at which the gain is above the level, for loops that have one."""
        rows, columns, _ = self.plants[group.members[0]].channels[c]
        levels = {
            j: np.exp(max(loops[j].levels[c], least)) / self.plants[j].weights[c]
            * (1.0 + _ROUNDING)
            for j in group.members
        }  # fmt: skip
        # near the gain at infinity H is singular: there the system at ω²/s is looked at
        at_infinity = {j: loops[j].direct[c] > (1.0 - _SINGULAR) * levels[j] for j in levels}
        frequencies: dict[int, float] = {}
        for turned in (False, True):
            some = [j for j in levels if at_infinity[j] == turned]
            if not some:
                continue
            level = np.array([levels[j] for j in some])
            many = loops[some[0]].all.at(np.array([loops[j].place for j in some]))
            matrices = (
                many.a, many.b[..., columns], many.c[:, rows], many.d[:, rows][..., columns]
            )  # fmt: skip
            scale = np.ones(len(some))
            if turned:
                poles = np.array([loops[j].response.poles for j in some])
                scale = np.exp(np.mean(np.log(np.maximum(np.abs(poles), 1e-300)), axis=1))
                matrices = invert_frequency(*matrices, scale)
                size = np.linalg.norm(matrices[3], 2, axis=(1, 2))
                if (size > (1.0 - _SINGULAR) * level).any():  # and so it is at zero
                    frequencies |= self._by_norms(loops, dict(zip(some, level, strict=True)), c)
                    continue
            # Boyd, Balakrishnan and Kabamba (1989): the gain crosses the level at imaginary
            # eigenvalues
            all_values = hamiltonians_eigenvalues(*matrices, level)
            for j, values, one in zip(some, all_values, scale.tolist(), strict=True):
                near = np.abs(values[np.abs(values.real) <= _IMAGINARY * np.abs(values)].imag)
                if not near.size:
                    continue
                omega = np.unique(np.append(near, 0.0))  # the gain may be above from zero on
                omega = np.concatenate([omega, 0.5 * (omega[1:] + omega[:-1])])
                if turned:
                    omega = one**2 / omega[omega > 0.0]
                made = loops[j].response((1j * omega).astype(complex))
                high = gains(made[:, rows][:, :, columns])
                best = int(np.argmax(high))
                if high[best] > levels[j]:
                    frequencies[j] = float(omega[best])
        return frequencies

    def _by_norms(
        self, loops: Sequence[Loop], levels: dict[int, float], c: int
    ) -> dict[int, float]:
        """Return the same for loops whose gains at zero and at infinity are both at the level."""
        frequencies: dict[int, float] = {}
        for j, level in levels.items():
            rows, columns, _ = self.plants[j].channels[c]
            norm = hinf_norm(closed_loop_part(loops[j].closed, rows, columns))
            if norm.value > level and np.isfinite(norm.frequency_rad_s):
                frequencies[j] = norm.frequency_rad_s
        return frequencies


def _group_key(plant: OpenLoop) -> tuple[object, ...]:
    """Return the key by which plants of one shape and set of channels are grouped."""
    channels = [
        (tuple(rows.tolist()), tuple(columns.tolist()), channel.norm, channel.limit is None)
        for rows, columns, channel in plant.channels
    ]
    direct = bool(plant.open.d22.any())
    return plant.open.b1.shape, plant.open.c1.shape, direct, tuple(channels)


def closed_loop_part(closed: Closed, rows: Integers, columns: Integers) -> LtiSystem:
    """Return the closed loop from some w to some z."""
    return LtiSystem(
        closed.a, closed.b[:, columns], closed.c[rows], closed.d[np.ix_(rows, columns)]
    )
