"""Mutation score: how many small faults of a module its own tests notice.

    python benchmarks/mutation.py                   # every module of mutation.toml
    python benchmarks/mutation.py averager shooting # these
    python benchmarks/mutation.py --count 40 --seed 7 averager
    python benchmarks/mutation.py --list averager   # show the mutants, run nothing

For each module some mutants are drawn by a fixed seed (see `mutants`), each is run against the
module's own test files, and the script fails if fewer than 85 % are killed. A mutant is killed if a
test fails, the interpreter dies, or the tests take more than three times as long as without it.
The score is over the mutants that are not equivalent: a mutant that no test can tell from the
original, because it computes the same, stands in ``mutation.toml`` with the reason, by its function
and text. Those are run as well; one that is killed was no equivalent, and the script fails.

A mutant costs little: the process that waits has imported the third-party packages, each mutant is
a fork of it that imports the framework with the one module exchanged and runs pytest inside itself,
the quickest tests first, until the first failure. Compiled code is shared through links, so that no
mutant alters another's.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import os
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # before numpy is imported, which reads them then

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE))

from mutants import Mutant, draw_mutants, generate_mutants  # noqa: E402

AT_LEAST = 0.85
"""Share of the mutants that a module's own tests must kill."""
COUNT, SEED = 20, 20261126
TIME_FACTOR, MARGIN_S = 3.0, 5.0
"""A mutant has this multiple of the unmutated time, and this much more for a busy machine."""


@dataclass(frozen=True)
class Target:
    """A module with the tests that must notice its faults.

    Parameters
    ----------
    name : str
        As it is called on the command line.
    module : str
        Dotted name.
    path : Path
        Its source file.
    tests : tuple of str
        Test files, or single tests (``file::test``).
    equivalents : mapping
        (function, before, after) of an equivalent mutant → the reason.
    """

    name: str
    module: str
    path: Path
    tests: tuple[str, ...]
    equivalents: dict[tuple[str, str, str], str] = field(default_factory=dict)


@dataclass
class Score:
    """What became of the mutants of one target."""

    target: Target
    killed: list[tuple[Mutant, str]] = field(default_factory=list)
    survivors: list[Mutant] = field(default_factory=list)
    equivalents: list[Mutant] = field(default_factory=list)
    refuted: list[Mutant] = field(default_factory=list)

    @property
    def ratio(self) -> float:
        """Share of the mutants that are not equivalent and were killed."""
        total = len(self.killed) + len(self.survivors)
        return len(self.killed) / total if total else 0.0


def read_targets(table: Path) -> tuple[dict[str, Target], list[str]]:
    """Return the targets of a table by name, and what is imported before any of them.

    Raises
    ------
    FileNotFoundError
        If a source or a test file is not there.
    ValueError
        If an equivalent mutant belongs to no target, or no longer fits the source.
    """
    data = tomllib.loads(table.read_text())
    base = table.resolve().parent / data.get("base", ".")
    targets: dict[str, Target] = {}
    for name, entry in data["target"].items():
        paths = [base / entry["source"], *(base / t.partition("::")[0] for t in entry["tests"])]
        for path in paths:
            if not path.is_file():
                raise FileNotFoundError(f"{table.name}: target {name!r}: {path} is not a file")
        tests = tuple(str(base / test) for test in entry["tests"])
        targets[name] = Target(name, module_name(paths[0]), paths[0], tests)
    for entry in data.get("equivalent", []):
        if entry["target"] not in targets:
            raise ValueError(f"{table.name}: no target is called {entry['target']!r}")
        target = targets[entry["target"]]
        key = (entry["function"], entry["before"], entry["after"])
        target.equivalents[key] = entry["reason"]
    for target in targets.values():
        keys = {mutant.key for mutant in generate_mutants(target.path.read_text())}
        if stale := target.equivalents.keys() - keys:
            listed = "; ".join(f"{function}: {before!r}" for function, before, _ in stale)
            raise ValueError(f"{table.name}: not in {target.path.name} any more: {listed}")
    return targets, data.get("warm", [])


def module_name(path: Path) -> str:
    """Return the dotted name of a source file: up to the topmost folder with an ``__init__.py``."""
    parts, folder = [path.stem], path.resolve().parent
    while (folder / "__init__.py").is_file():
        parts.insert(0, folder.name)
        folder = folder.parent
    return ".".join(parts)


class _Loader(SourceFileLoader):
    """Loads a module from changed source."""

    def __init__(self, name: str, path: str, source: str) -> None:
        super().__init__(name, path)
        self.source = source

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.source, self.path, "exec", dont_inherit=True)


class _Finder:
    """Finds one module, to be loaded from changed source."""

    def __init__(self, name: str, source: str) -> None:
        self.name, self.source = name, source

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name != self.name:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(name, spec.origin, self.source)
        return spec


class _Order:
    """A pytest plugin: measures the tests, or runs the quickest first."""

    def __init__(self, durations: dict[str, float], out: Path | None) -> None:
        self.durations, self.out = durations, out

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        if self.out is None:
            items.sort(key=lambda item: self.durations.get(item.nodeid, 0.0))

    def pytest_runtest_logreport(self, report: Any) -> None:
        before = self.durations.get(report.nodeid, 0.0)
        self.durations[report.nodeid] = before + report.duration

    def pytest_sessionfinish(self) -> None:
        if self.out is not None:
            self.out.write_text("".join(f"{t}\t{n}\n" for n, t in self.durations.items()))


def run_tests(
    target: Target,
    source: str | None,
    scratch: Path,
    durations: dict[str, float],
    limit_s: float,
    measured: Path | None = None,
) -> tuple[int | None, float]:
    """Run a target's tests in a fork, with changed source; return the exit code and the seconds.

    The code is pytest's, 0 if all tests passed; negative if a signal ended it; None if it took
    longer than `limit_s`.
    """
    sys.stdout.flush()
    started = time.monotonic()
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.setsid()  # so that what a test starts ends with it
            log = os.open(scratch / "log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
            os.dup2(log, 1)
            os.dup2(log, 2)
            os.environ["HILLSPHERE_CACHE"] = str(scratch / "cache")
            os.chdir(ROOT)
            if source is not None:
                sys.meta_path.insert(0, _Finder(target.module, source))
            code = _pytest(target, scratch, _Order(dict(durations), measured))
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    try:
        ended = _wait(child, started + limit_s)
    finally:
        _end_group(child)
    return ended, time.monotonic() - started


def _pytest(target: Target, scratch: Path, order: _Order) -> int:
    import pytest

    options = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "--tb=no", "--no-header",
               f"--basetemp={scratch / 'tmp'}"]  # fmt: skip
    return int(pytest.main([*options, *target.tests], plugins=[order]))


def _wait(child: int, deadline: float) -> int | None:
    while time.monotonic() < deadline:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    return None


def _end_group(child: int) -> None:
    """End a fork and all that it started; it is the leader of its own group."""
    try:
        os.killpg(child, signal.SIGKILL)
    except ProcessLookupError:
        return
    with suppress(ChildProcessError):  # it had ended by itself, and only what it started was left
        os.waitpid(child, 0)


@contextmanager
def _scratch(warm: Path) -> Iterator[Path]:
    """Make a directory whose cache holds the compiled code of `warm`, by links."""
    directory = Path(tempfile.mkdtemp(prefix="mutant-"))
    try:
        if warm.is_dir():
            shutil.copytree(warm, directory / "cache", copy_function=os.link)
        else:
            (directory / "cache").mkdir(mode=0o700)
        yield directory
    finally:
        shutil.rmtree(directory, ignore_errors=True)


def score_target(
    target: Target, count: int, seed: int, margin_s: float = MARGIN_S, verbose: bool = False
) -> Score:
    """Run the mutants of a target.

    Raises
    ------
    RuntimeError
        If its tests fail without any mutant.
    """
    source = target.path.read_text()
    mutants = generate_mutants(source)
    score = Score(target)
    base = Path(tempfile.mkdtemp(prefix="mutation-"))
    try:
        timings = base / "durations"
        durations: dict[str, float] = {}
        # Twice: the first run fills the cache of compiled code, the second gives the times.
        for measured in (timings, None):
            code, seconds = run_tests(target, None, base, durations, 3600.0, measured)
            if code != 0:
                log = (base / "log").read_text()[-2000:]
                raise RuntimeError(f"{target.name}: the tests fail without a mutant:\n{log}")
            rows = (line.split("\t", 1) for line in timings.read_text().splitlines())
            durations = {name: float(took) for took, name in rows}
        shutil.rmtree(base / "cache" / "stages", ignore_errors=True)
        limit_s = TIME_FACTOR * seconds + margin_s
        print(f"{target.name}: {len(mutants)} places, tests take {seconds:.1f} s", flush=True)
        known = target.equivalents
        active = [mutant for mutant in mutants if mutant.key not in known]
        drawn = draw_mutants(active, count, seed)
        for mutant in [*drawn, *(mutant for mutant in mutants if mutant.key in known)]:
            with _scratch(base / "cache") as scratch:
                code, took = run_tests(target, mutant.source, scratch, durations, limit_s)
            how = "hung" if code is None else f"signal {-code}" if code < 0 else "a test failed"
            if mutant.key in known:
                (score.refuted if code != 0 else score.equivalents).append(mutant)
            elif code == 0:
                score.survivors.append(mutant)
            else:
                score.killed.append((mutant, how))
            if verbose:
                state = "survived" if code == 0 else f"killed ({how})"
                print(f"  {took:5.1f} s {state}: {mutant}", flush=True)
    finally:
        shutil.rmtree(base, ignore_errors=True)
    return score


def print_score(score: Score) -> bool:
    """Print what became of a target's mutants; return whether it passes."""
    total = len(score.killed) + len(score.survivors)
    passes = score.ratio >= AT_LEAST and not score.refuted
    print(
        f"{score.target.name:<22} {len(score.killed):>3} of {total:<3} killed {score.ratio:>6.0%}"
        f"  {len(score.equivalents)} equivalent  {'' if passes else 'FAILED'}"
    )
    for mutant in score.survivors:
        print(f"  survived: {score.target.path.name}:{mutant}")
    for mutant in score.refuted:
        print(f"  listed as equivalent, but killed: {score.target.path.name}:{mutant}")
    sys.stdout.flush()
    return passes


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, run, print; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("names", nargs="*", help="targets; all if none is given")
    parser.add_argument("--table", type=Path, default=HERE / "mutation.toml", help="targets")
    parser.add_argument("--count", type=int, default=COUNT, help=f"mutants of each ({COUNT})")
    parser.add_argument("--seed", type=int, default=SEED, help="which of them")
    margin = f"seconds a mutant has beside {TIME_FACTOR:g} times the tests' own ({MARGIN_S:g})"
    parser.add_argument("--margin", type=float, default=MARGIN_S, help=margin)
    parser.add_argument("--list", action="store_true", help="show the mutants, run nothing")
    parser.add_argument("--verbose", action="store_true", help="show each mutant as it ends")
    options = parser.parse_args(arguments)
    try:
        targets, warm = read_targets(options.table)
    except (OSError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    if unknown := [name for name in options.names if name not in targets]:
        known = ", ".join(targets)
        print(f"no target is called {unknown[0]!r}; there are {known}", file=sys.stderr)
        return 2
    chosen = [targets[name] for name in options.names or targets]
    if options.list:
        for target in chosen:
            print(target.name)
            for mutant in draw_mutants(
                generate_mutants(target.path.read_text()), options.count, options.seed
            ):
                note = target.equivalents.get(mutant.key)
                print(f"  {mutant}" + (f"\n    equivalent: {note}" if note else ""))
        return 0
    for name in ("pytest", *warm):
        importlib.import_module(name)
    gc.freeze()  # so that the forks' collector does not touch, and thereby copy, these pages
    failed = 0
    for target in chosen:
        score = score_target(target, options.count, options.seed, options.margin, options.verbose)
        failed += not print_score(score)
    if failed:
        print(f"{failed} target(s) below {AT_LEAST:.0%}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
