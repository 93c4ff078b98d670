"""The stage ``sweep``: another stage at chosen points, with many cases at each if asked."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated
from hillsphere.cases.specs import RangeSpec, SweepSpec
from hillsphere.cases.swept import Swept
from hillsphere.errors import InputError
from hillsphere.presentation import Presentation
from hillsphere.products import CaseList, CaseTable
from hillsphere_campaigns.bands import Parts, lines_of
from hillsphere_campaigns.campaign import Campaign
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.crossings import crossing_table
from hillsphere_campaigns.line_figures import MOST_LINES, line_chart
from hillsphere_campaigns.sweep_points import (
    case_list,
    cross_points,
    grid,
    points_of_list,
    sample_ranges,
)

__all__ = ["Sweep"]

_NO_BANDS = "needs.behind: this campaign has no bands; let it keep some"


class Sweep(Campaign):
    """Parameter sweep of a stage, with a Monte Carlo sample at each point if wanted.

    Parameters
    ----------
    spec : SweepSpec
        With its references bound.
    """

    spec: SweepSpec

    def check(self, repeated: Repeated) -> None:
        """Raise `InputError` if the campaign cannot be planned, as far as this can be seen yet."""
        if self.spec.needs.rows is None:
            super().check(repeated)

    def plan(
        self,
        repeated: Repeated,
        *,
        rows: CaseList | None = None,
        behind: CaseTable | None = None,
        **needs: Any,
    ) -> Plan:
        """Return the cases; see `Campaign.plan`."""
        if behind is not None and behind.bands is None:
            raise InputError(_NO_BANDS)
        stream = self.spec.draws_as or repeated.by
        made = plan_of(
            repeated,
            self._names(),
            cases=self.spec.repetitions,
            swept=self._swept(repeated.mission.seed, stream, rows),
            stream=stream,
        )
        if self.spec.lines and made.cases > MOST_LINES:
            raise InputError(
                f"lines: {made.cases} cases, of which no figure can tell the lines; at most "
                f"{MOST_LINES}"
            )
        return made

    def bands(self) -> tuple[str, ...]:
        """Return the quantities whose histories are kept; see `Campaign.bands`."""
        return self.spec.lines

    def with_histories(self, table: CaseTable, parts: Parts) -> CaseTable:
        """Return the table with its lines; see `Campaign.with_histories`."""
        return replace(table, lines=lines_of(parts, table.case))

    def present(self, product: CaseTable, **needs: Any) -> Presentation:
        """Return the report of `Campaign.present`, with the crossings of the threshold."""
        shown = super().present(product, **needs)
        if product.lines is not None:
            behind: CaseTable | None = needs.get("behind")
            bands = None if behind is None else behind.bands
            if behind is not None and bands is None:
                raise InputError(_NO_BANDS)
            chart = line_chart(product, product.lines, bands)
            shown = replace(shown, figures={"sweep_lines": chart, **shown.figures})
        if self.spec.threshold is None:
            return shown
        # One case of drawn ones, or the first of some that were not flown, is one of many.
        chosen = not self.spec.dispersions and self.spec.repetitions == 1
        found = crossing_table(product, self.spec.threshold, self.spec.confidence, chosen=chosen)
        return (
            shown
            if found is None
            else replace(shown, tables={"sweep_crossings": found, **shown.tables})
        )

    def _swept(self, seed: int, stream: str, rows: CaseList | None) -> Swept:
        spec = self.spec
        if spec.rows is not None:
            rows = case_list(spec.rows)
        if rows is not None:
            points = points_of_list(rows)
            return cross_points(points, grid(spec.over)) if spec.over else points
        if spec.design not in ("latin_hypercube", "sobol"):
            return grid(spec.over)
        ranges = {name: v for name, v in spec.over.items() if isinstance(v, RangeSpec)}
        return sample_ranges(ranges, spec.design, spec.points or 1, seed=seed, stream=stream)
