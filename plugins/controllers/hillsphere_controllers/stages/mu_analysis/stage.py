"""The stage ``mu_analysis``: robustness of loops, certified over all frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array, Context
from hillsphere.linear_products import UncertainModel, UncertainModels
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere.products import ControlDesign
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.lft.transformation import Lft
from hillsphere_controllers.lft.uncertainties import physical_values
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.certified import CertifiedPeak
from hillsphere_controllers.mu.robustness import (
    Robustness,
    complexified,
    mu_bounds_on_grid,
    performance_structure,
    robust_performance,
    robust_stability,
)
from hillsphere_controllers.mu.sensitivities import sensitivities
from hillsphere_controllers.mu.upper_bound import upper_bounds
from hillsphere_controllers.mu.worst_case_gain import worst_case_gain
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.mu_analysis.presentation import presented
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis
from hillsphere_controllers.stages.mu_analysis.specs import MuAnalysisSpec
from hillsphere_controllers.stages.uncertain import lft_of
from hillsphere_controllers.systems.algebra import lower_lft

__all__ = ["MuAnalysisStage"]

_NONE: Array = np.zeros(0)


class MuAnalysisStage:
    """What loops bear of their uncertainty.

    Parameters
    ----------
    spec : MuAnalysisSpec
        Which analyses, how close the bounds.
    """

    def __init__(self, spec: MuAnalysisSpec) -> None:
        self.spec = spec

    def run(
        self, ctx: Context, uncertain: UncertainModels, controllers: tuple[ControlDesign, ...]
    ) -> MuAnalysis:
        """Analyse every uncertain model with every controller.

        Parameters
        ----------
        ctx : Context
            Progress and seeds.
        uncertain : UncertainModels
            Generalised plants, or closed loops.
        controllers : tuple of ControlDesign
            That close the loops; none for closed loops.

        Returns
        -------
        MuAnalysis
            Bounds with what proves them.

        Raises
        ------
        InputError
            If a controller does not fit, nothing is uncertain, or nothing is left for performance
            where it is asked for.
        """
        spec = self.spec
        names = _labels([ref.name for ref in spec.needs.controllers]) or ("as it is",)
        systems: list[LtiSystem | None] = [design.controller for design in controllers]
        systems = systems or [None]
        seed = int(ctx.rng("starts").integers(1 << 31))
        advance = ctx.track("analyses", len(systems) * len(uncertain.models) * len(spec.analyses))
        nominal: list[float] = []
        on_grid: list[float] = []
        grid = self._grid()
        results: list[Analysed] = []
        places: list[tuple[int, int]] = []
        loops: list[LtiSystem] = []
        for c, controller in enumerate(systems):
            for m, model in enumerate(uncertain.models):
                if not model.names:
                    raise InputError(f"{uncertain.labels[m]}: nothing is uncertain")
                loops.append(_closed(model.system, controller, uncertain, names[c]))
                places.append((c, m))
        ends = _ends(loops)
        for number, (_, m) in enumerate(places):
            model, loop = uncertain.models[m], loops[number]
            lft = lft_of(_with_system(model, loop))
            # the norm is infinite if any state is not stable, performance or not
            nominal.append(hinf_norm(lft.nominal).value)
            gains = largest_gains(lft.nominal.response(grid)) if grid.size else [np.nan]
            on_grid.append(float(np.max(gains)) if np.isfinite(nominal[-1]) else np.nan)
            for analysis in spec.analyses:
                if loop.is_stable:
                    results.append(self._analysed(number, analysis, lft, model, seed, ends))
                advance(1)
        pairs = np.array(places, dtype=np.int64)
        return MuAnalysis(
            controllers=names,
            models=uncertain.labels,
            controller=pairs[:, 0],
            model=pairs[:, 1],
            nominal=np.array(nominal),
            nominal_grid=np.array(on_grid),
            results=tuple(results),
            size=spec.size,
            gap=spec.gap,
        )

    def present(
        self,
        product: MuAnalysis,
        uncertain: UncertainModels,
        controllers: tuple[ControlDesign, ...],
    ) -> Presentation:
        """Show bounds over frequency with their certificates, worst cases, shares of blocks."""
        return presented(product, self.spec.reference)

    def _analysed(
        self, number: int, analysis: str, lft: Lft, model: UncertainModel, seed: int,
        ends: tuple[float, float],
    ) -> Analysed:  # fmt: skip
        spec, structure, loop = self.spec, lft.structure, lft.system
        if analysis == "worst_case_gain":
            gain = worst_case_gain(loop, structure, size=spec.size, gap=spec.gap, seed=seed)
            return _result(
                number, analysis, gain.upper, gain.lower, gain.frequency_rad_s, gain.certified,
                lft, model, gain.values, structure, gain.delta,
            )  # fmt: skip
        found: Robustness
        if analysis == "robust_stability":
            found = robust_stability(
                loop, structure, gap=spec.gap, complex_shares=spec.complex_parts, seed=seed
            )
            whole = structure
            p, m = structure.shape
            loop = LtiSystem(loop.a, loop.b[:, :m], loop.c[:p], loop.d[:p, :m], loop.dt_s)
        else:
            found = robust_performance(loop, structure, gap=spec.gap, seed=seed)
            whole = performance_structure(loop, structure)
        certified, worst = found.certified, found.worst
        # a purely real µ jumps: a perturbation may show more than the bounds looked at
        peak = certified.frequency_rad_s
        if found.lower > certified.peak:
            peak = found.frequency_rad_s
        grid = self._grid()
        grid_peak = np.nan
        if grid.size:
            bounds = upper_bounds(loop.response(grid), whole)
            grid_peak = max(one.value for one in bounds)
        omega = _drawn(loop, [peak, found.frequency_rad_s], spec.points, ends)
        lower, upper = mu_bounds_on_grid(loop, whole, omega, seed=seed)
        shares = _NONE
        if spec.sensitivities and max(certified.peak, found.lower) > 0.0:
            with suppress(ConvergenceError):  # a bound too flat has no shares
                shares = self._shares(loop, whole, peak)
        return _result(
            number, analysis, found.upper, found.lower, found.frequency_rad_s, certified, lft,
            model, worst.values if worst else {}, whole, worst.system if worst else None,
            grid_peak=grid_peak, omega_rad_s=omega, curve_lower=lower, curve_upper=upper,
            shares=shares,
            pole=worst.pole if worst else complex(np.nan, np.nan),
            singular=worst.singular if worst else np.nan,
            complex_parts=np.array([one.share for one in found.complexified]),
            complex_upper=np.array([one.upper for one in found.complexified]),
            complex_lower=np.array([one.lower for one in found.complexified]),
        )  # fmt: skip

    def _grid(self) -> Array:
        """Return the frequencies of what is published (K,)."""
        grid = self.spec.reference_grid
        if grid is None:
            return _NONE
        return np.geomspace(grid.low_rad_s, grid.high_rad_s, grid.count)

    def _shares(self, loop: LtiSystem, structure: BlockStructure, omega_rad_s: float) -> Array:
        """Return the shares of the blocks (k,) at a frequency.

        A purely real µ jumps: its shares are those with complex parts; none if there are no such.
        """
        omega = np.array([omega_rad_s])
        if not structure.purely_real:
            return sensitivities(loop.response(omega)[0], structure)
        if not self.spec.complex_parts:
            return _NONE
        wider, blocks = complexified(loop, structure, max(self.spec.complex_parts))
        found = sensitivities(wider.response(omega)[0], blocks)
        return np.asarray(found.reshape(2, -1).sum(axis=0))


def _result(
    number: int,
    analysis: str,
    upper: float,
    lower: float,
    frequency_rad_s: float,
    certified: CertifiedPeak,
    lft: Lft,
    model: UncertainModel,
    values: dict[str, float],
    structure: BlockStructure,
    delta: LtiSystem | None,
    *,
    grid_peak: float = np.nan,
    omega_rad_s: Array = _NONE,
    curve_lower: Array = _NONE,
    curve_upper: Array = _NONE,
    shares: Array = _NONE,
    pole: complex = complex(np.nan, np.nan),
    singular: float = np.nan,
    complex_parts: Array = _NONE,
    complex_upper: Array = _NONE,
    complex_lower: Array = _NONE,
) -> Analysed:
    real = [(k, u) for k, u in enumerate(lft.uncertainties) if u.name in values]
    small = np.array([values[u.name] for _, u in real])
    in_units = physical_values([u for _, u in real], {u.name: values[u.name] for _, u in real})
    physical = np.array([in_units[u.name] for _, u in real])
    shown = certified.peak < lower < np.inf
    return Analysed(
        loop=number, analysis=analysis, upper=float(upper), lower=float(lower),
        peak=float(lower if shown else certified.peak),
        peak_rad_s=float(frequency_rad_s if shown else certified.frequency_rad_s),
        frequency_rad_s=float(frequency_rad_s), grid_peak=float(grid_peak),
        interval_low_rad_s=np.array([one.low_rad_s for one in certified.intervals]),
        interval_high_rad_s=np.array([one.high_rad_s for one in certified.intervals]),
        interval_at_rad_s=np.array([one.frequency_rad_s for one in certified.intervals]),
        interval_bound=np.array([one.bound for one in certified.intervals]),
        omega_rad_s=omega_rad_s, curve_lower=curve_lower, curve_upper=curve_upper,
        blocks=tuple(b.name or str(k) for k, b in enumerate(structure.blocks)), shares=shares,
        names=tuple(u.name for _, u in real), units=tuple(model.units[k] for k, _ in real),
        values=physical, normalised=small, delta=delta,
        pole_re=float(pole.real), pole_im=float(pole.imag),
        singular=float(singular), complex_parts=complex_parts, complex_upper=complex_upper,
        complex_lower=complex_lower,
    )  # fmt: skip


def _labels(names: Sequence[str]) -> tuple[str, ...]:
    """Return names that differ."""
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"{name} {k + 1}" for k, name in enumerate(names))


def _closed(
    system: LtiSystem, controller: LtiSystem | None, uncertain: UncertainModels, name: str
) -> LtiSystem:
    if controller is None:
        if uncertain.controls or uncertain.measurements:
            raise InputError(
                "needs.controllers: the uncertain models have controls and measurements; name the "
                "stage of a controller that closes their loops"
            )
        return system
    if controller.shape != (uncertain.controls, uncertain.measurements):
        raise InputError(
            f"needs.controllers: {name} takes {controller.shape[1]} measurements and gives "
            f"{controller.shape[0]} controls, the uncertain models have {uncertain.measurements} "
            f"and {uncertain.controls}"
        )
    return lower_lft(system, controller)


def _with_system(model: UncertainModel, system: LtiSystem) -> UncertainModel:
    return UncertainModel(
        system, model.names, model.units, model.kinds, model.rows, model.columns, model.times,
        model.lower, model.nominal, model.upper, model.dynamic,
    )  # fmt: skip


def _ends(loops: Sequence[LtiSystem]) -> tuple[float, float]:
    """Return the lowest and the highest frequency at which any loop is worth drawing."""
    found = [frequencies([loop])[[0, -1]] for loop in loops]
    return float(min(low for low, _ in found)), float(max(high for _, high in found))


def _drawn(loop: LtiSystem, more: Sequence[float], points: int, ends: tuple[float, float]) -> Array:
    """Return about so many of the frequencies of a loop, the ends of all, and those wanted."""
    low, high = ends[0], min(ends[1], np.pi / loop.dt_s if loop.dt_s is not None else np.inf)
    omega = frequencies([loop], more)
    outside = np.geomspace(low, high, points)
    omega = np.concatenate([outside[outside < omega[0]], omega, outside[outside > omega[-1]]])
    kept = omega[np.unique(np.linspace(0, omega.size - 1, points).astype(int))]
    wanted = [low, high, *(w for w in more if low <= w <= high)]
    return np.unique(np.concatenate([kept, np.array(wanted, dtype=float)]))
