"""The pages of runs: list, report, comparison, figures, cases, missions."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starlette.testclient import TestClient
from tests.plugins.view.serving import CASES

from hillsphere.products import CaseTable
from hillsphere.products.product_codec import load_product
from hillsphere.runs.run_summary import RunSummary
from hillsphere_view.case_list import PAGE_ROWS
from hillsphere_view.overlays import overlay, read_figure
from hillsphere_view.run_folders import RunFolders
from hillsphere_view.side_by_side import compare_side_by_side


def cells(text: str) -> list[str]:
    """Return the cells of all tables of a page."""
    found = re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", text, re.DOTALL)
    return [re.sub(r"<[^>]*>", "", cell).strip() for cell in found]


def test_runs_are_listed_latest_first(client: TestClient) -> None:
    page = client.get("/").text
    assert page.index(">two</a>") < page.index(">one</a>")
    assert "2026-01-02 03:04:05" in page
    assert cells(page).count("finished") == 2


@pytest.mark.parametrize(
    ("text", "names"),
    [("", ["two", "one"]), ("2026-01-02", ["one"]), ("WAVES finished", ["two", "one"]),
     ("nothing of it", [])],
)  # fmt: skip
def test_list_is_searched_by_text(client: TestClient, text: str, names: list[str]) -> None:
    page = client.get("/", params={"q": text}).text
    assert re.findall(r'href="/runs/0/(\w+)"', page) == names


def test_list_changes_with_the_files(place: Path, tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    folders = RunFolders([folder])
    assert folders.runs() == []
    (folder / "copy").mkdir()
    for name in ("manifest.json", "summary.json"):
        (folder / "copy" / name).write_bytes((place / "runs" / "one" / name).read_bytes())
    (row,) = folders.runs()
    assert (row.key, row.mission, row.state) == ("0/copy", "waves", "finished")
    text = (folder / "copy" / "manifest.json").read_text("utf-8")
    running = text.replace('"state": "finished"', '"state": "running"', 1)
    (folder / "copy" / "manifest.json").write_text(running, "utf-8")
    # No process holds its lock: it was killed.
    assert [row.state for row in folders.runs()] == ["interrupted"]


def test_run_shows_its_outcomes_and_what_it_offers(client: TestClient) -> None:
    page = client.get("/runs/0/one").text
    assert "hillsphere run waves.toml" in page
    assert 'href="/runs/0/one/report.html"' in page
    assert 'href="/runs/0/one/cases/many"' in page
    assert 'data-src="/runs/0/one/figures/wave"' in page
    assert "/resume" not in page  # it is finished


def test_report_is_served_as_stored_with_its_own_policy(client: TestClient, place: Path) -> None:
    answer = client.get("/runs/0/one/report.html")
    assert answer.content == (place / "runs/one/report.html").read_bytes()
    policy = answer.headers["content-security-policy"]
    assert "script-src 'sha256-" in policy
    assert "default-src 'none'" in policy
    assert "sandbox" in policy
    assert "'self'" not in policy  # no script and no connection of this server's own


def test_files_of_a_run_are_saved_not_shown(client: TestClient, place: Path) -> None:
    (place / "runs/one/files/wave").mkdir(parents=True)
    (place / "runs/one/files/wave/a b.html").write_text("<script>1</script>")
    answer = client.get("/runs/0/one/files/wave/a%20b.html")
    assert answer.text == "<script>1</script>"
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.headers["content-disposition"] == "attachment; filename*=UTF-8''a%20b.html"


def test_runs_side_by_side(client: TestClient, place: Path) -> None:
    page = client.get("/compare", params={"run": ["0/one", "0/two"]}).text
    assert "stage.wave.height: 1.0 -&gt; 1.5" in page
    heights = [json.loads((place / f"runs/{name}/summary.json").read_text("utf-8"))
               ["metrics"]["height"]["value"] for name in ("one", "two")]  # fmt: skip
    shown = cells(page)
    at = shown.index("height")
    assert shown[at + 1 : at + 4] == [*(f"{v:.8g}".replace("-", "−") for v in heights), "m"]
    assert 'class="differs"' in page
    at = shown.index("cases")
    assert shown[at + 1 : at + 3] == [str(CASES)] * 2


FORM = {"Content-Type": "application/x-www-form-urlencoded"}
"""Header of an empty form, which the client leaves out."""


def test_equal_runs_differ_nowhere(client: TestClient, place: Path) -> None:
    twin = place / "runs" / "twin"
    twin.mkdir()
    try:
        for name in ("manifest.json", "summary.json"):
            (twin / name).write_bytes((place / "runs/one" / name).read_bytes())
        page = client.get("/compare", params={"run": ["0/one", "0/twin"]}).text
        assert "equal those of A" in page
        assert 'class="differs"' not in page
    finally:
        for file in twin.iterdir():
            file.unlink()
        twin.rmdir()


def test_tables_are_joined_by_their_first_column() -> None:
    runs = [_run([("a", 1.0, 5.0), ("b", 2.0, 5.0)]), _run([("b", 3.0, 5.0), ("c", 4.0, 5.0)])]
    (table,) = compare_side_by_side(runs).tables
    assert [head[::2] for head in table.heads] == [
        ("name", ""), ("value", "A"), ("value", "B"), ("same", "A"), ("same", "B"),
    ]  # fmt: skip
    assert [(key, [c.text for c in row]) for key, row in table.rows] == [
        ("a", ["1", "–", "5", "–"]), ("b", ["2", "3", "5", "5"]), ("c", ["–", "4", "–", "5"]),
    ]  # fmt: skip
    marked = [[c.differs for c in row] for _, row in table.rows]
    assert marked == [
        [False, True, False, True], [False, True, False, False], [False, True, False, True],
    ]  # fmt: skip


def _run(rows: list[tuple[str, float, float]]) -> RunSummary:
    names = ("name", "value", "same")
    columns = [{"name": n, "unit": "", "label": "", "digits": 6} for n in names]
    table = {"columns": columns, "rows": [dict(zip(names, row, strict=True)) for row in rows]}
    manifest: dict[str, Any] = {"mission": {}, "versions": {}, "platform": {}, "stages": {}}
    return RunSummary(Path("x"), manifest, {"metrics": {}, "tables": {"t": table}, "verdict": {}})


def test_figures_lie_over_each_other(client: TestClient, place: Path) -> None:
    answer = client.get("/compare/figure?run=0/one&run=0/two&name=wave")
    traces = answer.json()["data"]
    assert [t["name"] for t in traces] == ["A: wave", "B: wave"]
    assert [t["line"]["dash"] for t in traces] == ["solid", "dash"]
    ends = [np.frombuffer(b64decode(t["y"]["bdata"]), t["y"]["dtype"])[-1] for t in traces]
    np.testing.assert_allclose(ends, [1.0, 1.5], rtol=1e-6)
    single = client.get("/runs/0/one/figures/wave").json()
    assert len(single["data"]) == 1


def test_figure_brings_no_link_picture_or_map() -> None:
    figure = read_figure(
        json.dumps(
            {
                "data": [{"type": "scattergeo"}, {"type": "scatter", "name": "<A HREF='x'>y</a>"}],
                "layout": {"images": [{"source": "http://x"}], "map": {}, "updatemenus": [],
                           "xaxis": {"title": {"text": "<b>t</b>"}}},
                "height": 10**9,
            }
        ).encode(),
        "f",
    )  # fmt: skip
    assert figure == {
        "data": [{"type": "scatter", "name": "y"}],
        "layout": {"xaxis": {"title": {"text": "<b>t</b>"}}},
        "height": 400,
    }


def test_ranges_that_differ_are_left_to_the_plot() -> None:
    figures = {
        letter: {"data": [], "layout": {"xaxis": {"range": [0, end], "type": "log"},
                                        "yaxis": {"range": [0, 1]}}, "height": 9}
        for letter, end in (("A", 1), ("B", 2))
    }  # fmt: skip
    layout = overlay(figures)["layout"]
    assert layout["xaxis"] == {"type": "log"}
    assert layout["yaxis"] == {"range": [0, 1]}


def test_cases_are_listed_a_page_at_a_time(client: TestClient, place: Path) -> None:
    numbers = []
    for page in (1, 2, 3):
        text = client.get(f"/runs/0/one/cases/many?page={page}").text
        numbers.append([int(n) for n in re.findall(r"cases/many/(\d+)\"", text)])
    assert [len(n) for n in numbers] == [PAGE_ROWS, PAGE_ROWS, CASES - 2 * PAGE_ROWS]
    assert [n for page in numbers for n in page] == list(range(CASES))


def test_cases_are_filtered(client: TestClient, place: Path) -> None:
    table: CaseTable = load_product(place / "runs/one/many.npz")
    undecided = table.case[table.status == "error"].tolist()
    assert undecided == [70]
    folded = table.values[table.metrics.index("folded")]
    low, high = np.nanquantile(folded, [0.5, 0.6])
    inside = table.case[(folded >= low) & (folded <= high)].tolist()

    def listed(**query: Any) -> list[int]:
        text = client.get("/runs/0/one/cases/many", params=query).text
        return [int(n) for n in re.findall(r"cases/many/(\d+)\"", text)]

    assert listed(**{"class": "undecided"}) == undecided
    assert listed(status="error") == undecided
    assert listed(metric="folded", low=repr(float(low)), high=repr(float(high))) == inside
    assert 0 < len(inside) < PAGE_ROWS
    assert listed(**{"class": "failure"}) == []
    assert client.get("/runs/0/one/cases/many?metric=none").status_code == 422
    assert client.get("/runs/0/one/cases/many?low=much").status_code == 422


def test_case_shows_inputs_metrics_and_message(client: TestClient, place: Path) -> None:
    table: CaseTable = load_product(place / "runs/one/many.npz")
    page = client.get("/runs/0/one/cases/many/3").text
    value = float(table.values[0, 3])
    assert f"{value:.10g}".replace("-", "−") in cells(page)
    assert "the wave" in client.get("/runs/0/one/cases/many/70").text
    assert client.get("/runs/0/one/cases/many/230").status_code == 404
    assert client.get("/runs/0/one/cases/wave").status_code == 404


def test_missions_are_offered_with_their_profiles(client: TestClient) -> None:
    page = client.get("/start").text
    assert 'href="/start/file%3A0"' in page
    assert 'href="/start/phobos-qso"' in page
    assert "<option>fast</option>" in client.get("/start/phobos-qso").text
    assert "[dispersions.start]" in client.get("/start/file:0").text


def test_problems_are_shown_with_their_lines(client: TestClient, place: Path) -> None:
    answer = client.post(
        "/start/file:0/run", data={"sets": "stage.wave.steps=0\nstage.many.cases=x\n\n"}
    )
    assert answer.status_code == 422
    problems = answer.json()["problems"]
    assert any(
        p.startswith("--set stage.wave.steps=…: stage.wave.steps: must be") for p in problems
    )
    assert any(p.startswith("--set stage.many.cases=…: ") for p in problems)
    mission = place / "waves.toml"
    text = mission.read_text("utf-8")
    try:
        mission.write_text(text.replace('type = "wave"', 'type = "weve"'), "utf-8")
        (problem, *_) = client.post("/start/file:0/run", headers=FORM).json()["problems"]
        assert re.search(r"waves\.toml:\d+: stage\.wave\.type: ", problem)
    finally:
        mission.write_text(text, "utf-8")
    assert sorted(path.name for path in (place / "runs").iterdir()) == ["one", "two"]
