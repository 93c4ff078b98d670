"""The page in a browser: list, search, comparison, filter, start and progress."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from time import monotonic, sleep
from typing import Any

import pytest
from tests.plugins.view.serving import Command, make_runs, viewing

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
if CHROMIUM is None:
    pytest.skip("the system has no chromium", allow_module_level=True)


@pytest.fixture(scope="module")
def command(_waves: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Command]:
    folder = tmp_path_factory.mktemp("folder")
    make_runs(folder)
    with viewing(folder) as made:
        yield made


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-background-networking"]
        )
        yield made
        made.close()


@pytest.fixture(params=[390, 1280])
def page(request: pytest.FixtureRequest, browser: Any, command: Command) -> Iterator[Any]:
    """Open the list of runs; whatever the browser complains of fails the test."""
    context = browser.new_context(
        viewport={"width": request.param, "height": 900},
        color_scheme="dark" if request.param == 390 else "light",
    )
    made = context.new_page()
    complaints: list[str] = []
    made.on("pageerror", lambda error: complaints.append(str(error)))
    made.on("console", lambda said: complaints.extend([said.text] * (said.type == "error")))
    made.goto(command.address)
    made.wait_for_selector("h1")
    yield made
    made.wait_for_timeout(100)
    # A refused mission is answered with status 422, which the browser writes down too.
    assert [said for said in complaints if "status of 422" not in said] == []
    context.close()


def names(page: Any) -> list[str]:
    return [link.inner_text() for link in page.query_selector_all(".runs th.name a")]


def fits(page: Any) -> bool:
    """Return whether nothing but tables and plots, which scroll, is wider than the window."""
    return bool(page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"))


def _wait_until(holds: Callable[[], bool]) -> None:
    """Wait for a state of the page, whose policy lets no script of a test in."""
    end = monotonic() + 10.0
    while not holds():
        assert monotonic() < end
        sleep(0.05)


def test_list_is_searched_and_runs_are_compared(page: Any) -> None:
    assert {"one", "two"} <= set(names(page))
    assert fits(page)
    assert page.is_disabled("#compare")
    page.fill("input[name=q]", "2026-01-02")
    _wait_until(lambda: page.locator(".runs th.name").count() == 1)
    assert names(page) == ["one"]
    page.fill("input[name=q]", "")
    _wait_until(lambda: page.locator(".runs th.name").count() > 1)
    for name in ("one", "two"):
        page.check(f"input[aria-label='compare {name}']")
    assert page.inner_text("#compare") == "Compare 2 runs"
    page.focus("#compare")
    page.keyboard.press("Enter")
    page.wait_for_selector("text=2 runs side by side")
    page.locator(".plot").scroll_into_view_if_needed()
    page.wait_for_selector(".plot[data-drawn=yes] .legendtext")
    assert page.locator(".plot .legendtext").all_text_contents() == ["A: wave", "B: wave"]
    assert fits(page)


def test_figures_of_a_run_stay_in_their_panels(page: Any) -> None:
    page.click("text=two")
    page.click("summary >> text=Figure wave")
    page.wait_for_selector(".plot[data-drawn=yes]")
    widths = page.evaluate(
        "[document.querySelector('.plot').getBoundingClientRect().right,"
        " document.querySelector('details').getBoundingClientRect().right]"
    )
    assert widths[0] <= widths[1]
    assert fits(page)


def test_report_opens_in_a_page_of_its_own(page: Any) -> None:
    page.click("text=one")
    with page.expect_popup() as opened:
        page.click("text=Open the report")
    report = opened.value
    report.wait_for_selector("h1")
    # Its own script has run, although the server's policy and sandbox are around it.
    contents = report.locator("nav details")
    if contents.get_attribute("open") is None:  # folded on a narrow page
        contents.locator("summary").click()
    report.wait_for_selector("#search", state="visible")
    assert report.url.endswith("/runs/0/one/report.html")


def test_cases_are_filtered(page: Any) -> None:
    page.goto(page.url.rstrip("/") + "/runs/0/one/cases/many")
    assert fits(page)
    page.select_option("select[name=class]", "undecided")
    page.wait_for_selector("text=1 of 230 cases")
    page.click("th a >> text=70")
    page.wait_for_selector("text=Case 70")
    assert fits(page)


def test_a_mission_is_started_and_its_progress_shown(page: Any) -> None:
    page.click("text=Start a mission")
    page.click("text=waves.toml")
    page.wait_for_selector("textarea")
    assert fits(page)
    page.fill("textarea", "stage.wave.steps=0")
    page.click("button >> text=Start")
    page.wait_for_selector("text=must be ≥ 1")
    page.evaluate("document.querySelector('textarea').dataset.seen = '1'")
    page.fill("textarea", "stage.wave.steps=20000\nstage.many.cases=1300")
    page.click("button >> text=Start")
    page.wait_for_selector("progress", timeout=60_000)
    assert fits(page)
    # The page follows the run by itself, to its end.
    page.wait_for_selector("text=Open the report", timeout=120_000)
    page.wait_for_selector(".badge.finished")
