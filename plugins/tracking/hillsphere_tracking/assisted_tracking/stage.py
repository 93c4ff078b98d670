"""The stage ``assisted_tracking``: passes with a loss of signal, N cases at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hillsphere.base.orientation import doubts
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context, Parameter, Plant, Tracker
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults, Histories, histories_to_keep
from hillsphere.model.earth.planet import Planet, StationedPlanet
from hillsphere.model.earth.specs import PlanetSpec
from hillsphere.presentation import Presentation
from hillsphere_tracking.assisted_tracking.following import (
    ERRORS,
    SPREAD,
    AntennaRecord,
    FollowedPass,
    TrackerOutcome,
    follow,
)
from hillsphere_tracking.assisted_tracking.measures import MEASURES, MetricName, outage_name
from hillsphere_tracking.assisted_tracking.nominal_orbits import (
    NominalOrbits,
    error_inputs,
    nominal_orbits,
)
from hillsphere_tracking.assisted_tracking.presentation import present_case
from hillsphere_tracking.assisted_tracking.products import AssistedTracking
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec
from hillsphere_tracking.assisted_tracking.truth import PassTruth, check_passes, fly_passes
from hillsphere_tracking.mean_elements import EARTH_FIELD
from hillsphere_tracking.orbits import Orbit
from hillsphere_tracking.passes.sources import orbits_from
from hillsphere_tracking.recording import draw_constants, record

__all__ = ["AssistedTrackingStage"]

_STREAM = "assisted_tracking"
_GIVEN = "(given)"


@dataclass(frozen=True, eq=False)
class _Block:
    """Results of a block of cases: for each pass its measurements and each tracker's outcome."""

    seen: list[AntennaRecord]
    followed: list[list[TrackerOutcome]]


class AssistedTrackingStage:
    """Passes in which trackers use measurements of an antenna, and predict after a loss of signal.

    Each tracker processes the measurements of a pass once. At each loss of signal its current state
    predicts the rest of the pass.

    Parameters
    ----------
    spec : AssistedTrackingSpec
        Spec of the stage, its references bound; the satellite's file is read.

    Raises
    ------
    InputError
        If the satellite or the body cannot be used.
    """

    def __init__(self, spec: AssistedTrackingSpec) -> None:
        self.spec = spec
        body = Planet(PlanetSpec()) if spec.body is None else spec.body.get()
        if not isinstance(body, StationedPlanet):
            raise InputError(
                f"body: tracking needs a body of type 'planet', got {type(body).__name__}; leave "
                "it out for the Earth"
            )
        self.orientation = body.orientation
        orbits = orbits_from([spec.satellite], self.orientation)
        if len(orbits) != 1:
            raise InputError(
                f"satellite: one is tracked, the file has {len(orbits)}; give its name"
            )
        self.orbit: Orbit = orbits[0]
        orbit = self.orbit
        self.field = getattr(orbit, "field", EARTH_FIELD)
        self.plant: Plant | None = None if spec.plant is None else spec.plant.get()
        check_passes(spec.passes, self.plant)
        self.trackers: dict[str, Tracker[Any]] = {}
        for number, ref in enumerate(spec.trackers, start=1):
            name = ref.name if ref.name != _GIVEN else f"tracker{number}"
            self.trackers[name] = ref.get()
        self._truths: tuple[PassTruth, ...] | None = None

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return the sizes of the nominal orbit's errors."""
        return error_inputs(self.spec.nominal_error)

    def prepare_cases(self, names: Sequence[str]) -> None:
        """Fly the satellite and find its passes, once for all cases."""
        self._passes(_ignore_progress)

    def run(self, ctx: Context) -> AssistedTracking:
        """Run the single case of draw 0.

        Parameters
        ----------
        ctx : Context
            Provides the seed and reports the progress.

        Returns
        -------
        AssistedTracking
            The case, with all histories.
        """
        advance = ctx.track("tracking", len(self.spec.passes) * (1 + len(self.trackers)))
        passes = self._passes(advance)
        # One lane of 64 as in a campaign: vectorised operations then give the same bits there.
        lanes = np.zeros(LANES, dtype=np.int64)
        filler = np.arange(LANES) > 0
        batch = CaseBatch(lanes, lanes, filler, (), np.zeros((0, LANES)), ctx.seed, _STREAM)
        block = self._follow_cases(passes, batch, self._all_histories(), advance, history_cases=1)
        return self._product(passes, block, self._results(passes, block))

    def run_cases(self, batch: CaseBatch, history: bool | Sequence[str] = False) -> CaseResults:
        """Run a block of cases.

        Parameters
        ----------
        batch : CaseBatch
            Inputs by the names of `case_inputs`; its draws determine all random numbers.
        history : bool or sequence of str
            Keep all histories of errors, or names and patterns of the histories to keep.

        Returns
        -------
        CaseResults
            Metrics as in `hillsphere_tracking.assisted_tracking.measures`; histories over the time
            since each pass's acquisition, named ``PASS.OUTAGE.TRACKER.error`` …

        Raises
        ------
        InputError
            If the batch has an unknown input.
        """
        known = [q.name for q in self.case_inputs()]
        if unknown := [name for name in batch.names if name not in known]:
            raise InputError(
                f"assisted_tracking has no input {', '.join(unknown)}; it has {', '.join(known)}"
            )
        passes = self._passes(_ignore_progress)
        names = histories_to_keep(history, self._history_names())
        keep: dict[tuple[str, str], set[str]] = {}
        for q in map(MetricName.parse, names):
            assert q is not None
            keep.setdefault((q.pass_, q.tracker), set()).add(q.measure)
        block = self._follow_cases(passes, batch, keep, _ignore_progress)
        results = self._results(passes, block)
        return (
            replace(results, histories=self._histories(passes, block, names))
            if history
            else results
        )

    def present(self, product: AssistedTracking) -> Presentation:
        """Present the passes and the case beside published values."""
        return present_case(product, self.spec)

    def _passes(self, advance: Callable[[int], None]) -> tuple[PassTruth, ...]:
        if self._truths is None:
            self._truths = fly_passes(self.spec, self.orbit, self.plant, self.orientation, advance)
        return self._truths

    def _follow_cases(
        self,
        passes: Sequence[PassTruth],
        batch: CaseBatch,
        keep: Mapping[tuple[str, str], Collection[str]],
        advance: Callable[[int], None],
        history_cases: int | None = None,
    ) -> _Block:
        """Run all cases; `keep` gives the histories to be kept, by pass and tracker."""
        spec = self.spec
        followed: list[FollowedPass] = []
        nominal: list[NominalOrbits] = []
        for truth in passes:
            followed.append(FollowedPass(truth, self._observe(truth, batch)))
            nominal.append(
                nominal_orbits(spec.nominal_error, batch, truth.name, truth.start_teme, self.field)
            )
        columns = []
        for name, tracker in self.trackers.items():
            as_they_are = spec.osculating_as_mean and not tracker.short_period
            # a diverged case is recognised by results that are not finite
            with np.errstate(all="ignore"):
                columns.append(
                    follow(tracker, followed,
                           [n.osculating if as_they_are else n.mean for n in nominal],
                           self.orbit.epoch, spec.lock_angle_rad, spec.search,
                           keep=[keep.get((truth.name, name), ()) for truth in passes],
                           history_cases=history_cases)
                )  # fmt: skip
            advance(len(passes))
        rows = [list(row) for row in zip(*columns, strict=True)]
        return _Block([p.record for p in followed], rows)

    def _observe(self, truth: PassTruth, batch: CaseBatch) -> AntennaRecord:
        """Simulate the antenna's measurements, which are common to all trackers."""
        sensor, t, cases = truth.sensor, truth.t_s, len(batch.draws)
        name = f"antenna {sensor.station.name}"
        constant = draw_constants(sensor, batch.seed, batch.stream, batch.draws, name)
        measured = record(
            sensor, truth.x[:, :, None], t, truth.scene, seed=batch.seed, stage=batch.stream,
            cases=batch.draws, name=name, occasion=truth.name,
        )  # fmt: skip
        bias = sensor.bias(
            np.repeat(truth.x, cases, axis=1),
            np.repeat(t, cases),
            {key: np.repeat(value, cases, axis=-1) for key, value in truth.scene.items()},
            np.tile(constant, t.size),
        ).reshape(2, t.size, cases)
        believed = (
            sensor.believed_stations(constant) if self.spec.believed_stations else (sensor.station,)
        )
        return AntennaRecord(measured, bias, believed)

    def _results(self, passes: Sequence[PassTruth], block: _Block) -> CaseResults:
        metrics, units, values, causes = [], [], [], []
        for p, truth, row in zip(self.spec.passes, passes, block.followed, strict=True):
            for k, outage_s in enumerate(p.outages_s):
                for tracker, followed in zip(self.trackers, row, strict=True):
                    for measure, value in followed.measures[k].items():
                        name = MetricName(truth.name, outage_name(outage_s), tracker, measure)
                        metrics.append(str(name))
                        units.append(MEASURES[measure])
                        values.append(value)
                        causes.append(tracker)
        table = np.array(values)
        bad = ~np.isfinite(table)
        failed = np.logical_or.reduce(bad, axis=0)
        first = np.argmax(bad, axis=0)
        return CaseResults(
            tuple(metrics),
            tuple(units),
            table,
            tuple("diverged" if f else "completed" for f in failed),
            tuple(causes[i] if f else "" for i, f in zip(first.tolist(), failed, strict=True)),
            failed,
        )

    def _outages(self) -> list[tuple[int, int, float]]:
        """Return the pass, the number within the pass and the beginning of each outage."""
        return [
            (i, k, outage_s)
            for i, p in enumerate(self.spec.passes)
            for k, outage_s in enumerate(p.outages_s)
        ]

    def _all_histories(self) -> dict[tuple[str, str], Collection[str]]:
        return {(p.name, t): (*ERRORS, SPREAD) for p in self.spec.passes for t in self.trackers}

    def _history_names(self) -> tuple[str, ...]:
        return tuple(
            str(MetricName(self.spec.passes[i].name, outage_name(outage_s), tracker, quantity))
            for i, _, outage_s in self._outages()
            for tracker in self.trackers
            for quantity in ERRORS
        )

    def _histories(
        self, passes: Sequence[PassTruth], block: _Block, names: Sequence[str]
    ) -> Histories:
        count, cases = max(q.t_s.size for q in passes), block.seen[0].measured_rad.shape[2]
        values = np.full((len(names), count, cases), np.nan)
        there = {
            str(MetricName(passes[i].name, outage_name(outage_s), tracker, quantity)): errors
            for i, k, outage_s in self._outages()
            for tracker, followed in zip(self.trackers, block.followed[i], strict=True)
            for quantity, errors in followed.over_time[k].items()
        }
        for row, name in zip(values, names, strict=True):
            row[: there[name].shape[0]] = there[name]
        times = np.repeat(np.arange(count)[:, None] * self.spec.period_s, cases, axis=1)
        return Histories(times, tuple(names), ("rad",) * len(names), values)

    def _product(
        self, passes: Sequence[PassTruth], block: _Block, results: CaseResults
    ) -> AssistedTracking:
        """Return the product of the case in lane 0."""
        outages, rows = self._outages(), block.followed
        count = max(q.t_s.size for q in passes)

        def filled(parts: Sequence[Array]) -> Array:
            """Pad arrays (..., K) with NaN to a common K, and stack them along axis −2."""
            padded = [
                np.pad(p, [(0, 0)] * (p.ndim - 1) + [(0, count - p.shape[-1])],
                       constant_values=np.nan)
                for p in parts
            ]  # fmt: skip
            return np.stack(padded, axis=-2)

        def per_pass(parts: Sequence[Array]) -> Array:
            return np.asarray(filled(parts).swapaxes(-1, -2))

        def over_time(quantity: str) -> Array:
            return np.array(
                [
                    filled([rows[i][t].over_time[k][quantity][:, 0] for i, k, _ in outages])
                    for t in range(len(self.trackers))
                ]
            )

        plain = [q.plain for q in passes]
        span = np.array([0.0, max(float(q.t_s[-1]) for q in passes)])
        return AssistedTracking(
            satellite=self.orbit.name,
            start=self.orbit.epoch.isot(np.zeros(1), 6)[0],
            trackers=tuple(self.trackers),
            passes=tuple(q.name for q in passes),
            stations=tuple(q.sensor.station.name for q in passes),
            revolution=np.array([p.revolution for p in self.spec.passes], dtype=np.int64),
            directions=tuple(q.direction for q in passes),
            plain_acquisition_s=np.array([v.first_s if v else np.nan for v in plain]),
            plain_duration_s=np.array([v.set_s - v.rise_s if v else np.nan for v in plain]),
            plain_elevation_max_rad=np.array([v.highest_rad if v else np.nan for v in plain]),
            earth_shift_rad=np.array([q.shift_rad for q in passes]),
            acquisition_s=np.array([q.tracked.first_s for q in passes]),
            duration_s=np.array([q.tracked.set_s - q.tracked.rise_s for q in passes]),
            elevation_max_rad=np.array([q.tracked.highest_rad for q in passes]),
            station_error_m=np.array(
                [
                    np.linalg.norm(s.stations[0].ecef_m - q.sensor.station.ecef_m)
                    for q, s in zip(passes, block.seen, strict=True)
                ]
            ),
            t_s=per_pass([q.t_s - q.t_s[0] for q in passes]),
            true_rad=per_pass([q.angles_rad for q in passes]),
            measured_rad=per_pass([s.measured_rad[:, :, 0] for s in block.seen]),
            bias_rad=per_pass([s.bias_rad[:, :, 0] for s in block.seen]),
            sigma_rad=per_pass([q.sigma_rad for q in passes]),
            outage_pass=np.array([i for i, _, _ in outages], dtype=np.int64),
            outage_s=np.array([s for _, _, s in outages]),
            outage_names=tuple(outage_name(s) for _, _, s in outages),
            error_rad=over_time("error"),
            sky_error_rad=over_time("sky_error"),
            encoder_error_rad=over_time("encoder_error"),
            spread_rad=over_time(SPREAD),
            metrics=results.metrics,
            units=results.units,
            values=results.values[:, 0],
            lock_angle_rad=self.spec.lock_angle_rad,
            warnings=(
                *getattr(self.orbit, "warnings", ()),
                *doubts(self.orientation, self.orbit.epoch, span),
            ),
        )


def _ignore_progress(count: int) -> None:
    """Ignore the progress (a callback that does nothing)."""
