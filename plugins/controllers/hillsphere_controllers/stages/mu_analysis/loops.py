"""Robustness analysis of a single loop, independent of all others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import physical_values
from hillsphere_controllers.linear_products import UncertainModel
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import CertifiedPeak, certified_peak
from hillsphere_controllers.mu.division import Division, prove_by_branch_and_bound
from hillsphere_controllers.mu.robustness import (
    Robustness,
    complexify,
    mu_bounds_on_grid,
    performance_structure,
    robust_performance,
    robust_stability,
)
from hillsphere_controllers.mu.sensitivities import sensitivities
from hillsphere_controllers.mu.upper_bound import upper_bounds
from hillsphere_controllers.mu.worst_case_gain import worst_case_gain
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.mu_analysis.products import Analysed
from hillsphere_controllers.stages.uncertain import to_lft

__all__ = ["Analyses", "Piece"]

_NONE: Array = np.zeros(0)
_UNDIVIDED = Division(0, 0)
_MOST_COVERED = 450
"""Intervals for a certificate with a cover, before its gap is widened: half of what the truncated
loops of the packaged missions take at most. The cover is itself wider than what it covers, so that
a narrower gap would say little."""


@dataclass(frozen=True)
class Piece:
    """One analysis of one loop.

    Parameters
    ----------
    loop : int
        Number of the loop.
    analysis : {"robust_stability", "robust_performance", "worst_case_gain"}
        Which one.
    model : UncertainModel
        The loop, closed by its controller.
    drawn : bool
        Whether bounds over frequency are wanted.
    channel : str
        Name of the outputs whose performance it is, where it is not that of all.
    covered : UncertainModel or None
        The loop with the blocks that cover what the model's approximation left out, if it has any.
    """

    loop: int
    analysis: str
    model: UncertainModel
    drawn: bool
    channel: str = ""
    covered: UncertainModel | None = None


@dataclass(frozen=True, eq=False)
class Analyses:
    """Options common to all analyses; see `hillsphere.runs.workers.Divisible`.

    Parameters
    ----------
    gap, prove_below, size, complex_parts, sensitivities, points, sensitivity_curves
        As of the spec.
    grid_rad_s : ndarray, shape (K,)
        Frequencies of what is published.
    seed : int
        Of the lower bounds' random starts.
    ends : tuple of float
        Lowest and highest frequency drawn, rad/s.
    """

    gap: float
    prove_below: float | None
    size: float
    complex_parts: tuple[float, ...]
    sensitivities: bool
    points: int
    sensitivity_curves: bool
    grid_rad_s: Array
    seed: int
    ends: tuple[float, float]

    def prepare(self) -> Callable[[Piece], tuple[Analysed, Analysed]]:
        """Return the function that analyses a loop."""
        return self.analyse

    def analyse(self, piece: Piece) -> tuple[Analysed, Analysed]:
        """Return the bounds of one loop with their certificates, and those without the cover.

        Parameters
        ----------
        piece : Piece
            A stable loop.
        """
        bare = self._analyse_bare(piece)
        return (bare if piece.covered is None else self._cover(piece.covered, bare)), bare

    def _cover(self, model: UncertainModel, bare: Analysed) -> Analysed:
        """Return an analysis with the certificate of the loop with its cover.

        What the truncated model bears, the cover's Δ = 0 does: the lower bound stays.
        """
        lft = to_lft(model)
        structure, loop, division = lft.structure, lft.system, _UNDIVIDED
        curve = bare.curve_upper
        if bare.analysis == "worst_case_gain":
            made = worst_case_gain(loop, structure, size=self.size, gap=self.gap, seed=self.seed)
            upper, certified = made.upper, made.certified
        else:
            if bare.analysis == "robust_stability":
                p, m = structure.shape
                loop = LtiSystem(loop.a, loop.b[:, :m], loop.c[:p], loop.d[:p, :m], loop.dt_s)
            else:
                structure = performance_structure(loop, structure)
            certified = certified_peak(loop, structure, gap=self.gap, most=_MOST_COVERED)
            upper, division = self._upper(bare.lower, certified.upper, loop, structure)
            if bare.omega_rad_s.size:
                bounds = upper_bounds(loop.response(bare.omega_rad_s), structure)
                curve = np.array([one.value for one in bounds])
        peak, peak_rad_s = _peak(certified, bare.lower, bare.frequency_rad_s)
        low, high, at, bound = _intervals(certified)
        return replace(
            bare, upper=float(upper), peak=peak, peak_rad_s=peak_rad_s,
            parts=division.proved, parts_left=division.left, curve_upper=curve,
            interval_low_rad_s=low, interval_high_rad_s=high, interval_at_rad_s=at,
            interval_bound=bound,
        )  # fmt: skip

    def _analyse_bare(self, piece: Piece) -> Analysed:
        seed = self.seed
        lft = to_lft(piece.model)
        structure, loop = lft.structure, lft.system
        if piece.analysis == "worst_case_gain":
            gain = worst_case_gain(loop, structure, size=self.size, gap=self.gap, seed=seed)
            return _result(
                piece, lft, gain.upper, gain.lower, gain.frequency_rad_s, gain.certified,
                gain.values, structure, gain.delta,
            )  # fmt: skip
        robustness: Robustness
        if piece.analysis == "robust_stability":
            robustness = robust_stability(
                loop, structure, gap=self.gap, complex_shares=self.complex_parts, seed=seed
            )
            whole = structure
            p, m = structure.shape
            loop = LtiSystem(loop.a, loop.b[:, :m], loop.c[:p], loop.d[:p, :m], loop.dt_s)
        else:
            robustness = robust_performance(loop, structure, gap=self.gap, seed=seed)
            whole = performance_structure(loop, structure)
        certified, worst = robustness.certified, robustness.worst
        upper, division = self._upper(robustness.lower, robustness.upper, loop, whole)
        # µ of purely real blocks is discontinuous: the perturbation found may exceed all bounds at
        # the frequencies looked at
        peak = certified.frequency_rad_s
        if robustness.lower > certified.peak:
            peak = robustness.frequency_rad_s
        grid_peak = np.nan
        if self.grid_rad_s.size:
            bounds = upper_bounds(loop.response(self.grid_rad_s), whole)
            grid_peak = max(one.value for one in bounds)
        shares = _NONE
        if self.sensitivities and max(certified.peak, robustness.lower) > 0.0:
            shares = self._shares(loop, whole, peak)
        return _result(
            piece, lft, upper, robustness.lower, robustness.frequency_rad_s, certified,
            worst.values if worst else {}, whole, worst.system if worst else None,
            division=division,
            grid_peak=grid_peak,
            curves=self._curves(piece, lft, loop, whole, [peak, robustness.frequency_rad_s]),
            shares=shares,
            pole=worst.pole if worst else complex(np.nan, np.nan),
            singular=worst.singular if worst else np.nan,
            complex_parts=np.array([one.share for one in robustness.complexified]),
            complex_upper=np.array([one.upper for one in robustness.complexified]),
            complex_lower=np.array([one.lower for one in robustness.complexified]),
        )  # fmt: skip

    def _upper(
        self, lower: float, upper: float, loop: LtiSystem, whole: BlockStructure
    ) -> tuple[float, Division]:
        """Return the certified bound, and the parts of the ranges if they were divided for it."""
        limit = self.prove_below
        real = any(block.kind == "real" for block in whole.blocks)
        if limit is None or not real or not lower < limit < upper:
            return upper, _UNDIVIDED
        division = prove_by_branch_and_bound(loop, whole, limit)
        return upper if division.left else limit, division

    def _curves(
        self,
        piece: Piece,
        lft: Lft,
        loop: LtiSystem,
        structure: BlockStructure,
        wanted: Sequence[float],
    ) -> _Curves:
        """Return bounds of µ, and optional nominal gains and shares, over frequency."""
        if not piece.drawn:
            return _Curves()
        omega = _curve_frequencies(loop, wanted, self.points, self.ends)
        lower, upper = mu_bounds_on_grid(loop, structure, omega, seed=self.seed)
        nominal, shares = _NONE, np.zeros((0, 0))
        if piece.analysis == "robust_performance":
            nominal = largest_gains(lft.nominal.response(omega))
        if self.sensitivity_curves:
            shares = np.full((len(structure.blocks), omega.size), np.nan)
            for k, at in enumerate(omega):
                with suppress(InputError):  # µ is zero there
                    shares_here = self._shares(loop, structure, float(at))
                    shares[:, k] = shares_here if shares_here.size else np.nan
        return _Curves(omega, lower, upper, nominal, shares)

    def _shares(self, loop: LtiSystem, structure: BlockStructure, omega_rad_s: float) -> Array:
        """Return the shares of the blocks (k,) at a frequency.

        µ of purely real blocks is discontinuous: its shares are computed with complex parts, and
        are none without them.
        """
        omega = np.array([omega_rad_s])
        if not structure.purely_real:
            return sensitivities(loop.response(omega)[0], structure)
        if not self.complex_parts:
            return _NONE
        wider, blocks = complexify(loop, structure, max(self.complex_parts))
        shares = sensitivities(wider.response(omega)[0], blocks)
        return np.asarray(shares.reshape(2, -1).sum(axis=0))


@dataclass(frozen=True, eq=False)
class _Curves:
    """Over frequency: bounds, largest gains of the nominal loop, shares of the blocks."""

    omega_rad_s: Array = field(default_factory=lambda: _NONE)
    lower: Array = field(default_factory=lambda: _NONE)
    upper: Array = field(default_factory=lambda: _NONE)
    nominal: Array = field(default_factory=lambda: _NONE)
    shares: Array = field(default_factory=lambda: np.zeros((0, 0)))


def _result(
    piece: Piece,
    lft: Lft,
    upper: float,
    lower: float,
    frequency_rad_s: float,
    certified: CertifiedPeak,
    values: dict[str, float],
    structure: BlockStructure,
    delta: LtiSystem | None,
    *,
    division: Division = _UNDIVIDED,
    grid_peak: float = np.nan,
    curves: _Curves | None = None,
    shares: Array = _NONE,
    pole: complex = complex(np.nan, np.nan),
    singular: float = np.nan,
    complex_parts: Array = _NONE,
    complex_upper: Array = _NONE,
    complex_lower: Array = _NONE,
) -> Analysed:
    drawn = curves or _Curves()
    real = [(k, u) for k, u in enumerate(lft.uncertainties) if u.name in values]
    small = np.array([values[u.name] for _, u in real])
    in_units = physical_values([u for _, u in real], {u.name: values[u.name] for _, u in real})
    physical = np.array([in_units[u.name] for _, u in real])
    peak, peak_rad_s = _peak(certified, lower, frequency_rad_s)
    low, high, at, bound = _intervals(certified)
    return Analysed(
        loop=piece.loop, analysis=piece.analysis, channel=piece.channel,
        upper=float(upper), lower=float(lower),
        peak=peak, peak_rad_s=peak_rad_s,
        frequency_rad_s=float(frequency_rad_s), lower_channel=piece.channel,
        parts=division.proved, parts_left=division.left,
        grid_peak=float(grid_peak),
        interval_low_rad_s=low, interval_high_rad_s=high, interval_at_rad_s=at,
        interval_bound=bound,
        omega_rad_s=drawn.omega_rad_s, curve_lower=drawn.lower, curve_upper=drawn.upper,
        curve_nominal=drawn.nominal, curve_shares=drawn.shares,
        blocks=tuple(b.name or str(k) for k, b in enumerate(structure.blocks)), shares=shares,
        names=tuple(u.name for _, u in real), units=tuple(piece.model.units[k] for k, _ in real),
        values=physical, normalised=small, delta=delta,
        pole_re=float(pole.real), pole_im=float(pole.imag),
        singular=float(singular), complex_parts=complex_parts, complex_upper=complex_upper,
        complex_lower=complex_lower,
    )  # fmt: skip


def _peak(certified: CertifiedPeak, lower: float, frequency_rad_s: float) -> tuple[float, float]:
    """Return the largest bound found at one frequency, from above or by a perturbation, and it."""
    if certified.peak < lower < np.inf:
        return float(lower), float(frequency_rad_s)
    return float(certified.peak), float(certified.frequency_rad_s)


def _intervals(certified: CertifiedPeak) -> tuple[Array, Array, Array, Array]:
    """Return ends, frequencies and bounds (K,) of the intervals of a certificate."""
    rows = [
        (one.low_rad_s, one.high_rad_s, one.frequency_rad_s, one.bound)
        for one in certified.intervals
    ]
    low, high, at, bound = np.array(rows, dtype=float).reshape(-1, 4).T
    return low, high, at, bound


def _curve_frequencies(
    loop: LtiSystem, more: Sequence[float], points: int, ends: tuple[float, float]
) -> Array:
    """Return frequencies for the curves: about `points` of a loop's, both ends, and `more`."""
    low, high = ends[0], min(ends[1], np.pi / loop.dt_s if loop.dt_s is not None else np.inf)
    omega = frequencies([loop], more)
    outside = np.geomspace(low, high, points)
    omega = np.concatenate([outside[outside < omega[0]], omega, outside[outside > omega[-1]]])
    kept = omega[np.unique(np.linspace(0, omega.size - 1, points).astype(int))]
    wanted = [low, high, *(w for w in more if low <= w <= high)]
    return np.unique(np.concatenate([kept, np.array(wanted, dtype=float)]))
