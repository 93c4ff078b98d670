"""Specs of the stage ``navigation_comparison``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Self

from pydantic import model_validator

from hillsphere.cases.specs import MonteCarloSpec, SweepSpec
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

__all__ = ["NavigationComparisonNeeds", "NavigationComparisonSpec"]


class NavigationComparisonNeeds(Spec):
    """Flights, the sets of a campaign, or both."""

    examples = ({"flights": ["navigation", "navigation"]}, {"campaign": "sets"})

    flights: tuple[Ref, ...] = need(
        "hillsphere_estimators.navigation.products:NavigationFlight",
        "stages 'navigation', shown in one figure",
        default=(),
        max_length=20,
    )
    campaign: Ref | None = need(
        "hillsphere.products:CaseTable",
        "a sweep of a stage 'navigation' over sets of sensors and, if need be, other keys",
        default=None,
    )


class NavigationComparisonSpec(StageSpec):
    """Sets of sensors side by side: errors, published errors, ratios and bound."""

    results = ResultNames(
        metrics=(
            "navigation_consistent_share",
            "navigation_lightest",
        ),
        tables={
            "navigation_comparison": (),
            "navigation_ratios": (),
            "navigation_flights": (),
        },
    )
    produces = "hillsphere_estimators.navigation_comparison.products:NavigationComparison"
    examples = (
        {"needs": {"flights": ["navigation", "navigation"]}, "labels": ["a", "b"]},
        {
            "needs": {"campaign": "sets"},
            "labels": ["cameras", "cameras and lidars"],
            "masses_kg": [4, 10],
            "required_position_m": 5,
        },
    )

    needs: NavigationComparisonNeeds = option("products of earlier stages")
    sets: str = option(
        "with needs.campaign: last part of the swept key whose values are compared, in the order "
        "in which they are swept",
        default="sensors",
        min_length=1,
    )
    labels: tuple[str, ...] = option(
        "name of each flight and set in tables; of flights alone left out: those of their stages",
        default=(),
    )
    paired: bool = option(
        "whether each set is tested against the one before it: ratio of their rms errors on the "
        "same draws, with an interval that claims can rest on",
        default=False,
    )
    reference: DataPath | None = data_path(
        "cited CSV table of published errors with the columns case (the label's number, counted "
        "from 1), spacecraft, position_error_m and velocity_error_mm_s",
        default=None,
    )
    confidence: float = option("confidence of all intervals", default=0.95, gt=0.5, lt=1)
    masses_kg: tuple[float, ...] = quantity(
        "mass", "mass of each set of sensors, for the choice of the lightest", default=()
    )
    required_position_m: float | None = quantity(
        "length", "largest allowed rms position error of every spacecraft",
        default=None, gt=0,
    )  # fmt: skip
    label: str = option(
        "appended to the names of tables, figures and metrics",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        campaign, flights = self.needs.campaign, len(self.needs.flights)
        if campaign is None and not flights:
            raise rule("needs", "nothing is compared; give flights, a campaign or both")
        if campaign is None and (self.masses_kg or self.reference or self.paired):
            raise rule("needs", "masses_kg, reference and paired are about a campaign; name one")
        if campaign is not None and not self.labels:
            raise rule("labels", "name each set of the campaign")
        count = flights or len(self.labels)
        for key, given in (("labels", self.labels), ("masses_kg", self.masses_kg)):
            if given and len(given) != count:
                raise rule(key, f"{len(given)} for {count} to be compared")
        if self.required_position_m is not None and not self.masses_kg:
            raise rule("required_position_m", "needs masses_kg, by which the lightest is found")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield mismatches between the sets and the campaign's sweep, if that is known."""
        if self.needs.campaign is None:
            return
        campaign = tables.get("stage", {}).get(self.needs.campaign.name)
        if isinstance(campaign, SweepSpec) and campaign.design != "list":
            swept = campaign.over
        elif isinstance(campaign, MonteCarloSpec):
            swept = {}
        else:
            return
        sets = [given for key, given in swept.items() if key.rpartition(".")[2] == self.sets]
        if len(sets) != 1:
            yield ("needs", "campaign"), self.no_sets(swept)
        elif isinstance(sets[0], tuple) and len(sets[0]) != len(self.labels):
            yield ("labels",), self.miscounted(len(sets[0]))

    def no_sets(self, swept: Iterable[str]) -> str:
        """Say that a campaign sweeps something else."""
        return (
            f"expected a sweep over one key that ends in {self.sets!r}; this one is over "
            f"{', '.join(swept) or 'nothing'}"
        )

    def miscounted(self, sets: int) -> str:
        """Say that there are not as many labels as a campaign has sets."""
        return f"{len(self.labels)} for {sets} values of {self.sets!r}; name each of them"
