"""Nothing that a stranger has written is connected to, run, followed out of its place, or hangs."""

from __future__ import annotations

import os
import sys
from collections import Counter

import pytest
from tests.hostile.study import study

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="FIFOs, devices and /proc")

SAMPLE = 45
"""Cases of the sample: five of each of the nine makers, in some 10 s."""


def judged(seed: int, cases: int, workers: int) -> Counter[str]:
    """Do the first cases of a seed; return how many of each kind there were."""
    verdicts = list(study(seed, list(range(cases)), workers))
    faults = {v.number: (v.kind, v.note, v.faults) for v in verdicts if v.faults}
    assert faults == {}
    assert sorted(v.number for v in verdicts) == list(range(cases))
    # Something must be refused, and something must still work: else nothing was tried.
    assert {v.code for v in verdicts} >= {0, 2}
    return Counter(v.kind for v in verdicts)


def test_a_sample_of_hostile_cases() -> None:
    counts = judged(seed=32, cases=SAMPLE, workers=1)
    assert counts == {"run": 20, "mission": 5, "cache": 5, "data": 10, "output": 5}


@pytest.mark.slow
def test_a_thousand_hostile_cases() -> None:
    judged(seed=1, cases=1080, workers=max(1, (os.cpu_count() or 2) // 2))
