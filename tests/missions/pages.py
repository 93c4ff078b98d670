"""A run's page in the system's Chromium: nothing is requested, nothing overflows, everything works.

The pages are opened as files, as a user does, with the console, requests and errors recorded.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

WIDTHS = (390, 1280, 1600)
ARGUMENTS = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
)  # fmt: skip
"""Without a graphics processor WebGL is drawn by SwiftShader; nothing is fetched at the start."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def find_browser() -> str:
    """Return the system's browser, or skip the test; in CI a missing one is a failure."""
    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        if os.environ.get("HILLSPHERE_REQUIRE_BROWSER"):
            raise AssertionError(f"no browser: none of {', '.join(BROWSERS)} is installed")
        pytest.skip("needs the system's Chromium")
    return path


@contextmanager
def open_browser() -> Iterator[Any]:
    """Yield the system's browser."""
    executable = find_browser()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=list(ARGUMENTS))
        yield browser
        browser.close()


@contextmanager
def open_page(
    directory: Path, width: int = 1280, scheme: Any = "light", scripts: bool = True
) -> Iterator[tuple[Any, list[str]]]:
    """Yield the page of a run, and what it asked for or complained about; starts a browser."""
    with (
        open_browser() as browser,
        open_page_in(browser, directory, width, scheme, scripts) as both,
    ):
        yield both


@contextmanager
def open_page_in(
    browser: Any, directory: Path, width: int = 1280, scheme: Any = "light", scripts: bool = True
) -> Iterator[tuple[Any, list[str]]]:
    """Yield the page of a run, without memory of other pages, as `open_page` does."""
    url = (directory / "report.html").resolve().as_uri()
    told: list[str] = []

    def note_request(request: Any) -> None:
        if request.url.split("#")[0] != url and not request.url.startswith(("data:", "blob:")):
            told.append(f"request {request.url[:100]}")

    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, java_script_enabled=scripts
    )
    page = context.new_page()
    page.on("request", note_request)
    page.on("pageerror", lambda error: told.append(f"error {error}"))
    page.on(
        "console", lambda m: told.append(f"console {m.text[:200]}") if m.type == "error" else None
    )
    page.goto(url)
    yield page, told
    context.close()


_IDENTIFIER = re.compile(r"\w_\w|[A-Za-z]\w*\.[A-Za-z]")
"""Two words joined by ``_``, or a key such as ``stage.hover``; ``C3,1`` and ``0.5 m`` are none."""


def identifiers_in(plot: Mapping[str, Any]) -> list[str]:
    """Return axis titles, ticks, titles and legend entries of a plot that are no words."""
    return [text for text in _texts(plot) if _IDENTIFIER.search(text)]


def _texts(plot: Mapping[str, Any]) -> Iterator[str]:
    layout = plot["layout"]
    for name, part in layout.items():
        if name.startswith(("xaxis", "yaxis")):
            yield part.get("title", {}).get("text", "")
            yield from part.get("ticktext", ())
        elif name.startswith("scene"):
            yield from (part[f"{axis}axis"]["title"]["text"] for axis in "xyz")
        elif name.startswith("coloraxis") and "colorbar" in part:
            yield part["colorbar"]["title"]["text"]
    yield from (note["text"] for note in layout.get("annotations", ()))
    for mark in (*plot["data"], *layout.get("shapes", ())):
        if mark.get("showlegend"):
            yield mark["name"]


def check_words(directory: Path) -> None:
    """Fail if a figure of a run shows an identifier where a reader expects words."""
    found = {
        path.stem: names
        for path in sorted((directory / "figures").glob("*.json"))
        if (names := identifiers_in(json.loads(path.read_text("utf-8"))))
    }
    assert found == {}


def check_page(directory: Path) -> None:
    """Fail unless the page of a run works at every width, in both schemes, and is accessible."""
    check_words(directory)
    with open_browser() as browser:
        for width in WIDTHS:
            _check_width(browser, directory, width)
        with open_page_in(browser, directory, scripts=False) as (page, _):
            assert page.locator("h1").is_visible()
            page.locator(".picture").first.wait_for(state="visible")
        _check_print(browser, directory)


def _check_width(browser: Any, directory: Path, width: int) -> None:
    scheme = "dark" if width == 1600 else "light"
    with open_page_in(browser, directory, width, scheme) as (page, told):
        _wait_for_plots(page)
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        size = page.evaluate("[document.documentElement.scrollWidth, window.innerWidth]")
        assert size[0] <= size[1], f"at {width} px the page is {size[0]} px wide"
        if width == 1280:
            _wait_for_plots(page)
            _check_tables(page)
            _check_scenes(page)
        if width > 390:  # one in each scheme
            _check_accessibility(page)
        assert told == []


def _wait_for_plots(page: Any) -> None:
    """Draw every visible plot, and wait until it is there."""
    for box in page.locator(".plot").all():
        if box.is_visible():
            box.scroll_into_view_if_needed()
            box.locator(".main-svg").first.wait_for(timeout=20_000)


def _check_tables(page: Any) -> None:
    table = page.locator(".table table:not(.transposed)").first
    if not table.count():
        return
    heading = table.locator("thead th").nth(1)
    before = heading.get_attribute("aria-sort")
    heading.focus()
    page.keyboard.press("Enter")
    assert before is None
    assert heading.get_attribute("aria-sort") == "ascending"
    values = table.locator("tbody tr").evaluate_all(
        "rows => rows.map(r => (r.cells[1].dataset.v ?? r.cells[1].textContent) || NaN).map(Number)"
    )
    numbers = [value for value in values if value == value and value is not None]
    assert numbers == sorted(numbers)


def _check_scenes(page: Any) -> None:
    """Fail if a canvas of a scene is blank."""
    for canvas in page.locator(".plot .gl-container canvas").all()[:2]:
        canvas.scroll_into_view_if_needed()
        page.wait_for_timeout(500)
        assert len(set(canvas.screenshot())) > 100


def _check_accessibility(page: Any) -> None:
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    serious = [v for v in found if v["impact"] in ("serious", "critical")]
    assert serious == [], "\n".join(
        f"{v['id']}: {v['help']}: {[n['html'][:120] for n in v['nodes'][:3]]}" for v in serious
    )


def _check_print(browser: Any, directory: Path) -> None:
    """Fail if the page, as it opens, needs more than fifteen sheets."""
    with open_page_in(browser, directory) as (page, _):
        _wait_for_plots(page)
        pdf = page.pdf(format="A4")
    assert pdf.count(b"/Type /Page\n") + pdf.count(b"/Type /Page ") <= 15
