"""Objective of a design: the logarithm of the largest weighted norm, with its gradients.

Constraints h ≤ 0 are added as ρ max(h, 0), an exact penalty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import eig

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.gradients import gain_slopes, h2_slope, pole_slopes
from hillsphere_controllers.structured.pieces import (
    ALIKE,
    NEAR,
    Piece,
    distinct_peaks,
    nearest_frequency,
    piece_key,
    without_duplicates,
)
from hillsphere_controllers.structured.plant_norms import Loop, PlantNorms
from hillsphere_controllers.structured.requirements import PoleRegion
from hillsphere_controllers.structured.structure import Structure

__all__ = ["FURTHEST", "Objective", "Point"]

_Wanted = tuple[int, int, float, int | None]
"""Plant, channel, frequency in rad/s, and number of a singular value; None: all that are high."""

_REFINED = 0.85
"""Those of at least this share are found exactly, the others to the next frequency looked at."""
_MOST = 14
"""Peaks that a step takes into account at most, for one plant. More make the quadratic programs
slower; with fewer, a peak left out rises and the step is rejected."""
_EACH, _AT_ALL = 6, 60
"""With many plants more peaks are, or nearly are, the highest: so many for each, and at all."""
_ROUGH = 0.95
"""Peaks that are roughly below this share of the largest so far are not the largest."""
_NEAR_HARD = -0.3
"""Constraints above this are looked at."""
FURTHEST = 1e8
"""Scaled parameters beyond this are out of bounds: where gains run away, γ has long settled."""
_STRICTLY = 1e-5
"""Poles of a controller that is to be stable are below minus this share of the rate."""
_MARGIN = 1e-7
"""By so much constraints are kept, so that rounding does not break them."""


@dataclass
class Point:
    """A θ (scaled) with its value.

    Parameters
    ----------
    x : ndarray, shape (size,)
        Scaled parameters.
    value : float
        Logarithm of the objective plus the penalty; infinite where the loop is not stable, and
        where it was only seen to be above what was asked for.
    objective : float
        Logarithm of the largest weighted norm.
    excess : float
        Largest of the constraints; minus infinity without any.
    """

    x: Array
    value: float
    objective: float = np.inf
    excess: float = -np.inf
    gains: Array | None = None
    loops: list[Loop] = field(default_factory=list)


class Objective:
    """The function of the scaled parameters x, θ = middle + spread x.

    Parameters
    ----------
    loops : sequence of OpenLoop
        Plants of the design.
    structure : Structure
        Of the controller.
    middle, spread : ndarray, shape (size,)
        Scaling.
    region : PoleRegion or None
        Where all closed loops' poles are to be.
    largest_gain : float or None
        Limit of the Frobenius norm of K.
    controller_stable : bool
        Whether the poles of the controller are to be in the left half-plane.

    Attributes
    ----------
    penalty : float
        ρ.
    evaluations : int
        How often a closed loop was made.
    """

    def __init__(
        self,
        loops: Sequence[OpenLoop],
        structure: Structure,
        middle: Array,
        spread: Array,
        region: PoleRegion | None = None,
        largest_gain: float | None = None,
        controller_stable: bool = False,
    ) -> None:
        self.loops, self.structure = list(loops), structure
        self._most = max(_MOST, min(_EACH * len(self.loops), _AT_ALL))
        rates = [loop.rate for loop in self.loops]
        self._rate = float(np.exp(np.mean(np.log(rates))))
        self._controller_stable = controller_stable and structure.order > 0
        self.norms = PlantNorms(self.loops)
        self.middle, self.spread = middle, spread
        self.region, self.largest_gain = region, largest_gain
        self.penalty, self.evaluations = 10.0, 0
        if not any(c.limit is None for loop in self.loops for _, _, c in loop.channels):
            raise InputError("every channel has a limit: nothing is left to be minimised")

    def theta(self, x: Array) -> Array:
        """Return θ of x, both (size,)."""
        return np.asarray(self.middle + self.spread * x)

    def evaluate(self, x: Array, above: float = np.inf) -> Point:
        """Return the point at x; its value is infinite where it is larger than `above`."""
        self.evaluations += 1
        with np.errstate(over="ignore", invalid="ignore"):
            matrix = self.structure.gains(self.theta(x))
        no = Point(x, np.inf)
        if not np.isfinite(matrix).all() or float(np.abs(x).max()) > FURTHEST:
            return no
        loops = self.norms.close_loop(matrix)
        # the cheapest test first: a remembered peak may already exceed the level
        if loops is None or self.norms.seen_above(loops, above):
            return no
        self.norms.measure(loops)
        # then the peaks on a grid, a lower bound; only those that may decide are refined
        roughly = self.norms.highest(loops)
        if roughly > above:
            return no
        self.norms.refine(loops, roughly + np.log(_ROUGH))
        objective = self.norms.highest(loops)
        if objective > above:
            return no
        excess = max(self._gain_excess(matrix), self._controller_excess(matrix))
        for plant, loop in zip(self.loops, loops, strict=True):
            for c, level in loop.levels.items():
                if plant.channels[c][2].limit is not None:
                    excess = max(excess, level)
            if self.region is not None:
                excess = max(excess, float(self.region.excess(loop.response.poles)[0].max()))
        # exact penalty: its minimum keeps the constraints for a finite ρ
        value = objective + self.penalty * max(0.0, excess + _MARGIN)
        return Point(x, value, objective, excess, matrix, loops)

    def _gain_excess(self, matrix: Array) -> float:
        if self.largest_gain is None:
            return -np.inf
        return float(np.log(max(float(np.linalg.norm(matrix)), 1e-300) / self.largest_gain))

    def _controller_excess(self, matrix: Array) -> float:
        if not self._controller_stable:
            return -np.inf
        k = self.structure.order
        return float(np.linalg.eigvals(matrix[:k, :k]).real.max()) / self._rate + _STRICTLY

    def remember(self, point: Point, more: bool = False) -> None:
        """Take the peaks of a point for the next ones; see `PlantNorms.remember`."""
        self.norms.remember(point.loops, more)

    def forget(self) -> None:
        """Drop all remembered peaks, so that a start does not depend on those before it."""
        self.norms.forget()

    def restricted(self, places: Sequence[int]) -> Objective:
        """Return the objective of some plants alone, with what is remembered of them."""
        part = Objective(
            [self.loops[j] for j in places], self.structure, self.middle, self.spread, self.region,
            self.largest_gain,
        )  # fmt: skip
        part._controller_stable, part._rate = self._controller_stable, self._rate
        part.penalty = self.penalty
        part.norms.recall(self.norms.memory(places))
        return part

    def take_over(self, part: Objective, places: Sequence[int]) -> None:
        """Take what the objective of some plants has learned, and count its evaluations."""
        self.penalty = part.penalty
        self.evaluations += part.evaluations
        self.norms.recall(part.norms.memory(range(len(places))), places)

    def levels(self, point: Point, kept: float = 0.0) -> Array:
        """Return the logarithm of each plant's largest weighted norm at a point, (plants,).

        A plant that exceeds a constraint by more than `kept` is as much higher than the objective.
        """
        levels = np.full(len(self.loops), -np.inf)
        for j, loop in enumerate(point.loops):
            excess = -np.inf
            for c, level in loop.levels.items():
                if self.loops[j].channels[c][2].limit is None:
                    levels[j] = max(levels[j], level)
                else:
                    excess = max(excess, level)
            if self.region is not None:
                excess = max(excess, float(self.region.excess(loop.response.poles)[0].max()))
            if excess > kept:
                levels[j] = max(levels[j], point.objective + excess)
        return levels

    def unstable(self, x: Array) -> list[int]:
        """Return the plants that are not stable at x, the worst first; all if none is sure."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self.norms.unstable(self.structure.gains(self.theta(x)))

    def certify(self, point: Point) -> Point:
        """Return the point, with peaks added that only the level-set method found."""
        missed = self.norms.finds_higher_gain(point.loops, point.objective)
        return self.evaluate(point.x) if missed else point

    def slope(self, point: Point) -> Array:
        """Return a gradient at a point, shape (size,): that of the largest, and of the penalty."""
        gradient = np.zeros(point.x.size)
        if point.excess + _MARGIN > 0.0:
            hard = self._hard(point)
            if hard:  # none where multiple poles have no slope
                gradient += self.penalty * max(hard, key=lambda piece: piece.level).slope
        best = max(
            ((j, c) for j, loop in enumerate(point.loops) for c in loop.levels
             if self.loops[j].channels[c][2].limit is None),
            key=lambda jc: point.loops[jc[0]].levels[jc[1]],
        )  # fmt: skip
        j, c = best
        if self.loops[j].channels[c][2].norm == "h2":
            return gradient + self._h2_piece(point, j, c).slope
        omega, high = point.loops[j].peaks[c]
        [pieces] = self._at(point, [(j, c, float(omega[int(np.argmax(high))]), 0)])
        return gradient + (pieces[0].slope if pieces else 0.0)

    def pieces(self, point: Point, extra: Sequence[Piece] = ()) -> list[Piece]:
        """Return the pieces near the largest, and the constraints near or above zero.

        Parameters
        ----------
        point : Point
            Where.
        extra : sequence of Piece
            Peaks elsewhere: their frequencies are looked at too.
        """
        soft: list[Piece] = []
        peaks: list[tuple[float, int, int, float]] = []
        least = self._refine(point)
        for j, loop in enumerate(point.loops):
            for c, level in loop.levels.items():
                channel = self.loops[j].channels[c][2]
                if channel.limit is not None or level < least:
                    continue
                if channel.norm == "h2":
                    soft.append(self._h2_piece(point, j, c))
                    continue
                omega, high = loop.peaks[c]
                share = high / max(float(high.max()), 1e-300)
                peaks += [
                    (float(np.exp(level - point.objective) * share[i]), j, c, float(omega[i]))
                    for i in distinct_peaks(omega, high)
                ]
        highest: list[_Wanted] = []
        heights: set[tuple[int, float, float]] = set()
        for level, j, c, at in sorted(peaks, key=lambda peak: -peak[0]):
            heights.add((c, at, round(level, ALIKE)))
            if len(heights) > self._most:
                break
            highest.append((j, c, at, None))
        for made in self._at(point, highest):
            soft += [p for p in made if p.level >= least]
        soft = without_duplicates(sorted(soft, key=lambda p: -p.level))[: self._most]
        hard = [p for p in self._hard(point) if p.level > _NEAR_HARD]
        return self.with_extra(point, soft + hard, extra)

    def with_extra(
        self, point: Point, pieces: Sequence[Piece], extra: Sequence[Piece]
    ) -> list[Piece]:
        """Return pieces at a point, and those at the frequencies of other ones, each once."""
        made = list(pieces)
        known = {piece_key(p) for p in made}
        wanted: list[_Wanted] = []
        for p in extra:
            if not p.hard and piece_key(p) not in known and not np.isnan(p.omega_rad_s):
                known.add(piece_key(p))
                wanted.append((p.plant, p.channel, p.omega_rad_s, p.number))
        return made + [p for pieces_there in self._at(point, wanted) for p in pieces_there]

    def follow(self, point: Point, pieces: Sequence[Piece]) -> list[Piece]:
        """Return the same pieces at another point; a piece that is gone there stays as it was."""
        followed, hard = list(pieces), None
        self._refine(point)
        places: list[int] = []
        wanted: list[_Wanted] = []
        for k, piece in enumerate(pieces):
            j, c = piece.plant, piece.channel
            if c < 0 or piece.hard:
                hard = self._hard(point) if hard is None else hard
                same = [h for h in hard if (h.plant, h.channel, h.number) == (j, c, piece.number)]
                followed[k] = max(same, key=lambda h: h.level) if same else piece
            elif np.isnan(piece.omega_rad_s):
                followed[k] = self._h2_piece(point, j, c)
            else:
                places.append(k)
                omega = nearest_frequency(point.loops[j].peaks[c][0], piece.omega_rad_s)
                wanted.append((j, c, omega, piece.number))
        for k, at in zip(places, self._at(point, wanted), strict=True):
            followed[k] = at[0] if at else pieces[k]
        return followed

    def _refine(self, point: Point) -> float:
        """Refine the highest peaks; return the level from which they are near the largest."""
        self.norms.refine(point.loops, point.objective + float(np.log(_REFINED)))
        return point.objective + float(np.log(NEAR))

    def _hard(self, point: Point) -> list[Piece]:
        hard: list[Piece] = []
        assert point.gains is not None
        for j, loop in enumerate(point.loops):
            for c, level in loop.levels.items():
                channel = self.loops[j].channels[c][2]
                if channel.limit is None or level < _NEAR_HARD:
                    continue
                if channel.norm == "h2":
                    hard.append(self._h2_piece(point, j, c))
                    continue
                at = loop.peaks[c][0][distinct_peaks(*loop.peaks[c])].tolist()
                for made in self._at(point, [(j, c, omega, None) for omega in at]):
                    hard += [p for p in made if p.level > _NEAR_HARD]
            if self.region is not None:
                hard += self._pole_pieces(point, j, self.region)
        level = self._gain_excess(point.gains)
        if level > _NEAR_HARD:
            slope = point.gains / np.sum(point.gains**2)
            slope = self._chain_rule(point, slope)
            hard.append(Piece(level + _MARGIN, slope, -1, -1, np.nan, 0, True))
        if self._controller_stable:
            hard += self._controller_pieces(point)
        return hard

    def _controller_pieces(self, point: Point) -> list[Piece]:
        assert point.gains is not None
        k = self.structure.order
        poles, left, right = eig(point.gains[:k, :k], left=True, right=True)
        pieces: list[Piece] = []
        for number, i in enumerate(np.argsort(-poles.real, kind="stable")):
            level = float(poles[i].real) / self._rate + _STRICTLY + _MARGIN
            along = left[:, i].conj() @ right[:, i]
            if poles[i].imag < 0.0 or level < _NEAR_HARD or abs(along) < 1e-12:
                continue
            slope = np.zeros_like(point.gains)
            slope[:k, :k] = np.real(np.outer(left[:, i].conj(), right[:, i]) / along) / self._rate
            pieces.append(
                Piece(level, self._chain_rule(point, slope), -2, -1, np.nan, number, True)
            )
        return pieces

    def _chain_rule(self, point: Point, slope: Array) -> Array:
        return self.structure.pull_back(self.theta(point.x), slope) * self.spread

    def _at(self, point: Point, wanted: Sequence[_Wanted]) -> list[list[Piece]]:
        """Return, for each that is wanted, the pieces of all singular values or of one of them."""
        pieces: list[list[Piece]] = [[] for _ in wanted]
        groups: dict[tuple[int, int], list[int]] = {}
        for k, (j, c, _, _) in enumerate(wanted):
            groups.setdefault((self.norms.group[j], c), []).append(k)
        for (_, c), members in groups.items():
            first = wanted[members[0]][0]
            rows, columns, channel = self.loops[first].channels[c]
            hard = channel.limit is not None
            omega = np.array([wanted[k][2] for k in members])
            weight = np.array([self.loops[wanted[k][0]].weights[c] for k in members])
            place = np.array([point.loops[wanted[k][0]].place for k in members])
            # all singular values near the largest: where two meet, both hold the optimum up
            sigma, slopes = gain_slopes(point.loops[first].all.at(place), rows, columns, omega)
            looked = sigma > NEAR * sigma[:, :1] * (1.0 - 1e-12)
            for i, k in enumerate(members):
                number = wanted[k][3]
                if number is not None:
                    looked[i] = (np.arange(sigma.shape[1]) == number) & (sigma[i] > 0.0)
            high = sigma[looked]
            levels = np.log((weight[:, None] * sigma)[looked]) + (_MARGIN if hard else 0.0)
            chained = self._chain_rule(point, slopes[looked] / high[:, None, None])
            places = zip(*np.nonzero(looked), strict=True)
            for (i, number), level, slope in zip(places, levels.tolist(), chained, strict=True):
                j, _, at, _ = wanted[members[int(i)]]
                pieces[members[int(i)]].append(Piece(level, slope, j, c, at, int(number), hard))
        return pieces

    def _h2_piece(self, point: Point, j: int, c: int) -> Piece:
        rows, columns, channel = self.loops[j].channels[c]
        slope = self._chain_rule(point, h2_slope(point.loops[j].closed, rows, columns))
        hard = channel.limit is not None
        level = point.loops[j].levels[c] + (_MARGIN if hard else 0.0)
        return Piece(level, slope, j, c, np.nan, 0, hard)

    def _pole_pieces(self, point: Point, j: int, region: PoleRegion) -> list[Piece]:
        poles, slopes = pole_slopes(point.loops[j].closed)
        excess, by_pole = region.excess(poles)
        pieces = []
        for kind, i in zip(*np.nonzero(excess > _NEAR_HARD), strict=True):
            slope = self._chain_rule(point, np.real(by_pole[kind, i] * slopes[i]))
            if poles[i].imag < 0.0 or not np.isfinite(slope).all():
                continue
            # poles keep their places only roughly: the worst of a condition is followed
            level = float(excess[kind, i]) + _MARGIN
            pieces.append(Piece(level, slope, j, -1, np.nan, int(kind), True))
        return sorted(pieces, key=lambda piece: -piece.level)[:_MOST]
