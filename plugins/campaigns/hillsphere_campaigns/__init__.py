"""Built-in campaigns plugin: Monte Carlo, sweeps, statistics, comparison, summary, export."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "stage",
            "monte_carlo",
            "hillsphere_campaigns.monte_carlo:MonteCarlo",
            "hillsphere.cases.specs:MonteCarloSpec",
            "many cases of another stage, with what is uncertain drawn at random",
        ),
        Component(
            "stage",
            "sweep",
            "hillsphere_campaigns.sweep:Sweep",
            "hillsphere.cases.specs:SweepSpec",
            "another stage at chosen points, with many cases at each if asked",
        ),
        Component(
            "stage",
            "campaign_comparison",
            "hillsphere_campaigns.campaign_comparison.stage:CampaignComparisonStage",
            "hillsphere_campaigns.campaign_comparison.specs:CampaignComparisonSpec",
            "campaigns on the same random numbers, compared case by case",
        ),
        Component(
            "stage",
            "campaign_summary",
            "hillsphere_campaigns.campaign_summary.stage:CampaignSummaryStage",
            "hillsphere_campaigns.campaign_summary.specs:CampaignSummarySpec",
            "campaigns side by side, beside published values, with tests of their differences",
        ),
        Component(
            "command",
            "export",
            "hillsphere_campaigns.export_command:app",
            "",
            "Write the cases of a campaign to a file for other programs.",
        ),
    ]
