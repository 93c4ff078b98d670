"""Compare with other codes on problems that others chose, and write ``docs/public-problems.md``.

    python benchmarks/public_problems.py                     # the problems of estimation
    python benchmarks/public_problems.py --hostile ROWS.csv  # rows of bench_hostile.py
    python benchmarks/public_problems.py --collection ROWS        # rows of bench_structured.py
    python benchmarks/public_problems.py --page              # the page from what is stored

What was measured is stored in ``public_problems.json`` beside this file; each call replaces the
parts that it measures and writes the page. Stone Soup and slycot are used where they are installed.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import Any

import bench_hostile
import bench_structured
import numpy as np
from estimation_problems import PROBLEMS, draw
from numpy.typing import NDArray
from wide_priors import Scenario, bearings_only, low_earth_orbit, spring_mass

from hillsphere import create
from hillsphere.errors import HillsphereError
from hillsphere.estimation import Belief, Innovation
from hillsphere_estimators.consistency import chi_square_band, nees, verdict

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
RECORD = Path(__file__).with_name("public_problems.json")
PAGE = ROOT / "docs" / "public-problems.md"
DRAWS = 100
"""Draws of the truth and the noise for filters that take all at once."""
SINGLE = 20
"""Draws for those that take one after the other."""
OURS: dict[str, tuple[str, dict[str, Any]]] = {
    "unscented": ("unscented", {}),
    "iterated extended": ("iterated_extended", {}),
    "Gaussian sum": ("gaussian_sum", {}),
}
"""Estimators of ours: the plain choice, the one by linearisation, and the one for wide priors."""


def scenarios() -> list[tuple[str, str, Callable[[int], Scenario]]]:
    """Return name, source and maker of each problem."""
    book = [
        (p.name, p.source, lambda draws, p=p: draw(p, draws)) for p in PROBLEMS
    ]  # fmt: skip
    wide = [
        ("spring and mass, wide prior", "Tapley, Schutz, Born (2004), section 4.8.2", spring_mass),
        ("bearings only, observer turns", "after Nardone, Aidala (1981)", bearings_only),
        (
            "low Earth orbit, three stations",
            "constructed: 1 km prior, 1 cm ranges",
            low_earth_orbit,
        ),
    ]
    return [*book, *wide]


@dataclass(frozen=True)
class Run:
    """What a filter of ours made of a scenario."""

    after: list[Belief]
    innovations: list[Innovation]
    seconds: float


def run_filter(scenario: Scenario, name: str, options: dict[str, Any]) -> Run:
    """Run a filter over all sets of measurements."""
    estimator, belief, model = create("estimator", name, **options), scenario.prior, scenario.model
    after, innovations = list[Belief](), list[Innovation]()
    begun = process_time()
    for measured in scenario.sets:
        if (measured.t_s > belief.t_s).any():
            belief = estimator.predict(model, belief, measured.t_s, scenario.nothing())
        belief, innovation = estimator.update(model, belief, measured)
        after.append(belief)
        innovations.append(innovation)
    return Run(after, innovations, process_time() - begun)


def judged_by_truth(normalised: Array, states: int) -> dict[str, Any]:
    """Return the mean NEES, its band, and what it says."""
    low, high = (float(v) for v in chi_square_band(states, normalised.size))
    mean = float(np.mean(normalised))
    says = (
        "consistent"
        if low <= mean <= high
        else "overconfident"
        if mean > high
        else "underconfident"
    )
    if not np.isfinite(mean):
        says = "failed"
    return {"nees": mean, "low": low, "high": high, "truth": says}


def measure_estimation() -> list[dict[str, Any]]:
    """Return a row for each problem and filter."""
    rows = []
    for name, source, make in scenarios():
        scenario = make(DRAWS)
        states = len(scenario.prior.x)
        for label, (component, options) in OURS.items():
            row: dict[str, Any] = {
                "problem": name,
                "source": source,
                "filter": label,
                "draws": DRAWS,
            }
            try:
                made = run_filter(scenario, component, options)
                found = nees(made.after[-1], scenario.truth[-1])
                row |= judged_by_truth(found, states)
                row["ms"] = 1e3 * made.seconds / DRAWS
                row["verdict"] = verdict(
                    scenario.model, scenario.prior, scenario.sets, made.after, made.innovations
                ).answer
            except HillsphereError as error:
                row |= {"truth": "failed", "reason": str(error).splitlines()[0]}
            rows.append(row)
            print(row, flush=True)
        rows += measure_others(name, source, make(SINGLE))
    return rows


def measure_others(name: str, source: str, scenario: Scenario) -> list[dict[str, Any]]:
    """Return rows of FilterPy's and Stone Soup's filters."""
    rows, states, last = [], len(scenario.prior.x), scenario.truth[-1]

    def of_filterpy() -> Array:
        return nees(run_filter(scenario, "ukf", {}).after[-1], last)

    def of_stone_soup(unscented: bool) -> Array:
        import stone_soup

        mean, covariance = stone_soup.run(scenario, SINGLE, unscented)
        off = (mean - last).T[:, :, None]
        return np.asarray(np.sum(off * np.linalg.solve(covariance, off), axis=(1, 2)))

    peers: dict[str, Callable[[], Array]] = {
        f"FilterPy {version('filterpy')}, unscented": of_filterpy
    }
    if find_spec("stonesoup"):
        soup = f"Stone Soup {version('stonesoup')}"
        peers[f"{soup}, unscented"] = lambda: of_stone_soup(True)
        peers[f"{soup}, extended"] = lambda: of_stone_soup(False)
    for label, work in peers.items():
        row: dict[str, Any] = {"problem": name, "source": source, "filter": label, "draws": SINGLE}
        begun = process_time()
        try:
            row |= judged_by_truth(work(), states)
        except Exception as error:  # whatever another code raises is its result
            row |= {"truth": "failed", "reason": f"{type(error).__name__}: {error}".splitlines()[0]}
        row["ms"] = 1e3 * (process_time() - begun) / SINGLE
        rows.append(row)
        print(row, flush=True)
    return rows


def hostile_rows(path: Path) -> list[dict[str, Any]]:
    """Return a row for each kind of hostile plant, the last for all."""
    rows = bench_hostile.read_rows(path)
    return [
        {"kind": kind or "all"} | bench_hostile.summarise(rows, kind)
        for kind in (*bench_hostile.KINDS, "")
    ]


def collection_rows(path: Path) -> list[dict[str, Any]]:
    """Return a row for each plant of the collection."""
    kept = ("name", "order", "gamma", "verdict", "full_order", "starts_alone", "cpu_s", "error")
    rows = bench_structured.read_rows(str(path)).values()
    return [
        {key: row[key] for key in kept if key in row}
        | {"hifoo": bench_structured.KNOWN.get(row["name"])}
        for row in rows
    ]


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def number(value: Any, digits: int = 3) -> str:
    """Return a number for a table, nothing for none."""
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:.{digits}g}"


def hostile_section(rows: list[dict[str, Any]]) -> str:
    """Return the section of the hostile plants."""
    heads = ("kind", "plants", "found by ours", "by SLICOT", "missed", "largest ratio", "median",
             "s a plant, ours", "SLICOT")  # fmt: skip
    cells = (
        [
            row["kind"], *(number(row[key]) for key in ("plants", "ours", "slicot", "missed")),
            number(row["largest"] or None, 5), number(row["median"], 5),
            number(row["ours_s"] / row["plants"]), number(row["slicot_s"] / row["plants"]),
        ]
        for row in rows
    )  # fmt: skip
    return _HOSTILE + "\n\n" + table(heads, cells)


def collection_section(rows: list[dict[str, Any]]) -> str:
    """Return the section of the collection of plants."""
    heads = ("plant", "order", "γ, ours", "γ, HIFOO", "difference, %", "verdict",
             "γ of full order", "CPU, s")  # fmt: skip

    def cells(row: dict[str, Any]) -> list[str]:
        gamma, known = row.get("gamma"), row.get("hifoo")
        off = "–" if not (gamma and known) else f"{100.0 * (gamma / known - 1.0):+.2f}"
        says = row.get("verdict") or f"none found: {row.get('error', '')}"
        return [row["name"], str(row["order"]), number(gamma, 6), number(known, 6), off, says,
                number(row.get("full_order"), 4), number(row["cpu_s"])]  # fmt: skip

    solved = [row for row in rows if row.get("gamma") is not None]
    both = [row for row in solved if row.get("hifoo")]
    above = [row["name"] for row in both if row["gamma"] > row["hifoo"] * 1.001]
    said = (
        f"{len(solved)} of {len(rows)} plants have a controller. Of the {len(both)} with a number "
        f"of HIFOO, {len(both) - len(above)} are at most 0.1 % above it"
        + (f"; not {', '.join(above)}." if above else ".")
    )
    return f"{_COLLECTION}\n\n{said}\n\n{table(heads, map(cells, rows))}"


def estimation_section(rows: list[dict[str, Any]]) -> str:
    """Return the section of the problems of estimation."""
    heads = ("problem", "filter", "draws", "mean NEES", "band", "by the truth", "our verdict",
             "ms a draw")  # fmt: skip
    lines, before = list[list[str]](), ""
    for row in rows:
        title = f"{row['problem']} ({row['source']})"
        failed = f"failed: {row.get('reason', 'no number')}"
        band = f"{row['low']:.2f} to {row['high']:.2f}" if "low" in row else "–"
        lines.append([
            "" if title == before else title, row["filter"], str(row["draws"]),
            number(row.get("nees")), band,
            failed if row["truth"] == "failed" else row["truth"],
            row.get("verdict", ""), number(row.get("ms")),
        ])  # fmt: skip
        before = title
    judged = [row for row in rows if row.get("verdict") and row["truth"] != "failed"]
    over = [row for row in judged if row["truth"] == "overconfident"]
    unnamed = [row for row in over if row["verdict"] in ("consistent", "underconfident")]
    alarms = [
        row for row in judged
        if row["truth"] == "consistent"
        and row["verdict"] in ("overconfident", "not linear enough here")
    ]  # fmt: skip
    names = {row["problem"] for row in rows}
    said = (
        f"{len(names)} problems. Of {len(judged)} runs of our filters {len(over)} are "
        f"overconfident by the truth; the verdict, which does not see it, names "
        f"{len(over) - len(unnamed)} of them, and calls {len(alarms)} overconfident whose NEES "
        "lies in its band."
    )
    return f"{_ESTIMATION}\n\n{said}\n\n{table(heads, lines)}"


_HEAD = """# Problems that others chose

Ours beside other codes on plants and problems that the methods were not made for.
`python benchmarks/public_problems.py` measures and writes this page; the numbers are those of one
machine."""
_HOSTILE = """## Hostile plants

H∞ synthesis on 500 plants of a seeded generator (`benchmarks/hostile_plants.py`), orders 2 to 20:
poles over eight decades, states and channels in units of 1e±4, a mode that is nearly out of reach,
direct terms of 1e-7 to 1e-2, damping of 1e-6 to 1e-3, and zeros and integrators on the axis. A loop
counts as found if it is stable beyond rounding and its norm is certain to 1 %. SLICOT is the better
one of SB10AD (bisection) and SB10FD, through slycot; a plant is missed where SLICOT finds a loop
and ours does not. The ratio is that of the norms, ours over SLICOT's."""
_COLLECTION = """## A collection of plants

Static output feedback for the plants of COMPleib 1.1 (Leibfritz, 2004) of order 8 and less, with
the default effort. HIFOO's γ is that of one run of HIFOO 3.5 with its own settings. The verdict is
*confirmed* if two different routes arrive at γ, *best* if it is the proved bound. The γ of full
order is what a controller of the plant's order reaches, or its bound."""
_ESTIMATION = """## Problems of estimation

Examples of textbooks and of the tutorials of Stone Soup and FilterPy, with truths drawn from the
prior (`benchmarks/estimation_problems.py`), and three with wide priors
(`benchmarks/wide_priors.py`). The mean NEES at the end is χ² distributed if the filter is
consistent; the band holds 99.9 %. FilterPy and Stone Soup run on fewer draws, one by one."""


def write_page(record: dict[str, Any]) -> None:
    """Write the page of what is stored."""
    parts = [_HEAD]
    for name, section in (
        ("hostile", hostile_section), ("collection", collection_section),
        ("estimation", estimation_section),
    ):  # fmt: skip
        if name in record:
            parts.append(section(record[name]))
    PAGE.write_text("\n\n".join(parts) + "\n", encoding="utf-8")


def main() -> None:
    """Measure what is asked for, store it and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--hostile", type=Path, help="rows of bench_hostile.py")
    parser.add_argument("--collection", type=Path, help="rows of bench_structured.py")
    parser.add_argument("--page", action="store_true", help="write the page only")
    options = parser.parse_args()
    record: dict[str, Any] = json.loads(RECORD.read_text("utf-8")) if RECORD.exists() else {}
    if options.hostile:
        record["hostile"] = hostile_rows(options.hostile)
    if options.collection:
        record["collection"] = collection_rows(options.collection)
    if not (options.hostile or options.collection or options.page):
        record["estimation"] = measure_estimation()
    RECORD.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    write_page(record)


if __name__ == "__main__":
    main()
