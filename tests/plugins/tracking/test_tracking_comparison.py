"""The comparison of trackers: its statistics against plain numpy, what it says, what it refuses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from hillsphere.errors import InputError
from hillsphere.plugins import default_registry, validate
from hillsphere.presentation import (
    Band,
    Chart,
    Curve,
    Mark,
    Panel,
    Points,
    Presentation,
    Sky,
    presentation_faults,
)
from hillsphere.products import CaseTable
from hillsphere.products.products import Bands
from hillsphere.testing import check_stage
from hillsphere_tracking.assisted_tracking.measures import MEASURES, MetricName
from hillsphere_tracking.assisted_tracking.presentation import present_case
from hillsphere_tracking.assisted_tracking.products import AssistedTracking
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec
from hillsphere_tracking.tracking_comparison.products import FRAMES, TrackingComparison
from hillsphere_tracking.tracking_comparison.specs import TrackingComparisonSpec
from hillsphere_tracking.tracking_comparison.stage import TrackingComparisonStage

CASES = 200
OUTAGES = (("P1", "60s"), ("P1", "120s"), ("P2", "60s"))
SCALE = {"table": 0.010, "same": 0.010, "good": 0.004}
REFERENCE = """# source: Nobody (2001), Table 9
pass,outage,determination_s,prediction_s,error_max_deg,note
P1,60s,60,240,0.57,
P1,120s,120,180,5.00,far from anything
"""


class Given:
    """A context with nothing but random numbers."""

    def rng(self, stream: str = "") -> np.random.Generator:
        return np.random.default_rng(5)


def marks(chart: object, index: int) -> Sequence[Mark]:
    """Return the marks of a panel of a chart."""
    assert isinstance(chart, Chart)
    panel = chart.panels[index]
    assert isinstance(panel, Panel | Sky)
    return panel.marks


def check_rows(
    shown: Presentation, figure: str, column: str, kind: type[Curve] | type[Points]
) -> None:
    """Check that the labelled points of a figure are those of the rows that they refer to."""
    chart = shown.figures[figure]
    assert isinstance(chart, Chart)
    rows = shown.tables[chart.table].rows
    labelled = [mark for mark in marks(chart, 0) if isinstance(mark, kind) and mark.label]
    assert labelled
    for mark in labelled:
        assert mark.rows is not None
        assert not isinstance(mark.rows, int)
        for y, row in zip(np.asarray(mark.y).tolist(), mark.rows, strict=True):
            assert rows[row]["tracker"] == mark.label.partition(",")[0]
            assert rows[row][column] == pytest.approx(y)


def tracking(trackers: tuple[str, ...] = tuple(SCALE)) -> AssistedTracking:
    """One case of two passes of 300 s, at 1 Hz."""
    t, outages = np.arange(301.0), len(OUTAGES)
    angles = np.array([np.linspace(1.0, 2.0, 301), 0.1 + 0.5 * np.sin(np.pi * t / 300.0)])
    pair = np.stack([angles, angles], axis=-1)
    noise = np.zeros_like(pair)
    noise[0, 7, 0], noise[1, 9, 1] = -0.003, 0.002
    error = np.full((len(trackers), outages, 301), 0.005)
    names = tuple(str(MetricName(p, o, k, "error_max")) for p, o in OUTAGES for k in trackers)
    return AssistedTracking(
        satellite="SAT", start="2020-01-01T00:00:00", trackers=trackers, passes=("P1", "P2"),
        stations=("Here", "There"), revolution=np.array([2, 3]),
        directions=("ascending", "descending"), plain_acquisition_s=np.array([100.0, np.nan]),
        plain_duration_s=np.array([297.0, np.nan]),
        plain_elevation_max_rad=np.radians([30.0, np.nan]),
        earth_shift_rad=np.radians([0.5, -1.0]), acquisition_s=np.array([100.0, 6000.0]),
        duration_s=np.array([300.0, 300.0]), elevation_max_rad=np.radians([34.0, 34.0]),
        station_error_m=np.array([11e3, 0.0]),
        t_s=np.stack([t, t], axis=-1), true_rad=pair, measured_rad=pair + 0.001 + noise,
        bias_rad=np.full_like(pair, 0.001), sigma_rad=np.full_like(pair, 0.002),
        outage_pass=np.array([0, 0, 1]), outage_s=np.array([60.0, 120.0, 60.0]),
        outage_names=tuple(o for _, o in OUTAGES), error_rad=error, sky_error_rad=error,
        encoder_error_rad=error, spread_rad=error, metrics=names, units=("rad",) * len(names),
        values=np.linspace(0.001, 0.03, len(names)), lock_angle_rad=0.0175, warnings=("Beware.",),
    )  # fmt: skip


def campaign(
    values: dict[str, np.ndarray[Any, Any]], stage: str = "track", **changed: Any
) -> CaseTable:
    """Return a campaign whose metrics have these values (N,)."""
    count = len(next(iter(values.values())))
    numbers = np.arange(count)
    table = CaseTable(
        stage=stage, design="random", planned=count, stopped="", case=numbers, draw=numbers,
        point=np.zeros(count, dtype=np.int64), inputs=(), input_units=(),
        input_values=np.empty((0, count)), metrics=tuple(values),
        units=tuple("rad" for _ in values), values=np.array(list(values.values())),
        status=np.full(count, "completed"), cause=np.full(count, ""),
        failed=np.zeros(count, dtype=bool), message_case=np.empty(0, dtype=np.int64), messages=(),
    )  # fmt: skip
    return replace(table, **changed)


def errors(seed: int = 1, scale: dict[str, float] = SCALE) -> dict[str, np.ndarray[Any, Any]]:
    """Errors of all frames, and times; 'same' is as the table, drawn anew."""
    rng = np.random.default_rng(seed)
    made = {}
    for p, o in OUTAGES:
        for tracker, size in scale.items():
            for measure in MEASURES:
                drawn = size * (1.0 + 0.2 * rng.normal(size=CASES))
                made[str(MetricName(p, o, tracker, measure))] = np.abs(drawn)
            # Of ten cases one is found by the search, one not at all.
            found, at_once = np.ones((2, CASES))
            found[::10], at_once[::10], at_once[1::10] = 0.0, 0.0, 0.0
            made[str(MetricName(p, o, tracker, "found"))] = found
            made[str(MetricName(p, o, tracker, "found_at_once"))] = at_once
    return made


def stage(**keys: Any) -> TrackingComparisonStage:
    needs = {"tracking": "track", "campaign": "verify", **keys.pop("needs", {})}
    given = {"needs": needs, "resamples": 100, **keys}
    spec = validate(TrackingComparisonSpec, given, where="test")
    assert isinstance(spec, TrackingComparisonSpec)
    return TrackingComparisonStage(spec)


def compared(table: CaseTable, one: AssistedTracking | None = None, **keys: Any) -> tuple[
    TrackingComparison, Presentation
]:  # fmt: skip
    made = stage(**keys)
    given = {"tracking": one or tracking(), "campaign": table}
    product = made.run(Given(), **given)  # type: ignore[arg-type]
    return product, made.present(product, **given)  # type: ignore[arg-type]


def test_contract() -> None:
    keys = {"needs": {"tracking": "track", "campaign": "verify"}, "resamples": 100}
    inputs = {"tracking": tracking(), "campaign": campaign(errors())}
    check_stage("tracking_comparison", keys, inputs | {"ages": None, "consistency": None})
    assert "tracking_comparison" in [r.component.type for r in default_registry().of_kind("stage")]


def test_quantiles_means_and_shares() -> None:
    values = errors()
    found, _ = compared(campaign(values))
    for t, tracker in enumerate(found.trackers):
        middles = []
        for k, (p, o) in enumerate(OUTAGES):
            drawn = values[str(MetricName(p, o, tracker, "error_max"))]
            assert found.quantiles[:, 0, t, k] == pytest.approx(
                np.quantile(drawn, [0.05, 0.5, 0.95])
            )
            assert found.locked[0, t, k] == pytest.approx(np.mean(drawn <= 0.0175))
            middles.append(np.median(drawn))
        assert found.mean_median_rad[0, t] == pytest.approx(np.mean(middles))
        assert found.worst_median_rad[0, t] == pytest.approx(np.max(middles))
    assert found.loss_s.tolist() == [60.0, 120.0, 60.0]
    assert found.prediction_s.tolist() == [240.0, 180.0, 240.0]
    assert found.ratio[found.trackers.index("table")] == 1.0


def test_interval_of_the_ratio_covers() -> None:
    """Two trackers differ by their draws only: most intervals of their ratio hold 1."""
    held = 0
    for seed in range(20):
        found, _ = compared(campaign(errors(seed)), resamples=200)
        low, high = found.ratio_interval[:, found.trackers.index("same")]
        held += bool(low <= 1.0 <= high)
        assert low < found.ratio[found.trackers.index("same")] < high
    # Fewer than 15 of 20 have a probability below 1e-3 if 95 % are right.
    assert held >= 15


def test_interval_of_the_mean_of_medians() -> None:
    """Against the spread of the mean of medians over campaigns that are drawn anew."""
    means, widths = [], []
    for seed in range(30):
        found, _ = compared(campaign(errors(seed)))
        t = found.trackers.index("good")
        low, high = found.mean_interval_rad[:, :, t]
        assert np.all(low < found.mean_median_rad[:, t])
        assert np.all(found.mean_median_rad[:, t] < high)
        means.append(found.mean_median_rad[0, t])
        widths.append(high[0] - low[0])
    # Of normal errors a median has √(π/2) times the deviation of a mean.
    expected = 0.004 * 0.2 * np.sqrt(0.5 * np.pi / CASES / len(OUTAGES))
    assert np.mean(widths) == pytest.approx(2.0 * 1.96 * expected, rel=0.15)
    assert np.std(means, ddof=1) == pytest.approx(expected, rel=0.4)


def test_what_is_not_found_is_no_time() -> None:
    values = errors()
    for p, o in OUTAGES:
        lost = values[str(MetricName(p, o, "good", "found"))] == 0.0
        # The time to the set, as long as nothing that is found.
        values[str(MetricName(p, o, "good", "time_to_reacquire"))][lost] = 1e3
    found, shown = compared(campaign(values))
    t = found.trackers.index("good")
    assert found.reacquired[:, t].tolist() == pytest.approx([0.8, 0.1, 0.1])
    pooled = np.concatenate(
        [
            np.delete(
                values[str(MetricName(p, o, "good", "time_to_reacquire"))], slice(0, None, 10)
            )
            for p, o in OUTAGES
        ]
    )
    assert found.reacquire_s[:, t] == pytest.approx(np.quantile(pooled, [0.5, 0.95]))
    row = next(r for r in shown.tables["tracking_trackers"].rows if r["tracker"] == "good")
    assert row["not_found"] == pytest.approx(0.1)
    assert "does not find before the set: table 10 %, same 10 %, good 10 %" in " ".join(
        shown.verdict
    )
    none = {
        n: np.zeros(CASES) if n.endswith((".found", "at_once")) else v for n, v in values.items()
    }
    found, shown = compared(campaign(none))
    assert found.reacquired[:, t].tolist() == [0.0, 0.0, 1.0]
    assert np.isnan(found.reacquire_s).all()
    assert not presentation_faults(shown)


def test_covariances_that_do_not_cover_the_errors() -> None:
    rng, values = np.random.default_rng(2), errors()
    for p, o in OUTAGES:
        for tracker, factor in (("table", 1.0), ("same", 0.01), ("good", 20.0)):
            name = str(MetricName(p, o, tracker, "nees"))
            values[name] = factor * rng.chisquare(2, size=CASES)
    found, shown = compared(campaign(values))
    limit = chi2.ppf(0.999, 2)
    assert found.nees_limit == pytest.approx(limit)
    t = found.trackers.index("good")
    # 20 χ² beyond the limit: exp(−limit/40).
    assert np.mean(found.uncovered[t]) == pytest.approx(np.exp(-limit / 40.0), abs=0.06)
    assert np.mean(found.uncovered[found.trackers.index("table")]) < 0.01
    (said,) = (one for one in shown.verdict if one.startswith("The covariances"))
    assert "good 7" in said
    assert "median in 3" in said
    assert "table" not in said
    assert "errors of up to 11 km" in said
    row = next(r for r in shown.tables["tracking_trackers"].rows if r["tracker"] == "good")
    assert row["uncovered_outages"] == 3


def test_it_says_what_the_numbers_say() -> None:
    found, shown = compared(campaign(errors()))
    good = found.trackers.index("good")
    assert found.ratio[good] == pytest.approx(0.4, rel=0.05)
    said = " ".join(shown.verdict)
    assert "good is better than table" in said
    assert "same is not distinguishable from the baseline table" in said
    swapped = errors(scale={"table": 0.004, "same": 0.004, "good": 0.010})
    said = " ".join(compared(campaign(swapped))[1].verdict)
    assert "good is worse than the baseline table" in said
    assert "good is better than table" not in said


def test_failed_cases_are_left_out() -> None:
    values = errors()
    lost = np.zeros(CASES, dtype=bool)
    lost[[3, 50]] = True
    status = np.where(lost, "error", "completed")
    broken = {name: np.where(lost, np.nan, v) for name, v in values.items()}
    # What a lost case may have left must not count.
    broken["P1.60s.table.error_max"] = np.where(lost, 1e6, values["P1.60s.table.error_max"])
    found, shown = compared(campaign(broken, status=status, failed=lost))
    kept = {name: v[~lost] for name, v in values.items()}
    expected, _ = compared(campaign(kept))
    np.testing.assert_array_equal(found.quantiles, expected.quantiles)
    assert (found.cases, found.ended) == (CASES, CASES - 2)
    assert "2 of 200 cases were not completed" in " ".join(shown.verdict)


def test_a_tracker_that_diverges_costs_the_others_nothing() -> None:
    values = errors()
    lost = np.arange(CASES) < 20
    values["P2.60s.good.error_max"] = np.where(lost, np.nan, values["P2.60s.good.error_max"])
    table = campaign(values, status=np.where(lost, "diverged", "completed"), failed=lost)
    found, _ = compared(table)
    first = found.trackers.index("table")
    assert np.all(found.count[0, first] == CASES)
    assert found.count[0, found.trackers.index("good"), 2] == CASES - 20
    assert np.isfinite(found.ratio_interval).all()


def test_without_a_search_nothing_is_said_of_it() -> None:
    gone = ("time_to_reacquire", "found", "found_at_once")
    values = {name: v for name, v in errors().items() if not name.endswith(gone)}
    _, shown = compared(campaign(values))
    assert not presentation_faults(shown)
    table = shown.tables["tracking_trackers"]
    assert not any("reacquire" in column.name or "found" in column.name for column in table.columns)
    assert "does not find" not in " ".join(shown.verdict)
    assert "outside_s" in {column.name for column in table.columns}


def test_published_values(tmp_path: Path) -> None:
    path = tmp_path / "paper.csv"
    path.write_text(REFERENCE)
    _, shown = compared(campaign(errors()), reference=str(path))
    table = shown.tables["tracking_outages"]
    rows = {(r["pass"], r["outage"], r["tracker"]): r for r in table.rows}
    assert rows["P1", "60s", "table"]["paper_inside"] is True
    assert rows["P1", "60s", "good"]["paper_inside"] is False
    assert rows["P1", "120s", "table"]["paper_inside"] is False
    assert rows["P1", "120s", "table"]["note"] == "far from anything"
    assert rows["P2", "60s", "table"].get("error_max_deg_paper") is None
    assert rows["P1", "60s", "table"]["prediction_s_paper"] == 240.0
    said = " ".join(shown.verdict)
    assert "Mean of the 2 published errors: 2.785°" in said
    conditions = "under the conditions of the published values"
    assert f"same is not distinguishable from the baseline table, {conditions}" in said
    path.write_text(REFERENCE.replace("error_max_deg", "error_deg"))
    with pytest.raises(InputError, match="no column 'error_max_deg'"):
        stage(reference=str(path))


def test_inputs_that_do_not_fit() -> None:
    good = campaign(errors())
    with pytest.raises(InputError, match="'verify' repeats stage 'hover', but needs"):
        compared(replace(good, stage="hover"))
    with pytest.raises(InputError, match="none of whose metrics"):
        compared(campaign({"dv": np.ones(4)}))
    with pytest.raises(InputError, match="none of its 200 cases"):
        compared(replace(good, failed=np.ones(CASES, bool), status=np.full(CASES, "error")))
    with pytest.raises(InputError, match="no tracker 'tabel' is compared; did you mean 'table'"):
        compared(good, baseline="tabel")
    with pytest.raises(InputError, match="other outages or trackers"):
        compared(good, tracking(("table", "same")))
    with pytest.raises(InputError, match="is a sweep"):
        compared(replace(good, swept=("stage.track.x",), points=np.zeros((1, 1))))
    known = stage(needs={"consistency": "consistency"}, consistent=["rihgt"])
    with pytest.raises(InputError, match="has no tracker 'rihgt'; did you mean 'right'"):
        known.run(Given(), tracking(), good, consistency=nees())  # type: ignore[arg-type]
    lacking = errors(scale={"good": 0.004})
    sweep = replace(swept(), metrics=tuple(lacking), values=np.array(list(lacking.values())))
    with pytest.raises(InputError, match="'ages' has no tracker 'table', the baseline"):
        stage(needs={"ages": "ages"}).run(Given(), tracking(), good, ages=sweep)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="not a sweep over a number"):
        stage(needs={"ages": "ages"}).run(Given(), tracking(), good, ages=good)  # type: ignore[arg-type]


def swept() -> CaseTable:
    """Four points, 50 cases each: two ages, each with a switch off and on."""
    values = errors()
    age = np.array([1.0, 1.0, 10.0, 10.0])
    point = np.repeat(np.arange(4), 50)
    name = str(MetricName("P1", "60s", "table", "error_max"))
    values[name] = np.where(np.isin(point, [2, 3]), 10.0, 1.0) * values[name]
    return campaign(
        values, stage="stale", point=point,
        swept=("stage.stale.age", "stage.stale.believed_stations"),
        swept_units=("s", ""), points=np.array([age, [0.0, 1.0, 0.0, 1.0]]),
        point_labels=tuple(
            f"stage.stale.age = {a:g} s, stage.stale.believed_stations = {b}"
            for a, b in zip(age, ["False", "True"] * 2, strict=True)
        ),
    )  # fmt: skip


def nees(seed: int = 3) -> CaseTable:
    """Normalised errors squared of trackers: as they should be, too large, too small."""
    rng = np.random.default_rng(seed)
    values = {}
    for p, o in OUTAGES:
        error = np.abs(rng.normal(size=CASES))
        for tracker, factor in (("right", 1.0), ("bold", 3.0), ("shy", 0.3)):
            drawn = factor * rng.chisquare(2, size=CASES)
            values[str(MetricName(p, o, tracker, "nees"))] = drawn
            size = 2.0 if tracker == "shy" else 1.0
            values[str(MetricName(p, o, tracker, "error_max"))] = size * error
    return campaign(values, stage="consistent")


def test_ages_and_consistency() -> None:
    made = stage(needs={"ages": "ages", "consistency": "consistency"}, consistent=["right"])
    given: dict[str, Any] = {
        "tracking": tracking(), "campaign": campaign(errors()), "ages": swept(),
        "consistency": nees(),
    }  # fmt: skip
    found = made.run(Given(), **given)  # type: ignore[arg-type]
    ages, known = found.ages, found.consistency
    assert ages is not None
    assert known is not None
    assert (ages.name, ages.unit, ages.value.tolist()) == ("age", "s", [1.0, 1.0, 10.0, 10.0])
    told = ("stations at their true places", "stations where they are believed")
    assert ages.group == told * 2
    table = swept()
    for p in range(4):
        middles = [
            np.median(
                table.values[table.metrics.index(f"{a}.{o}.table.error_max"), table.point == p]
            )
            for a, o in OUTAGES
        ]
        first = ages.trackers.index("table")
        assert ages.mean_median_rad[first, p] == pytest.approx(np.mean(middles))
        assert ages.worst_median_rad[first, p] == pytest.approx(np.max(middles))
        t = ages.trackers.index("good")
        good = [
            np.median(
                table.values[table.metrics.index(f"{a}.{o}.good.error_max"), table.point == p]
            )
            for a, o in OUTAGES
        ]
        ratios = np.array(good) / np.array(middles)
        assert ages.worst_ratio[t, p] == pytest.approx(ratios.max())
        assert ages.worst_ratio_outage[t, p] == np.argmax(ratios)
        low, high = ages.mean_interval_rad[:, t, p]
        assert low < ages.mean_median_rad[t, p] < high
        assert ages.reacquired[:, t, p].tolist() == pytest.approx([0.8, 0.1, 0.1])
    assert ages.count.tolist() == [50] * 4
    # A sum of N χ² variables with two degrees of freedom has 2N of them.
    expected = chi2.ppf([0.025, 0.975], 2 * CASES) / CASES
    assert known.interval[:, 0, 0] == pytest.approx(expected)
    shown = made.present(found, **given)
    rows = {row["tracker"]: row for row in shown.tables["tracking_consistency"].rows}
    assert (rows["right"]["inside"], rows["bold"]["inside"]) == (3, 0)
    said = {one.partition(",")[0]: one for one in shown.verdict}
    assert "with the true error statistics, is consistent" in said["right"]
    assert "with other than the true error statistics, is overconfident" in said["bold"]
    assert "Its error is not changed: 1 times the error of right" in said["bold"]
    assert "is too cautious" in said["shy"]
    assert "Its error is larger: 2 times the error of right" in said["shy"]
    overall = known.overall[known.trackers.index("bold")]
    assert overall == pytest.approx(np.mean(known.mean[known.trackers.index("bold")]))
    begins = "Sweep of age, ratio of the mean error of good to table"
    over = next(one for one in shown.verdict if one.startswith(begins))
    k = int(ages.worst_ratio_outage[ages.trackers.index("good"), 0])
    assert f"{told[0]}: 1 s 0." in over
    assert f"({' '.join(OUTAGES[k])})" in over
    assert not presentation_faults(shown)
    assert {"tracking_ages", "tracking_consistency", "tracking_outages"} == set(shown.figures)
    check_rows(shown, "tracking_ages", "mean_deg", Curve)
    check_rows(shown, "tracking_consistency", "nees", Points)
    check_rows(shown, "tracking_outages", "error_max_deg", Points)


def test_bands_are_drawn() -> None:
    names = tuple(f"{p}.{o}.table.error" for p, o in OUTAGES)
    t = np.arange(301.0)
    values = np.array([np.full((3, 301), q) for q in (0.001, 0.005, 0.02)])
    bands = Bands(names, ("rad",) * 3, (0.05, 0.5, 0.95), t, values, np.full((3, 301), CASES))
    _, shown = compared(replace(campaign(errors()), bands=bands))
    assert not presentation_faults(shown)
    chart = shown.figures["tracking_bands"]
    assert isinstance(chart, Chart)
    assert len(chart.panels) == len(OUTAGES)
    (band,) = (mark for mark in marks(chart, 0) if isinstance(mark, Band))
    (curve,) = (mark for mark in marks(chart, 0) if isinstance(mark, Curve))
    assert (curve.label, np.size(curve.x)) == ("table", 301)
    for drawn, value in ((band.low, 0.001), (curve.y, 0.005), (band.high, 0.02)):
        np.testing.assert_allclose(np.asarray(drawn), np.degrees(value))


def test_case_beside_published_values(tmp_path: Path) -> None:
    path = tmp_path / "paper.csv"
    path.write_text(
        "# source: Nobody (2001), Table 8\n"
        "pass,duration_s,elevation_max_deg,bias_azimuth_deg,noise_azimuth_deg,note\n"
        "P1,297,30.0,0.06,-0.17,\nP2,300,34.0,0.06,0.1,not in the elements\n"
    )
    example = dict(AssistedTrackingSpec.examples[0])
    spec = validate(AssistedTrackingSpec, example | {"reference": str(path)}, where="test")
    assert isinstance(spec, AssistedTrackingSpec)
    shown = present_case(tracking(), spec)
    assert not presentation_faults(shown)
    first, second = shown.tables["tracked_passes"].rows
    assert (first["duration_s"], first["duration_s_paper"]) == (297.0, 297.0)
    assert first["tracked_duration_s"] == 300.0
    assert first["earth_turned_deg"] == pytest.approx(0.5)
    assert second["duration_s"] is None
    assert second["note"] == "not in the elements"
    noise = shown.tables["antenna_errors"].rows
    # The largest by size, with its sign.
    assert noise[0]["noise_azimuth_deg"] == pytest.approx(np.degrees(-0.003))
    assert noise[1]["noise_elevation_deg"] == pytest.approx(np.degrees(0.002))
    assert noise[0]["bias_azimuth_deg_paper"] == pytest.approx(0.06)
    # Two draws stand side by side: no column that a difference is taken of.
    names = [column.name for column in shown.tables["antenna_errors"].columns]
    assert names.index("published_noise_azimuth_deg") == names.index("noise_azimuth_deg") + 1
    assert "noise_azimuth_deg_paper" not in names
    assert noise[0]["published_noise_azimuth_deg"] == pytest.approx(-0.17)
    rows = shown.tables["tracking"].rows
    assert len(rows) == len(OUTAGES) * len(SCALE)
    assert rows[0]["error_max_deg"] == pytest.approx(np.degrees(0.001))
    assert shown.verdict[-1] == "Beware."
    assert set(shown.figures) == {"tracking_errors", "tracking_spread", "tracking_sky"}
    errors_over_time = shown.figures["tracking_errors"]
    assert isinstance(errors_over_time, Chart)
    assert len(errors_over_time.panels) == len(OUTAGES)
    curves = [mark for mark in marks(errors_over_time, 1) if isinstance(mark, Curve)]
    assert [curve.label for curve in curves] == list(SCALE)
    for curve in curves:
        np.testing.assert_allclose(np.asarray(curve.y), np.degrees(0.005))
        assert isinstance(curve.rows, int)
        assert (rows[curve.rows]["tracker"], rows[curve.rows]["pass"]) == (curve.label, "P1")
    # Azimuth and distance from the zenith of the true path.
    true = marks(shown.figures["tracking_sky"], 0)[0]
    assert isinstance(true, Curve)
    np.testing.assert_allclose(np.asarray(true.x), np.degrees(np.linspace(1.0, 2.0, 301)))
    assert np.asarray(true.y).min() == pytest.approx(90.0 - np.degrees(0.6))


def test_frames_are_measures() -> None:
    assert all(MEASURES[name] == "rad" for name in FRAMES)
