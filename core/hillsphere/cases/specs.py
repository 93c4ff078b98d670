"""Specs of the stages ``monte_carlo`` and ``sweep``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, Self

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from hillsphere.spec.base import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    need,
    option,
    quantity,
    reference,
    repeated,
    rule,
)

__all__ = ["CampaignSpec", "MonteCarloSpec", "RangeSpec", "StopSpec", "SweepNeeds", "SweepSpec"]


class StopSpec(Spec):
    """When a campaign ends before all its cases are done.

    The rules look at the cases in order, block by block, so that the cut is the same for any number
    of workers.
    """

    examples = ({"failure_half_width": 0.01}, {"failures_above": 0.2, "least_cases": 128})

    failure_half_width: float | None = option(
        "end when the confidence interval of the failure ratio reaches no farther to either side",
        default=None,
        gt=0,
        lt=0.5,
    )
    mean_half_widths: dict[str, float] = option(
        "end when the intervals of these metrics' means are as narrow as this, in their units",
        default={},
        gt=0,
    )
    failures_above: float | None = option(
        "end when the failure ratio is surely above this", default=None, ge=0, lt=1
    )
    least_cases: int = option(
        "least number of cases before the campaign may end", default=256, ge=2
    )

    @model_validator(mode="after")
    def _something(self) -> Self:
        if not (self.failure_half_width or self.mean_half_widths) and self.failures_above is None:
            text = "nothing ends it; give failure_half_width, mean_half_widths or failures_above"
            raise PydanticCustomError("rule", "{text}", {"text": text})
        return self


_RESULTS = ResultNames(
    metrics=(
        "campaign_cases",
        "campaign_failures",
        "campaign_undecided",
        "campaign_not_computed",
        "campaign_failure_ratio",
        "campaign_failure_ratio_low",
        "campaign_failure_ratio_high",
        "campaign_failure_ratio_least",
        "campaign_failure_ratio_most",
        "campaign_*",
    ),
    tables={
        "campaign_classes": (),
        "campaign_failed": (),
        "campaign_undecided": (),
        "campaign_statistics": (),
        "campaign_extremes": (),
        "campaign_correlations": (),
        "campaign_sobol": (),
        "sweep_failures": (),
        "sweep_statistics": (),
    },
)
"""What a campaign presents; means and quantiles are named after the metrics of its cases."""


class CampaignSpec(StageSpec):
    """Parameters that all campaigns share."""

    produces: ClassVar[str] = "hillsphere.products:CaseTable"

    repeat: Ref = repeated("stage that is repeated, one case after the other")
    dispersions: tuple[Ref, ...] = reference(
        "dispersions", "what differs at random from case to case", default=()
    )
    draws_as: str = option(
        "name of the random numbers: campaigns of the same name see the same ones, so that they "
        "can be compared case by case; left out: the stage's own name",
        default="",
        max_length=64,
    )
    confidence: float = option("confidence level of all intervals", default=0.95, gt=0.5, lt=1)
    quantiles: tuple[float, ...] = option(
        "quantiles of the metrics that are shown, and those of bands",
        default=(0.05, 0.5, 0.95),
        gt=0,
        lt=1,
    )
    show: tuple[str, ...] = option(
        "metrics that tables and figures show, by name or pattern ('*' is any characters); left "
        "out: all; what is stored and exported has all metrics in any case",
        default=(),
    )
    block_limit_s: float | None = quantity(
        "time",
        "wall-clock time for a block of 64 cases, after which its worker is stopped; the case that "
        "takes too long is undecided; left out: no limit",
        default=None,
        gt=0,
    )

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        names = [ref.name for ref in self.dispersions if ref.target is None]
        if len(set(names)) < len(names):
            raise rule("dispersions", "a name is listed twice")
        return self


class MonteCarloSpec(CampaignSpec):
    """Many cases with what is uncertain drawn at random."""

    results = _RESULTS
    examples = (
        {"repeat": "hover", "dispersions": ["field"], "cases": 128},
        {"repeat": "hover", "dispersions": ["field"], "cases": 64, "design": "latin_hypercube"},
        {"repeat": "hover", "cases": 64, "bands": ["x", "u.*"], "show": ["dv*"]},
    )

    cases: int = option(
        "number of cases; for 'sobol_indices' that of each of its k + 2 samples, k being the "
        "number of quantities that differ",
        ge=1,
        le=10_000_000,
    )
    design: Literal["random", "latin_hypercube", "sobol", "sobol_indices"] = option(
        "how the cases are chosen: 'random'; 'latin_hypercube' and 'sobol' (scrambled) fill the"
        " space more evenly, best with a power of two; 'sobol_indices' is made for variance-"
        "based sensitivities",
        default="random",
    )
    stop: StopSpec | None = option("when the campaign ends early; left out: never", default=None)
    bands: tuple[str, ...] = option(
        "quantities whose histories are kept and made into quantiles over time, by name or "
        "pattern ('*' is any characters); left out: none",
        default=(),
    )

    @model_validator(mode="after")
    def _something_differs(self) -> Self:
        if self.design != "random" and not self.dispersions:
            raise rule("dispersions", f"nothing differs: {self.design!r} needs dispersions")
        if self.design != "random" and self.stop is not None:
            raise rule("stop", f"a {self.design!r} design cannot be cut short; use 'random'")
        if self.bands and not self.quantiles:
            raise rule("quantiles", "bands need at least one quantile")
        return self


class RangeSpec(Spec):
    """Values from one end to the other."""

    examples = ({"first": 10, "last": 100, "points": 4, "spacing": "log"},)

    first: float = option("value at one end")
    last: float = option("value at the other end")
    points: int | None = option(
        "number of values, for 'grid'; the other designs choose their own", default=None, ge=2
    )
    spacing: Literal["linear", "log"] = option("how the values are spaced", default="linear")

    @model_validator(mode="after")
    def _ends(self) -> Self:
        if self.first == self.last:
            raise rule("last", "must differ from first")
        if self.spacing == "log" and not self.first * self.last > 0:
            raise rule("spacing", "'log' needs two ends of the same sign, neither zero")
        return self


class SweepNeeds(Spec):
    """Products of earlier stages that a sweep takes."""

    examples: ClassVar[tuple[dict[str, Any], ...]] = ({},)

    rows: Ref | None = need(
        "hillsphere.products:CaseList", "for 'list': the points, one per row", default=None
    )
    behind: Ref | None = need(
        "hillsphere.products:CaseTable",
        "with lines: a campaign of the same flight, along the same reference by the same plant, "
        "whose bands are drawn behind them",
        default=None,
    )


class SweepSpec(CampaignSpec):
    """A stage at chosen points, and at each of them many cases if something differs at random.

    What is swept is named by table and key, ``"stage.hover.period_s"``, ``"gravity.phobos.C2,0"``,
    ``"dispersions.field.scale"``: whatever the stage can take case by case, and any other key of
    the mission that it depends on. ``"repeat.period_s"`` is a key of the stage that is repeated.
    """

    results = _RESULTS
    examples = (
        {"repeat": "hover", "over": {"stage.hover.samples": [10, 20]}},
        {
            "repeat": "hover",
            "over": {"dispersions.field.scale": {"first": 1, "last": 4, "points": 3}},
            "dispersions": ["field"],
            "repetitions": 64,
        },
    )

    needs: SweepNeeds = option("products of earlier stages", default=SweepNeeds())
    over: dict[str, tuple[Any, ...] | RangeSpec] = option(
        'what is swept: "kind.table.key", or "repeat.key" of the repeated stage = list of values, '
        "or first, last, points and spacing",
        default={},
    )
    design: Literal["grid", "latin_hypercube", "sobol", "list"] = option(
        "'grid': every combination; 'latin_hypercube' and 'sobol': so many points between the "
        "ends; 'list': the rows of a file or of an earlier stage, each at every combination of "
        "what is swept besides",
        default="grid",
    )
    points: int | None = option(
        "number of points, for 'latin_hypercube' and 'sobol'", default=None, ge=1, le=10_000_000
    )
    rows: DataPath | None = data_path(
        "for 'list': a CSV file, its header the swept names, one point per row", default=None
    )
    repetitions: int = option(
        "cases at each point, with the same random numbers at every point", default=1, ge=1
    )
    lines: tuple[str, ...] = option(
        "quantities whose histories are kept and drawn as a line for each case, by name or "
        "pattern ('*' is any characters), of at most 1000 cases; left out: none",
        default=(),
    )
    threshold: float | None = option(
        "failure ratio: where along the last swept number it is first exceeded is shown, for each "
        "combination of the others",
        default=None, ge=0, lt=1,
    )  # fmt: skip

    @model_validator(mode="after")
    def _fits_the_design(self) -> Self:
        is_list = self.design == "list"
        if self.needs.behind is not None and not self.lines:
            raise rule("needs", "behind: there are no lines; name their quantities")
        if is_list != bool(self.rows or self.needs.rows) or (self.rows and self.needs.rows):
            raise rule("rows", "'list' takes either rows or needs.rows, the other designs neither")
        if not (is_list or self.over):
            raise rule("over", "names what is swept; only the rows of a 'list' do so by themselves")
        if (self.points is not None) != (self.design in ("latin_hypercube", "sobol")):
            raise rule("points", "is for 'latin_hypercube' and 'sobol', which need it")
        combined = self.design in ("grid", "list")
        for name, values in self.over.items():
            if not isinstance(values, RangeSpec):
                if not values or not combined:
                    raise rule(
                        "over",
                        f"{name}: {self.design!r} needs "
                        + ("at least one value" if not values else "first and last"),
                    )
            elif combined and values.points is None:
                raise rule("over", f"{name}: a grid needs the number of points")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the reasons why `needs.behind` is not a campaign of the same flight."""
        behind, stages = self.needs.behind, tables.get("stage", {})
        other = None if behind is None else stages.get(behind.name)
        if behind is not None and isinstance(other, CampaignSpec):
            for message in self._not_behind(behind.name, other, stages):
                yield ("needs", "behind"), message

    def _not_behind(
        self, name: str, other: CampaignSpec, stages: Mapping[str, Spec]
    ) -> Iterator[str]:
        """Yield the errors of `needs.behind` naming this campaign."""
        if isinstance(other, SweepSpec):
            yield f"stage {name!r} is a sweep, which has no bands; name a monte_carlo that has some"
        elif isinstance(other, MonteCarloSpec) and not other.bands:
            yield f'stage {name!r} keeps no bands; give it bands = ["…"], or name one that does'
        flights = [spec.repeat.name for spec in (self, other)]
        own, theirs = (stages.get(flight) for flight in flights)
        if not isinstance(own, StageSpec) or not isinstance(theirs, StageSpec):
            return
        if type(own) is not type(theirs):
            yield (
                f"stage {name!r} repeats {flights[1]!r}, a stage of another type than "
                f"{flights[0]!r}; name a campaign of the same flight"
            )
            return
        for key in own.course:
            there = _value(theirs, key)
            for here in self._taken(key, flights[0], _value(own, key)):
                if here != there:
                    yield (
                        f"stage {name!r} is of another flight: {key} is "
                        f"{_format_setting(there)} in its stage {flights[1]!r}, but "
                        f"{_format_setting(here)} in {flights[0]!r} here; name a campaign that "
                        f"repeats {flights[0]!r}, or give both the same {key}"
                    )
                    break

    def _taken(self, key: str, flight: str, own: Any) -> tuple[Any, ...]:
        """Return the values that a key of the repeated stage takes: its own, or what is swept."""
        for swept in (f"repeat.{key}", f"stage.{flight}.{key}"):
            if (values := self.over.get(swept)) is not None:
                return (values,) if isinstance(values, RangeSpec) else values
        return (own,)


def _value(spec: Spec, key: str) -> Any:
    """Return the value at a dotted key, a reference as its name; None if there is no such key."""
    found: Any = spec
    for part in key.split("."):
        found = getattr(found, part, None)
    return found.name if isinstance(found, Ref) else found


def _format_setting(value: Any) -> str:
    if isinstance(value, RangeSpec):
        return "swept"
    return "left out" if value is None or value == "" else repr(value)
