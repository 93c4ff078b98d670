"""Gives hostile cases to commands, and says which of them did what they must not.

``python -m tests.hostile.study --seed 1 --cases 1000 --workers 2``

Each worker is a process that does one case after another, watched by `Sentinel`. One that does not
answer in time is ended, which is a fault of the case (it hangs), and another one goes on.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import os
import re
import selectors
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
WAVES = ROOT / "tests" / "core" / "waves"
LIMIT_S = 60.0
"""Most seconds of a case. The longest takes 2 s alone; the machine may be busy with other tests."""

SECRET = "the combination is 7-31-4"
_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


@dataclass
class Verdict:
    """What came of a case."""

    number: int
    kind: str
    note: str
    code: int
    seconds: float
    faults: list[str] = field(default_factory=list)


def study(seed: int, numbers: list[int], workers: int) -> Iterator[Verdict]:
    """Do cases of a seed in processes; yield a verdict for each, in any order."""
    waiting = [numbers[i::workers] for i in range(workers)]
    with tempfile.TemporaryDirectory(prefix="hostile-") as place:
        crew = [_Worker(Path(place) / str(i), seed, rest) for i, rest in enumerate(waiting) if rest]
        with selectors.DefaultSelector() as selector:
            for worker in crew:
                selector.register(worker.answers, selectors.EVENT_READ, worker)
            while crew:
                for key, _ in selector.select(timeout=1.0):
                    worker = key.data
                    line = worker.answers.readline()
                    if line:
                        verdict = worker.heard(line)
                        if verdict:
                            yield verdict
                        continue
                    selector.unregister(key.fileobj)
                    yield from worker.ended()
                    crew.remove(worker)
                    if worker.rest:
                        crew.append(worker.again())
                        selector.register(crew[-1].answers, selectors.EVENT_READ, crew[-1])
                for worker in crew:
                    worker.end_if_late()


class _Worker:
    """A process that does cases, and what is known of it."""

    def __init__(self, place: Path, seed: int, rest: list[int]) -> None:
        self.place, self.seed, self.rest = place, seed, rest
        self.late = False
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("HILLSPHERE", "HEYOKA"))}
        path = os.pathsep.join([str(ROOT), str(WAVES), *filter(None, sys.path)])
        kept |= {"PYTHONPATH": path, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        self.errors = (place / "stderr").open("w")
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "tests.hostile.study", "--worker", str(place),
             "--seed", str(seed)],
            env=kept, cwd=place, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            stderr=self.errors, start_new_session=True,
        )  # fmt: skip
        self.errors.close()
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.answers = self.process.stdout
        self.process.stdin.write(json.dumps(rest) + "\n")
        self.process.stdin.close()
        self.since = time.monotonic()

    def heard(self, line: str) -> Verdict | None:
        self.since = time.monotonic()
        found = json.loads(line)
        if not found:  # it is ready
            return None
        self.rest.remove(found["number"])
        return Verdict(**found)

    def end_if_late(self) -> None:
        if time.monotonic() - self.since > LIMIT_S and not self.late:
            self.late = True
            self.process.kill()

    def ended(self) -> Iterator[Verdict]:
        code = self.process.wait()
        self.answers.close()
        if self.rest and (self.late or code):
            what = f"no end within {LIMIT_S:.0f} s" if self.late else f"ended the process: {code}"
            said = (self.place / "stderr").read_text("utf-8", "replace")[-2000:]
            yield Verdict(self.rest.pop(0), "?", said, code, LIMIT_S, [what])

    def again(self) -> _Worker:
        return _Worker(self.place, self.seed, self.rest)


def _work(place: Path, seed: int, numbers: list[int]) -> None:
    """Do cases in this process; write a line for each to the standard output."""
    import resource

    from tests.hostile.cases import Base, make_case
    from tests.hostile.mutations import Payloads
    from tests.hostile.sentinel import Sentinel

    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what a library prints must not mix with the answers
    # A claim of a terabyte must fail here, not only where the machine has none.
    resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
    outside = place / "outside"
    outside.mkdir()
    (outside / "secret.txt").write_text(SECRET, "utf-8")
    (outside / "secret.toml").write_text(f'format = 1\nname = "s"\ntitle = "{SECRET}"\nseed = 1\n')
    (outside / "passwd").write_text(f"root:{SECRET}:0:0\n", "utf-8")
    os.mkfifo(outside / "pipe")
    os.environ["HILLSPHERE_CACHE"] = str(place / "cache")
    _in_this_process()
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.setblocking(False)
        base = Base.make(place / "base", Payloads(outside, listener.getsockname()[1]))
        _warm_up(base.place)
        sentinel = Sentinel(outside)
        before = _facts(outside)
        answers.write("{}\n")
        for number in numbers:
            here = place / "cases" / str(number)
            here.parent.mkdir(exist_ok=True)
            os.environ["HILLSPHERE_CACHE"] = str(here / "own-cache")
            os.environ.pop("HEYOKA_CACHE_DIR", None)
            case = make_case(base, seed, number, here)
            verdict = Verdict(number, case.kind, case.note, -1, 0.0)
            out, err = StringIO(), StringIO()
            begun = time.perf_counter()
            # Where it hangs stands on the standard error, which the verdict then quotes.
            faulthandler.dump_traceback_later(0.8 * LIMIT_S, exit=False)
            with chdir(here), sentinel.watching(here) as faults:
                try:
                    with redirect_stdout(out), redirect_stderr(err):
                        verdict.code = case.act()
                except BaseException as error:
                    faults.append(f"{type(error).__name__}: {error}"[:300])
            faulthandler.cancel_dump_traceback_later()
            verdict.seconds = round(time.perf_counter() - begun, 3)
            verdict.faults = faults + _said(out.getvalue() + err.getvalue())
            if verdict.code not in (0, 1, 2) and not faults:
                verdict.faults.append(f"exit code {verdict.code}: {err.getvalue()[-300:]}")
            if _facts(outside) != before:
                verdict.faults.append("something outside was changed")
                before = _facts(outside)
            try:
                listener.accept()[0].close()
                verdict.faults.append("connected to an address of the case")
            except BlockingIOError:
                pass
            if [*here.rglob("*canary-ran"), *here.rglob("imported")]:
                verdict.faults.append("code of the case ran")
            answers.write(json.dumps(vars(verdict)) + "\n")
            shutil.rmtree(here, ignore_errors=True)


def _in_this_process() -> None:
    """Let single cases be repeated here rather than in a process of their own, which takes 2 s."""
    import hillsphere.runs.rerun
    from hillsphere.cases.executors.serial import Serial
    from hillsphere.cases.executors.specs import SerialSpec

    vars(hillsphere.runs.rerun)["Pool"] = lambda spec: Serial(SerialSpec())


def _warm_up(place: Path) -> None:
    """Let everything be imported, and what packages keep for themselves be made."""
    import hillsphere.symbolic._heyoka
    from hillsphere.cli.endings import run

    again = ["--mission", "waves.toml"]
    with chdir(place), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        for words in (["rerun", "finished", "--case", "1", *again], ["figures", "finished", *again],
                      ["export", "finished"],
                      ["export", "finished", "--format", "netcdf", "--out", "x.nc"],
                      ["mat", "finished/wave.npz"], ["validate", "waves.toml"]):  # fmt: skip
            run(words)
    shutil.rmtree(place / "finished" / "cases")
    for path in (place / "finished" / "many.csv", *(place / "finished" / "figures").glob("*.png")):
        path.unlink()
    (place / "x.nc").unlink()
    assert hillsphere.symbolic._heyoka


def _facts(place: Path) -> list[tuple[Any, ...]]:
    found = []
    for path in sorted([place, *place.rglob("*")]):
        status = path.lstat()
        found.append((str(path), status.st_mode, status.st_size, status.st_mtime_ns))
    return found


def _said(text: str) -> list[str]:
    """Return what is wrong with what was written."""
    faults = []
    if "Traceback (most recent call last)" in text:
        faults.append("a traceback")
    if SECRET in text:
        faults.append("the secret was shown")
    if _STEERING.search(text):
        faults.append(f"a control character: {_STEERING.findall(text)[:3]!r}")
    return faults


def main() -> int:
    """Do the study, or the part of it that a worker does."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of single cases")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.worker is not None:
        _work(chosen.worker, chosen.seed, json.loads(sys.stdin.readline()))
        return 0
    numbers = chosen.only or list(range(chosen.cases))
    count, bad, slowest = 0, 0, 0.0
    codes: dict[str, int] = {}
    for verdict in study(chosen.seed, numbers, chosen.workers):
        count, slowest = count + 1, max(slowest, verdict.seconds)
        codes[f"{verdict.kind} {verdict.code}"] = codes.get(f"{verdict.kind} {verdict.code}", 0) + 1
        if verdict.faults:
            bad += 1
            print(f"{verdict.number} {verdict.kind} ({verdict.note}): {verdict.faults}")  # noqa: T201
    print(f"{count} cases, {bad} with faults, the slowest {slowest:.1f} s; kind and exit code:")  # noqa: T201
    print("  " + ", ".join(f"{key}: {value}" for key, value in sorted(codes.items())))  # noqa: T201
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
