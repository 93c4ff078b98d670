"""The stage ``tracking_comparison``: comparison of trackers over the outages of many cases."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.base.problems import did_you_mean
from hillsphere.cases.specs import CampaignSpec, MonteCarloSpec, SweepSpec
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere.show.reference import ReferenceTable
from hillsphere_tracking.assisted_tracking.measures import MEASURES
from hillsphere_tracking.assisted_tracking.products import AssistedTracking
from hillsphere_tracking.tracking_comparison.age_statistics import age_comparison, no_sweep
from hillsphere_tracking.tracking_comparison.consistency_statistics import nees_consistency
from hillsphere_tracking.tracking_comparison.presentation import present_tracking
from hillsphere_tracking.tracking_comparison.products import COVERED, FRAMES, TrackingComparison
from hillsphere_tracking.tracking_comparison.specs import TrackingComparisonSpec
from hillsphere_tracking.tracking_comparison.statistics import (
    Outages,
    beyond_covariance,
    bootstrap_means,
    lock_share,
    medians,
    outages_of,
    reacquisitions,
)

__all__ = ["TrackingComparisonStage"]

_REQUIRED = ("pass", "outage", "error_max_deg")


class TrackingComparisonStage:
    """Comparison of trackers over a campaign of assisted tracking.

    Parameters
    ----------
    spec : TrackingComparisonSpec
        Spec of the stage, its references bound.

    Raises
    ------
    InputError
        If the published values cannot be read, or lack a column.
    """

    def __init__(self, spec: TrackingComparisonSpec) -> None:
        self.spec = spec
        self.reference = ReferenceTable.read(spec.reference) if spec.reference else None
        if self.reference is not None:
            missing = [name for name in _REQUIRED if name not in self.reference.columns]
            if missing:
                raise InputError(
                    f"reference {spec.reference}: no column {missing[0]!r}; it has "
                    f"{', '.join(self.reference.columns)}"
                )

    def check_needs(self, tracking: object, campaign: object, **others: object) -> None:
        """Refuse a baseline that is not among the trackers, and a campaign of another kind."""
        of = getattr(campaign, "spec", None)
        if isinstance(of, CampaignSpec):
            self._check_campaign(of.repeat.name, swept=isinstance(of, SweepSpec))
        if isinstance(getattr(others.get("ages"), "spec", None), MonteCarloSpec):
            assert self.spec.needs.ages is not None
            raise InputError(f"needs.ages: {no_sweep(self.spec.needs.ages.name)}")
        if trackers := getattr(tracking, "trackers", None):  # as `AssistedTrackingStage` has them
            self._check_baseline(tuple(trackers))

    def run(
        self,
        ctx: Context,
        tracking: AssistedTracking,
        campaign: CaseTable,
        ages: CaseTable | None = None,
        consistency: CaseTable | None = None,
    ) -> TrackingComparison:
        """Compare the trackers.

        Parameters
        ----------
        ctx : Context
            Provides the random numbers of the bootstrap.
        tracking : AssistedTracking
            One case of the repeated stage.
        campaign : CaseTable
            Cases of the repeated stage.
        ages : CaseTable, optional
            Sweep of a stage of assisted tracking.
        consistency : CaseTable, optional
            Cases of a stage whose true errors are the assumed errors of a tracker.

        Returns
        -------
        TrackingComparison
            The comparison.

        Raises
        ------
        InputError
            If a campaign is of the wrong kind, or the baseline does not exist.
        """
        outages = self._sort_outages(tracking, campaign)
        needs, spec = self.spec.needs, self.spec
        shape = (len(MEASURES), len(outages.trackers), len(outages.keys))
        quantiles, count = np.full((3, *shape), np.nan), np.zeros(shape, dtype=np.int64)
        pooled = np.full((3, *shape[:2]), np.nan)
        for m, values in ((m, outages.values.get(name)) for m, name in enumerate(MEASURES)):
            if values is not None:
                quantiles[:, m], count[m] = medians(values), np.sum(np.isfinite(values), axis=-1)
                pooled[:, m] = medians(values.reshape(values.shape[0], -1))
        middle = quantiles[1, [list(MEASURES).index(name) for name in FRAMES]]
        mean = np.mean(middle, axis=-1)
        first, f = outages.trackers.index(spec.baseline), FRAMES.index(spec.measure)
        keys = [(tracking.passes[p], name) for p, name in
                zip(tracking.outage_pass, tracking.outage_names, strict=True)]  # fmt: skip
        order = [keys.index(key) for key in outages.keys]
        loss = tracking.outage_s[order]
        drawn = self._bootstrap(outages, ctx)
        tail = 0.5 * (1.0 - spec.confidence)
        between = (tail, 1.0 - tail)
        shares, times = reacquisitions(outages, outages.ended)
        limit, uncovered = beyond_covariance(outages, COVERED)
        rng = ctx.rng("bootstrap of ages and consistency")
        return TrackingComparison(
            satellite=tracking.satellite,
            stage=campaign.stage,
            baseline=spec.baseline,
            measure=spec.measure,
            level=spec.confidence,
            lock_angle_rad=tracking.lock_angle_rad,
            cases=int(campaign.case.size),
            ended=int(np.count_nonzero(outages.ended)),
            passes=tuple(key[0] for key in outages.keys),
            outages=tuple(key[1] for key in outages.keys),
            loss_s=loss,
            prediction_s=tracking.duration_s[tracking.outage_pass[order]] - loss,
            trackers=outages.trackers,
            measures=tuple(MEASURES),
            units=tuple(MEASURES.values()),
            quantiles=quantiles,
            count=count,
            locked=lock_share(outages, tracking.lock_angle_rad),
            pooled=pooled,
            mean_median_rad=mean,
            mean_interval_rad=medians(drawn, between),
            worst_median_rad=np.max(middle, axis=-1),
            ratio=mean[f] / mean[f, first],
            ratio_interval=medians(drawn[f] / drawn[f, first], between),
            reacquired=shares,
            reacquire_s=times,
            nees_limit=limit,
            uncovered=uncovered,
            station_error_m=float(np.max(tracking.station_error_m)),
            ages=None
            if ages is None or needs.ages is None
            else age_comparison(
                ages, needs.ages.name, spec.measure, spec.baseline, spec.resamples,
                spec.confidence, rng,
            ),
            consistency=None
            if consistency is None or needs.consistency is None
            else nees_consistency(
                consistency, needs.consistency.name, spec.consistent, spec.measure,
                spec.resamples, spec.confidence, rng,
            ),
        )  # fmt: skip

    def _bootstrap(self, outages: Outages, ctx: Context) -> Array:
        """Return the bootstrap means (3, T, R) of the medians, for each of `FRAMES`."""
        means = np.full((len(FRAMES), len(outages.trackers), self.spec.resamples), np.nan)
        for f, frame in enumerate(FRAMES):
            if frame in outages.values:
                # a new generator with the same seed: the same cases for each error
                rng = ctx.rng("bootstrap")
                ended = outages.values[frame][:, :, outages.ended]
                means[f] = bootstrap_means(ended, self.spec.resamples, rng)
        return means

    def present(
        self,
        product: TrackingComparison,
        tracking: AssistedTracking,
        campaign: CaseTable,
        ages: CaseTable | None = None,
        consistency: CaseTable | None = None,
    ) -> Presentation:
        """Present the comparison."""
        return present_tracking(product, self.reference, campaign.bands)

    def _sort_outages(self, tracking: AssistedTracking, campaign: CaseTable) -> Outages:
        """Check that a campaign repeats the stage, and sort its metrics by outage."""
        needs, name = self.spec.needs, self.spec.needs.campaign.name
        self._check_campaign(campaign.stage, swept=bool(campaign.swept))
        outages = outages_of(campaign, name)
        keys = {(tracking.passes[p], o) for p, o in
                zip(tracking.outage_pass, tracking.outage_names, strict=True)}  # fmt: skip
        if set(outages.keys) != keys or set(outages.trackers) != set(tracking.trackers):
            raise InputError(
                f"campaign {name!r} has other outages or trackers than stage "
                f"{needs.tracking.name!r}; run both anew"
            )
        self._check_baseline(outages.trackers)
        return outages

    def _check_campaign(self, repeated: str, *, swept: bool) -> None:
        needs, name = self.spec.needs, self.spec.needs.campaign.name
        if repeated != needs.tracking.name:
            raise InputError(
                f"needs.campaign: campaign {name!r} repeats stage {repeated!r}, but needs.tracking "
                f"is {needs.tracking.name!r}; name the stage that it repeats"
            )
        if swept:
            raise InputError(
                f"needs.campaign: campaign {name!r} is a sweep; needs.campaign takes one by "
                "monte_carlo, needs.ages a sweep"
            )

    def _check_baseline(self, trackers: Sequence[str]) -> None:
        if self.spec.baseline not in trackers:
            hint = did_you_mean(self.spec.baseline, trackers, otherwise="there are")
            raise InputError(f"baseline: no tracker {self.spec.baseline!r} is compared{hint}")
