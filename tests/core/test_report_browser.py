"""The page of a run in the system's Chromium: copied tables, printed figures, a telephone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from tests.missions.pages import open_page

from hillsphere.mission.report_spec import ReportSpec, SectionSpec
from hillsphere.presentation import Axis, Cell, Chart, Column, Curve, Panel, Printed, Space, Table
from hillsphere.presentation import Path as Line
from hillsphere.runs.store import csv_text
from hillsphere.show.html_tables import MAX_ROWS
from hillsphere.show.plotly_renderer import plotly_figure
from hillsphere.show.report import render
from hillsphere.show.report_content import Report, ShownFigure, StageResult

COLUMNS = [Column("name", ""), Column("x_km", "km", digits=3), Column("c_m", "m"), Column("ok", "")]
PAPER = [*COLUMNS[:2], Column("x_paper", "km")]


def rows_of(count: int) -> list[Mapping[str, Cell]]:
    cells: list[Cell] = [1 / 3, None, math.nan, -math.inf, 7]
    return [
        {"name": f'a, "{i}"', "x_km": cells[i % 5], "c_m": 0.1 + 0.2, "ok": i > 2}
        for i in range(count)
    ]


TABLES = {
    "constants": Table("Constants", COLUMNS, rows_of(5)),
    "long": Table("Long", COLUMNS, rows_of(MAX_ROWS + 5)),
    "turned": Table(
        "Turned", [Column(c) for c in "abcdefghij"],
        [dict.fromkeys("abcdefghij", value) for value in (0.5, None)],
    ),
    "paper": Table(
        "Paper", PAPER, [{"name": "a", "x_km": 7.5871, "x_paper": Printed("7.590")}, {"name": "b"}]
    ),
}  # fmt: skip
LINE = Panel(Axis("x", "km"), Axis("y"), [Curve([0, 1, 2], [1, 0, 3], "line")])
FLAT = Chart("Flat", [LINE, LINE], columns=2)
DEEP = Chart("Deep", [Space([Line([[0, 1], [0, 2], [0, 1]], "way")])])


def write_page(directory: Path, stage: StageResult, **spec: Any) -> None:
    """Write the page of a run with one stage."""
    page = render(
        Report(
            mission="small", title="", description="", profile="", verdict="all is well",
            spec=ReportSpec(**spec), requirements={}, claims={}, stages=[stage], started="2026",
            seconds=1.0, command="hillsphere run small", mission_text="", versions={},
        )
    )  # fmt: skip
    (directory / "report.html").write_text(page, encoding="utf-8")


@pytest.mark.parametrize("name", TABLES)
def test_a_copied_table_is_its_file(tmp_path: Path, name: str) -> None:
    write_page(tmp_path, StageResult("one", "make", tables=TABLES))
    with open_page(tmp_path) as (page, told):
        copied = page.evaluate(f"csvOf(document.querySelector('#table-{name} table'))")
        page.locator("#stage-one").evaluate("fold => fold.open = true")
        assert (
            page.locator(f"#table-{name} .constant").count() == 0
            or not page.locator(f"#table-{name} .constant").first.is_visible()
        )
        part = f" {MAX_ROWS} of {MAX_ROWS + 5} rows" if name == "long" else ""
        page.locator(f"#table-{name} .copy").click()
        copy = page.locator(f"#table-{name} .copy")
        from playwright.sync_api import expect

        expect(copy).to_have_text(f"copied{part} as CSV")  # the clipboard answers later
        assert told == []
    lines = csv_text(TABLES[name]).splitlines()
    assert copied.splitlines() == lines[: MAX_ROWS + 1]


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_figures_of_open_folds_are_printed(tmp_path: Path, scheme: str) -> None:
    figures = {
        name: ShownFigure(chart, plotly_figure(chart))
        for name, chart in (("first", FLAT), ("flat", FLAT), ("deep", DEEP), ("closed", FLAT))
    }
    shown = SectionSpec(title="Shown", show=("one.flat", "one.deep"))
    stage = StageResult(
        "one", "make", figures=figures, own_figures={name: name for name in figures}
    )
    write_page(tmp_path, stage, section=(shown,))
    with open_page(tmp_path, scheme=scheme) as (page, told):
        page.locator("#figure-first .main-svg").first.wait_for()
        page.locator("#section-1").evaluate("fold => fold.open = true")
        for name in ("first", "flat", "deep"):
            page.locator(f"#figure-{name} .picture").wait_for(state="attached", timeout=20_000)
        assert page.locator("#figure-closed .picture").count() == 0
        assert not page.locator(".picture").first.is_visible()
        assert len(page.pdf(format="A4")) > 20_000
        page.set_viewport_size({"width": 673, "height": 900})  # A4 between its margins
        page.emulate_media(media="print")
        for name in ("first", "flat", "deep"):
            assert not page.locator(f"#figure-{name} .plot").is_visible()
            picture = page.locator(f"#figure-{name} .picture")
            assert picture.is_visible()
            assert picture.evaluate("i => i.complete && i.naturalWidth") == 760
            assert 400 < picture.bounding_box()["width"] <= 673
        assert told == []


def test_dark_lines_are_lightened_on_a_dark_page(tmp_path: Path) -> None:
    curves = [Curve([0, 1], [0, 1], colour=colour) for colour in ("#440154", "#0072b2", "black")]
    chart = Chart("C", [Panel(Axis("x"), Axis("y"), curves)])
    figures = {"c": ShownFigure(chart, plotly_figure(chart))}
    write_page(tmp_path, StageResult("one", "make", figures=figures, own_figures={"c": "c"}))
    with open_page(tmp_path, scheme="dark") as (page, told):
        page.locator("#figure-c .main-svg").first.wait_for()
        drawn = page.evaluate("document.querySelector('.plot').data.map(trace => trace.line.color)")
        assert drawn == ["#946d9d", "#0072b2", "#e4e8ec"]
        assert told == []


@pytest.mark.parametrize("width", [390, 1280])
def test_the_buttons_of_a_figure_cover_no_legend(tmp_path: Path, width: int) -> None:
    curves = [Curve([0, 1], [0, k], f"a curve of a long name {k}") for k in range(4)]
    chart = Chart("C", [Panel(Axis("x"), Axis("y"), curves)])
    figures = {"c": ShownFigure(chart, plotly_figure(chart))}
    write_page(tmp_path, StageResult("one", "make", figures=figures, own_figures={"c": "c"}))
    with open_page(tmp_path, width) as (page, told):
        plot = page.locator("#figure-c .plot")
        plot.locator(".main-svg").first.wait_for()
        buttons = plot.locator(".modebar-btn")
        if width == 390:
            assert buttons.count() == 0
            return
        plot.hover()
        buttons.first.wait_for()
        legend = plot.locator(".legend").bounding_box()
        assert buttons.first.bounding_box()["y"] > legend["y"] + legend["height"]
        assert told == []


@pytest.mark.parametrize("scripts", [True, False])
def test_a_telephone_shows_question_and_answer_first(tmp_path: Path, scripts: bool) -> None:
    sections = tuple(SectionSpec(title=f"Section of a name {n}") for n in range(8))
    stage = StageResult("one", "make")
    write_page(tmp_path, stage, question="Does it fit?", answer="Yes.", section=sections)
    with open_page(tmp_path, 390, scripts=scripts) as (page, told):
        link = page.locator("nav a").first
        assert not link.is_visible()
        assert page.locator("h1").bounding_box()["y"] < 120
        page.locator("nav summary").click()
        assert link.is_visible()
        assert told == []
    with open_page(tmp_path, 1280, scripts=scripts) as (page, _):
        assert page.locator("nav a").last.is_visible()
        assert not page.locator("nav summary").is_visible()
