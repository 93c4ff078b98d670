"""Campaigns side by side: statistics, published values, and tests of differences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.products import CaseTable
from hillsphere.runs.judgements import RunEvidence
from hillsphere.show.outcome_specs import StatementSpec
from hillsphere.show.outcomes import Statement
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_campaigns.campaign_summary.products import CampaignSummary, PairedTest
from hillsphere_campaigns.campaign_summary.specs import CampaignSummarySpec, PairedTestSpec
from hillsphere_campaigns.campaign_summary.stage import CampaignSummaryStage, summary

LABELS = ("A", "B")


def campaign(shift: float, fails: float, n: int = 500) -> CaseTable:
    """Return cases of common draws: the metric moves by `shift`, the share that fails is given."""
    rng = np.random.default_rng(3)
    x, u = rng.normal(size=n), rng.uniform(size=n)
    failed = u < fails
    return CaseTable(
        stage="descent", design="random", planned=n, stopped="", case=np.arange(n),
        draw=np.arange(n), point=np.zeros(n, dtype=np.int64), inputs=("u",), input_units=("-",),
        input_values=u[None], metrics=("dv", "speed"), units=("m/s", "m/s"),
        values=np.array([8.0 + x + shift, 1e-3 * (2.0 + x)]),
        status=np.where(failed, "impact", "completed"), cause=np.full(n, ""), failed=failed,
        message_case=np.empty(0, dtype=np.int64), messages=(),
    )  # fmt: skip


def made(*tests: dict[str, str], worst: bool = True) -> CampaignSummary:
    tables = (campaign(0.0, 0.0), campaign(0.3, 0.2))
    hard = (campaign(0.0, 0.5, 24), campaign(0.0, 0.25, 24)) if worst else ()
    asked = [PairedTestSpec(**test) for test in tests]
    return summary(tables, hard, LABELS, asked, 0.95)


def sign(test: PairedTest) -> str:
    """Return how a statement about the difference is decided by the interval."""
    low, high = test.interval
    return "less" if high < 0.0 else "more" if low > 0.0 else "undecided"


def test_means_and_failures_are_those_of_the_cases() -> None:
    found, other = made(), campaign(0.3, 0.2)
    np.testing.assert_allclose(found.mean[0, 1], other.values[0, ~other.failed].mean(), rtol=1e-14)
    np.testing.assert_allclose(
        found.deviation[0, 1], other.values[0, ~other.failed].std(ddof=1), rtol=1e-12
    )
    assert found.failures.tolist() == [0, int(other.failed.sum())]
    assert found.worst_cases.tolist() == [24, 24]


@pytest.mark.parametrize(
    ("test", "expected"),
    [
        ({"of": "dv", "campaign": "A", "against": "B"}, "less"),
        ({"of": "dv", "campaign": "B", "against": "A"}, "more"),
        ({"of": "speed", "campaign": "A", "against": "B"}, "undecided"),
        ({"of": "failures", "campaign": "A", "against": "B"}, "less"),
        ({"of": "failures", "campaign": "B", "against": "A"}, "more"),
        ({"of": "worst", "campaign": "B", "against": "A"}, "less"),
        ({"of": "worst", "campaign": "A"}, "more"),
    ],
)
def test_differences_have_paired_intervals(test: dict[str, str], expected: str) -> None:
    (found,) = made(test).tests
    low, high = found.interval
    assert sign(found) == expected
    assert low <= found.difference <= high


def test_two_campaigns_without_a_failure_decide_nothing() -> None:
    test = PairedTestSpec(of="failures", campaign="A", against="B")
    tables = (campaign(0.0, 0.0), campaign(0.3, 0.0))
    found = summary(tables, (), LABELS, [test], 0.95).tests[0]
    assert found.interval[0] < 0.0 < found.interval[1]


@pytest.mark.parametrize("shifts", [(0.1, 0.2), (-0.1, -0.2), (0.1, -0.2)])
def test_the_interval_of_groups_holds_those_of_all_pairs(shifts: tuple[float, float]) -> None:
    tables = (campaign(0.0, 0.0), *(campaign(shift, 0.2) for shift in shifts))
    test = PairedTestSpec(of="dv", campaign="A", against="B *")
    found = summary(tables, (), ("A", "B 1", "B 2"), [test], 0.95).tests[0]
    assert found.pairs == int((~tables[1].failed).sum())
    # the same draws, moved: the differences of a pair are all alike
    np.testing.assert_allclose(found.interval, [-max(shifts), -min(shifts)], atol=1e-12)
    assert found.difference == pytest.approx(-np.mean(shifts), abs=1e-12)


def test_a_group_that_names_nothing_is_refused() -> None:
    tables, labels = (campaign(0.0, 0.0), campaign(0.3, 0.2)), LABELS
    for first, message in (("C*", "tests has no campaign 'C"), ("B", "name the same campaign")):
        test = PairedTestSpec(of="dv", campaign=first, against="B*")
        with pytest.raises(InputError, match=message):
            summary(tables, (), labels, [test], 0.95)


def test_chosen_cases_are_those_of_single_campaigns() -> None:
    with pytest.raises(ValueError, match="'worst' is about single campaigns"):
        PairedTestSpec(of="worst", campaign="A", against="B*")
    with pytest.raises(ValueError, match="only of = 'worst' can do without"):
        PairedTestSpec(of="dv", campaign="A")


def test_points_of_a_sweep_stand_for_themselves() -> None:
    whole = campaign(0.0, 0.1)
    names = ("stage.d.follow = rt2", "stage.d.follow = rt3")
    swept = replace(whole, point=np.arange(500) % 2, point_labels=names)
    found = summary((whole, swept), (), ("K rt1", "K"), (), 0.95)
    assert found.labels == ("K rt1", "K rt2", "K rt3")
    assert found.cases.tolist() == [500, 250, 250]
    odd = whole.values[0, 1::2][~whole.failed[1::2]]
    assert found.mean[0, 2] == pytest.approx(odd.mean(), rel=1e-14)


def test_published_values_stand_beside_in_their_units(tmp_path: Path) -> None:
    reference = tmp_path / "paper.csv"
    reference.write_text(
        "# source: A paper, Table 1\ncampaign,metric,mean,deviation\nA,speed,2.0,1.0\n"
        "B,failures,20,\n"
    )
    spec = CampaignSummarySpec.model_validate(
        {
            "needs": {"campaigns": ["a", "b"]}, "labels": LABELS, "units": {"speed": "mm_s"},
            "reference": str(reference),
        }
    )  # fmt: skip
    stage = CampaignSummaryStage(spec)
    tables = (campaign(0.0, 0.0), campaign(0.3, 0.2))
    product = stage.run(RecordingContext(), tables)
    check_product(product)
    shown = stage.present(product, tables)
    check_presentation(shown)
    rows = {row["name"]: row for row in shown.tables["campaign_summary"].rows}
    speed = 1e3 * tables[0].values[1].mean()
    assert rows["A, speed"]["mean"] == pytest.approx(speed, rel=1e-12)
    assert rows["A, speed"]["mean_paper"] == 2.0
    assert rows["A, speed"]["unit"] == "mm/s"
    assert rows["B, failures"]["mean_paper"] == 20.0
    reference.write_text("# source: A paper\ncampaign,metric,mean\nC,speed,2.0\n")
    with pytest.raises(InputError, match="none of its rows"):
        stage.present(product, tables)


def test_faults_name_what_is_there() -> None:
    with pytest.raises(InputError, match=r"no campaign is called 'C'.*A"):
        made({"of": "dv", "campaign": "C", "against": "A"})
    with pytest.raises(InputError, match="no metric 'dw'"):
        made({"of": "dw", "campaign": "A", "against": "B"})
    with pytest.raises(InputError, match=r"needs\.worst"):
        made({"of": "worst", "campaign": "A"}, worst=False)
    others = replace(campaign(0.0, 0.0), input_values=np.zeros((1, 500)))
    test = PairedTestSpec(of="dv", campaign="A", against="B")
    with pytest.raises(InputError, match="did not see the same draws"):
        summary((campaign(0.0, 0.0), others), (), LABELS, [test], 0.95)


def test_a_claim_rests_on_a_test() -> None:
    """The stage keeps numbers alone; the mission's claim has the text and gets the verdict."""
    spec = CampaignSummarySpec.model_validate(
        {
            "needs": {"campaigns": ["a", "b"]}, "labels": LABELS,
            "tests": [
                {"of": "dv", "campaign": "A", "against": "B"},
                {"of": "speed", "campaign": "A", "against": "B"},
            ],
        }
    )  # fmt: skip
    tables = (campaign(0.0, 0.0), campaign(0.3, 0.2))
    stage = CampaignSummaryStage(spec)
    shown = stage.present(stage.run(RecordingContext(), tables), tables)
    check_presentation(shown)
    assert not shown.verdict
    evidence = RunEvidence({"table": shown})

    def state(of: str, op: str) -> str:
        claim = {
            "text": "said", "stage": "table", "table": "campaign_tests", "column": "difference",
            "row": {"of": of, "campaign": "A", "against": "B"}, "op": op, "value": 0,
            "confidence": 0.95,
        }  # fmt: skip
        return Statement(StatementSpec.model_validate(claim)).judge(evidence).state

    assert [state("dv", "<"), state("dv", ">")] == ["confirmed", "refuted"]
    assert state("speed", "<") == "refuted"  # alike, and thus not less
