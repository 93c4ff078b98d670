"""Survival of perturbed flights: propagation until a limit, a surface or the duration.

Lanes fly in lockstep by the step map, each with a step of its own in proportion to the local time
scale, so that a close pass is resolved while the others stride on; a lane that is lost leaves the
batch. A step that changes the integral of motion by more than it may is taken again, half as long.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import IntEnum
from itertools import count

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import ArrayFunction, Derivatives, StepMap, system
from hillsphere.interfaces import Array, ArrayConserved, Plant
from hillsphere.symbolic import Expr, gradient, is_zero, parameter, sum_of
from hillsphere_orbits.nonlinear_stability.sampled_orbits import require_states

__all__ = ["Fate", "Fates", "Survival"]

_STRIDE = 0.4
"""Step times the rate of the fastest local motion: 18 to 28 steps per revolution of a
quasi-satellite orbit, for errors of 1e-8 of its size."""
_GROWTH = 1.1
"""Factor by which a halved stride may grow again in each step. A larger one makes steps alternate
between halving and growing; with a smaller one a passage near the body slows all that follows."""
_LEAST_STRIDE = 1e-3
"""Stride below which a flight is given up as unresolved: halving it 400-fold did not keep the
integral of motion, so that a singularity is near."""
_LAST_STRIDE = 0.05
"""Stride below which a step across a limit is accepted although the integral of motion changes:
beyond the surface other equations hold. Its place is then known to a small part of a step."""
_SHARE = 2e-3  # of the accuracy of a flight, for one step
_SLOWEST = 1e-3
"""Least rate, per unit of time, of which steps are made: where the gravity gradient vanishes, far
from all bodies, the step stays finite."""
_FASTEST = 1e4  # per unit of time: nearer to a singularity nothing is resolved
_LIMITS = ("limit:x", "limit:y", "limit:z")
_WIDTH = 8
"""Lanes in the widest SIMD word. Batches are filled up to a multiple of it: the compiled code of a
remainder rounds otherwise, and a chaotic lane's fate would depend on how many fly beside it."""
_BLOCK = 2048  # lanes at once: what they need at a step stays in the processor's cache
_LOOKS = np.linspace(0.0, 1.0, 17)


class Fate(IntEnum):
    """Fate of a flight."""

    SURVIVES = 0
    ESCAPE = 1
    IMPACT = 2
    UNRESOLVED = 3

    @property
    def text(self) -> str:
        """Its word in tables."""
        return self.name.lower()

    @property
    def plural(self) -> str:
        """Its heading in tables of counts."""
        return ("survivors", "escapes", "impacts", "unresolved")[self]


@dataclass(frozen=True, eq=False)
class Fates:
    """Fates of N flights.

    Parameters
    ----------
    fate : ndarray of int, shape (N,)
        A `Fate` each.
    time : ndarray, shape (N,)
        Time of the loss, normalised; the whole duration for survivors.
    drift : ndarray, shape (N,)
        Change of the integral of motion, normalised; NaN where there is none.
    """

    fate: NDArray[np.int64]
    time: Array
    drift: Array

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Whether each flight was lost."""
        return np.asarray(self.fate != Fate.SURVIVES)


class Survival:
    """Propagates batches of flights until they are lost.

    A lane is lost where |x|, |y| or |z| passes its limit, or where it meets an event of the plant
    (the surface; a distance of escape). Both are looked for inside each step, on the cubic through
    the values and slopes at its ends: a graze between two steps is seen.

    Parameters
    ----------
    plant : Plant
        Equations with states x, y, z, vx, vy, vz.
    accuracy : float
        Largest change of the integral of motion, relative to it or to one natural unit,
        that a flight may show.

    Raises
    ------
    InputError
        If the plant has other states.
    """

    def __init__(self, plant: Plant, accuracy: float = 1e-5) -> None:
        self.system = system(plant, normalised=True)
        require_states(plant.states, "survival")
        self.accuracy = accuracy
        self.map = StepMap(self.system)
        self._derivatives = Derivatives(self.system)
        self._array = plant if isinstance(plant, ArrayConserved) else None
        self._energy = (
            self.system.function(self.system.integral) if self.system.integral is not None else None
        )
        margins = [
            1.0 - q * q / (parameter(name) * parameter(name))
            for q, name in zip(self.system.x[:3], _LIMITS, strict=True)
        ]
        events = self.system.events
        self.fates_of_margins = [Fate.ESCAPE] * 3 + [
            Fate.IMPACT if name == "impact" else Fate.ESCAPE for name in events
        ]
        margins += list(events.values())
        self._margins = ArrayFunction(
            [*margins, *(self._slope(g) for g in margins)], self.system.x, _LIMITS
        )

    @property
    def has_integral(self) -> bool:
        """Whether the plant has an integral of motion; its drift measures the error."""
        return self._energy is not None or self._array is not None

    def integral(self, x: Array) -> Array:
        """Return the integral (N,) at normalised states (6, N); NaN if the plant has none."""
        if self._energy is not None:
            return np.asarray(self._energy(x)[0])
        if self._array is not None:
            unit = self.system.unit[3]
            return np.asarray(self._array.integral_array(x * self.system.unit[:, None]) / unit**2)
        return np.full(x.shape[1], np.nan)

    def fly(
        self, x: Array, limits: Array, duration: float, tick: Callable[[int], None] = lambda _: None
    ) -> Fates:
        """Fly every lane until it is lost, at most for the duration.

        Parameters
        ----------
        x : ndarray, shape (6, N)
            Starts, normalised.
        limits : ndarray, shape (3, N)
            Of |x|, |y| and |z|, normalised; may be infinite.
        duration : float
            Normalised.
        tick : callable
            Called at intervals with the number of ended lanes; its exceptions pass through.

        Returns
        -------
        Fates
            A lane that keeps its integral at no step that is worth trying is unresolved.
        """
        cases = x.shape[1]
        fates = Fates(np.zeros(cases, dtype=np.int64), np.zeros(cases), np.zeros(cases))
        for begin in range(0, cases, _BLOCK):
            own = np.arange(begin, min(begin + _BLOCK, cases))
            self._march(self._flock(x, limits, own), duration, fates, tick)
        fates.fate[np.abs(fates.drift) > self.accuracy] = Fate.UNRESOLVED
        return fates

    def _flock(self, x: Array, limits: Array, own: NDArray[np.intp]) -> _ActiveLanes:
        """Return the initial state of the lanes."""
        owner = _pad_lanes(own)
        y, box = np.ascontiguousarray(x[:, owner]), np.ascontiguousarray(limits[:, owner])
        margin, slope = np.split(self._margins(y, box), 2)
        value, zero = self.integral(y), np.zeros(owner.size)
        return _ActiveLanes(owner, y, box, zero, zero.copy(), value, value, margin, slope)

    def _slope(self, margin: Expr) -> Expr:
        """Return the rate of change of a margin along the motion."""
        by = gradient(margin, self.system.x)
        pairs = zip(by, self.system.rhs, strict=True)
        return sum_of([slope * rate for slope, rate in pairs if not is_zero(slope)])

    def _strides(self, y: Array, time: Array) -> Array:
        """Return steps (N,) for a stride of 1: one over the rate of the fastest local motion."""
        a = self._derivatives.both(y, None, time)[1][3:, :3]
        # gravity gradient A (3 × 3): the fastest local frequency is about √|A|, the root of its
        # norm
        rate = np.sqrt(np.sqrt(np.sum(a * a, axis=(0, 1))))
        return np.where(rate < _FASTEST, 1.0 / np.maximum(rate, _SLOWEST), np.nan)

    def _march(
        self, flock: _ActiveLanes, duration: float, out: Fates, tick: Callable[[int], None]
    ) -> None:
        """Fly lanes and write their fates into `out`."""
        # per step, so that a whole flight keeps the accuracy
        allowed = _SHARE * self.accuracy
        # without an integral no check of the step exists: half the step throughout
        longest = _STRIDE if self.has_integral else 0.5 * _STRIDE
        flock.stride[:] = longest
        which = np.argmin(flock.margin, axis=0)
        done = np.min(flock.margin, axis=0) < 0.0  # beyond a limit from the start
        fate = np.where(done, self._fates(which), Fate.SURVIVES)
        for steps in count(1):
            if done.any():
                tick(flock.end(done, fate, out))
                if done.all():
                    return
                flock = flock.without(done)
            elif steps % 64 == 0:
                tick(0)
            y, t = flock.y, flock.t
            h = np.minimum(flock.stride * self._strides(y, t), duration - t)
            bad = ~np.isfinite(h) | (flock.stride < _LEAST_STRIDE)
            h = np.where(bad, 0.0, h)
            there = self.map.step(y, h, t=t, strict=False)
            bad |= ~np.isfinite(there).all(axis=0)
            there = np.where(bad, y, there)
            margin, slope = np.split(self._margins(there, flock.limits), 2)
            # cubics through margins and slopes: a loss within the step is seen, not only at its end
            part, which = _first_loss(flock.margin, flock.slope, margin, slope, h)
            lost = np.isfinite(part)
            # the change of the integral in this step measures its error
            value = self.integral(there)
            again = (np.abs(value - flock.value) > allowed * flock.size) & ~bad
            # beyond a surface other equations hold: a short step across it is not checked
            again &= ~lost | (flock.stride > _LAST_STRIDE)
            lost &= ~again
            flock.stride = np.where(
                again, 0.5 * flock.stride, np.minimum(longest, _GROWTH * flock.stride)
            )
            flock.value = np.where(lost | again, flock.value, value)
            flock.t = np.where(again, t, t + np.where(lost, part, 1.0) * h)
            flock.y = np.where(again, y, there)
            flock.margin = np.where(again, flock.margin, margin)
            flock.slope = np.where(again, flock.slope, slope)
            done = lost | bad | (flock.t >= duration * (1.0 - 1e-14))
            fate = np.where(lost, self._fates(which), Fate.SURVIVES)
            fate = np.where(bad, Fate.UNRESOLVED, fate)

    def _fates(self, which: NDArray[np.intp]) -> NDArray[np.int64]:
        return np.array(self.fates_of_margins, dtype=np.int64)[which]


@dataclass(eq=False)
class _ActiveLanes:
    """The lanes that still fly.

    Their numbers, states, limits, times, strides, the integral at the start and now, the margins
    and their slopes; lanes are the last axis of each.
    """

    owner: NDArray[np.intp]
    y: Array
    limits: Array
    t: Array
    stride: Array
    first: Array
    value: Array
    margin: Array
    slope: Array

    @property
    def size(self) -> Array:
        """What the change of the integral is measured against."""
        return np.maximum(1.0, np.abs(self.first))

    def end(self, done: NDArray[np.bool_], fate: NDArray[np.int64], out: Fates) -> int:
        """Write the fates of ended lanes into `out`; return their number."""
        own = self.owner[done]
        out.fate[own], out.time[own] = fate[done], self.t[done]
        out.drift[own] = ((self.value - self.first) / self.size)[done]
        return int(np.unique(own).size)

    def without(self, done: NDArray[np.bool_]) -> _ActiveLanes:
        """Return the lanes that are not done."""
        keep = np.flatnonzero(~done)
        # padding copies end together with their originals
        keep = _pad_lanes(keep[np.unique(self.owner[keep], return_index=True)[1]])
        return _ActiveLanes(*(getattr(self, field.name)[..., keep] for field in fields(self)))


def _pad_lanes(lanes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Repeat the last lane until the number is a multiple of the SIMD width."""
    return np.concatenate([lanes, np.repeat(lanes[-1:], -lanes.size % _WIDTH)])


def _first_loss(
    g: Array, s: Array, after: Array, slopes: Array, h: Array
) -> tuple[Array, NDArray[np.intp]]:
    """Return where in the step a margin first falls below zero, and which one.

    Parameters
    ----------
    g, s, after, slopes : ndarray, shape (K, N)
        Margins and their slopes at the start and at the end.
    h : ndarray, shape (N,)
        Steps.

    Returns
    -------
    part : ndarray, shape (N,)
        Of the step; infinite where no margin falls.
    which : ndarray of int, shape (N,)
        Number of the margin.
    """
    part = np.full(h.shape, np.inf)
    which = np.zeros(h.shape, dtype=np.intp)
    p, q = g + s * h / 3.0, after - slopes * h / 3.0
    # the cubic lies within its Bézier points; a lane that starts at a margin is not lost there
    low = np.minimum(np.minimum(p, q), after) < 0.0
    for k in np.flatnonzero(low.any(axis=1)):
        i = np.flatnonzero(low[k])
        u = _LOOKS[:, None]
        w = 1.0 - u
        values = (
            w**3 * g[k, i] + 3.0 * w**2 * u * p[k, i] + 3.0 * w * u**2 * q[k, i]
            + u**3 * after[k, i]
        )  # fmt: skip
        below = values[1:] < 0.0
        hit = below.any(axis=0)
        j, lane = np.argmax(below, axis=0)[hit], np.flatnonzero(hit)
        f0, f1 = values[j, lane], values[j + 1, lane]
        loss = _LOOKS[j] + np.diff(_LOOKS)[j] * np.clip(f0 / (f0 - f1), 0.0, 1.0)
        i = i[hit]
        sooner = loss < part[i]
        part[i[sooner]], which[i[sooner]] = loss[sooner], k
    return part, which
