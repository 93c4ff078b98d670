"""The stages ``monte_carlo`` and ``sweep``: many cases of another stage."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from hillsphere.base.arrays import Integers
from hillsphere.base.matching import match_names
from hillsphere.cases.case_classes import ended
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated, RepeatedWork
from hillsphere.cases.specs import CampaignSpec, MonteCarloSpec, RangeSpec, SweepSpec
from hillsphere.cases.swept import Swept
from hillsphere.errors import InputError
from hillsphere.interfaces.cases import Histories
from hillsphere.interfaces.stages import Context
from hillsphere.presentation import Presentation
from hillsphere.products import CaseList, CaseTable
from hillsphere_campaigns.bands import Parts, bands_of, lines_of
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.case_table import table_of
from hillsphere_campaigns.crossings import crossing_table
from hillsphere_campaigns.engine import run_campaign
from hillsphere_campaigns.line_figures import MOST_LINES, line_figure
from hillsphere_campaigns.presentation import present_campaign
from hillsphere_campaigns.sensitivity import independent_cases
from hillsphere_campaigns.stopping import StopCriteria
from hillsphere_campaigns.sweep_points import case_list, crossed, grid, listed, sampled

__all__ = ["Campaign", "MonteCarlo", "Sweep"]


_NO_BANDS = "needs.behind: this campaign has no bands; let it keep some"


class Campaign(ABC):
    """What the campaigns share; see `hillsphere_campaigns.engine`.

    Parameters
    ----------
    spec : CampaignSpec
        With its references bound, but for the stage that is repeated.

    Attributes
    ----------
    foreseen : Plan or None
        The cases as `check` has planned them without any product; None before, and where that
        cannot be done.
    """

    def __init__(self, spec: CampaignSpec) -> None:
        self.spec: Any = spec
        self.foreseen: Plan | None = None

    @abstractmethod
    def plan(self, repeated: Repeated, **needs: Any) -> Plan:
        """Return the cases.

        Parameters
        ----------
        repeated : Repeated
            The stage, of which nothing is run.
        **needs
            Products, as for `run`.
        """

    def check(self, repeated: Repeated) -> None:
        """Raise `InputError` if the campaign cannot be planned, before anything runs."""
        self.foreseen = self.plan(repeated)

    def run(self, ctx: Context, *, repeat: Repeated, **needs: Any) -> CaseTable:
        """Compute the cases, and take up what an interrupted run has left.

        Parameters
        ----------
        ctx : Context
            Gives executor, workspace and progress.
        repeat : Repeated
            The stage with its products.
        **needs
            Products of earlier stages.

        Returns
        -------
        CaseTable
            Every case, whatever became of it.

        Raises
        ------
        InputError
            If the stage has no metric that `show` names.
        StageError
            If the stage keeps no history that bands name, the cases were not sampled at the same
            times, or the campaign cannot go on, see `hillsphere_campaigns.engine`.
        """
        self.foreseen = None  # it would stay in memory beside the plan with products
        warnings = repeat.warnings()
        repeat = replace(repeat, nominal=None)  # workers need no product of it
        plan = self.plan(repeat, **needs)
        failed = 0

        def count(failures: int) -> None:
            nonlocal failed
            failed = failures

        def check(metrics: Sequence[str]) -> None:
            match_names(self.spec.show, metrics, f"show: stage {repeat.stage!r}", "metric")

        advance = ctx.track("cases", plan.cases, note=lambda: f"{failed} failed" if failed else "")
        checkpoints = Checkpoints(ctx.workspace(), ctx.fingerprint, ctx.info)
        outcomes, stopped = run_campaign(
            plan,
            RepeatedWork(plan.variants, self.bands()),
            executor=ctx.executor,
            checkpoints=checkpoints,
            limit_s=self.spec.block_limit_s,
            stop=self.stop(),
            advance=advance,
            on_failures=count,
            on_metrics=check,
        )
        for note in plan.notes:
            ctx.info(note)
        table = replace(table_of(plan, outcomes, repeat.stage, stopped), warnings=warnings)
        if not self.bands():
            return table

        def parts() -> Iterator[tuple[Integers, Histories]]:
            for part in checkpoints.histories():
                advance(0)
                yield part

        return self.with_histories(table, parts)

    def with_histories(self, table: CaseTable, parts: Parts) -> CaseTable:
        """Return the table with what is made of the histories that were kept."""
        kept = table.case[ended(table) & independent_cases(table)]
        return replace(table, bands=bands_of(parts, kept, self.spec.quantiles))

    def present(self, product: CaseTable, **needs: Any) -> Presentation:
        """Return statistics, failures, sensitivities and figures."""
        return present_campaign(
            product,
            levels=self.spec.quantiles,
            level=self.spec.confidence,
            show=self.spec.show,
        )

    def _names(self) -> tuple[str, ...]:
        return tuple(ref.name for ref in self.spec.dispersions)

    def stop(self) -> Callable[..., str] | None:
        """Return the rule by which it ends early, if there is one; see `engine.StopRule`."""
        return None

    def bands(self) -> tuple[str, ...]:
        """Return the quantities whose histories are kept, by name or pattern."""
        return ()


class MonteCarlo(Campaign):
    """Many cases with what is uncertain drawn at random.

    Parameters
    ----------
    spec : MonteCarloSpec
        With its references bound.
    """

    spec: MonteCarloSpec

    def plan(self, repeated: Repeated, **needs: Any) -> Plan:
        """Return the cases; see `Campaign.plan`."""
        return plan_of(
            repeated,
            self._names(),
            cases=self.spec.cases,
            design=self.spec.design,
            stream=self.spec.draws_as or repeated.by,
        )

    def stop(self) -> Callable[..., str] | None:
        """Return the rule by which it ends early; see `Campaign.stop`."""
        given = self.spec.stop
        if given is None:
            return None
        return StopCriteria(
            failure_half_width=given.failure_half_width,
            mean_half_widths=given.mean_half_widths,
            failures_above=given.failures_above,
            least_cases=given.least_cases,
            level=self.spec.confidence,
        ).rule()

    def bands(self) -> tuple[str, ...]:
        """Return the quantities whose quantiles over time are wanted; see `Campaign.bands`."""
        return self.spec.bands


class Sweep(Campaign):
    """A stage at chosen points, and at each of them cases with what is uncertain drawn at random.

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
        """Return what `Campaign.present` does, and where failures exceed the threshold."""
        shown = super().present(product, **needs)
        if product.lines is not None:
            behind: CaseTable | None = needs.get("behind")
            bands = None if behind is None else behind.bands
            if behind is not None and bands is None:
                raise InputError(_NO_BANDS)
            figure = line_figure(product, product.lines, bands)
            shown = replace(shown, figures={"sweep_lines": figure, **shown.figures})
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
            return crossed(listed(rows), grid(spec.over)) if spec.over else listed(rows)
        if spec.design not in ("latin_hypercube", "sobol"):
            return grid(spec.over)
        ranges = {name: v for name, v in spec.over.items() if isinstance(v, RangeSpec)}
        return sampled(ranges, spec.design, spec.points or 1, seed=seed, stream=stream)
