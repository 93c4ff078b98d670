"""The largest µ of a stable system over all frequencies, without a grid.

Scalings that prove a bound at one frequency prove it on an interval around it (`intervals`). The
bound is a little more than the largest found, so that a few such intervals cover every frequency;
where one is found at which it does not hold, it is raised. Nothing between two frequencies goes
unseen, however narrow a peak is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.bilinear_images import continuous_image, discrete_frequency
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.intervals import Loop
from hillsphere_controllers.mu.scalings import Scalings
from hillsphere_controllers.mu.upper_bound import UpperBound, upper_bound
from hillsphere_controllers.systems.balancing import balance_states

__all__ = [
    "CertifiedPeak",
    "Interval",
    "certified_peak",
    "find_unproved",
]

Complex = NDArray[np.complex128]

_GRID = 40
"""Frequencies of the first look, evenly spaced in their logarithm; besides those of the poles."""
_MOST_INTERVALS = 3000
"""Intervals at most before the gap is made four times as large: loops of the packaged missions take
ten to nine hundred. Where a small gap or rounding makes the intervals short without end, this
bounds the time."""
_CHECKED = 150
"""Intervals after which it is looked at how much of the axis they have covered."""
_HOPELESS = 10.0
"""Multiple of the intervals allowed that the rest of the axis would take at the present rate, above
which the gap is widened at once. The rate grows as gaps are halved, so that ten times too many may
still end in time."""
_WIDEST = 1e3
"""Gap beyond which no wider one is tried: the bound is then at most that of scalings D alone."""
_MOST_OF_A_LIMIT = 500
"""Where a bound is all but the limit, intervals on which that is proved are short without end."""
_NARROW = 1e-7
"""A gap narrower than that, relative to its frequency, or far from all poles, is closed by scalings
for both its ends: at a jump of µ none for one frequency reaches the other."""
_FLOOR = 1e-7
"""Of the bound, relative to the largest gain."""
_ENDLESS = 1e6
"""Relative to the largest gain: above it, a skewed bound grows without end as intervals near the
frequency at which the other blocks take the loop to the border of stability."""


@dataclass(frozen=True, eq=False)
class Interval:
    """Frequencies on which one pair of scalings proves the bound.

    Parameters
    ----------
    low_rad_s, high_rad_s : float
        Its ends.
    frequency_rad_s : float
        Where the scalings were found.
    bound : float
        What they prove on the whole of the interval.
    scalings : Scalings
        Of the squared matrix.
    """

    low_rad_s: float
    high_rad_s: float
    frequency_rad_s: float
    bound: float
    scalings: Scalings


@dataclass(frozen=True, eq=False)
class CertifiedPeak:
    """A bound of µ at all frequencies.

    Parameters
    ----------
    upper : float
        µ is no larger at any frequency.
    peak : float
        The largest bound at one frequency that was found.
    frequency_rad_s : float
        Where; 0 and infinity included.
    scalings : Scalings
        Of the bound there.
    intervals : tuple of Interval
        They cover all frequencies from 0 to infinity, or to the Nyquist frequency. Empty if the
        bound is infinite or the system has no states.
    looked_at_rad_s, bounds : ndarray, shape (K,)
        Frequencies at which the least bound was computed, and what it is there; elsewhere it was
        enough that it is below `upper`.
    undecided_gap : float
        Relative distance of `upper` above `peak`, if it is larger than was asked for since the
        intervals that a smaller one needs are too many: between the two, nothing is decided. Else
        zero.
    """

    upper: float
    peak: float
    frequency_rad_s: float
    scalings: Scalings
    intervals: tuple[Interval, ...]
    looked_at_rad_s: Array
    bounds: Array
    undecided_gap: float = 0.0


def certified_peak(
    system: LtiSystem,
    structure: BlockStructure,
    *,
    skewed: Sequence[int] | None = None,
    gap: float = 0.01,
    most: int | None = None,
) -> CertifiedPeak:
    """Return an upper bound of µ that is proved at all frequencies, without a grid.

    Parameters
    ----------
    system : LtiSystem
        M, stable; in discrete time its bilinear image is analysed.
    structure : BlockStructure
        Of Δ.
    skewed : sequence of int, optional
        Blocks whose size the bound is about, the others being no larger than one; all, if left out.
    gap : float
        By how much, relatively, the result is above the largest bound found at one frequency;
        smaller ones need more intervals. Where they are too many it grows, and
        `CertifiedPeak.undecided_gap` says what it became.
    most : int, optional
        Intervals that are too many; by default 3000.

    Returns
    -------
    CertifiedPeak
        The bound and the intervals that prove it. Infinite, in a skewed problem, if at some
        frequency the other blocks are not shown to leave the loop stable, or the bound is more than
        a million times the largest gain of M.

    Raises
    ------
    InputError
        If the system is not stable or does not fit, or the gap is out of range.
    ConvergenceError
        If too many intervals are needed whatever the gap, which only rounding brings about.

    Notes
    -----
    Crossings of a level are eigenvalues, found to the square root of rounding where two of them
    meet: a peak narrower than some 1e-8 of its frequency (damping below 3e-9), other than at a pole
    of M, may stand above the bound, by 1 %.
    """
    if not 1e-6 <= gap < 1.0:
        raise InputError(f"gap must be from 1e-6 to 1, got {gap}")
    image = continuous_image(system, structure)
    free = structure.indices(range(len(structure.blocks)) if skewed is None else skewed)
    search = _Cover(Loop(balance_states(image)[0], structure, free), skewed, gap, allowed=most)
    return search.result(system.dt_s)


def find_unproved(
    system: LtiSystem, structure: BlockStructure, limit: float
) -> tuple[float, float] | None:
    """Return a frequency at which scalings do not prove that µ is below a limit.

    Parameters
    ----------
    system : LtiSystem
        M, stable, in continuous or discrete time.
    structure : BlockStructure
        Of Δ.
    limit : float
        Above zero.

    Returns
    -------
    tuple of float, or None
        A frequency, rad/s, and the least bound there, or around it where µ jumps: above the limit,
        or so near it that intervals on which it is proved are too short to count. None if µ is
        below the limit at all frequencies.

    Raises
    ------
    InputError
        If the system is not stable or does not fit.
    """
    image = continuous_image(system, structure)
    free = structure.indices(range(len(structure.blocks)))
    search = _Cover(Loop(balance_states(image)[0], structure, free), None, 0.0, limit)
    if not search.bounds:
        return None
    return discrete_frequency(search.where, system.dt_s), search.peak


class _Cover:
    """Bounds found at frequencies, and intervals.

    With a limit, the bound is that; at the first frequency at which it does not hold the search
    ends, with the bounds that exceed it.
    """

    def __init__(
        self,
        loop: Loop,
        skewed: Sequence[int] | None,
        gap: float,
        limit: float | None = None,
        allowed: int | None = None,
    ) -> None:
        self.loop, self.skewed, self.gap, self.limit = loop, skewed, gap, limit
        self.asked, self.allowed = gap, _MOST_INTERVALS if allowed is None else allowed
        self.bounds: dict[float, UpperBound] = {}  # the least at their frequencies
        self.proved: dict[float, Scalings] = {}  # of any bound, to begin others with
        self.intervals: list[Interval] = []
        self.beta = 0.0
        self._first_look()
        if self._is_decided() or not (loop.poles.size and 0.0 < self.beta < np.inf):
            return
        size = np.abs(loop.poles)
        self.slowest, self.fastest = 1e-6 * float(size.min()), 1e6 * float(size.max())
        self._add(0.0)
        self._add(np.inf)
        most, checked, rest = self.allowed, _CHECKED, float("inf")
        # cover the axis: bound µ in the middle of the widest gap, then take the interval it proves
        while not self._is_decided() and (between := self._widest_gap()) is not None:
            low, high = between
            near, far = max(low, self.slowest), min(high, self.fastest)
            if limit is not None and len(self.intervals) > _MOST_OF_A_LIMIT:
                self._bound(float(np.sqrt(near * far)))
                return
            if limit is None and len(self.intervals) >= checked:
                checked += _CHECKED
                before, rest = rest, self._uncovered()
                tolerable = (before - rest) / _CHECKED * _HOPELESS * self.allowed
                if rest > tolerable or len(self.intervals) > most:
                    self.gap *= 4.0
                    self.beta = max(self.beta, (1.0 + self.gap) * self.peak)
                    if self.gap >= 1.0 and (self.gap > _WIDEST or self.beta >= self._norm()):
                        self._bound_by_norm(low)
                        return
                    # short intervals leave as many gaps, each of which would need one more: fewer
                    # and wider ones prove the larger bound from the beginning
                    self.intervals.clear()
                    self._add(0.0)
                    self._add(np.inf)
                    most, checked, rest = 2 * _CHECKED, _CHECKED, np.inf
                    continue
            # a gap this narrow, or beyond all poles, is closed by one pair of scalings for both its
            # ends
            if far <= near * (1.0 + _NARROW):
                self._close(low, high)
            else:
                self._add(float(np.sqrt(near * far)))

    @property
    def peak(self) -> float:
        return max(b.value for b in self.bounds.values())

    @property
    def where(self) -> float:
        return max(self.bounds, key=lambda omega: self.bounds[omega].value)

    def _first_look(self) -> None:
        """Find the largest bound at the frequencies of the poles and of a coarse grid.

        Scalings of one frequency bound µ at all others too; where that bound is below the largest
        known, none need be found.
        """
        poles = self.loop.poles
        size = np.abs(poles)
        omega = np.array([0.0, np.inf])
        if poles.size:
            low, high = np.log10(size.min()) - 1.0, np.log10(size.max()) + 1.0
            omega = np.unique(
                np.concatenate([omega, size, np.abs(poles.imag), np.logspace(low, high, _GRID)])
            )
        matrices = self.loop.structure.pad_to_square(self.loop.response(omega))
        gains = np.linalg.norm(matrices, 2, axis=(1, 2))
        self.largest = float(gains.max())
        self.floor = _FLOOR * self.largest
        known, done = gains.copy(), np.zeros(omega.size, dtype=bool)
        if not self.loop.free.all():
            # the gain bounds µ itself only if all blocks are free
            known[:] = np.inf
        best = -np.inf if self.limit is None else self.limit
        while not done.all():
            # largest remaining bound first: as soon as it is below the peak found, all others are
            # too
            k = int(np.argmax(np.where(done, -1.0, known)))
            if known[k] <= best:
                break
            bound = self._bound(float(omega[k]), best if best > 0.0 else None)
            done[k], best = True, max(best, bound.value)
            if not np.isfinite(best):
                break
            known = np.minimum(known, self._everywhere(matrices, bound.scalings))
        self.beta = max((1.0 + self.gap) * best, self.floor) if self.limit is None else self.limit

    def _everywhere(self, m: Complex, scalings: Scalings) -> Array:
        """Return the bounds (K,) that scalings prove for matrices."""
        root = np.linalg.cholesky(scalings.d)
        inverse = np.linalg.inv(root)
        x = root.conj().T @ m @ inverse.conj().T
        gx = inverse @ scalings.g @ inverse.conj().T @ x
        # with D = L Lᴴ: β² is the largest eigenvalue of Xᴴ X + j(Ĝ X − Xᴴ Ĝ), X = Lᴴ M L⁻ᴴ
        right = x.conj().swapaxes(1, 2) @ x + 1j * (gx - gx.conj().swapaxes(1, 2))
        free = self.loop.free
        made = np.full(len(m), np.inf)
        if free.all():
            made = np.linalg.eigvalsh(right)[:, -1]
        else:
            kept = ~free
            # skewed problem: Schur complement of the blocks whose level is one
            inner = np.eye(int(kept.sum())) - right[:, kept][:, :, kept]
            good = np.linalg.eigvalsh(inner)[:, 0] > 1e-9
            side = right[good][:, kept][:, :, free]
            more = side.conj().swapaxes(1, 2) @ np.linalg.solve(inner[good], side)
            made[good] = np.linalg.eigvalsh(right[good][:, free][:, :, free] + more)[:, -1]
        return np.asarray(np.sqrt(np.maximum(made, 0.0)))

    def _bound(self, omega: float, target: float | None = None) -> UpperBound:
        """Return the bound at a frequency; its search starts from the nearest known scalings."""
        start = None
        if self.proved:
            # distances are in ln ω; zero and infinity stand at the ends of the range of double
            # precision
            place = np.log(max(omega, 1e-300)) if np.isfinite(omega) else 700.0
            nearest = min(
                self.proved,
                key=lambda w: abs((np.log(max(w, 1e-300)) if np.isfinite(w) else 700.0) - place),
            )
            start = self.proved[nearest]
        bound = upper_bound(
            self.loop.response(np.array([omega]))[0], self.loop.structure,
            skewed=self.skewed, start=start, target=target,
        )  # fmt: skip
        self.proved[omega] = bound.scalings
        if target is None or bound.value >= target:
            self.bounds[omega] = bound
        return bound

    def _add(self, omega: float) -> None:
        """Add an interval around a frequency, raising the bound if it does not hold there."""
        # the bound fails here: raise it by the gap, so that it cannot fail by rounding again
        while (bound := self._bound(omega, self.beta)).value >= self.beta:
            self.beta = (1.0 + self.gap) * bound.value
            if self._is_decided():
                return
        self._enter(omega, bound.scalings)

    def _is_decided(self) -> bool:
        """Return whether a limit is exceeded, or a skewed bound out of reach: none is proved."""
        if self.limit is not None:
            return bool(self.bounds)
        if self.loop.free.all() or self.beta <= _ENDLESS * self.largest:
            return False
        self.beta = np.inf
        self.intervals.clear()
        return True

    def _close(self, low: float, high: float) -> None:
        middle = 0.5 * (low + high)
        ends = np.array([low * (1.0 - _NARROW), middle, high * (1.0 + _NARROW)])
        matrices = self.loop.response(ends)
        while True:
            bound = upper_bound(matrices, self.loop.structure, skewed=self.skewed, target=self.beta)
            if bound.value < self.beta:
                break
            self.beta, self.bounds[middle] = (1.0 + self.gap) * bound.value, bound
            if self._is_decided():
                return
        self._enter(middle, bound.scalings)

    def _diagonal(self) -> Array:
        """Return the diagonal (n,) of D at the peak: a diagonal D is real, and of the structure."""
        return np.asarray(np.diagonal(self.bounds[self.where].scalings.d).real)

    def _norm(self) -> float:
        """Return a bound by one diagonal D at all frequencies; none for a skewed problem."""
        if not self.loop.free.all():
            return np.inf
        return hinf_norm(self.loop.scaled(np.sqrt(self._diagonal()))).upper

    def _bound_by_norm(self, low: float) -> None:
        """Cover the axis by one pair of scalings, the D of the peak and no G, and their norm."""
        self.intervals.clear()
        if not self.loop.free.all():
            # without room for the blocks of fixed size, nothing is proved
            self.beta = np.inf
            return
        diagonal = self._diagonal()
        plain = Scalings(np.diag(diagonal).astype(complex), np.zeros((diagonal.size,) * 2, complex))
        for room in (1e-6, 1e-2):  # beyond rounding
            self.beta = (1.0 + room) * self._norm()
            self._enter(self.where, plain)
            if self._widest_gap() is None:
                return
        raise ConvergenceError(
            f"no scalings cover all frequencies: a gap around {low:.6g} rad/s is left"
        )

    def _enter(self, omega: float, scalings: Scalings) -> None:
        low, high = self.loop.reach(scalings, self.beta, omega)
        self.intervals.append(Interval(low, high, omega, self.beta, scalings))

    def _uncovered(self) -> float:
        """Return how much of the logarithm of frequency no interval covers, within the poles."""
        left, end = 0.0, self.slowest
        for one in sorted(self.intervals, key=lambda i: i.low_rad_s):
            if one.low_rad_s > end:
                left += float(np.log(min(one.low_rad_s, self.fastest) / end))
            end = min(max(end, one.high_rad_s), self.fastest)
        return left + float(np.log(self.fastest / end))

    def _widest_gap(self) -> tuple[float, float] | None:
        widest, gap = 0.0, None
        end = 0.0
        for one in sorted(self.intervals, key=lambda i: i.low_rad_s):
            if one.low_rad_s > end:
                width = np.inf if end == 0.0 else np.log(one.low_rad_s / end)
                if width > widest:
                    widest, gap = width, (end, one.low_rad_s)
            end = max(end, one.high_rad_s)
        return gap

    def result(self, dt_s: float | None) -> CertifiedPeak:
        """Return the certified peak; frequencies of a bilinear image are mapped back."""

        def back(omega: float) -> float:
            return discrete_frequency(omega, dt_s)

        intervals = tuple(
            Interval(back(i.low_rad_s), back(i.high_rad_s), back(i.frequency_rad_s), i.bound,
                     i.scalings)
            for i in sorted(self.intervals, key=lambda i: i.low_rad_s)
        )  # fmt: skip
        omega = sorted(self.bounds)
        upper = self.beta if intervals or np.isinf(self.beta) else self.peak
        # where Δ has no effect, µ is zero and the bound is rounding
        is_known = np.isfinite(upper) and self.peak > 0.0
        return CertifiedPeak(
            upper, self.peak, back(self.where), self.bounds[self.where].scalings, intervals,
            np.array([back(w) for w in omega]), np.array([self.bounds[w].value for w in omega]),
            upper / self.peak - 1.0 if self.gap > self.asked and is_known else 0.0,
        )  # fmt: skip
