"""The documentation site is built without a warning, and its generated reference is complete."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path

import pytest

from hillsphere.plugins import default_registry

DOCS = Path(__file__).parents[2] / "docs"
NEEDED = ("sphinx", "pydata_sphinx_theme", "myst_nb", "numpydoc")
MISSING = [name for name in NEEDED if find_spec(name) is None]

pytestmark = [
    pytest.mark.slow,  # more than a minute of one processor
    pytest.mark.skipif(bool(MISSING), reason=f"not installed: {', '.join(MISSING)} (extra docs)"),
]


class Page(HTMLParser):
    """Identifiers and links of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if identifier := values.get("id"):
            self.ids.add(identifier)
        if tag == "a" and (link := values.get("href")):
            self.links.append(link)
        source = values.get("href" if tag == "link" else "src")
        if tag in ("link", "script", "img") and source:
            self.loaded.append(source)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the site without executing the tutorials."""
    directory = tmp_path_factory.mktemp("site")
    source = directory / "docs"
    shutil.copytree(DOCS, source, ignore=shutil.ignore_patterns("_build", "jupyter_execute"))
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-D", "nb_execution_mode=off",
         str(source), str(directory / "html")],
        capture_output=True, text=True, check=False, env={**os.environ, "NO_COLOR": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return directory / "html"


def test_every_key_has_an_entry(site: Path) -> None:
    """Of every component of this distribution, one entry per key of its Spec."""
    for record in default_registry():
        own = record.distribution.partition(" ")[0] in ("", "hillsphere")
        if not own or not record.component.spec:
            continue
        kind, type_ = record.component.kind, record.component.type
        page = Page(site / "reference" / "keys" / kind / f"{type_}.html")
        for name in record.load_spec().model_fields:
            assert f"key-{kind}.{type_}.{name}".replace("_", "-").replace(".", "-") in {
                one.replace("_", "-").replace(".", "-") for one in page.ids
            }, f"{kind}.{type_}.{name}"


def test_an_entry_tells_unit_bounds_and_meaning(site: Path) -> None:
    text = (site / "reference" / "keys" / "gravity" / "ellipsoid.html").read_text("utf-8")
    assert "axes_km" in text
    assert "kg/m³" in text


def test_links_within_the_site_resolve(site: Path) -> None:
    pages = {path.resolve(): Page(path) for path in site.rglob("*.html")}
    for path, page in pages.items():
        for link in page.links:
            place, _, anchor = link.partition("#")
            if ":" in place or place.startswith("//"):
                continue
            target = (path.parent / place).resolve() if place else path
            if target.suffix != ".html":
                assert target.exists(), f"{path}: {link}"
            elif anchor:
                assert anchor in pages[target].ids, f"{path}: {link}"


def test_nothing_is_loaded_from_elsewhere(site: Path) -> None:
    """Pages and the search work without a network."""
    for path in site.rglob("*.html"):
        outside = [one for one in Page(path).loaded if "//" in one]
        assert outside == [], path
    assert (site / "searchindex.js").is_file()
