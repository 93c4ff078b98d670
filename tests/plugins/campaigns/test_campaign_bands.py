"""Quantiles over time: those of numpy, whatever is divided, interrupted or read in pieces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray
from tests.core.cases.toy_cases import Toy, ToyPlan, same

from hillsphere.cases.block_outcome import BlockOutcome, join_outcomes
from hillsphere.cases.case_classes import is_undecided
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.cases.isolation import compute
from hillsphere.cases.repeated import Repeated
from hillsphere.cases.specs import MonteCarloSpec, SweepSpec
from hillsphere.errors import InputError, Interrupted, StageError
from hillsphere.interfaces import Array
from hillsphere.interfaces.cases import CaseBatch, CaseResults, Histories, histories_to_keep
from hillsphere.interfaces.tasks import Task
from hillsphere.mission.faults import faults_of
from hillsphere.plugins import validate
from hillsphere.presentation import Band, Curve, Panel
from hillsphere.products import CaseTable, load_product, save_product
from hillsphere.products.products import Bands, Lines, LinesToEnds
from hillsphere.runs.rerun import _row
from hillsphere.show.drawing import draw
from hillsphere.show.history import history_csv
from hillsphere.spec import Spec
from hillsphere.testing import check_product
from hillsphere_campaigns.band_figures import MOST_PANELS, band_chart
from hillsphere_campaigns.bands import Parts, bands_of, lines_of
from hillsphere_campaigns.engine import run_campaign
from hillsphere_campaigns.line_figures import line_chart
from hillsphere_campaigns.sweep import Sweep
from hillsphere_flight.specs import ClosedLoopSpec

LEVELS = (0.05, 0.5, 0.95)
SAMPLES, CASES = 40, 300


def flights() -> Histories:
    """Return cases that begin and end at their own times; the last sample has no command."""
    rng = np.random.default_rng(3)
    time = 0.1 * np.arange(SAMPLES)[:, None] + 1e4 * rng.random(CASES)
    values = rng.normal(size=(2, SAMPLES, CASES)).cumsum(axis=1)
    ends = rng.integers(SAMPLES // 2, SAMPLES, CASES)
    ends[7] = SAMPLES - 1
    time[np.arange(SAMPLES)[:, None] > ends] = np.nan
    values[1, ends, np.arange(CASES)] = np.nan
    return Histories(time, ("x", "u.x"), ("m", "-"), values)


FLIGHTS = flights()
COUNTED = np.flatnonzero(np.arange(CASES) % 7 != 2)


def of_columns(histories: Histories, columns: NDArray[np.int64]) -> Histories:
    """Return some cases, without samples that none of them has, as a block keeps them."""
    time = histories.time_s[:, columns]
    last = int(np.flatnonzero(np.isfinite(time).any(axis=1))[-1]) + 1
    return replace(histories, time_s=time[:last], values=histories.values[:, :, columns][:, :last])


def parts_of(*groups: Sequence[int], histories: Histories = FLIGHTS) -> Parts:
    def parts() -> Iterator[tuple[NDArray[np.int64], Histories]]:
        for group in groups:
            columns = np.array(group, dtype=np.int64)
            yield columns, of_columns(histories, columns)

    return parts


def found(parts: Parts, **options: Any) -> Bands:
    bands = bands_of(parts, COUNTED, LEVELS, **options)
    assert bands is not None
    return bands


def assert_same(one: Bands | None, other: Bands | None) -> None:
    assert one is not None
    assert other is not None
    assert (one.names, one.units, one.levels) == (other.names, other.units, other.levels)
    for a, b in ((one.time_s, other.time_s), (one.values, other.values), (one.count, other.count)):
        assert (a.shape, a.tobytes()) == (b.shape, b.tobytes())


WHOLE = found(parts_of(range(CASES)))


def test_bands_are_the_quantiles_of_numpy() -> None:
    time = FLIGHTS.time_s[:, COUNTED]
    values = np.where(np.isfinite(time), FLIGHTS.values[:, :, COUNTED], np.nan)
    assert_array_equal(WHOLE.time_s, FLIGHTS.time_s[:, 7] - FLIGHTS.time_s[0, 7])
    assert (WHOLE.names, WHOLE.units, WHOLE.levels) == (("x", "u.x"), ("m", "-"), LEVELS)
    assert_array_equal(WHOLE.count, np.isfinite(values).sum(axis=2))
    assert_array_equal(WHOLE.values[:, 0], np.nanquantile(values[0], LEVELS, axis=1))
    assert_array_equal(WHOLE.values[:, 1, :-1], np.nanquantile(values[1, :-1], LEVELS, axis=1))
    # Nobody has a command at the very last sample; values after the end of a case do not count.
    assert np.isnan(WHOLE.values[:, 1, -1]).all()
    assert WHOLE.count[0, 0] == len(COUNTED) > WHOLE.count[0, -1] > WHOLE.count[1, -1] == 0
    check_product(WHOLE)


@pytest.mark.parametrize("room_bytes", [1, 2 * 8 * CASES * 7, 1 << 29])
def test_parts_and_room_change_no_bit(room_bytes: int) -> None:
    order = np.random.default_rng(1).permutation(CASES).tolist()
    divided = [range(64), range(64, 71), range(71, CASES)]
    overlapping = [range(200, CASES), range(50, 250), range(64)]
    for groups in (divided, overlapping, divided[::-1], [order]):
        assert_same(found(parts_of(*groups), room_bytes=room_bytes), WHOLE)


def test_levels_are_put_in_order() -> None:
    bands = bands_of(parts_of(range(CASES)), COUNTED, LEVELS[::-1] + LEVELS)
    assert_same(bands, WHOLE)


def test_no_case_no_bands() -> None:
    assert bands_of(parts_of(range(CASES)), np.empty(0, dtype=np.int64), LEVELS) is None
    assert bands_of(lambda: [], COUNTED, LEVELS) is None


def test_cases_sampled_at_other_times() -> None:
    late = FLIGHTS.time_s.copy()
    late[5:, 101] += 1e-3
    other = replace(FLIGHTS, time_s=late)
    with pytest.raises(StageError, match="those of case 101 differ from those of case 7,"):
        found(parts_of(range(100), range(100, 200), histories=other))
    # A case that is not counted may be sampled as it likes, and rounding is no difference.
    late[5:, 101] = FLIGHTS.time_s[5:, 101]
    late[5:, 2] += 1e-3
    late[1:-1, 101] = np.nextafter(late[1:-1, 101], np.inf)
    assert_same(found(parts_of(range(CASES), histories=replace(other, time_s=late))), WHOLE)


def test_a_case_with_a_gap() -> None:
    gap = FLIGHTS.time_s.copy()
    gap[4, 7] = np.nan
    with pytest.raises(StageError, match="common times"):
        found(parts_of(range(CASES), histories=replace(FLIGHTS, time_s=gap)))


def test_parts_with_other_quantities() -> None:
    def parts() -> Iterator[tuple[NDArray[np.int64], Histories]]:
        yield from parts_of(range(64))()
        yield from parts_of(range(64, 99), histories=replace(FLIGHTS, names=("x", "u.y")))()

    with pytest.raises(StageError, match=r"histories of x, u\.y for some cases, but of x, u\.x"):
        found(parts)


# --- in a campaign

PLAN = ToyPlan(1000)
FAULTS = {9: "raise", 130: "nan", **dict.fromkeys(range(256, 320), "memory")}


@dataclass(frozen=True)
class Banded:
    """Work that keeps histories for bands."""

    stage: Any
    bands: tuple[str, ...] = ("x",)

    def prepare(self) -> Callable[[Task], tuple[BlockOutcome, ...]]:
        return lambda task: tuple(
            compute(self.stage, block, {}, task.history, self.bands) for block in task.blocks
        )


def campaign(
    checkpoints: Checkpoints | None = None, bands: tuple[str, ...] = ("x",), **options: Any
) -> list[BlockOutcome]:
    return run_campaign(
        PLAN, Banded(Toy(FAULTS), bands), executor=Serial(SerialSpec()), checkpoints=checkpoints,
        **options,
    )[0]  # fmt: skip


def in_memory(outcomes: Sequence[BlockOutcome]) -> Bands | None:
    parts = [(o.numbers, o.histories) for o in outcomes if o.histories is not None]
    return bands_of(lambda: parts, sound(outcomes), LEVELS)


def sound(outcomes: Sequence[BlockOutcome]) -> NDArray[np.int64]:
    return np.concatenate([o.numbers[~(o.failed | is_undecided(o.status))] for o in outcomes])


def test_bands_of_a_campaign(tmp_path: Path) -> None:
    outcomes = campaign()
    # Histories change nothing else.
    assert same(outcomes, campaign(bands=()))
    bands = in_memory(outcomes)
    assert bands is not None
    x = np.concatenate([o.values[0][~(o.failed | is_undecided(o.status))] for o in outcomes])
    assert_array_equal(
        bands.values[:, 0], np.quantile(x[None] * np.arange(3.0)[:, None], LEVELS, 1)
    )
    assert_array_equal(bands.count, [[x.size] * 3])
    # With checkpoints, histories are in the files and not in memory.
    for group_blocks in (1, 3):
        kept = Checkpoints(tmp_path / str(group_blocks), "f")
        stored = campaign(kept, group_blocks=group_blocks)
        assert same(stored, outcomes)
        assert all(o.histories is None for o in stored)
        assert_same(bands_of(kept.histories, sound(outcomes), LEVELS), bands)


def test_an_interrupted_campaign_comes_to_the_same_bands(tmp_path: Path) -> None:
    outcomes = campaign()
    done = 0

    def interrupt(cases: int) -> None:
        nonlocal done
        done += cases
        if done >= 400:
            raise Interrupted("enough")

    with pytest.raises(Interrupted):
        campaign(Checkpoints(tmp_path, "f"), group_blocks=2, advance=interrupt)
    assert 0 < len(list(tmp_path.iterdir())) < 8
    kept = Checkpoints(tmp_path, "f")
    assert same(campaign(kept, group_blocks=3), outcomes)
    assert_same(bands_of(kept.histories, sound(outcomes), LEVELS), in_memory(outcomes))


def test_a_file_that_was_damaged_since(tmp_path: Path) -> None:
    kept = Checkpoints(tmp_path, "f")
    campaign(kept, group_blocks=4)
    path = sorted(tmp_path.iterdir())[1]
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(StageError, match="resume the run"):
        list(kept.histories())


def test_groups_are_not_larger_than_their_histories_allow(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []

    class Counting(Banded):
        def prepare(self) -> Callable[[Task], tuple[BlockOutcome, ...]]:
            do = super().prepare()

            def counted(task: Task) -> tuple[BlockOutcome, ...]:
                sizes.append(len(task.blocks))
                return do(task)

            return counted

    # Two blocks of one quantity at three samples of 64 cases.
    monkeypatch.setattr("hillsphere_campaigns.task_sizes.MOST_BYTES", 2 * 3 * 64 * 8)
    run_campaign(PLAN, Counting(Toy(), ("x",)), executor=Serial(SerialSpec()))
    assert max(sizes) == 2


def test_a_block_keeps_what_bands_name() -> None:
    @dataclass(frozen=True)
    class Two(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            results = super().run_cases(batch, history)
            kept = results.histories
            both = kept and replace(
                kept, names=("x", "seen.x"), units=("m", "km"),
                values=np.concatenate([kept.values, 1e-3 * kept.values]),
            )  # fmt: skip
            return replace(results, histories=both)

    batch = PLAN.block(0)[0]
    whole = compute(Two({3: "raise"}), batch, {}, history=True)
    part = compute(Two({3: "raise"}), batch, {}, bands=("seen.*",))
    assert whole.histories is not None
    assert part.histories is not None
    assert (part.histories.names, part.histories.units) == (("seen.x",), ("km",))
    assert part.histories.values.tobytes() == whole.histories.values[1:].tobytes()
    assert (len(whole.tracebacks), part.tracebacks) == (1, ())
    both = compute(Two(), batch, {}, bands=("seen.*", "*")).histories
    assert both is not None
    assert both.names == ("seen.x", "x")
    with pytest.raises(StageError, match=r"no quantity 'sen\.x'; did you mean 'seen\.x'\?"):
        compute(Two(), batch, {}, bands=("x", "sen.x"))


def test_what_is_wrong_with_bands_is_told_after_the_first_block() -> None:
    blocks: list[int] = []

    @dataclass(frozen=True)
    class Forgetful(Toy):
        def run_cases(self, batch: CaseBatch, history: bool = False, **inputs: Any) -> CaseResults:
            blocks.append(int(batch.numbers[0]))
            return super().run_cases(batch)

    with pytest.raises(StageError, match=r"Forgetful\.run_cases keeps no histories"):
        run_campaign(PLAN, Banded(Forgetful()), executor=Serial(SerialSpec()))
    with pytest.raises(StageError, match="no quantity 'z'; there are: x"):
        campaign(bands=("z",))
    assert blocks == [0]


def test_metrics_are_told_once_and_early() -> None:
    heard: list[tuple[Sequence[str], int]] = []
    done = 0

    def count(cases: int) -> None:
        nonlocal done
        done += cases

    campaign(advance=count, on_metrics=lambda names: heard.append((names, done)))
    assert heard == [(("x", "y"), 0)]


def test_bands_need_quantiles() -> None:
    keys = {"repeat": "hover", "cases": 64, "bands": ["x"], "quantiles": []}
    made, faults = faults_of(MonteCarloSpec, keys)
    assert made is None
    assert [fault.message for fault in faults] == ["bands need at least one quantile"]


# --- what is shown


def many(quantities: int, levels: tuple[float, ...] = LEVELS, samples: int = 50) -> Bands:
    time = np.linspace(0.0, 5e4, samples)
    spread = np.linspace(-1.0, 1.0, len(levels))[:, None, None]
    values = np.sin(time / 1e4) + spread * np.ones((len(levels), quantities, samples))
    count: NDArray[np.int64] = np.full((quantities, samples), 300)
    count[:, samples // 2 :] = 250
    names = tuple(f"state.x{i}" for i in range(quantities))
    return Bands(names, ("m",) * quantities, levels, time, values, count)


@pytest.mark.parametrize("levels", [LEVELS, (0.9,), (0.1, 0.9), (0.01, 0.05, 0.25, 0.75, 0.95)])
def test_figure_of_bands(levels: tuple[float, ...]) -> None:
    bands = many(2, levels)
    chart = band_chart(bands)
    assert "The first" not in chart.caption
    for quantity, panel in enumerate(chart.panels):
        assert isinstance(panel, Panel)
        drawn = [mark for mark in panel.marks if isinstance(mark, Band)]
        lines = [mark for mark in panel.marks if isinstance(mark, Curve)]
        for i, mark in enumerate(drawn):
            assert_array_equal(mark.low, bands.values[i, quantity])
            assert_array_equal(mark.high, bands.values[-1 - i, quantity])
        assert len(drawn) == len(levels) // 2
        assert len(lines) == len(levels) % 2
    assert draw(chart).svg


def test_a_page_of_many_quantities() -> None:
    chart = band_chart(many(700, samples=3000))
    assert f"The first {MOST_PANELS} of 700 quantities; the other 691" in chart.caption
    assert "At most 500 of 3000 samples" in chart.caption
    assert chart.size[1] < 10.0
    assert len(chart.panels) == MOST_PANELS
    assert draw(chart).svg


def test_bands_of_a_single_sample(tmp_path: Path) -> None:
    one = many(1, samples=1)
    assert draw(band_chart(one)).svg
    save_product(tmp_path / "bands.npz", one)
    read: Array = load_product(tmp_path / "bands.npz").values
    assert_array_equal(read, one.values)


def test_which_histories_a_stage_has_to_keep() -> None:
    names = ("x", "u.x", "u.y")
    assert histories_to_keep(True, names) == names
    assert histories_to_keep(False, names) == ()
    assert histories_to_keep(("u.*",), names) == ("u.x", "u.y")
    assert histories_to_keep(("u.y", "x"), names) == ("x", "u.y")
    assert histories_to_keep(("v",), names) == names  # whoever asks tells what there is


# --- single cases


def test_lines_are_the_cases_themselves() -> None:
    lines = lines_of(parts_of(range(100), range(50, CASES)), COUNTED)
    assert lines is not None
    check_product(lines)
    assert_array_equal(lines.case, COUNTED)
    assert_array_equal(lines.time_s, WHOLE.time_s)
    there = np.isfinite(FLIGHTS.time_s[:, COUNTED])
    assert_array_equal(lines.values, np.where(there, FLIGHTS.values[:, :, COUNTED], np.nan))
    assert lines_of(lambda: [], COUNTED) is None


def with_ends() -> Histories:
    """Return the cases of which every third ended a little after its last sample."""
    last = np.nanmax(FLIGHTS.time_s, axis=0)
    between = np.arange(CASES) % 3 == 0
    values = np.array([np.arange(CASES, dtype=float), np.full(CASES, np.nan)])
    return replace(
        FLIGHTS,
        end_s=np.where(between, last + 0.04, np.nan),
        end_values=np.where(between, values, np.nan),
    )


def test_ends_between_samples_are_no_samples() -> None:
    """Bands are as without them; lines go on to them."""
    histories = with_ends()
    assert histories.end_s is not None
    assert histories.end_values is not None

    def parts() -> Iterator[tuple[NDArray[np.int64], Histories]]:
        for group in (range(100), range(100, 130), range(130, CASES)):
            places = np.array(group, dtype=np.int64)
            yield places, histories.of_cases(places)

    bands, bare = (bands_of(p, COUNTED, LEVELS) for p in (parts, parts_of(range(CASES))))
    assert bands is not None
    assert bare is not None
    for name in ("time_s", "values", "count"):
        assert_array_equal(getattr(bands, name), getattr(bare, name))
    lines = lines_of(parts, COUNTED)
    assert isinstance(lines, LinesToEnds)
    check_product(lines)
    plain = lines_of(parts_of(range(CASES)), COUNTED)
    assert type(plain) is Lines
    assert_array_equal(lines.values, plain.values)
    begun = FLIGHTS.time_s[0, COUNTED]
    assert_array_equal(lines.end_s, histories.end_s[COUNTED] - begun)
    assert_array_equal(lines.end_values, histories.end_values[:, COUNTED])
    # The parts of a block that was bisected belong together again, one without any ends, too.
    blocks = [outcome_of(histories.of_cases(np.arange(3)), 0)]
    blocks.append(outcome_of(FLIGHTS.of_cases(np.arange(3, 5)), 3))
    again = join_outcomes(blocks).histories
    assert again is not None
    assert_array_equal(again.end_s, [*histories.end_s[:3], np.nan, np.nan])
    assert_array_equal(again.end_values, np.append(histories.end_values[:, :3], NONE, axis=1))
    none = join_outcomes(
        [outcome_of(FLIGHTS.of_cases(np.arange(k, k + 2)), k) for k in (0, 2)]
    ).histories
    assert none is not None
    assert none.end_s is None
    few = histories.of_quantities([1])
    assert (few.names, few.units) == (("u.x",), ("-",))
    assert_array_equal(few.end_values, histories.end_values[1:])


NONE = np.full((2, 2), np.nan)


def outcome_of(histories: Histories, first: int) -> BlockOutcome:
    count = histories.time_s.shape[1]
    return BlockOutcome(
        numbers=first + np.arange(count), metrics=(), units=(), values=np.zeros((0, count)),
        status=np.full(count, "completed"), cause=np.full(count, ""),
        failed=np.zeros(count, dtype=bool), message_case=np.zeros(0, dtype=np.int64), messages=(),
        histories=histories,
    )  # fmt: skip


def test_a_single_case_is_told_to_its_end() -> None:
    outcome = outcome_of(with_ends(), 0)
    for case in (3, 4):  # one that ended after its last sample, and one that did not
        row = _row(outcome, case).histories
        assert row is not None
        assert row.end_s is None
        there = np.flatnonzero(np.isfinite(FLIGHTS.time_s[:, case]))
        time, values = FLIGHTS.time_s[there, case], FLIGHTS.values[:, there, case]
        if case == 3:
            time = np.append(time, time[-1] + 0.04)
            values = np.append(values, [[3.0], [np.nan]], axis=1)
        assert_array_equal(row.time_s[:, 0], time)
        assert_array_equal(row.values[:, :, 0], values)
        assert len(history_csv(row).splitlines()) == 1 + len(time)


def test_a_line_is_drawn_to_its_end() -> None:
    table = chosen()
    assert table.lines is not None
    end_s, end_values = np.full(6, np.nan), np.full((1, 6), np.nan)
    end_s[2], end_values[0, 2] = 3.01e4, 5.0
    lines = LinesToEnds(**vars(table.lines), end_s=end_s, end_values=end_values)
    check_product(replace(table, lines=lines))
    (panel,) = line_chart(table, lines, None).panels
    assert isinstance(panel, Panel)
    failed = panel.marks[1]
    assert isinstance(failed, Curve)
    assert failed.label == "failed case"
    time, values = (np.asarray(one, dtype=float)[:-1] for one in (failed.x, failed.y))
    assert values[-1] == 5.0
    assert np.isfinite(values).all()
    assert time[-1] == pytest.approx(3.01e4 / 3600.0)
    assert failed.rows == [2] * (time.size + 1)  # of the table of the points


def chosen(count: int = 6) -> CaseTable:
    """Return a sweep of single cases with their lines; the third fails, and ends early."""
    number = np.arange(count)
    time = np.linspace(0.0, 6e4, 40)
    values = np.array([[np.cos(time / 1e4 + 0.2 * k) for k in number]]).transpose(0, 2, 1)
    values[0, 20:, 2] = np.nan
    failed = number == 2
    return CaseTable(
        stage="descent", design="list", planned=count, stopped="", case=number, draw=number,
        point=number, inputs=(), input_units=(), input_values=np.zeros((0, count)), metrics=(),
        units=(), values=np.zeros((0, count)), status=np.where(failed, "impact", "completed"),
        cause=np.full(count, ""), failed=failed, message_case=np.zeros(0, dtype=np.int64),
        messages=(), swept=("x",), swept_units=("-",), points=number[None].astype(float),
        point_labels=tuple(f"case {k}" for k in number),
        lines=Lines(("state.x0",), ("m",), number, time, values),
    )  # fmt: skip


@pytest.mark.parametrize("bands", [None, many(2, (0.05, 0.25, 0.5, 0.75, 0.95))])
def test_figure_of_lines_before_bands(bands: Bands | None) -> None:
    table = chosen()
    assert table.lines is not None
    check_product(table)
    chart = line_chart(table, table.lines, bands)
    assert draw(chart).svg
    (panel,) = chart.panels
    assert isinstance(panel, Panel)
    told = {getattr(mark, "label", "") for mark in panel.marks}
    assert {"case", "failed case"} <= told
    assert ("median" in told) == (bands is not None)
    assert ("Behind" in chart.caption) == (bands is not None)
    assert chart.table == "sweep_failures"


def test_what_stands_behind_needs_lines() -> None:
    keys = {"repeat": "hover", "over": {"stage.hover.samples": [1, 2]}, "needs": {"behind": "all"}}
    made, faults = faults_of(SweepSpec, keys)
    assert made is None
    assert [fault.message for fault in faults] == [
        "behind: there are no lines; name their quantities"
    ]
    made, faults = faults_of(SweepSpec, keys | {"lines": ["x"]})
    assert not faults


def test_a_campaign_behind_without_bands_is_told_before_any_case_is_flown() -> None:
    keys = {"repeat": "hover", "over": {"stage.hover.samples": [1, 2]}, "lines": ["x"],
            "needs": {"behind": "all"}}  # fmt: skip
    made, faults = faults_of(SweepSpec, keys)
    assert not faults
    assert isinstance(made, SweepSpec)
    bare = replace(chosen(), bands=None)
    with pytest.raises(InputError, match=r"needs\.behind: this campaign has no bands"):
        Sweep(made).plan(Repeated(None, "hover"), behind=bare)  # type: ignore[arg-type]


def courses(**keys: Any) -> dict[str, dict[str, Spec]]:
    """Return stages of which two campaigns repeat one each: "one", and "two" with these keys."""
    flight = {"plant": "hill", "law": "hold", "needs": {"reference": "guidance"}, "follow": "rt1"}
    tables: dict[str, tuple[type[Spec], dict[str, Any]]] = {
        "one": (ClosedLoopSpec, flight),
        "two": (ClosedLoopSpec, flight | keys),
        "all": (MonteCarloSpec, {"repeat": "two", "cases": 9, "bands": ["x"]}),
        "bare": (MonteCarloSpec, {"repeat": "one", "cases": 9}),
        "swept": (SweepSpec, {"repeat": "one", "over": {"repeat.follow": ["rt1"]}}),
        "other": (MonteCarloSpec, {"repeat": "all", "cases": 9, "bands": ["x"]}),
    }
    return {"stage": {k: validate(spec, table, where=k) for k, (spec, table) in tables.items()}}


def told_behind(tables: dict[str, dict[str, Spec]], behind: str = "all", **keys: Any) -> list[str]:
    table = {"repeat": "one", "over": {"stage.one.substeps": [1, 2]}, "lines": ["x"],
             "needs": {"behind": behind}}  # fmt: skip
    made = validate(SweepSpec, table | keys, where="few")
    found = list(made.misfits(tables))
    assert all(where == ("needs", "behind") for where, _ in found)
    return [message for _, message in found]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, ""),
        ({"law": "other", "label": "b", "substeps": 3}, ""),
        ({"follow": "rt2"}, "follow is 'rt2' in its stage 'two', but 'rt1' in 'one' here"),
        ({"follow": ""}, "follow is left out in its stage 'two', but 'rt1' in 'one' here"),
        ({"plant": "solid"}, "plant is 'solid' in its stage 'two', but 'hill' in 'one' here"),
        ({"needs": {"reference": "far"}}, "needs.reference is 'far' in its stage 'two', but 'gu"),
        ({"duration_s": 600}, "duration_s is 600.0 in its stage 'two', but left out in 'one' here"),
    ],
)
def test_what_stands_behind_is_of_the_same_flight(keys: dict[str, Any], said: str) -> None:
    found = told_behind(courses(**keys))
    assert len(found) == bool(said)
    for message in found:
        assert message.startswith("stage 'all' is of another flight: ")
        assert said in message
        assert "name a campaign that repeats 'one', or give both the same " in message


def test_what_stands_behind_has_bands_of_such_a_stage() -> None:
    tables = courses()
    (bare,) = told_behind(tables, "bare")
    assert bare.startswith("stage 'bare' keeps no bands; give it bands")
    (swept,) = told_behind(tables, "swept")
    assert "is a sweep, which has no bands" in swept
    (other,) = told_behind(tables, "other")
    assert "repeats 'all', a stage of another type than 'one'" in other
    assert told_behind(tables, "absent") == []  # told elsewhere


def test_a_sweep_of_the_reference_itself_leaves_the_flight_behind() -> None:
    for key in ("repeat.follow", "stage.one.follow"):
        assert told_behind(courses(), over={key: ["rt1"]}) == []
        (message,) = told_behind(courses(), over={key: ["rt1", "rt2"]})
        assert "follow is 'rt1' in its stage 'two', but 'rt2' in 'one' here" in message
    assert told_behind(courses(follow="rt2"), over={"repeat.follow": ["rt2"]}) == []
    span = {"first": 60, "last": 600, "points": 3}
    (message,) = told_behind(courses(duration_s=60), over={"repeat.duration_s": span})
    assert "duration_s is 60.0 in its stage 'two', but swept in 'one' here" in message
