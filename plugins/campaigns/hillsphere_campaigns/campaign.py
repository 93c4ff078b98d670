"""The base of the stages ``monte_carlo`` and ``sweep``: many cases of another stage."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from hillsphere.base.arrays import Integers
from hillsphere.base.matching import match_names
from hillsphere.cases.case_classes import has_ended
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated, RepeatedWork
from hillsphere.cases.specs import CampaignSpec
from hillsphere.cases.stored_blocks import MOST_IN_MEMORY, BlockFiles, StoredBlocks
from hillsphere.interfaces.cases import Histories
from hillsphere.interfaces.stages import Context
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere_campaigns.bands import Parts, bands_of
from hillsphere_campaigns.case_table import table_of
from hillsphere_campaigns.engine import run_campaign
from hillsphere_campaigns.presentation import present_campaign
from hillsphere_campaigns.sensitivity import independent_cases

__all__ = ["Campaign"]


class Campaign(ABC):
    """Base of the campaigns: plan, run, product and report; see `hillsphere_campaigns.engine`.

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
        """Compute the cases; blocks that an interrupted run has finished are not computed again.

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
            All cases, with the failed and the undecided ones.

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
        files = stored = None
        if plan.cases > MOST_IN_MEMORY:
            files = BlockFiles(ctx.workspace().absolute(), ctx.fingerprint, plan)
            stored = StoredBlocks(files, ctx.info, by_workers=not self.bands())
        outcomes, stopped = run_campaign(
            plan,
            RepeatedWork(plan.variants, self.bands(), files),
            executor=ctx.executor,
            checkpoints=checkpoints,
            stored=stored,
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
        """Return the table with quantiles of the histories over the cases."""
        kept = table.case[has_ended(table) & independent_cases(table)]
        return replace(table, bands=bands_of(parts, kept, self.spec.quantiles))

    def present(self, product: CaseTable, **needs: Any) -> Presentation:
        """Return statistics, failures, sensitivities and figures of the campaign."""
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
