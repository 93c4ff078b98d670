"""Show where the CPU time of a mission goes, by stage and by kind of work.

    python benchmarks/profile_mission.py phobos-qso  # compiled code and caches are warm
    python benchmarks/profile_mission.py phobos-qso --cold             # everything is compiled anew
    python benchmarks/profile_mission.py missions/phobos-landing.toml --profile fast --out profiles
    python benchmarks/profile_mission.py --all --profile fast --markdown

The mission runs in this process alone, without the cache of results. Every two milliseconds of
CPU time a signal looks at the stack of Python calls; each look counts for the CPU time since the
one before, so that a long call of compiled code, during which no look is possible, has its whole
time. Work of other processes (SPICE, plugins of their own) is counted in one row, by its total.

`--out` writes the stacks twice: `NAME.txt` holds one line per stack with its microseconds, which
programs for flame graphs read, and `NAME.html` is the flame graph.
"""

from __future__ import annotations

import argparse
import linecache
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from time import process_time
from types import FrameType
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

INTERVAL_S = 0.002
"""CPU time between two looks: a look takes about 20 µs, 1 % of it."""
DEPTH = 200
"""Calls of a stack that are kept, from the outermost on; recursions are cut here."""
KINDS = ("start", "compile", "kernel", "linear algebra", "drawing", "writing", "Python")
"""What work is distinguished, in the order of the table. `start` is the import of modules, and
`Python` is interpreted code with NumPy's operations on arrays between calls of compiled code."""

_STAGE = "_Run._stage"
"""The call of `hillsphere.runs.pipeline` that runs one stage, whose argument is its name."""
Key = tuple[str, ...]
"""A stack: names of calls, the outermost first."""


class Sampler:
    """CPU seconds by stack, stage and kind, collected by a timer of CPU time."""

    def __init__(self) -> None:
        self.stacks: dict[Key, float] = defaultdict(float)
        self.work: dict[tuple[str, str], float] = defaultdict(float)
        self._last = process_time()

    def __enter__(self) -> Sampler:
        self._last = process_time()
        signal.signal(signal.SIGPROF, self._look)
        signal.setitimer(signal.ITIMER_PROF, INTERVAL_S, INTERVAL_S)
        return self

    def __exit__(self, *_: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, signal.SIG_IGN)

    def _look(self, _number: int, frame: FrameType | None) -> None:
        now = process_time()
        passed, self._last = now - self._last, now
        if frame is None:
            return
        frames = list(_outwards(frame))
        stage, kind = _stage(frames), _kind(frames)
        self.work[stage, kind] += passed
        calls = list(_calls(frames))[:DEPTH]
        self.stacks[(f"stage {stage}" if stage else "outside stages", *calls, kind)] += passed


def _outwards(frame: FrameType | None) -> Iterator[FrameType]:
    while frame is not None:
        yield frame
        frame = frame.f_back


def _calls(frames: Sequence[FrameType]) -> Iterator[str]:
    """Yield the names from the outermost call in, without what all have in common."""
    stage = [i for i, f in enumerate(frames) if f.f_code.co_qualname == _STAGE]
    for frame in reversed(frames[: stage[0]] if stage else frames):
        # Six calls of the import machinery stand between two modules.
        if not frame.f_code.co_filename.startswith("<frozen importlib"):
            yield _name(frame)


def _name(frame: FrameType) -> str:
    path = Path(frame.f_code.co_filename)
    module = path.parent.name if path.stem == "__init__" else path.stem
    return f"{module}.{frame.f_code.co_qualname}"


def _stage(frames: Sequence[FrameType]) -> str:
    """Return the name of the stage that is being computed or presented, or an empty string."""
    for frame in frames:
        if frame.f_code.co_qualname == _STAGE:
            return str(frame.f_locals["name"])
    return ""


_KIND_OF_FRAME: tuple[tuple[str, str], ...] = (
    # Part of a frame's "path:function", kind. The first that matches, from the innermost call out.
    ("importlib._bootstrap", "start"),
    ("/symbolic/compile_cache.py", "compile"),
    ("/heyoka/", "compile"),
    ("/numpy/linalg/", "linear algebra"),
    ("/scipy/linalg/", "linear algebra"),
    ("/scipy/sparse/linalg/", "linear algebra"),
    ("/matplotlib/", "drawing"),
    ("/plotly/", "drawing"),
    ("/hillsphere/show/", "drawing"),
    ("/json/", "writing"),
    ("/zipfile", "writing"),
    ("/numpy/lib/", "writing"),
    ("/hillsphere/base/atomic.py", "writing"),
    ("/hillsphere/base/npz.py", "writing"),
    ("/hillsphere/products/product_codec.py", "writing"),
    ("/hillsphere/runs/store.py", "writing"),
    ("/hillsphere/runs/stage_cache.py", "writing"),
    ("/symbolic/", "compile"),
    ("/engine/dynamics/compiled.py:ArrayFunction.__init__", "compile"),
    ("/engine/dynamics/taylor.py:Taylor.__init__", "compile"),
    ("/engine/dynamics/taylor_batches.py:TaylorBatches._integrator", "compile"),
)
_FUNCTIONS_OF_ARRAYS_IN_LIB = ("format.py", "npyio.py", "_format_impl.py", "_npyio_impl.py")
"""Modules of numpy.lib that read and write files; the others compute."""
_KERNEL_CALLS = ("_function(", "propagate_", ".step(", "_compiled[", "function(", "advance(")
"""Words of a line that calls a compiled function, in the modules of `engine/dynamics`."""
_LAPACK_CALLS = ("lapack.", "blas.", "linalg.", "_lapack", "eig", "schur(", "solve(", "svd(")
"""Words of a line that calls LAPACK or BLAS without a frame of Python between."""


def _kind(frames: Sequence[FrameType]) -> str:
    innermost = frames[0]
    line = linecache.getline(innermost.f_code.co_filename, innermost.f_lineno or 0)
    path = innermost.f_code.co_filename
    if "/engine/dynamics/" in path and any(word in line for word in _KERNEL_CALLS):
        return "kernel"
    if any(word in line for word in _LAPACK_CALLS) and "/hillsphere" in path:
        return "linear algebra"
    for frame in frames:
        name = f"{frame.f_code.co_filename}:{frame.f_code.co_qualname}"
        if frame.f_code.co_qualname == _STAGE:
            break
        for part, kind in _KIND_OF_FRAME:
            if part in name:
                if part == "/numpy/lib/" and Path(frame.f_code.co_filename).name not in (
                    _FUNCTIONS_OF_ARRAYS_IN_LIB
                ):
                    continue
                return kind
    return "Python"


def profile(mission: str, options: argparse.Namespace) -> tuple[Sampler, float]:
    """Run a mission in this process; return what was sampled, and CPU seconds of others."""
    from hillsphere.cli import main  # its import belongs to the start, which is sampled below

    with tempfile.TemporaryDirectory() as scratch:
        words = ["run", mission, "--no-cache", "--workers", "0", "--quiet"]
        if options.profile:
            words += ["--profile", options.profile]
        for setting in options.set or ():
            words += ["--set", setting]
        if not options.cold:
            # A first run compiles; in a process of its own, so that the second imports everything.
            first = [*words, "--out", str(Path(scratch) / "first")]
            subprocess.run([sys.executable, "-m", "hillsphere", *first], stdout=subprocess.DEVNULL)
        words += ["--out", str(Path(scratch) / "run")]
        before = _others()
        sys.argv = ["hillsphere", *words]
        said = StringIO()
        status = 0
        with Sampler() as sampler, redirect_stdout(said), redirect_stderr(said):
            try:
                main()
            except SystemExit as end:
                status = int(end.code or 0)
        # 4: a requirement is not met, which is no fault of the run.
        if status not in (0, 4):
            raise SystemExit(f"{mission} ended with {status}\n{said.getvalue()}")
        return sampler, _others() - before


def _others() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def table(
    title: str, work: Mapping[tuple[str, str], float], others: float, *, markdown: bool
) -> str:
    """Return the table of CPU seconds by stage and kind, the largest stage first."""
    totals: dict[str, float] = defaultdict(float)
    for (stage, _), seconds in work.items():
        totals[stage] += seconds
    rows = [[title, *KINDS, "all"]]
    for stage in sorted(totals, key=lambda s: -totals[s]):
        values = [work.get((stage, kind), 0.0) for kind in KINDS]
        rows.append([stage or "outside stages", *map(_seconds, values), _seconds(totals[stage])])
    sums = [sum(v for (_, k), v in work.items() if k == kind) for kind in KINDS]
    if others >= 0.01:
        rows.append(["other processes", *[""] * len(KINDS), _seconds(others)])
    rows.append(["all", *map(_seconds, sums), _seconds(sum(sums) + others)])
    return _set(rows, markdown=markdown)


def _seconds(value: float) -> str:
    return "" if value < 0.005 else f"{value:.2f}"


def _set(rows: Sequence[Sequence[str]], *, markdown: bool) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]

    def line(row: Sequence[str]) -> str:
        cells = [row[0].ljust(widths[0])]
        cells += [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        return "| " + " | ".join(cells) + " |" if markdown else "  ".join(cells)

    lines = [line(row) for row in rows]
    if markdown:
        lines.insert(1, "|---" + "|--:" * (len(rows[0]) - 1) + "|")
    return "\n".join(lines)


def write_stacks(path: Path, stacks: Mapping[Key, float]) -> None:
    """Write the stacks with their microseconds as text, and as a flame graph beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"{';'.join(stack)} {round(1e6 * s)}" for stack, s in sorted(stacks.items())]
    path.with_suffix(".txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    _flame_graph(stacks).write_html(path.with_suffix(".html"))


def _flame_graph(stacks: Mapping[Key, float]) -> Any:
    from plotly.graph_objects import Figure, Icicle

    total: dict[Key, float] = defaultdict(float)
    for stack, seconds in stacks.items():
        for depth in range(1, len(stack) + 1):
            total[stack[:depth]] += seconds
    # What is narrower than a thousandth of the picture cannot be seen.
    least = 1e-3 * sum(stacks.values())
    shown = [key for key, seconds in total.items() if seconds >= least]
    number = {key: str(i) for i, key in enumerate(shown)}
    return Figure(
        Icicle(
            ids=list(number.values()),
            labels=[key[-1] for key in shown],
            parents=[number.get(key[:-1], "") for key in shown],
            values=[total[key] for key in shown],
            branchvalues="total",
            tiling={"orientation": "v"},
            hovertemplate="%{label}<br>%{value:.3f} s<extra></extra>",
        ),
        layout={"margin": {"t": 8, "l": 8, "r": 8, "b": 8}},
    )


def main() -> int:
    """Profile the missions, print their tables; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("mission", nargs="*", help="names of packaged missions or files")
    parser.add_argument("--all", action="store_true", help="every packaged mission")
    parser.add_argument("--profile", default="", help="profile of the missions, such as fast")
    parser.add_argument("--set", action="append", metavar="KEY=VALUE", help="replace a value")
    parser.add_argument("--cold", action="store_true", help="compile everything anew")
    parser.add_argument("--markdown", action="store_true", help="print tables for a page")
    parser.add_argument("--out", type=Path, help="directory for stacks and flame graphs")
    options = parser.parse_args()
    missions = options.mission or []
    if options.all:
        missions = [p.stem for p in sorted((Path(__file__).parents[1] / "missions").glob("*.toml"))]
    if not missions:
        parser.error("name a mission, or give --all")
    if len(missions) > 1:
        # Each in a process of its own: the second would find modules and functions in memory.
        rest = [word for word in sys.argv[1:] if word != "--all" and word not in options.mission]
        return max(
            subprocess.run([sys.executable, __file__, mission, *rest], check=False).returncode
            for mission in missions
        )
    if not options.cold:
        sampler, others = profile(missions[0], options)
    else:
        with tempfile.TemporaryDirectory() as cache:
            os.environ["HILLSPHERE_CACHE"] = cache
            sampler, others = profile(missions[0], options)
    title = f"{Path(missions[0]).stem}, CPU s"
    with suppress(BrokenPipeError):
        print(table(title, sampler.work, others, markdown=options.markdown) + "\n")
    if options.out:
        write_stacks(options.out / Path(missions[0]).stem, sampler.stacks)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
