"""The stage ``worst_cases``: points of a sweep from the worst perturbations of a µ analysis."""

from __future__ import annotations

import numpy as np

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Metric, Presentation
from hillsphere.products.products import Ladder
from hillsphere.show.tables import FieldColumns, column, tabulate, text_column
from hillsphere_controllers.linear_products import UncertainModel, UncertainModels
from hillsphere_controllers.stages.linearise.products import LinearisedFlight
from hillsphere_controllers.stages.mu_analysis.products import Analysed, MuAnalysis
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.stages.worst_cases.products import WorstCases
from hillsphere_controllers.stages.worst_cases.specs import WorstCasesSpec

__all__ = ["WorstCasesStage"]

_SHOWN = 60
"""Rows of the table of cases at most; all cases are in the product."""
_ROUNDING = 1e-6
"""Normalised values below this share of the largest are rounding of the search and stay nominal; a
lower bound of µ below it counts as this value."""


class WorstCasesStage:
    """The worst cases of an analysis by µ.

    Parameters
    ----------
    spec : WorstCasesSpec
        Which, and what they set.
    """

    def __init__(self, spec: WorstCasesSpec) -> None:
        self.spec = spec

    def run(
        self,
        ctx: Context,
        analysis: MuAnalysis,
        uncertain: UncertainModels,
        flight: LinearisedFlight,
    ) -> WorstCases:
        """Collect them.

        Parameters
        ----------
        ctx : Context
            Told which worst cases cannot be scaled.
        analysis : MuAnalysis
            With worst perturbations.
        uncertain : UncertainModels
            That were analysed.
        flight : LinearisedFlight
            With all parameters.

        Returns
        -------
        WorstCases
            One point for each controller, model, analysis and place of the remaining parameters.

        Raises
        ------
        InputError
            If a controller or block is not there.
        StageError
            If the analysis is not that of these models, or has found no worst case.
        """
        spec = self.spec
        if analysis.models != uncertain.labels:
            raise StageError("needs.analysis: it is not one of the models of needs.uncertain")
        for name in spec.controllers:
            if name not in analysis.controllers:
                hint = did_you_mean(name, analysis.controllers, otherwise="there are")
                raise InputError(f"controllers: none is called {name!r}{hint}")
        blocks = {name for model in uncertain.models for name in model.names}
        for name in spec.inputs:
            if name not in blocks:
                hint = did_you_mean(name, sorted(blocks), otherwise="there are")
                raise InputError(f"inputs: the models have no block {name!r}{hint}")
        nominal = {
            name: float(value)
            for model in uncertain.models
            for name, value in zip(model.names, model.nominal, strict=True)
        }
        names = (*flight.dispersed, *spec.inputs.values())
        columns: list[Array] = []
        collected: list[tuple[str, str, Analysed, float]] = []
        sizes: list[float] = []
        moved: list[int] = []
        unmoved: list[str] = []
        for one in analysis.results:
            controller = analysis.controllers[int(analysis.controller[one.loop])]
            place = int(analysis.model[one.loop])
            if one.analysis not in spec.analyses or not one.normalised.size:
                continue
            if spec.controllers and controller not in spec.controllers:
                continue
            worst = _scale_to_bounds(uncertain.models[place], one, analysis.size)
            settable = {*flight.dispersed, *spec.inputs} & set(worst)
            moves = sum(worst[name] != nominal[name] for name in settable)
            who = _describe_case(controller, analysis.models[place], one)
            if not moves:
                # the peak is that of the nominal loop, or of blocks that no flight has
                unmoved.append(who)
                continue
            for away in spec.remaining:
                values = flight.nominal[1:] + away * flight.sigma
                kept = [k for k, name in enumerate(flight.dispersed) if name in worst]
                others = [worst.get(name, nominal[name]) for name in spec.inputs]
                gap = np.array([worst[flight.dispersed[k]] for k in kept])
                gap -= flight.nominal[1:][kept]
                sigma = np.maximum(flight.sigma[kept], np.finfo(float).tiny)
                size = float(np.max(np.abs(gap) / sigma, initial=0.0))
                if spec.scales and not 0.0 < size < np.inf:
                    # the peak is that of the actuator: nothing to enlarge
                    unmoved.append(who)
                    continue
                for scale in spec.scales or (size,):
                    factor = scale / size if spec.scales else 1.0
                    values[kept] = flight.nominal[1:][kept] + factor * gap
                    columns.append(np.array([*values, *others]))
                    collected.append((controller, analysis.models[place], one, away))
                    sizes.append(scale)
                    moved.append(moves)
        told = "; ".join(dict.fromkeys(unmoved))
        if unmoved and not collected:
            what = "a parameter that has a standard deviation" if spec.scales else "what it sets"
            raise StageError(
                f"needs.analysis: no worst case ({told}) moves {what} in the flight, so all would "
                "be nominal; take analyses = ['worst_case_gain'], or name the blocks in 'inputs'"
                + ("; or leave scales out" if spec.scales else "")
            )
        if unmoved:
            ctx.info(f"worst cases that move nothing: {told}")
        if not collected:
            raise StageError("needs.analysis: it has no worst case of what is asked for")
        groups = tuple(
            f"{_describe_case(controller, model, one)}, others {away:+g} σ"
            for controller, model, one, away in collected
        )
        steps = np.array(sizes)
        ladder = Ladder("σ of the worst case", "-", steps, groups) if spec.scales else None
        said = [f", {size:g} σ" if spec.scales else "" for size in sizes]
        return WorstCases(
            names=names,
            units=(*flight.units[1:], *("" for _ in spec.inputs)),
            values=np.array(columns).T,
            labels=tuple(group + size for group, size in zip(groups, said, strict=True)),
            ladder=ladder,
            controller=tuple(entry[0] for entry in collected),
            model=tuple(entry[1] for entry in collected),
            analysis=tuple(entry[2].analysis for entry in collected),
            channel=tuple(entry[2].channel for entry in collected),
            mu=np.array([entry[2].lower for entry in collected]),
            frequency_rad_s=np.array([entry[2].frequency_rad_s for entry in collected]),
            remaining=np.array([entry[3] for entry in collected]),
            sigmas=steps,
            moved=np.array(moved, dtype=np.int64),
            unmoved=tuple(dict.fromkeys(unmoved)),
        )

    def present(
        self,
        product: WorstCases,
        analysis: MuAnalysis,
        uncertain: UncertainModels,
        flight: LinearisedFlight,
    ) -> Presentation:
        """Show them, in standard deviations."""
        count, cases = len(flight.dispersed), len(product.labels)
        sigma = np.where(flight.sigma > 0.0, flight.sigma, np.inf)
        size = (product.values[:count] - flight.nominal[1:, None]) / sigma[:, None]
        far = np.abs(size).argmax(axis=0) if count else np.zeros(cases, dtype=int)
        farthest = [flight.dispersed[k] for k in far] if count else [""] * cases
        largest = size[far, np.arange(cases)] if count else np.full(cases, np.nan)
        of = FieldColumns(product, "cases")
        columns = [
            text_column("case", product.labels, "case"),
            *map(of, ("mu", "frequency_rad_s", "moved")),
            text_column("farthest", farthest, "parameter farthest from nominal"),
            column("sigmas", largest, "its standard deviations", 4),
            column("norm_sigmas", np.sqrt([np.sum(one**2) for one in size.T]), "all together", 4),
        ]
        notes = [
            "Worst perturbations, scaled to the declared bounds: for µ with the largest entry at "
            "its bound, for the worst-case gain as they are"
            + (", with their parameters scaled together to other sizes" if self.spec.scales else "")
            + ". Together they are far less probable than each alone: the last column is the root "
            "sum of squares, in standard deviations."
        ]
        if cases > _SHOWN:
            notes.append(f"The first {_SHOWN} of {cases} cases.")
        if product.unmoved:
            notes.append(
                f"Without a case ({len(product.unmoved)}): the worst perturbation changes no "
                "parameter that can be set or scaled in the flight: "
                f"{'; '.join(product.unmoved)}."
            )
        return Presentation(
            metrics={"worst_cases": Metric(cases)},
            tables={"worst_cases": tabulate("Worst cases", columns, notes).first(_SHOWN)},
            figures={},
        )


def _describe_case(controller: str, model: str, one: Analysed) -> str:
    """Return whose worst case it is."""
    channel = f" of {one.channel}" if one.channel else ""
    return f"{controller}, {model}, {one.analysis.replace('_', ' ')}{channel}"


def _scale_to_bounds(model: UncertainModel, one: Analysed, size: float) -> dict[str, float]:
    """Return the worst values by name, of the size of the declared bounds.

    Those of the worst-case gain are divided by the size it was asked for; others are scaled so that
    the largest normalised one is a bound. What is but rounding stays nominal.
    """
    largest = float(np.abs(one.normalised).max())
    whole = size if one.analysis == "worst_case_gain" else 1.0 / max(one.lower, _ROUNDING)
    if one.analysis != "worst_case_gain":
        size = largest
    small = np.zeros_like(one.normalised)
    if largest > _ROUNDING * whole:
        small = np.where(np.abs(one.normalised) > _ROUNDING * largest, one.normalised / size, 0.0)
    by_name = {u.name: u for u in to_lft(model).uncertainties}
    return {
        name: float(by_name[name].physical(np.array(value)))
        for name, value in zip(one.names, np.clip(small, -1.0, 1.0), strict=True)
    }
