"""The report: one page that needs nothing but itself, and figures that are the same every time."""

from __future__ import annotations

import math
import re
import zlib
from base64 import b64decode, b64encode
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree as ET

import matplotlib as mpl
import pytest

from hillsphere.interfaces.outcomes import Judgement
from hillsphere.mission.report_spec import ReportSpec, SectionSpec
from hillsphere.presentation import (
    PALETTE,
    Axis,
    Cell,
    Chart,
    Column,
    Curve,
    Figure,
    Metric,
    Panel,
    Presentation,
    Printed,
    Table,
    presentation_faults,
)
from hillsphere.show.drawing import Drawing, draw
from hillsphere.show.html_tables import MAX_ROWS
from hillsphere.show.plotly_renderer import plotly_figure
from hillsphere.show.report import render
from hillsphere.show.report_content import Report, ShownFigure, StageResult

VOID = {"meta", "img", "br", "hr", "input"}


class Page(HTMLParser):
    """Checks that elements nest, and collects links, tables and text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.cells: list[str] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("td", "th"):
            self.cells.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not {"style", "script"} & set(self.open):
            self.text += data
        if {"td", "th"} & set(self.open):
            self.cells[-1] += data


def plot(figure: Any) -> None:
    axes = figure.add_subplot()
    axes.plot([0, 1], [1, 0], label="line")
    axes.legend()
    axes.set_xlabel("x [km]")


FIGURE = Figure("A <figure>", plot, "What & how")
LINE = Panel(Axis("x", "km"), Axis("y"), [Curve([0, 1], [1, 0], "</script>")])
CHART = Chart("A <chart>", [LINE], "What & how")


def shown(figure: Figure | Chart = FIGURE) -> ShownFigure:
    data = plotly_figure(figure) if isinstance(figure, Chart) else None
    return ShownFigure(figure, data, None if data else draw(figure))


def page(*stages: StageResult, **changes: Any) -> tuple[str, Page]:
    content: dict[str, Any] = {
        "mission": "small", "title": "", "description": "", "profile": "", "verdict": "all is well",
        "spec": ReportSpec(), "requirements": {}, "claims": {}, "stages": stages,
        "started": "2026-11-21T03:04:05Z", "seconds": 4.2, "command": "hillsphere run small",
        "mission_text": "", "versions": {"numpy": "2"},
    }  # fmt: skip
    text = render(Report(**(content | changes)))
    return text, Page(text)


def test_shapes_and_gravity_are_described() -> None:
    _, found = page(descriptions={"shape.eros": ("8 triangles", "volume <4 km³")})
    assert "shape.eros: 8 triangles; volume <4 km³" in found.text
    assert "Shapes and gravity" not in page()[1].text


def test_page_asks_for_nothing_outside_itself() -> None:
    stage = StageResult("one", "make", figures={"f": shown(), "c": shown(CHART)})
    text, found = page(stage)
    policy = next(a for t, a in found.elements if t == "meta" and "http-equiv" in a)["content"]
    assert policy is not None
    assert policy.startswith("default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; ")
    assert not {t for t, _ in found.elements} & {"link", "iframe", "object", "base"}
    assert not [a for t, a in found.elements if t == "script" and "src" in a]
    sources = [a["src"] or "" for t, a in found.elements if t == "img"]
    assert [s[:26] for s in sources] == ["data:image/svg+xml;base64,"]
    assert all((a["href"] or "").startswith("#") for t, a in found.elements if t == "a")
    assert "@import" not in text


def test_policy_allows_the_two_scripts_of_the_page_only() -> None:
    stage = StageResult("one", "make", figures={"c": shown(CHART)})
    text, _ = page(stage)
    allowed = set(re.findall(r"'sha256-([^']+)'", text.partition("<title>")[0]))
    blocks = re.findall(r"<script([^>]*)>(.*?)</script>", text, re.DOTALL)
    own = [body for attributes, body in blocks if not attributes]
    packed = [body for attributes, body in blocks if 'id="plotly"' in attributes]
    assert (len(own), len(packed)) == (1, 1)
    library = zlib.decompress(b64decode(packed[0])).decode()
    assert "plotly.js" in library[:100]
    assert allowed == {
        b64encode(sha256(script.encode()).digest()).decode() for script in (own[0], library)
    }
    plain, _ = page(StageResult("one", "make"))
    assert len(re.findall("'sha256-", plain)) == 1
    assert len(plain) < 40_000


def test_links_lead_to_parts_of_the_page() -> None:
    spec = ReportSpec(section=(SectionSpec(title="First", show=("one",)),))
    _, found = page(
        StageResult("one", "make", tables={"t": Table("T", [Column("a")], [])}),
        StageResult("two-b", "make"), spec=spec,
    )  # fmt: skip
    ids = {a["id"] for _, a in found.elements if "id" in a}
    links = {a["href"] for t, a in found.elements if t == "a"} - {"tables/t.csv"}
    assert links == {"#answer", "#section-1", "#results", "#run", "#table-t"}
    assert links <= {f"#{i}" for i in ids}


def test_everything_is_escaped() -> None:
    evil = "<script>alert('1')</script>&\"'"
    table = Table(evil, [Column(evil, evil, evil), Column("t", "")], [{evil: evil, "t": evil}],
                  [evil])  # fmt: skip
    stage = StageResult(
        "one", evil, evil, "failed", message=evil, notes=[evil],
        metrics={evil: Metric(evil, evil)}, tables={"t": table}, files=(evil,),
        figures={"f": ShownFigure(Figure(evil, plot, evil), None, draw(FIGURE)),
                 "c": ShownFigure(replace(CHART, title=evil), plotly_figure(CHART))},
    )  # fmt: skip
    fields = ("mission", "title", "description", "command", "mission_text", "started", "profile")
    outcome = Judgement("met", evil, evil, evil, evil, unit=evil, reason=evil, source=evil)
    spec = ReportSpec(
        question=evil, answer=evil, section=(SectionSpec(title=evil, text=evil, show=("one",)),)
    )
    text, found = page(
        stage, versions={evil: evil}, spec=spec, requirements={"a": outcome},
        claims={"b": replace(outcome, state="confirmed")}, **dict.fromkeys(fields, evil),
    )  # fmt: skip
    assert "<script>alert" not in text
    kinds = [a.get("type") for t, a in found.elements if t == "script"]
    assert kinds == ["application/json", "text/plain", None]
    assert found.text.count(evil) >= 25


def test_first_screen_answers_with_numbers() -> None:
    spec = ReportSpec(
        question="Is it small?",
        answer="It is {requirement.small}, and {one.mass} heavy: {requirement.light.state}.",
        numbers=("small", "one.mass"), figure="one.f",
        section=(SectionSpec(title="How", text="By care. And luck.", show=("one.t", "one.f")),),
    )  # fmt: skip
    stage = StageResult(
        "one", "make", own_metrics={"mass": Metric(2.5, "kg")},
        tables={"t_one": Table("Sizes", [Column("a_km", "km")], [{"a_km": 1.0}])},
        figures={"f_one": shown()}, own_tables={"t": "t_one"}, own_figures={"f": "f_one"},
    )  # fmt: skip
    outcomes = {
        "small": Judgement("met", "size", "≤ 2 m", "1.5 m", 1.5, 2.0, "m"),
        "light": Judgement("undecided", "weight", reason="no scale"),
    }
    text, found = page(stage, spec=spec, requirements=outcomes)
    assert "It is 1.5 m, and 2.5 kg heavy: undecided." in found.text
    screen = text.partition("<main>")[2].partition("<details")[0]
    for part in ("Is it small?", "<span class=big>1.5 <span class=unit>m</span>",
                 "asked ≤\N{NO-BREAK SPACE}2\N{NO-BREAK SPACE}m", "2.5 <span class=unit>kg</span>",
                 "no scale", 'id="figure-f_one"'):  # fmt: skip
        assert part in screen
    assert "— By care" in text
    assert text.count('id="figure-f_one"') == 1
    assert "shown above" in text  # in the section, which names it too


def test_cards_say_what_was_asked_and_what_was_published() -> None:
    spec = ReportSpec(numbers=("closed", "table_1", "one.largest_error_km"))
    requirement = Judgement("met", "closed", "≤ 2 m", "1.5 m", 1.5, 2.0, "m")
    claim = Judgement("refuted", "Table 1", "25 printed values", "23 of 25 equal")
    stage = StageResult("one", "make", own_metrics={"largest_error_km": Metric(2.5, "km")})
    text, _ = page(stage, spec=spec, requirements={"closed": requirement},
                   claims={"table_1": claim})  # fmt: skip
    cards = re.findall("<li><span class=label>(.*?)</li>", text)
    shown = [re.sub("<[^>]*>", "|", card) for card in cards]
    assert shown == [
        "closed||1.5 |m||||met| asked ≤\N{NO-BREAK SPACE}2\N{NO-BREAK SPACE}m|",
        "Table 1||23 of 25 equal|||refuted| published 25\N{NO-BREAK SPACE}printed values|",
        "largest error||2.5 |km||||",
    ]
    assert '<table class="outcomes claims"' in text


def test_a_table_and_a_figure_may_share_a_name() -> None:
    spec = ReportSpec(section=(SectionSpec(title="Both", show=("one.orbits",)),))
    stage = StageResult(
        "one", "make", tables={"orbits": Table("Table", [Column("a")], [{"a": 1}])},
        figures={"orbits": shown(CHART), "first": shown()}, own_tables={"orbits": "orbits"},
        own_figures={"first": "first", "orbits": "orbits"},
    )  # fmt: skip
    text, _ = page(stage, spec=replace_figure(spec, "one.first"))
    section = text.partition('<details id="section-1">')[2].partition("</details>")[0]
    assert 'id="table-orbits"' in section
    assert 'id="figure-orbits"' in section


def replace_figure(spec: ReportSpec, figure: str) -> ReportSpec:
    return spec.model_copy(update={"figure": figure})


def test_wide_tables_hide_columns_and_lift_constants() -> None:
    names = ["name", *"abcdefghij"]
    rows: list[dict[str, Cell]] = [
        {n: (7 if n == "c" else i) for n in names} | {"name": f"r{i}"} for i in range(5)
    ]
    columns = [Column(n, "" if n == "name" else "-") for n in names]
    text, found = page(StageResult("s", "make", tables={"t": Table("T", columns, rows)}))
    assert "(c 7)" in found.text
    assert "all 10 columns" in found.text
    assert len(re.findall('<th scope=col class="more"', text)) == 2
    # two rows of many columns stand on their side
    text, _ = page(StageResult("s", "make", tables={"t": Table("T", columns, rows[:2])}))
    assert "class=transposed" in text
    assert "more" not in re.findall(r'class="(.*?)"', text.partition("<main>")[2])


def test_paper_values_are_marked_beside_ours() -> None:
    columns = [Column("name", ""), Column("t_h", "h", digits=4), Column("t_h_paper", "h")]
    rows: list[dict[str, Cell]] = [
        {"name": "a", "t_h": 7.587, "t_h_paper": Printed("7.59")},
        {"name": "b", "t_h": 5.7655628, "t_h_paper": Printed("5.760")},
        {"name": "c", "t_h": math.nan, "t_h_paper": Printed("1")},
        {"name": "d", "t_h": 2.0},
    ]
    _, found = page(StageResult("one", "make", tables={"t": Table("T", columns, rows)}))
    assert found.cells[:15] == [
        "name", "th", "paper",
        "a", "7.587", "7.59 ✓",
        "b", "5.766", "5.760 Δ +5.56",
        "c", "–", "1 Δ",
        "d", "2", "–",
    ]  # fmt: skip
    assert "✓ agrees with the paper to its printed digit" in found.text
    _, plain = page(StageResult("one", "make", tables={"t": Table("T", columns[:2], rows[3:])}))
    assert "paper" not in plain.text


def test_a_paper_value_stands_beside_a_name_that_carries_its_unit() -> None:
    columns = [Column("v", ""), Column("v_m_s", "m/s"), Column("v_paper", "m/s")]
    table = Table("T", columns[1:], [{"v_m_s": 0.93672, "v_paper": Printed("0.9367")}])
    _, found = page(StageResult("one", "make", tables={"t": table}))
    assert found.cells[:4] == ["vm/s", "paper", "0.93672", "0.9367 ✓"]
    # a column of the very name is meant before one with a unit
    exact = Table("T", columns, [{"v": "2", "v_m_s": 0.9, "v_paper": Printed("1")}])
    _, found = page(StageResult("one", "make", tables={"t": exact}))
    assert found.cells[3:6] == ["2", "0.9", "1"]


@pytest.mark.parametrize(
    ("value", "shown"),
    [(True, "yes"), (False, "no"), (3, "3"), (1.23456789123e-12, "1.2345679e−12"), (None, "–"),
     (math.inf, "inf"), ("text", "text")],
)  # fmt: skip
def test_cells(value: Any, shown: str) -> None:
    _, found = page(
        StageResult("s", "make", tables={"t": Table("T", [Column("speed_m_s", "m/s")],
                                                [{"speed_m_s": value}])})
    )  # fmt: skip
    assert found.cells[:2] == ["speedm/s", shown]


def test_long_tables_are_cut_and_say_so() -> None:
    table = Table("T", [Column("i")], [{"i": i} for i in range(MAX_ROWS + 5)])
    _, found = page(StageResult("s", "make", tables={"long": table}))
    assert f"The first {MAX_ROWS} of {MAX_ROWS + 5} rows; tables/long.csv has all." in found.text
    assert f"copy {MAX_ROWS} of {MAX_ROWS + 5} rows as CSV" in found.text
    assert str(MAX_ROWS - 1) in found.cells
    assert str(MAX_ROWS) not in found.cells


def test_verdict_names_what_failed() -> None:
    _, found = page(
        StageResult("a", "make", state="failed", message="ValueError: no"),
        StageResult("b", "make", state="not run", message="it needs a"),
        StageResult("c", "make", state="interrupted"),
        verdict="failed; 3 stages did not finish",
    )
    for sentence in (
        "Failed; 3 stages", "Stage a failed: ValueError: no", "Stage b was not run: it needs a",
        "Stage c was interrupted.",
    ):  # fmt: skip
        assert sentence in found.text


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(0.0123, "0.012 s"), (59.4, "59 s"), (61, "1 min 1 s"), (3 * 3600 + 120, "3 h 2 min")],
)
def test_durations(seconds: float, shown: str) -> None:
    assert f"2026-11-21 · computed in {shown}" in page(seconds=seconds)[1].text


def test_how_to_run_it_again() -> None:
    _, found = page(StageResult("s", "make", cached=True), mission_text="format = 1\n")
    for part in ("hillsphere run small", "format = 1\n", "from the cache", "numpy"):
        assert part in found.text


def test_figures_are_the_same_every_time(monkeypatch: pytest.MonkeyPatch) -> None:
    first = draw(FIGURE, png=True)
    # A user's own settings neither change the figure nor are changed by it.
    with mpl.rc_context({"font.size": 30, "svg.fonttype": "none", "lines.linewidth": 9}):
        assert draw(FIGURE, png=True) == first
        assert mpl.rcParams["font.size"] == 30
    root = ET.fromstring(first.svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert b"dc:date" not in first.svg
    # The first line is drawn in the first colour of the palette.
    assert PALETTE["blue"].lower().encode() in first.svg


def test_a_format_does_not_depend_on_the_other() -> None:
    both = draw(FIGURE, png=True)
    assert both.png is not None
    assert both.png.startswith(b"\x89PNG")
    assert draw(FIGURE) == Drawing(both.svg, None)


def test_nothing_outside_the_axes_is_cut_off() -> None:
    def wide(figure: Any) -> None:
        plot(figure)
        figure.text(1.3, 0.5, "beside the figure")  # the layout takes no account of it

    def width_pt(drawn: Figure) -> float:
        return float((ET.fromstring(draw(drawn).svg).get("width") or "").removesuffix("pt"))

    figure = Figure("Wide", wide, size_in=(3.0, 3.0))
    assert width_pt(Figure("Plain", plot, size_in=(3.0, 3.0))) <= 3.2 * 72
    assert width_pt(figure) > 3.5 * 72


def test_large_figures_are_shown_as_png(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hillsphere.show.drawing.MAX_SVG_BYTES", 10)
    text, _ = page(StageResult("s", "make", figures={"f": shown()}))
    assert re.findall(r'src="(data:image/\w+)', text) == ["data:image/png"]


def test_palette_can_be_told_apart_from_white() -> None:
    assert all(re.fullmatch(r"#[0-9A-F]{6}", colour) for colour in PALETTE.values())
    assert len(set(PALETTE.values())) == 8


def test_faults_of_a_presentation_are_all_named() -> None:
    good = Presentation(
        metrics={"a": Metric(1.0)}, tables={"t1": Table("T", [Column("a")], [{"a": None}, {}])}
    )
    assert presentation_faults(good) == []
    bad = Presentation(
        metrics={"../a": Metric(1), "b": Metric([])},  # type: ignore[arg-type]
        tables={"T": Table("T", [Column("a"), Column("a")], [{"b": 1}])},
        figures={"1": FIGURE, "f": replace(CHART, table="t2")},
    )
    faults = "\n".join(presentation_faults(bad))
    for part in (
        "'../a'",
        "a list",
        "'T': an id",
        "is listed twice",
        "['b']",
        "figure '1'",
        "one of ['T']",
    ):
        assert part in faults
