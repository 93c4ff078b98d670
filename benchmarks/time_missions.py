"""Measure what the packaged missions cost, and write the times into the list and its page.

    python benchmarks/time_missions.py phobos-qso deimos-qso   # what is not measured at this commit
    python benchmarks/time_missions.py phobos-landing --run fast --figures yes    # one of the four
    python benchmarks/time_missions.py --all --run fast --again
    python benchmarks/time_missions.py phobos-qso --before TREE    # another checkout with its .venv
    python benchmarks/time_missions.py --page                  # writes the page from the list alone

A mission is run by its command, with two workers and without the cache of results, whole and with
its profile ``fast``, each with figures as the command draws them and with ``figures = false`` in
every stage. CPU time is that of the run and all its processes. The first run of each kind may have
to compile functions: it is repeated if it was short; a long one finds in the cache what the profile
``fast`` compiled. The list says too what share of the processors was busy with something else.

Each row is written as soon as it is measured into ``missions/times.json``, which is the list that
``hillsphere missions`` shows, and ``docs/theory/cost.md`` is written from it. A row of the same
commit is not measured again, so that an interrupted series goes on where it was.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
TIMES = ROOT / "missions" / "times.json"
PAGE = ROOT / "docs" / "theory" / "cost.md"
RUNS = {"fast": "fast", "whole": ""}
"""Profiles by the word for them."""
SHORT_S = 200.0
"""CPU time up to which a first run is repeated: to compile takes some ten seconds, which would be
more than 5 % of it."""
QUIET = 0.1
"""Share of the processors that others may use while a wall time is measured: beyond it the time
is theirs as well, and the page does not show it."""
COMPLETE = (0, 4)
"""Exit codes of runs that came to their end; 4: a requirement is not met."""
WORKERS = 2
Row = dict[str, Any]


def read_times() -> dict[str, Any]:
    """Return the list: ``machine`` in words, ``runs`` and ``stages``."""
    times: dict[str, Any] = json.loads(TIMES.read_text("utf-8"))
    return times


def write_times(times: dict[str, Any]) -> None:
    """Write the list, one row per line."""
    lines = [f' "machine": {json.dumps(times["machine"], ensure_ascii=False)}']
    for key in ("runs", "stages"):
        rows = sorted(times[key], key=_order)
        text = ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in rows)
        lines.append(f' "{key}": [\n{text}\n ]')
    TIMES.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def _order(row: Row) -> tuple[Any, ...]:
    return row["mission"], row["profile"], row["version"], not row.get("figures", True)


def _same(row: Row, other: Row) -> bool:
    return _order(row) == _order(other)


def measure(tree: Path, mission: str, profile: str, *, figures: bool, limit_s: float) -> Row:
    """Run a mission of a checkout; return CPU and wall time, s, and what the machine did besides.

    Raises
    ------
    SystemExit
        If the run fails; a requirement that is not met is no failure.
    """
    words = ["run", mission, "--no-cache", "--workers", str(WORKERS), "--quiet"]
    words += ["--profile", profile] if profile else []
    if not figures:
        words += [w for s in stages(tree, mission) for w in ("--set", f"stage.{s}.figures=false")]
    with tempfile.TemporaryDirectory() as scratch:
        command = ["timeout", "--signal=INT", f"{limit_s:g}", str(tree / ".venv/bin/hillsphere")]
        command += [*words, "--out", str(Path(scratch) / "run")]
        busy, begin = read_busy(), perf_counter()
        with open(Path(scratch) / "log", "w+", encoding="utf-8") as log:
            alone = os.environ | {"OMP_NUM_THREADS": "1"}
            run = subprocess.Popen(command, stdout=log, stderr=log, env=alone)
            _, status, used = os.wait4(run.pid, 0)
            run.returncode = os.waitstatus_to_exitcode(status)
            log.seek(0)
            if run.returncode not in COMPLETE:
                raise SystemExit(f"{mission} {profile} ended with {run.returncode}\n{log.read()}")
        wall, cpu = perf_counter() - begin, used.ru_utime + used.ru_stime
        return {
            "cpu_s": round(cpu, 1), "wall_s": round(wall, 1),
            "memory_mb": round(used.ru_maxrss / 1024),
            "others": round(max(0.0, read_busy() - busy - cpu) / (wall * (os.cpu_count() or 1)), 2),
        }  # fmt: skip


def stages(tree: Path, mission: str) -> Iterator[str]:
    """Yield the names of a mission's stages as they stand in its file, quoted where TOML asks."""
    with open(tree / "missions" / f"{mission}.toml", "rb") as file:
        for name in tomllib.load(file)["stage"]:
            yield name if re.fullmatch(r"[\w-]+", name) else json.dumps(name)


def read_busy() -> float:
    """Return the CPU time that all processors have been busy, s; zero where no one counts it."""
    try:
        fields = Path("/proc/stat").read_text("ascii").split("\n", 1)[0].split()[1:]
    except OSError:
        return 0.0
    user, nice, system = (int(field) for field in fields[:3])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def measure_stages(mission: str) -> dict[str, dict[str, float]]:
    """Return CPU seconds by stage and kind of work of the profile ``fast``, in one process."""
    from profile_mission import profile

    options = argparse.Namespace(profile="fast", set=None, cold=False)
    sampler, others = profile(mission, options)
    work: dict[str, dict[str, float]] = {}
    for (stage, kind), seconds in sampler.work.items():
        work.setdefault(stage, {})[kind] = round(seconds, 2)
    return work | {"other processes": {"": round(others, 2)}}


def head(tree: Path) -> str:
    """Return the commit of a checkout."""
    words = ["git", "-C", str(tree), "rev-parse", "--short=12", "HEAD"]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


def update(options: argparse.Namespace) -> None:
    """Measure what is asked for and not known, and write it."""
    tree = Path(options.before).resolve() if options.before else ROOT
    version = "before" if options.before else "now"
    commit = options.commit or head(tree)
    date = datetime.now(UTC).date().isoformat()
    asked = [
        (name, run, figures)
        for name in options.mission
        for run in options.run or RUNS
        for figures in [word == "yes" for word in options.figures or ("yes", "no")]
    ]
    warm = set()
    for name, run, figures in asked:
        row: Row = {
            "mission": name, "profile": RUNS[run], "version": version, "figures": figures,
            "commit": commit, "date": date,
        }  # fmt: skip
        if options.again or not _is_known(row, read_times()["runs"]):
            got = measure(tree, name, RUNS[run], figures=figures, limit_s=options.limit)
            if (name, run) not in warm and got["cpu_s"] < SHORT_S:
                got = measure(tree, name, RUNS[run], figures=figures, limit_s=options.limit)
            warm.add((name, run))
            _put("runs", row | got)
            print(json.dumps(row | got), flush=True)
    for name in options.mission if version == "now" and "fast" in (options.run or RUNS) else ():
        row = {"mission": name, "profile": "fast", "version": "now", "commit": commit, "date": date}
        if options.again or not _is_known(row, read_times()["stages"]):
            # A process of its own: the next mission would find modules and functions in memory.
            words = [sys.executable, __file__, "--stages-of", name]
            done = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True)
            _put("stages", row | {"work": json.loads(done.stdout)})


def _is_known(row: Row, rows: Iterable[Row]) -> bool:
    return any(_same(row, one) and row["commit"] == one["commit"] for one in rows)


def _put(key: str, row: Row) -> None:
    times = read_times()
    times[key] = [one for one in times[key] if not _same(one, row)] + [row]
    write_times(times)


HEADS = (
    "run", "CPU before", "without figures", "CPU now", "without figures", "before / now",
    "wall before", "wall now",
)  # fmt: skip


def mission_table(times: dict[str, Any]) -> str:
    """Return the table of the missions before and now, s, as Markdown."""
    found: dict[tuple[str, str], dict[tuple[str, bool], Row]] = {}
    for row in times["runs"]:
        run = found.setdefault((row["mission"], row["profile"]), {})
        run[row["version"], row["figures"]] = row
    rows = []
    for (mission, profile), run in sorted(found.items()):
        before, now = run.get(("before", True)), run.get(("now", True))
        ratio = f"{before['cpu_s'] / now['cpu_s']:.2f}" if before and now else ""
        rows.append([
            f"{mission}, {profile or 'whole'}", _cpu(before), _cpu(run.get(("before", False))),
            _cpu(now), _cpu(run.get(("now", False))), ratio, _wall(before), _wall(now),
        ])  # fmt: skip
    return _markdown(HEADS, rows)


def _cpu(row: Row | None) -> str:
    if row is None:
        return ""
    return f"{row['cpu_s']:.1f}"


def _wall(row: Row | None) -> str:
    return f"{row['wall_s']:.1f}" if row and row.get("others", 1.0) <= QUIET else ""


def provenance(times: dict[str, Any]) -> str:
    """Return which commits and days the times are of."""
    lines = []
    for version in ("before", "now"):
        rows = [row for row in times["runs"] if row["version"] == version]
        commits = sorted({f"{row['commit']} ({row['date']})" for row in rows})
        lines.append(f"{version.capitalize()}: {', '.join(commits) or 'not measured'}.")
    return f"The times are {times['machine']}. " + " ".join(lines) + "\n"


def stage_tables(times: dict[str, Any]) -> str:
    """Return the tables of the missions by stage and kind of work, as Markdown."""
    from profile_mission import table

    parts = []
    for row in times["stages"]:
        work = {(s, k): v for s, kinds in row["work"].items() if s != "other processes"
                for k, v in kinds.items()}  # fmt: skip
        others = row["work"]["other processes"][""]
        parts.append(table(f"{row['mission']}, CPU s", work, others, markdown=True) + "\n")
    return "\n".join(parts) or "Not measured.\n"


def _markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---", *["--:"] * (len(heads) - 1)], *rows]
    return "\n".join("| " + " | ".join(c or "–" for c in line) + " |" for line in lines) + "\n"


def filled(text: str, times: dict[str, Any]) -> str:
    """Return the page with the parts that are written from the list."""
    parts = {
        "missions": f"{mission_table(times)}\n{provenance(times)}",
        "stages": stage_tables(times),
    }
    for name, part in parts.items():
        begin, end = f"<!-- begin of {name} -->\n", f"<!-- end of {name} -->\n"
        pattern = f"(?<={re.escape(begin)}).*?(?={re.escape(end)})"
        text, count = re.subn(pattern, lambda _, p=part: p, text, flags=re.DOTALL)
        if count != 1:
            raise SystemExit(f"{PAGE}: expected once: {begin}…{end}")
    return text


def main() -> None:
    """Measure, write and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("mission", nargs="*", help="names of packaged missions")
    parser.add_argument("--all", action="store_true", help="every packaged mission")
    parser.add_argument("--run", action="append", choices=RUNS, help="by default both")
    parser.add_argument("--figures", action="append", choices=("yes", "no"), help="by default both")
    parser.add_argument("--before", metavar="TREE", help="checkout that is compared with this one")
    parser.add_argument("--commit", help="name of what is measured, if not that of git")
    parser.add_argument("--limit", type=float, default=7200.0, help="longest run, s of wall time")
    parser.add_argument("--again", action="store_true", help="measure again what is known")
    parser.add_argument("--page", action="store_true", help="write the page alone")
    parser.add_argument("--stages-of", metavar="MISSION", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.stages_of:
        print(json.dumps(measure_stages(options.stages_of)))
        return
    if options.all:
        options.mission = [path.stem for path in sorted((ROOT / "missions").glob("*.toml"))]
    if not options.mission and not options.page:
        parser.error("name a mission, or give --all or --page")
    update(options)
    times = read_times()
    PAGE.write_text(filled(PAGE.read_text("utf-8"), times), "utf-8")
    print(mission_table(times))


if __name__ == "__main__":
    main()
