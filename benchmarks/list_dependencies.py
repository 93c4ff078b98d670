"""Write ``docs/dependencies.md``: every package that Hillsphere installs, its licence and size.

What stands from the heading "Considered" on is written by hand and kept.

``python benchmarks/list_dependencies.py`` follows the requirements of the installed distribution
``hillsphere`` and of its extras; run it in an environment with all extras.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PAGE = Path(__file__).resolve().parents[1] / "docs" / "dependencies.md"
EXTRAS = ("", "notebook", "web", "dask", "mesh", "spice", "parquet", "slicot")
"""Without an extra, and the extras that a user chooses."""
_REASONS = {
    "parquet": "Writes campaigns for pandas, polars, DuckDB and Spark, a row group at a time, with "
    "units in the schema. Heavy, and therefore an extra: CSV and netCDF need nothing.",
    "mesh": "Reads shapes as STL and PLY, text and binary, whose variants are many. It needs numpy "
    "only; of its further functions none is used.",
}
"""Why an extra is worth its weight, where its name does not say it."""
_LICENCES = {
    "annotated-types": "MIT", "contourpy": "BSD-3-Clause", "cycler": "BSD-3-Clause",
    "kiwisolver": "BSD-3-Clause", "matplotlib": "PSF-based", "scipy": "BSD-3-Clause",
    "pyerfa": "BSD-3-Clause", "qdldl": "Apache-2.0", "sortedcontainers": "Apache-2.0",
}  # fmt: skip
"""Licences that the metadata of a package gives as whole texts or in words of its own."""
_HEAD = """# Dependencies

Every package that `pip install hillsphere` brings, with the licence that its metadata states and
its installed size. None has a licence of the GPL family.
"""


def requirements(name: str, extras: set[str]) -> Iterator[tuple[str, set[str]]]:
    """Yield the packages that one requires here, and their extras."""
    for text in metadata.requires(name) or ():
        needed = Requirement(text)
        environments = [{"extra": extra} for extra in (extras or {""})]
        if needed.marker is None or any(needed.marker.evaluate(e) for e in environments):
            yield canonicalize_name(needed.name), set(needed.extras)


def closure(extra: str) -> list[str]:
    """Return the names of all packages, sorted, that an installation with one extra has."""
    left, seen = [("hillsphere", {extra} if extra else set())], {}
    while left:
        name, extras = left.pop()
        if name in seen and extras <= seen[name]:
            continue
        seen[name] = seen.get(name, set()) | extras
        try:
            left += requirements(name, extras)
        except metadata.PackageNotFoundError:
            print(f"{name} is not installed")
    return sorted(seen.keys() - {"hillsphere"})


def row(name: str) -> str:
    """Return a package's line of the table."""
    package = metadata.distribution(name)
    stated = package.metadata.get("License-Expression") or package.metadata.get("License") or ""
    classes = [c.rpartition(":: ")[2] for c in package.metadata.get_all("Classifier") or ()
               if c.startswith("License ::")]  # fmt: skip
    licence = _LICENCES.get(name) or (stated if 0 < len(stated) < 60 else ", ".join(classes))
    size = sum(path.stat().st_size for file in package.files or ()
               if (path := Path(str(package.locate_file(file)))).is_file())  # fmt: skip
    return f"| {name} | {' '.join(licence.replace('|', ' ').split())} | {size / 1e6:.1f} |"


if __name__ == "__main__":
    lines, known = [_HEAD], set[str]()
    for extra in EXTRAS:
        names = [name for name in closure(extra) if name not in known]
        installed = []
        for name in names:
            try:
                installed.append(row(name))
            except metadata.PackageNotFoundError:
                continue
        known.update(names)
        title = f"With `hillsphere[{extra}]` besides" if extra else "Always"
        if installed:
            table = ["| package | licence | MB |", "| --- | --- | --- |", *installed]
            reason = [_REASONS[extra], ""] if extra in _REASONS else []
            lines.append("\n".join([f"## {title}", "", *reason, *table, ""]))
    _, heading, by_hand = PAGE.read_text("utf-8").partition("\n## Considered")
    PAGE.write_text("\n".join(lines) + heading + by_hand, "utf-8")
