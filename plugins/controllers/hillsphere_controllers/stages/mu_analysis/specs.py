"""Spec of the stage ``mu_analysis``: keys of its table in a mission."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    quantity,
    rule,
)

__all__ = ["GridSpec", "MuAnalysisSpec", "MuNeeds"]


class MuNeeds(Spec):
    """Products of earlier stages that ``mu_analysis`` takes."""

    uncertain: Ref = need(
        "hillsphere_controllers.linear_products:UncertainModels",
        "uncertain models that are analysed",
    )
    controllers: tuple[Ref, ...] = need(
        "hillsphere.products:ControlDesign",
        "controllers that close their loops, one after the other; left out: the models as they are",
        default=(),
        max_length=20,
    )
    beside: tuple[Ref, ...] = need(
        "hillsphere_controllers.stages.mu_analysis.products:MuAnalysis",
        "analyses whose curves stand before this one's in the figure of shares over frequency; of "
        "the same 'analyses' and 'outputs'",
        default=(),
        max_length=4,
    )


class GridSpec(Spec):
    """Frequencies evenly spaced in their logarithm, both ends included."""

    examples = ({"low_rad_s": 0.001, "high_rad_s": 1000, "count": 61},)

    low_rad_s: float = quantity("angular_rate", "lowest frequency", gt=0)
    high_rad_s: float = quantity("angular_rate", "highest frequency", gt=0)
    count: int = option("number of frequencies", ge=2, le=2000)

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.high_rad_s <= self.low_rad_s:
            raise rule("high_rad_s", "must be above the lowest")
        return self


class MuAnalysisSpec(StageSpec):
    """Robustness of loops: µ over all frequencies, worst cases, shares of the blocks."""

    results = ResultNames(
        metrics=(
            "mu_loops",
            "*_upper",
            "*_lower",
            "*_without_cover",
        ),
        tables={
            "mu_summary": (),
            "mu_certificates": (),
            "mu_worst_cases": (),
            "mu_models_*": (),
            "mu_sensitivities": (),
        },
    )
    produces = "hillsphere_controllers.stages.mu_analysis.products:MuAnalysis"
    examples = (
        {"needs": {"uncertain": "uncertain", "controllers": ["design"]}, "points": 20},
        {
            "needs": {"uncertain": "uncertain", "controllers": ["design"]},
            "analyses": ["robust_performance"],
            "gap": 0.001,
            "sensitivities": False,
        },
        {
            "needs": {"uncertain": "uncertain", "controllers": ["design"]},
            "models": ["*"],
            "outputs": [],
            "curves": ["*"],
            "points": 10,
            "analyses": ["robust_performance"],
            "sensitivity_curves": True,
        },
        {
            "needs": {"uncertain": "uncertain", "controllers": ["k0", "ka"], "beside": ["mu"]},
            "analyses": ["robust_performance"],
            "sensitivity_curves": True,
            "columns": ["ka"],
            "points": 10,
            "prove_below": 0.96,
        },
    )

    needs: MuNeeds = option("products of earlier stages")
    analyses: tuple[Literal["robust_stability", "robust_performance", "worst_case_gain"], ...] = (
        option(
            "whether loops stay stable; whether their gain stays below one; how large it becomes",
            default=("robust_stability", "robust_performance", "worst_case_gain"),
            min_length=1,
        )
    )
    gap: float = option(
        "by how much certified bounds are above the largest found at one frequency, relative; "
        "smaller ones take longer",
        default=0.01, ge=1e-6, lt=1,
    )  # fmt: skip
    prove_below: float | None = option(
        "a bound of µ that is to be proved: where the certified one is above it, and what a "
        "perturbation reaches below, the ranges of real parameters are divided until all parts "
        "prove it, or 64 of them do not; each takes as long as an analysis",
        default=None, gt=0,
    )  # fmt: skip
    size: float = option(
        "size of the uncertainty for the worst-case gain; 1: as declared", default=1.0, gt=0
    )
    complex_parts: tuple[float, ...] = option(
        "purely real uncertainties are analysed with complex parts of this size besides, since "
        "their µ may jump with the data",
        default=(0.01, 0.05), gt=0, lt=1,
    )  # fmt: skip
    models: tuple[str, ...] = option(
        "which of the uncertain models are analysed, by name, in which * stands for any "
        "characters; left out: all",
        default=(),
    )
    outputs: tuple[str, ...] = option(
        "outputs whose performance counts, each name a channel by itself of which the worst is "
        "shown, so that all gains are below one where its is; left out: all together as one",
        default=(),
    )
    sensitivities: bool = option("whether the shares of the blocks are computed", default=True)
    sensitivity_curves: bool = option(
        "whether the shares of the blocks are computed at all frequencies drawn, too", default=False
    )
    curves: tuple[str, ...] = option(
        "models whose bounds are drawn over frequency, as in 'models'; left out: all that are "
        "analysed",
        default=(),
    )
    columns: tuple[str, ...] = option(
        "controllers that have a column in the figure of shares over frequency; left out: the "
        "first ones of all",
        default=(),
    )
    points: int = option("frequencies of the curves shown", default=100, ge=2, le=2000)
    reference: DataPath | None = data_path(
        "cited CSV table of published peaks, matched by 'controller'", default=None
    )

    reference_grid: GridSpec | None = option(
        "frequencies at which what is published was found; the largest values at these are then "
        "held against it, beside those over all frequencies",
        default=None,
    )

    @model_validator(mode="after")
    def _once(self) -> Self:
        if len(set(self.analyses)) < len(self.analyses):
            raise rule("analyses", "an analysis is listed twice")
        known = {ref.name for ref in self.needs.controllers}
        if unknown := [name for name in self.columns if name not in known]:
            raise rule("columns", f"{unknown[0]!r} is none of needs.controllers")
        if (self.columns or self.needs.beside) and not self.sensitivity_curves:
            key = "columns" if self.columns else "needs"
            raise rule(key, "it is for the figure of shares over frequency; set sensitivity_curves")
        if self.prove_below is not None and self.analyses == ("worst_case_gain",):
            raise rule("prove_below", "it is a bound of µ, which the worst-case gain has none of")
        if self.reference_grid is not None and self.reference is None:
            raise rule("reference_grid", "there is no reference")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield which analyses beside are of another kind or other outputs."""
        for place, ref in enumerate(self.needs.beside):
            other = tables.get("stage", {}).get(ref.name)
            if not isinstance(other, MuAnalysisSpec):
                continue
            for key in ("analyses", "outputs"):
                here, there = getattr(self, key), getattr(other, key)
                if set(here) != set(there):
                    yield (
                        ("needs", "beside", place),
                        f"stage {ref.name!r} has {key} = {_format_names(there)}, this one "
                        f"{_format_names(here)}: its µ is another quantity; use the same in both",
                    )


def _format_names(names: tuple[str, ...]) -> str:
    return "[" + ", ".join(f'"{name}"' for name in names) + "]"
