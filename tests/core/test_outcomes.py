"""Requirements and claims: intervals decide, units are converted, what is missing is undecided."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hillsphere.base.errors import InputError
from hillsphere.cli.verdict import show_verdict
from hillsphere.interfaces.outcomes import Judgement, MissingResultError
from hillsphere.mission import Mission, MissionError, load_mission
from hillsphere.plugins import default_registry
from hillsphere.presentation import Column, Metric, Presentation, Printed, Table
from hillsphere.runs.judgements import RunEvidence
from hillsphere.show.outcome_specs import (
    ComparisonSpec,
    NotDerivableSpec,
    StatementSpec,
    ValueSpec,
)
from hillsphere.show.outcomes import Comparison, NotDerivable, Statement, Value
from hillsphere.spec.base import ResultNames, StageSpec
from hillsphere.spec.result_names import is_named, nearest_name

METRICS = {
    "speed": Metric(1.19, "m/s"),
    "failures": Metric(2.0, "%", (1.0, 4.0), 0.95),
    "stable": Metric(True),
    "count": Metric(3),
    "pull": Metric(0.002, "m/s2"),
    "word": Metric("round"),
    "nan": Metric(float("nan"), "m"),
    "upper": Metric(1.2, "-", (0.9, 1.2), 1.0),
    "unbounded": Metric(1.2, "-", None, 1.0),
}
ORBITS = Table(
    "Orbits",
    [
        Column("name", ""), Column("x_km", "km", interval=("low_km", "high_km"), confidence=0.99),
        Column("x_km_paper", "km"), Column("low_km", "km"), Column("high_km", "km"),
        Column("v_m_s", "m/s"), Column("v_paper", "m/s"),
    ],
    [
        {"name": "A", "x_km": 7.587, "x_km_paper": Printed("7.59"), "low_km": 7.5, "high_km": 7.6,
         "v_m_s": 1.0, "v_paper": Printed("1.0")},
        {"name": "B", "x_km": 5.766, "x_km_paper": Printed("5.76"), "low_km": 5.0, "high_km": 6.0,
         "v_m_s": None},
    ],
)  # fmt: skip
EVIDENCE = RunEvidence({"fly": Presentation(metrics=METRICS, tables={"orbits": ORBITS})})


def judge(**keys: Any) -> Judgement:
    keys = {"text": "t", "stage": "fly", "op": "<="} | keys
    return Value(ValueSpec.model_validate(keys)).judge(EVIDENCE)


@pytest.mark.parametrize(
    ("keys", "state", "asked", "got", "margin"),
    [
        ({"metric": "speed", "value": 2}, "met", "≤ 2 m/s", "1.19 m/s", 0.81),
        ({"metric": "speed", "value": 1}, "not met", "≤ 1 m/s", "1.19 m/s", -0.19),
        ({"metric": "speed", "value": 119, "unit": "cm/s"}, "met", "≤ 119 cm/s", "1.19 m/s", 0.0),
        ({"metric": "speed", "op": ">=", "value": 1}, "met", "≥ 1 m/s", "1.19 m/s", 0.19),
        ({"metric": "stable", "op": "==", "value": True}, "met", "yes", "yes", None),
        ({"metric": "word", "op": "!=", "value": "flat"}, "met", "not flat", "round", None),
        ({"metric": "count", "op": "==", "value": 3}, "met", "3", "3", 0.0),
        ({"metric": "pull", "value": 3, "unit": "mm/s²"}, "met", "≤ 3 mm/s²", "0.002 m/s2",
         0.001),
        ({"metric": "nan", "value": 3}, "undecided", "≤ 3 m", "nan m", None),
        # every row must comply, the worst is shown
        ({"table": "orbits", "column": "x_km", "value": 8}, "met", "≤ 8 km", "7.587 km, A", 0.413),
        ({"table": "orbits", "column": "x_km", "row": {"name": "B"}, "value": 6}, "met", "≤ 6 km",
         "5.766 km", 0.234),
        ({"table": "orbits", "column": "x_km", "value": 6}, "not met", "≤ 6 km", "7.587 km, A",
         -1.587),
    ],
)  # fmt: skip
def test_values(
    keys: dict[str, Any], state: str, asked: str, got: str, margin: float | None
) -> None:
    one = judge(**keys)
    assert (one.state, one.asked, one.got) == (state, asked, got)
    if margin is None:
        assert one.margin is None or one.margin != one.margin
    else:
        assert one.margin == pytest.approx(margin, abs=1e-12)


@pytest.mark.parametrize(
    ("keys", "state"),
    [
        ({"value": 4.0, "confidence": 0.95}, "met"),  # the worse end meets it
        ({"value": 3.9, "confidence": 0.95}, "undecided"),
        ({"value": 1.0, "confidence": 0.95}, "undecided"),  # the better end is the limit itself
        ({"value": 0.9, "confidence": 0.95}, "not met"),  # the better end misses it
        ({"value": 0.9, "confidence": 0.99}, "undecided"),  # the interval is not as sure
        ({"value": 4.0, "confidence": 0.9}, "met"),
        ({"op": ">=", "value": 1.0, "confidence": 0.95}, "met"),
        ({"op": ">=", "value": 4.1, "confidence": 0.95}, "not met"),
        ({"op": "==", "value": 2.0, "confidence": 0.95}, "undecided"),
        ({"op": "==", "value": 5.0, "confidence": 0.95}, "not met"),
        ({"op": "!=", "value": 5.0, "confidence": 0.95}, "met"),
        ({"op": "!=", "value": 2.0, "confidence": 0.95}, "undecided"),
        ({"value": 3.9}, "met"),  # without a confidence the value itself decides
        ({"metric": "speed", "value": 3.9, "confidence": 0.5}, "undecided"),  # no interval
    ],
)
def test_an_interval_decides(keys: dict[str, Any], state: str) -> None:
    one = judge(**({"metric": "failures"} | keys))
    assert one.state == state
    assert bool(one.reason) == (state == "undecided")


@pytest.mark.parametrize(
    ("interval", "shown"),
    [
        ((1.0, 4.0), "2 % (1 to 4)"),
        ((1.0, math.inf), "2 % (at least 1)"),
        ((-math.inf, 4.0), "2 % (at most 4)"),
        ((-math.inf, math.inf), "2 % (no finite end)"),
    ],
)
def test_an_interval_without_an_end_is_told_in_words(
    interval: tuple[float, float], shown: str
) -> None:
    metrics = {"share": Metric(2.0, "%", interval, 0.95)}
    evidence = RunEvidence({"fly": Presentation(metrics=metrics)})
    keys = {"text": "t", "stage": "fly", "op": "<=", "metric": "share", "value": 5}
    spec = ValueSpec.model_validate({**keys, "confidence": 0.95})
    assert Value(spec).judge(evidence).got == shown


@pytest.mark.parametrize(
    ("keys", "state"),
    [
        ({"op": "<", "value": 1.3}, "met"),
        ({"op": "<", "value": 1.0}, "undecided"),  # an upper bound above a limit refutes nothing
        ({"op": "<", "value": 0.8}, "not met"),  # the lower bound exceeds the limit
        ({"op": ">", "value": 1.0}, "undecided"),
        ({"op": ">", "value": 0.8}, "met"),
        ({"op": "<", "value": 1.0, "confidence": 0.95}, "undecided"),
        ({"metric": "unbounded", "value": 1.3}, "undecided"),
    ],
)
def test_proved_bounds_always_decide(keys: dict[str, Any], state: str) -> None:
    one = judge(**({"metric": "upper"} | keys))
    assert one.state == state
    assert bool(one.reason) == (state == "undecided")


def test_proved_bounds_are_shown() -> None:
    one = judge(metric="upper", op="<", value=1.0)
    assert one.got == "1.2 (0.9 to 1.2)"
    assert one.reason == "the limit lies between the proved bounds of the result"


def test_a_column_has_intervals_too() -> None:
    keys = {"table": "orbits", "column": "x_km", "row": {"name": "B"}, "confidence": 0.95}
    assert judge(**keys, value=6.0).state == "met"
    assert judge(**keys, value=5.9).state == "undecided"
    assert judge(**keys, value=6.0).got == "5.766 km (5 to 6)"


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"metric": "sped", "value": 1}, "no metric 'sped'; did you mean 'speed'"),
        ({"table": "orbit", "column": "a", "value": 1}, "no table 'orbit'; did you mean 'orbits'"),
        ({"table": "orbits", "column": "x", "value": 1}, "no column 'x'"),
        ({"table": "orbits", "column": "x_km", "row": {"name": "C"}, "value": 1},
         "no row with name = 'C'"),
        ({"metric": "speed", "value": 1, "unit": "km"}, "is in m/s, and the value in km"),
        ({"metric": "word", "value": 1}, "is a text, and is compared with a number"),
    ],
)  # fmt: skip
def test_what_is_missing_is_named(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(MissingResultError, match=message.replace("(", r"\(")):
        judge(**keys)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"value": 1}, "give either 'metric', or 'table' and 'column'"),
        ({"metric": "a", "table": "b", "value": 1}, "give either 'metric'"),
        ({"table": "b", "value": 1}, "belong together"),
        ({"metric": "a", "row": {"b": 1}, "value": 1}, "selects rows"),
        ({"metric": "a", "value": True}, "can only be compared by '=='"),
        ({"metric": "a", "op": "==", "value": "b", "unit": "m"}, "has no unit"),
    ],
)
def test_rules_between_keys(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        judge(**keys)


def test_a_comparison_counts_cells_and_names_the_deviating_ones() -> None:
    def compare(**keys: Any) -> Judgement:
        keys = {"text": "Table 1", "stage": "fly", "table": "orbits"} | keys
        return Comparison(ComparisonSpec.model_validate(keys)).judge(EVIDENCE)

    one = compare()
    assert (one.state, one.got, one.asked) == ("refuted", "2 of 3 equal", "3 printed values")
    assert one.reason == "B, x_km: 5.766 for 5.76"
    assert compare(columns=["v_m_s"]).state == "confirmed"
    assert compare(row={"name": "A"}).got == "2 of 2 equal"
    assert compare(last_digits=0.61).state == "confirmed"
    with pytest.raises(MissingResultError, match="no published values"):
        compare(columns=["low_km"])


def test_a_comparison_may_bring_its_own_values(tmp_path: Path) -> None:
    file = tmp_path / "paper.csv"
    file.write_text("# source: A paper, Table 2\nname,low_km,high_km\nA,7.5,7.7\n", "utf-8")
    spec = ComparisonSpec(
        text="t",
        stage="fly",  # type: ignore[arg-type]
        table="orbits",
        reference=str(file),
        on="name",
    )
    one = Comparison(spec).judge(EVIDENCE)
    assert (one.state, one.got, one.source) == ("refuted", "1 of 2 equal", "A paper, Table 2")
    file.write_text("name\nA\n", "utf-8")
    with pytest.raises(InputError, match=r"paper\.csv:1: no citation"):
        Comparison(spec)


def test_other_claims() -> None:
    keys = {"text": "t", "stage": "fly", "metric": "stable", "op": "==", "value": False}
    assert Statement(StatementSpec.model_validate(keys)).judge(EVIDENCE).state == "refuted"
    lost = NotDerivable(NotDerivableSpec(text="t", reason="no weights")).judge(EVIDENCE)
    assert (lost.state, lost.reason) == ("not derivable", "no weights")


MISSION = """format = 1
name = "small"
title = "Small"
seed = 1
[body.moon]
type = "moon"
name = "moon"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
[gravity.point]
type = "point_mass"
gm_km3_s2 = 7e-4
[plant.hill]
type = "hill"
body = "moon"
gravity = "point"
[stage.points]
type = "equilibria"
plant = "hill"
[stage.more]
type = "equilibria"
plant = "hill"
[requirement.near]
text = "equilibria are near"
stage = "points"
table = "equilibrium_points"
column = "distance_m"
op = "<="
value = 40
unit = "km"
[profile.near]
requirement.near.value = 10
[profile.few]
drop = ["stage.more"]
"""


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str], Path]:
    def write(more: str) -> Path:
        path = tmp_path / "small.toml"
        head, _, tail = MISSION.partition("[profile.near]")
        path.write_text(f"{head}{more}\n[profile.near]{tail}", "utf-8")
        return path

    return write


def test_a_requirement_may_refer_to_a_dropped_stage(write: Callable[[str], Path]) -> None:
    path = write(
        '[claim.more]\ntext = "more"\nstage = "more"\nmetric = "l1_distance"\n'
        'op = "=="\nvalue = 1\n'
    )
    for profile in (None, "near", "few"):
        mission = load_mission(path, profile=profile)
        assert mission.specs["requirement"]["near"].value == (10 if profile == "near" else 40)  # type: ignore[attr-defined]
    with pytest.raises(MissionError, match="no stage table is named 'moer'; did you mean 'more'"):
        load_mission(write('[claim.m]\ntext = "m"\nstage = "moer"\nmetric = "x"\n'
                           'op = "=="\nvalue = 1\n'))  # fmt: skip


def test_faults_have_lines(write: Callable[[str], Path]) -> None:
    path = write('[claim.a]\ntext = "m"\nstage = "more"\nmetrc = "x"\nop = "=<"\nvalue = 1\n')
    with pytest.raises(MissionError) as caught:
        load_mission(path)
    text = str(caught.value)
    assert "small.toml:34: claim.a.metrc: unknown key 'metrc'; did you mean 'metric'" in text
    assert "small.toml:35: claim.a.op: must be one of '<=', '<', '>=', '>', '==', '!='" in text


def test_exit_code_and_summary(write: Callable[[str], Path], tmp_path: Path) -> None:
    from hillsphere.cli.endings import run

    path = write('[claim.lost]\ntype = "not_derivable"\ntext = "l"\nreason = "no data"\n')
    out = iter(range(9))

    def ends(*arguments: str) -> tuple[int, dict[str, Any]]:
        where = tmp_path / f"out{next(out)}"
        code = run(["run", str(path), "--out", str(where), *arguments])
        return code, json.loads((where / "summary.json").read_text("utf-8"))

    code, summary = ends()
    assert code == 0
    (near,) = summary["requirements"]
    assert near["state"] == "met"
    assert set(near) >= {"name", "asked", "got", "margin", "confidence", "state", "source"}
    assert summary["verdict"]["text"] == "1 of 1 requirement met, no claim evaluated"
    assert ends("--profile", "near")[0] == 4
    code, summary = ends("--set", "requirement.near.column=distnce_m")
    assert code == 4
    assert summary["requirements"][0]["state"] == "undecided"
    assert "did you mean 'distance_m'" in summary["requirements"][0]["reason"]
    code, summary = ends("--set", "stage.points=false")
    assert code == 0
    assert summary["requirements"][0]["state"] == "not evaluated"


def test_a_blank_cell_hides_no_violation() -> None:
    column = {"table": "orbits", "column": "v_m_s"}
    one = judge(**column, value=2)
    assert (one.state, one.reason) == ("undecided", "column 'v_m_s' has no value in the row B")
    assert judge(**column, value=0.5).state == "not met"


@pytest.mark.parametrize(
    ("value", "limit", "unit", "op", "state", "asked", "got"),
    [
        (1.00004, 1.0, "", "<=", "not met", "≤ 1 m", "1.00004 m"),
        (12345.62, 12345.6, "", "<=", "not met", "≤ 12345.6 m", "12345.62 m"),
        (0.35, 35, "cm", "==", "met", "35 cm", "0.35 m"),
        (0.35, 35, "cm", ">=", "met", "≥ 35 cm", "0.35 m"),
        (0.35, 35, "cm", "<", "not met", "< 35 cm", "0.35 m"),
        (1e4, 10, "km", "<=", "met", "≤ 10 km", "1e4 m"),
    ],
)
def test_rows_show_why_they_are_met(
    value: float, limit: float, unit: str, op: str, state: str, asked: str, got: str
) -> None:
    evidence = RunEvidence({"fly": Presentation(metrics={"a": Metric(value, "m")})})
    keys = {"text": "t", "stage": "fly", "metric": "a", "op": op, "value": limit, "unit": unit}
    one = Value(ValueSpec.model_validate(keys)).judge(evidence)
    assert (one.state, one.asked, one.got) == (state, asked, got)


def test_a_truth_value_is_no_number() -> None:
    with pytest.raises(MissingResultError, match="is true or false, and is compared with a number"):
        judge(metric="stable", op="<=", value=1)


def test_every_published_row_and_column_must_be_computed(tmp_path: Path) -> None:
    file = tmp_path / "paper.csv"

    def compare(text: str, **keys: Any) -> Judgement:
        file.write_text(f"# source: A paper\n{text}", "utf-8")
        spec = {
            "text": "t",
            "stage": "fly",
            "table": "orbits",
            "reference": str(file),
            "on": "name",
        }
        return Comparison(ComparisonSpec.model_validate(spec | keys)).judge(EVIDENCE)

    for text, message in (
        ("name,x_kn\nA,7.59\n", "published column 'x_kn' is not computed; did you mean 'x_km'"),
        ("name,x_km\nA,7.59\nC,1.0\n", "not computed: published rows with name C"),
        ("nam,x_km\nA,7.59\n", "have no column 'name'"),
    ):
        with pytest.raises(MissingResultError, match=message):
            compare(text)
    # a number belongs to the printed one that it agrees with
    assert compare("x_km,high_km\n7.59,7.6\n5.77,6.0\n", on="x_km").got == "2 of 2 equal"
    with pytest.raises(MissingResultError, match="column 'v_m_s' has no published values"):
        compare("name,x_km\nA,7.59\nB,5.77\n", columns=["x_km", "v_m_s"])


def test_a_finished_run_that_is_resumed_ends_with_its_verdict(
    write: Callable[[str], Path], tmp_path: Path
) -> None:
    from hillsphere.cli.endings import run

    path, out = write(""), str(tmp_path / "out")
    arguments = ("--set", "requirement.near.value=10", "--workers", "0")
    assert run(["run", str(path), "--out", out, *arguments]) == 4
    assert run(["report", out]) == 4
    assert run(["resume", out, "--mission", str(path)]) == 4


@pytest.mark.parametrize(
    ("text", "key", "message"),
    [
        ('answer = "It is {requirement.naer}."', "report.answer", "did you mean 'near'"),
        ('answer = "{pionts.metric}"', "report.answer", "no stage table is named 'pionts'"),
        ('answer = "{Requirement.near}"', "report.answer", "is no placeholder"),
        ('numbers = ["naer"]', "report.numbers[0]", "did you mean 'near'"),
        ('answer = "{points.metric}"', "report.answer",
         "stage 'points' has no metric 'metric'; it has: *_distance"),
        ('numbers = ["points.x"]', "report.numbers[0]", "stage 'points' has no metric 'x'"),
        ('figure = "pionts.orbits"', "report.figure", "did you mean 'points'"),
        ('[[report.section]]\ntitle = "A"\nshow = ["pionts"]', "report.section[0].show[0]",
         "did you mean 'points'"),
    ],
)  # fmt: skip
def test_names_in_the_report_are_checked(
    write: Callable[[str], Path], text: str, key: str, message: str
) -> None:
    with pytest.raises(MissionError) as caught:
        load_mission(write(f"[report]\n{text}\n"))
    assert f"{key}: " in str(caught.value)
    assert message in str(caught.value)


def test_the_report_may_name_what_a_profile_drops(write: Callable[[str], Path]) -> None:
    path = write('[report]\nanswer = "{more.metric}"\nfigure = "more.orbits"\n')
    assert load_mission(path, profile="few").report.figure == "more.orbits"


def about_deimos(**requirement: Any) -> dict[str, Any]:
    """Return a mission with a stage that lists the names of its results, and a requirement."""
    stage = {"type": "qso_family", "plant": "hill", "x_amplitudes_km": [60], "label": "own"}
    body = {"type": "moon", "primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 23463}
    gravity = {"type": "point_mass", "gm_km3_s2": 1e-4}
    return {
        "title": "Deimos", "seed": 1, "body": {"deimos": body}, "gravity": {"deimos": gravity},
        "plant": {"hill": {"type": "hill", "body": "deimos", "gravity": "deimos"}},
        "stage": {"family": stage},
        "requirement": {"closed": {"text": "t", "stage": "family", "op": "<=", "value": 1}
                        | requirement},
    }  # fmt: skip


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"metric": "closure_own"},
         "closed.metric: stage 'family' has no metric 'closure_own'; did you mean "
         "'closure_max_own'? It has: closure_max_own, jacobi_drift_max_own, "),
        ({"metric": "closure_max"}, "has no metric 'closure_max'; did you mean 'closure_max_own'?"),
        ({"table": "tabel_1_own", "column": "x0_km"},
         "closed.table: stage 'family' has no table 'tabel_1_own'; did you mean 'table_1_own'?"),
        ({"table": "table_1_own", "column": "x0_m"},
         "closed.column: table 'table_1_own' of stage 'family' has no column 'x0_m'; did you mean "
         "'x0_km'?"),
        ({"table": "table_1_own", "column": "x0_km", "row": {"nme": "A"}},
         "closed.row.nme: table 'table_1_own' of stage 'family' has no column 'nme'; did you mean "
         "'name'?"),
    ],
)  # fmt: skip
def test_names_that_a_stage_does_not_have_are_refused_before_the_run(
    keys: dict[str, Any], message: str
) -> None:
    with pytest.raises(MissionError) as caught:
        Mission.from_dict(about_deimos(**keys))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "keys", [{"metric": "closure_max_own"}, {"table": "table_1_own", "column": "x0_km_paper"}]
)
def test_names_that_a_stage_has_are_accepted(keys: dict[str, Any]) -> None:
    assert Mission.from_dict(about_deimos(**keys)).order() == ["family"]


def test_the_examples_name_results_of_a_stage() -> None:
    spec = default_registry().get("stage", "qso_family").load_spec()
    assert issubclass(spec, StageSpec)
    names = spec.results
    assert names is not None
    for example in (*ValueSpec.examples, *ComparisonSpec.examples):
        assert example.get("metric", "closure_max") in names.metrics
        table = example.get("table", "table_1")
        assert example.get("column", "name") in names.tables[table]


def test_names_may_depend_on_the_mission() -> None:
    names = ResultNames(("*_upper", "loops"), {"models_*": ("model",)}).with_label("b")
    assert is_named("gain_upper_b", names.metrics)
    assert not is_named("gain_upper", names.metrics)
    assert names.columns_of("models_gain_b") == ("model",)
    assert names.columns_of("models") == ()
    assert nearest_name("lops_b", names.metrics).startswith("; did you mean 'loops_b'?")


def test_the_terminal_shows_the_whole_reason_of_an_undecided_row(
    capsys: pytest.CaptureFixture[str],
) -> None:
    reason = f"mission.toml:7: stage 'family' has no metric {'m' * 150!r}; it has: {'n' * 200}"
    row = {"text": "closed", "asked": "<= 1", "got": "", "margin": None, "state": "undecided",
           "reason": reason}  # fmt: skip
    verdict = {"state": "success", "text": "0 of 1 requirements met"}
    show_verdict({"mission": "m", "verdict": verdict, "requirements": [row]}, Path("r.html"),
                 verbose=False)  # fmt: skip
    assert f"undecided: {reason}\n" in capsys.readouterr().out
