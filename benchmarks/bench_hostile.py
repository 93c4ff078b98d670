"""H∞ synthesis of 500 hostile plants of six kinds, beside SLICOT's SB10AD and SB10FD.

    python benchmarks/bench_hostile.py --count 500 --csv rows.csv          # all of it: an hour
    python benchmarks/bench_hostile.py --first 100 --count 20 --csv rows.csv
    python benchmarks/bench_hostile.py --csv rows.csv --table              # of the rows so far

A loop counts as found if its eigenvalues are stable by more than rounding may have moved them and
rounding leaves its norm two digits, and if SLICOT's AB13DD finds a norm of it too. Both controllers
are closed with the plant as given, and both loops are judged by the same function. Ours does
without SLICOT. Of SLICOT the best counts of SB10AD's bisections from the γ from which
python-control begins and from one near ours, and of SB10FD at γ a little above theirs. Rows whose
indices are in the file already are not computed again.
"""

from __future__ import annotations

import argparse
import csv
import os
import warnings
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from time import process_time

import numpy as np

from hillsphere.errors import HillsphereError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.full_order.hinf import HinfDesign, hinf_synthesis
from hillsphere_controllers.full_order.modes import is_surely_stable
from hillsphere_controllers.systems.algebra import lower_lft

if __package__:
    from benchmarks.hostile_plants import KINDS, PLANTS, hostile_plant
else:
    from hostile_plants import KINDS, PLANTS, hostile_plant

CERTAIN = 1e-2
"""Relative error of a norm up to which it counts: the sentence that is held is one about 1 %."""
ABOVE = 1.01
"""Largest ratio of our norm to SLICOT's."""
BEGIN = 1e100
"""γ from which python-control lets SB10AD begin."""
BACK_OFFS = (1.001, 1.01, 1.1)
SHORT = 24
"""Plants in a run without `--long`: four of each kind."""
COLUMNS = ("index", "kind", "order", "ours", "least", "added", "slicot", "ours_s", "slicot_s",
           "ours_ab13dd", "slicot_ab13dd", "why")  # fmt: skip


def judged_norm(plant: LtiSystem, controller: LtiSystem) -> tuple[float, float]:
    """Return the norm of a loop by ours and by AB13DD (NaN without slycot); NaN if not verified."""
    try:
        loop = lower_lft(plant, controller)
        if not (loop.is_stable and is_surely_stable(loop.a)):
            return np.nan, np.nan
        norm = hinf_norm(loop)
    except HillsphereError:
        return np.nan, np.nan
    if not (norm.error <= CERTAIN and np.isfinite(norm.upper)):
        return np.nan, np.nan
    if find_spec("slycot") is None:
        return norm.value, np.nan
    import slycot

    n, (p, m) = loop.order, loop.shape
    try:
        other = float(
            slycot.ab13dd("C", "I", "S", "D", n, m, p, loop.a, np.eye(n), loop.b, loop.c, loop.d)[0]
        )
    except (slycot.exceptions.SlycotError, ValueError):
        return norm.value, np.nan
    return norm.value, other


def slicot_controllers(plant: LtiSystem, k: int, q: int, near: float) -> Iterator[LtiSystem]:
    """Yield what SB10AD and SB10FD make of a plant; `near` is a γ to begin at, NaN without."""
    import slycot

    n, (p, m) = plant.order, plant.shape
    given = plant.a, plant.b, plant.c, plant.d
    for begin in (BEGIN, 10.0 * near):
        if not 0.0 < begin < np.inf:
            continue
        try:
            # bisection alone: the scan of job 3 steps through γ and may not end within hours
            least, *made = slycot.sb10ad(
                n, m, p, k, q, begin, *given, job=1, gtol=1e-4 * near if begin < BEGIN else 0.0
            )
        except (slycot.exceptions.SlycotError, ValueError):
            continue
        yield LtiSystem(*made[:4])
        for factor in BACK_OFFS:
            try:
                made = slycot.sb10fd(n, m, p, k, q, factor * least, *given)
            except (slycot.exceptions.SlycotError, ValueError):
                continue
            yield LtiSystem(*made[:4])


def best_of_slicot(plant: LtiSystem, k: int, q: int, near: float) -> tuple[float, float]:
    """Return the least verified norm of SLICOT's controllers, by ours and by AB13DD."""
    best = (np.nan, np.nan)
    for controller in slicot_controllers(plant, k, q, near):
        if not all(np.isfinite(x).all() for x in (controller.a, controller.b, controller.c)):
            continue
        one = judged_norm(plant, controller)
        if not one[0] >= best[0] and np.isfinite(one).all():
            best = one
    return best


def added(design: HinfDesign) -> str:
    """Return what was added to the problem, in words; empty if nothing was."""
    return str(design.added or "")


def compare(index: int) -> dict[str, object]:
    """Return the row of a plant."""
    kind, plant, k, q = hostile_plant(index)
    begin, why, design = process_time(), "", None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            design = hinf_synthesis(plant, k, q)
        except Exception as error:  # a raw one is a finding too, and told as one
            why = f"{type(error).__name__}: {error}"
    if caught:
        why += f" [warned: {caught[0].message}]"
    ours_s = process_time() - begin
    ours, theirs = (np.nan, np.nan), (np.nan, np.nan)
    if design is not None:
        ours = judged_norm(plant, design.controller)
    begin = process_time()
    if find_spec("slycot") is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # slycot's own
            theirs = best_of_slicot(plant, k, q, ours[0])
    return dict(zip(COLUMNS, (
        index, kind, plant.order, ours[0], np.nan if design is None else design.least,
        "" if design is None else added(design), theirs[0], ours_s, process_time() - begin,
        ours[1], theirs[1], why,
    ), strict=True))  # fmt: skip


def read_rows(path: Path) -> list[dict[str, object]]:
    """Return the rows of a file, none if there is none."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        rows: list[dict[str, object]] = []
        for row in csv.DictReader(file):
            numbers = {
                key: float(row[key]) for key in COLUMNS if key not in ("kind", "why", "added")
            }
            rows.append({**row, **numbers})
    return list({row["index"]: row for row in rows}.values())


def summarise(rows: list[dict[str, object]], kind: str) -> dict[str, float]:
    """Return the figures of a kind, of all rows if it is empty."""
    some = [row for row in rows if not kind or row["kind"] == kind]
    get = {key: np.array([float(str(row[key])) for row in some]) for key in
           ("ours", "slicot", "least", "ours_s", "slicot_s")}  # fmt: skip
    ours, theirs = np.isfinite(get["ours"]), np.isfinite(get["slicot"])
    # a lower bound above what some controller reaches would be a wrong proof
    reached = np.fmin(get["ours"], get["slicot"])
    broken = get["least"] > reached * (1.0 + 1e-6)
    ratio = (get["ours"] / get["slicot"])[ours & theirs]
    return {
        "plants": len(some), "ours": int(ours.sum()), "slicot": int(theirs.sum()),
        "missed": int((theirs & ~ours).sum()), "bound": int(broken.sum()),
        "above": int((ratio > ABOVE).sum()),
        "largest": float(ratio.max(initial=0.0)),
        "median": float(np.median(ratio)) if ratio.size else np.nan,
        "ours_s": float(get["ours_s"].sum()), "longest_s": float(get["ours_s"].max(initial=0.0)),
        "slicot_s": float(get["slicot_s"].sum()),
    }  # fmt: skip


def print_table(rows: list[dict[str, object]]) -> None:
    """Print the figures of every kind and of all."""
    heads = ("plants", "ours", "slicot", "missed", "bound", "above", "largest", "median", "ours_s",
             "longest_s", "slicot_s")  # fmt: skip
    print(f"{'':<20}" + "".join(f"{head:>10}" for head in heads))
    for kind in (*KINDS, ""):
        got = summarise(rows, kind)
        print(f"{kind or 'all':<20}" + "".join(f"{got[head]:>10.4g}" for head in heads))


def figures() -> Mapping[str, float]:
    """Return the figures, for benchmarks/run.py; of all plants with `--long`."""
    count = PLANTS if os.environ.get("HILLSPHERE_BENCHMARK_LONG") else SHORT
    rows = [compare(index) for index in range(count)]
    got = summarise(rows, "")
    return {
        "found": got["ours"] / got["plants"],
        "missed_beside_slicot": got["missed"],
        "lower_bounds_above_a_loop": got["bound"],
        "above_slicot_by_1_percent": got["above"],
        "largest_ratio_to_slicot": got["largest"],
        "cpu_s_per_plant": got["ours_s"] / got["plants"],
    }


def main() -> None:
    """Compute rows, add them to a file, print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--first", type=int, default=0, help="index of the first plant")
    parser.add_argument("--count", type=int, default=PLANTS, help="number of plants")
    parser.add_argument("--step", type=int, default=1, help="distance of their indices")
    parser.add_argument("--csv", type=Path, help="file of the rows, which is added to")
    parser.add_argument("--table", action="store_true", help="print the table of the file only")
    options = parser.parse_args()
    rows = read_rows(options.csv) if options.csv else []
    known = {int(float(str(row["index"]))) for row in rows}
    wanted = range(options.first, min(options.first + options.count * options.step, PLANTS),
                   options.step)  # fmt: skip
    for index in () if options.table else wanted:
        if index in known:
            continue
        row = compare(index)
        rows.append(row)
        if options.csv:
            fresh = not options.csv.exists()
            with options.csv.open("a", newline="") as file:
                writer = csv.DictWriter(file, COLUMNS)
                if fresh:
                    writer.writeheader()
                writer.writerow(row)
    print_table(rows)


if __name__ == "__main__":
    main()
