"""Whole process of the packaged mission on one core, compile cache warm, stage cache off."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter


def _run(directory: Path) -> tuple[float, float]:
    """Run `phobos-qso` once; return wall and CPU seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = perf_counter()
    subprocess.run(
        [sys.executable, "-m", "hillsphere", "run", "phobos-qso", "--no-cache",
         "--out", str(directory)],
        check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    wall = perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, cpu


def figures() -> Mapping[str, float]:
    """Return the seconds of the second of two runs; the first fills the compile cache."""
    with tempfile.TemporaryDirectory() as scratch:
        _run(Path(scratch) / "cold")
        wall, cpu = _run(Path(scratch) / "warm")
    return {"phobos_qso_wall_s": wall, "phobos_qso_cpu_s": cpu}
