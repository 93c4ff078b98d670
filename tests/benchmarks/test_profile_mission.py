"""The profile of a mission: all CPU time is counted, under the right kind of work."""

from __future__ import annotations

from pathlib import Path
from time import process_time

import numpy as np
from benchmarks.profile_mission import Sampler, table, write_stacks


def _interpret(seconds: float) -> None:
    end = process_time() + seconds
    while process_time() < end:
        sum(range(100))


def _factorise(seconds: float) -> None:
    matrix = np.random.default_rng(1).normal(size=(60, 60))
    end = process_time() + seconds
    while process_time() < end:
        np.linalg.eigvals(matrix)


def test_all_cpu_time_is_counted_by_kind() -> None:
    begun = process_time()
    with Sampler() as sampler:
        _interpret(0.1)
        _factorise(0.3)
    spent = process_time() - begun
    assert abs(sum(sampler.work.values()) - spent) < 0.02 + 0.05 * spent
    assert abs(sampler.work["", "Python"] - 0.1) < 0.03
    assert abs(sampler.work["", "linear algebra"] - 0.3) < 0.03


def test_table_and_stacks_add_up(tmp_path: Path) -> None:
    work = {("a", "kernel"): 2.0, ("a", "Python"): 1.0, ("", "start"): 0.5}
    lines = table("toy", work, 0.25, markdown=True).splitlines()
    assert lines[2].split("|")[1].strip() == "a"
    assert lines[-1].rstrip(" |").endswith("3.75")
    write_stacks(tmp_path / "toy", {("stage a", "f.g", "kernel"): 2.0, ("stage a", "f.h"): 1.0})
    assert "stage a;f.g;kernel 2000000" in (tmp_path / "toy.txt").read_text()
    assert "stage a" in (tmp_path / "toy.html").read_text()
