"""The stage ``mu_analysis``: robustness of loops, certified over all frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hillsphere.base.matching import match_names
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere.presentation import Presentation
from hillsphere.products import ControlDesign
from hillsphere.runs.workers import Workers
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.linear_products import UncertainModel, UncertainModels
from hillsphere_controllers.stages.frequencies import frequencies
from hillsphere_controllers.stages.mu_analysis.loops import Analyses, Piece
from hillsphere_controllers.stages.mu_analysis.presentation import present_analyses
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis
from hillsphere_controllers.stages.mu_analysis.specs import MuAnalysisSpec
from hillsphere_controllers.stages.signals import find_signals
from hillsphere_controllers.stages.uncertain import remove_cover, to_lft
from hillsphere_controllers.systems.algebra import lower_lft

__all__ = ["MuAnalysisStage"]


class MuAnalysisStage:
    """Robustness analysis of loops with uncertain models.

    Parameters
    ----------
    spec : MuAnalysisSpec
        Which analyses, how close the bounds.
    """

    def __init__(self, spec: MuAnalysisSpec) -> None:
        self.spec = spec

    def run(
        self,
        ctx: Context,
        uncertain: UncertainModels,
        controllers: tuple[ControlDesign, ...],
        beside: tuple[MuAnalysis, ...] = (),
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
        beside : tuple of MuAnalysis
            Shown beside it; of the same analyses and outputs.

        Returns
        -------
        MuAnalysis
            Bounds with their certificates.

        Raises
        ------
        InputError
            If a controller does not fit, nothing is uncertain, nothing is left for performance
            where it is asked for, or an analysis beside is another one.
        """
        spec = self.spec
        self._comparable(beside)
        names = _labels([ref.name for ref in spec.needs.controllers]) or ("as it is",)
        systems: list[LtiSystem | None] = [design.controller for design in controllers]
        systems = systems or [None]
        seed = int(ctx.rng("starts").integers(1 << 31))
        chosen = _select_models(spec.models, uncertain, "models")
        drawn = _select_models(spec.curves, uncertain, "curves")
        of_loop: list[tuple[int, int]] = []
        loops: list[LtiSystem] = []
        for c, controller in enumerate(systems):
            for m in chosen:
                model = remove_cover(uncertain.models[m])
                if not model.names:
                    raise InputError(
                        f"needs.uncertain: nothing is uncertain in {uncertain.labels[m]!r} of "
                        f"{spec.needs.uncertain.name!r}; give that stage a smaller truncation, or "
                        "name other models here (models)"
                    )
                loops.append(_close_loop(model.system, controller, uncertain, names[c]))
                of_loop.append((c, m))
        grid = self._grid()
        nominal: list[float] = []
        on_grid: list[float] = []
        pieces: list[Piece] = []
        for number, (c, m) in enumerate(of_loop):
            whole = uncertain.models[m]
            model = _with_system(remove_cover(whole), loops[number])
            covered: dict[str, UncertainModel] = {}
            if whole.covers.any():
                closed = _close_loop(whole.system, systems[c], uncertain, names[c])
                whole = _with_system(whole, closed)
                covered = {"": whole, **_channels(whole, spec.outputs)}
            channels = _channels(model, spec.outputs)
            inner = [to_lft(one).nominal for one in channels.values()]
            # the norm is infinite if any state is not stable, performance or not
            nominal.append(max(hinf_norm(one).upper for one in inner))
            gains = [largest_gains(one.response(grid)).max() for one in inner if grid.size]
            on_grid.append(float(max(gains, default=np.nan)))
            if not np.isfinite(nominal[-1]):
                on_grid[-1] = np.nan
            if loops[number].is_stable:
                for analysis in spec.analyses:
                    taken = {"": model} if analysis == "robust_stability" else channels
                    pieces += [
                        Piece(number, analysis, one, m in drawn, name, covered.get(name))
                        for name, one in taken.items()
                    ]
        advance = ctx.track("analyses", len(pieces))
        results: list[tuple[Analysed, Analysed]] = []
        work = Analyses(
            gap=spec.gap, prove_below=spec.prove_below, size=spec.size,
            complex_parts=spec.complex_parts, sensitivities=spec.sensitivities, points=spec.points,
            sensitivity_curves=spec.sensitivity_curves, grid_rad_s=grid, seed=seed,
            ends=_ends(loops),
        )  # fmt: skip
        with Workers(ctx, work) as workers:
            for result in workers.map(pieces):
                results.append(result)
                advance(1)
        pairs = np.array(of_loop, dtype=np.int64)
        has_cover = any(uncertain.models[m].covers.any() for _, m in of_loop)
        return MuAnalysis(
            controllers=names,
            models=uncertain.labels,
            controller=pairs[:, 0],
            model=pairs[:, 1],
            nominal=np.array(nominal),
            nominal_grid=np.array(on_grid),
            results=tuple(one for one, _ in results),
            without_cover=tuple(bare for _, bare in results) if has_cover else (),
            size=spec.size,
            gap=spec.gap,
            uncertain=spec.needs.uncertain.name,
        )

    def present(
        self,
        product: MuAnalysis,
        uncertain: UncertainModels,
        controllers: tuple[ControlDesign, ...],
        beside: tuple[MuAnalysis, ...] = (),
    ) -> Presentation:
        """Show bounds over frequency with their certificates, worst cases, shares of blocks."""
        spec = self.spec
        self._comparable(beside)
        columns = [(other, one) for other in beside for one in other.worst]
        columns += [
            (product, one)
            for one in product.worst
            if not spec.columns
            or product.controllers[int(product.controller[one.loop])] in spec.columns
        ]
        return present_analyses(product, spec.reference, columns)

    def _comparable(self, beside: tuple[MuAnalysis, ...]) -> None:
        """Check that analyses shown beside are of the same kind and outputs."""
        spec = self.spec
        own = {
            (analysis, channel)
            for analysis in spec.analyses
            for channel in (spec.outputs if analysis != "robust_stability" else ()) or ("",)
        }
        for ref, other in zip(spec.needs.beside, beside, strict=True):
            theirs = {(one.analysis, one.channel) for one in other.results}
            # Of unstable loops there is nothing, which says nothing of what was asked for.
            for analysis, channel in sorted(theirs ^ own if theirs else ()):
                what = f"{analysis}{f' of {channel!r}' if channel else ''}"
                told = ("has", "not ") if (analysis, channel) in theirs else ("lacks", "")
                raise InputError(
                    f"needs.beside: {ref.name!r} {told[0]} {what}, which is {told[1]}analysed "
                    "here; use the same 'analyses' and 'outputs' in both"
                )

    def _grid(self) -> Array:
        """Return the frequencies (K,) of the published values."""
        grid = self.spec.reference_grid
        if grid is None:
            return np.zeros(0)
        return np.geomspace(grid.low_rad_s, grid.high_rad_s, grid.count)


def _select_models(patterns: tuple[str, ...], uncertain: UncertainModels, key: str) -> list[int]:
    """Return the places of models that are named; of all, if none is."""
    names = match_names(patterns, uncertain.labels, f"{key}: needs.uncertain", "model")
    return [k for k, label in enumerate(uncertain.labels) if not patterns or label in names]


def _labels(names: Sequence[str]) -> tuple[str, ...]:
    """Return names that differ."""
    if len(set(names)) == len(names):
        return tuple(names)
    return tuple(f"{name} {k + 1}" for k, name in enumerate(names))


def _close_loop(
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


def _channels(model: UncertainModel, outputs: tuple[str, ...]) -> dict[str, UncertainModel]:
    """Return the model with each of its channels of performance by itself, by their names."""
    if not outputs:
        return {"": model}
    system, p = model.system, to_lft(model).structure.shape[0]
    made = {}
    for name in outputs:
        rows = [*range(p), *(p + k for k in find_signals(system.outputs[p:], [name], "outputs"))]
        own = LtiSystem(system.a, system.b, system.c[rows], system.d[rows], system.dt_s)
        made[name] = _with_system(model, own)
    return made


def _with_system(model: UncertainModel, system: LtiSystem) -> UncertainModel:
    return replace(model, system=system)


def _ends(loops: Sequence[LtiSystem]) -> tuple[float, float]:
    """Return the lowest and the highest frequency at which any loop is worth drawing."""
    ends = [frequencies([loop])[[0, -1]] for loop in loops]
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))
