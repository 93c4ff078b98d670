"""The report: one page that needs nothing but itself, and figures that are the same every time."""

from __future__ import annotations

import math
import re
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree as ET

import matplotlib as mpl
import pytest

from hillsphere.presentation import (
    PALETTE,
    Cell,
    Column,
    Figure,
    Metric,
    Presentation,
    Printed,
    Table,
    presentation_faults,
)
from hillsphere.show.drawing import Drawing, draw, draw_png
from hillsphere.show.report import MAX_ROWS, Report, Section, render

VOID = {"meta", "img", "br", "hr"}


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
        if "style" not in self.open:
            self.text += data
        if {"td", "th"} & set(self.open):
            self.cells[-1] += data


def plot(figure: Any) -> None:
    axes = figure.add_subplot()
    axes.plot([0, 1], [1, 0], label="line")
    axes.legend()
    axes.set_xlabel("x [km]")


FIGURE = Figure("A <figure>", plot, "What & how")


def page(*sections: Section, **changes: Any) -> tuple[str, Page]:
    content: dict[str, Any] = {
        "mission": "small", "title": "", "description": "", "state": "success", "notes": (),
        "sections": sections, "started": "2026-11-21T03:04:05Z", "seconds": 4.2,
        "command": "hillsphere run small", "mission_text": "", "versions": {"numpy": "2"},
    }  # fmt: skip
    text = render(Report(**(content | changes)))
    return text, Page(text)


def test_page_asks_for_nothing_outside_itself() -> None:
    drawing = draw(FIGURE)
    text, found = page(Section("one", "make", figures={"f": (FIGURE, drawing)}))
    policy = next(a for t, a in found.elements if t == "meta" and "http-equiv" in a)
    assert policy["content"] == "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    assert not {t for t, _ in found.elements} & {"script", "link", "iframe", "object", "base"}
    sources = [a["src"] or "" for t, a in found.elements if t == "img"]
    assert [s[:26] for s in sources] == ["data:image/svg+xml;base64,"]
    assert all((a["href"] or "").startswith("#") for t, a in found.elements if t == "a")
    assert "url(" not in text
    assert "@import" not in text


def test_links_lead_to_the_stages() -> None:
    _, found = page(Section("one", "make"), Section("two-b", "make"))
    ids = {a["id"] for _, a in found.elements if "id" in a}
    assert {a["href"] for t, a in found.elements if t == "a"} == {f"#{i}" for i in ids}


def test_everything_is_escaped() -> None:
    evil = "<script>alert('1')</script>&\"'"
    table = Table(evil, [Column(evil, evil, evil), Column("t", "")], [{evil: evil, "t": evil}],
                  [evil])  # fmt: skip
    section = Section(
        "one", evil, "failed", message=evil,
        metrics={evil: Metric(evil, evil)}, tables={"t": table},
        figures={"f": (Figure(evil, plot, evil), draw(FIGURE))},
    )  # fmt: skip
    fields = ("mission", "title", "description", "command", "mission_text", "started")
    text, found = page(
        section, state="failed", notes=[evil], versions={evil: evil}, **dict.fromkeys(fields, evil)
    )
    assert "<script" not in text
    assert "script" not in {t for t, _ in found.elements}
    assert found.text.count(evil) >= 17


def test_paper_values_are_marked_beside_ours() -> None:
    columns = [Column("name", ""), Column("t_h", "h", digits=4), Column("t_h_paper", "h")]
    rows: list[dict[str, Cell]] = [
        {"name": "a", "t_h": 7.587, "t_h_paper": Printed("7.59")},
        {"name": "b", "t_h": 5.7655628, "t_h_paper": Printed("5.760")},
        {"name": "c", "t_h": math.nan, "t_h_paper": Printed("1")},
        {"name": "d", "t_h": 2.0},
    ]
    _, found = page(Section("one", "make", tables={"t": Table("T", columns, rows)}))
    assert found.cells[:15] == [
        "name", "th", "paper",
        "a", "7.587", "7.59 ✓",
        "b", "5.766", "5.760 Δ +5.56",
        "c", "–", "1 Δ",
        "d", "2", "–",
    ]  # fmt: skip
    assert "✓ agrees with the paper to its printed digit" in found.text
    _, plain = page(Section("one", "make", tables={"t": Table("T", columns[:2], rows[3:])}))
    assert "paper" not in plain.text


def test_a_paper_value_stands_beside_a_name_that_carries_its_unit() -> None:
    columns = [Column("v", ""), Column("v_m_s", "m/s"), Column("v_paper", "m/s")]
    table = Table("T", columns[1:], [{"v_m_s": 0.93672, "v_paper": Printed("0.9367")}])
    _, found = page(Section("one", "make", tables={"t": table}))
    assert found.cells[:4] == ["vm/s", "paper", "0.93672", "0.9367 ✓"]
    # a column of the very name is meant before one with a unit
    exact = Table("T", columns, [{"v": "2", "v_m_s": 0.9, "v_paper": Printed("1")}])
    _, found = page(Section("one", "make", tables={"t": exact}))
    assert found.cells[3:6] == ["2", "0.9", "1"]


@pytest.mark.parametrize(
    ("value", "shown"),
    [(True, "yes"), (False, "no"), (3, "3"), (1.23456789123e-12, "1.2345679e-12"), (None, "–"),
     (math.inf, "inf"), ("text", "text")],
)  # fmt: skip
def test_cells(value: Any, shown: str) -> None:
    _, found = page(
        Section("s", "make", tables={"t": Table("T", [Column("speed_m_s", "m/s")],
                                                [{"speed_m_s": value}])})
    )  # fmt: skip
    assert found.cells[:2] == ["speedm/s", shown]


def test_long_tables_are_cut_and_say_so() -> None:
    table = Table("T", [Column("i")], [{"i": i} for i in range(MAX_ROWS + 5)])
    _, found = page(Section("s", "make", tables={"long": table}))
    assert f"tables/long.csv ({MAX_ROWS + 5} rows, of which the first {MAX_ROWS} are shown)" in (
        found.text
    )
    assert str(MAX_ROWS - 1) in found.cells
    assert str(MAX_ROWS) not in found.cells


def test_verdict_names_what_failed() -> None:
    _, found = page(
        Section("a", "make", "failed", message="ValueError: no"),
        Section("b", "make", "not run", message="it needs a"),
        Section("c", "make", "interrupted"),
        state="failed",
        notes=["A note."],
    )
    for sentence in (
        "A stage failed", "Stage a failed: ValueError: no", "Stage b was not run: it needs a",
        "Stage c was interrupted.", "A note.",
    ):  # fmt: skip
        assert sentence in found.text


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [(0.0123, "0.012 s"), (59.4, "59 s"), (61, "1 min 1 s"), (3 * 3600 + 120, "3 h 2 min")],
)
def test_durations(seconds: float, shown: str) -> None:
    assert f"2026-11-21T03:04:05Z, {shown}" in page(seconds=seconds)[1].text


def test_how_to_run_it_again() -> None:
    _, found = page(Section("s", "make", cached=True), mission_text="format = 1\n")
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
    assert draw_png(FIGURE) == both.png


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
    text, _ = page(Section("s", "make", figures={"f": (FIGURE, draw(FIGURE))}))
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
        figures={"1": FIGURE},
    )
    faults = "\n".join(presentation_faults(bad))
    for part in ("'../a'", "a list", "'T': an id", "is listed twice", "['b']", "figure '1'"):
        assert part in faults
