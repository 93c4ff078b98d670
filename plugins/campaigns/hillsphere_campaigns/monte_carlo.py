"""The stage ``monte_carlo``: many cases of another stage, drawn at random."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated
from hillsphere.cases.specs import MonteCarloSpec
from hillsphere_campaigns.campaign import Campaign
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.stopping import StopCriteria

__all__ = ["MonteCarlo"]


class MonteCarlo(Campaign):
    """Many cases with uncertain quantities drawn at random.

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
