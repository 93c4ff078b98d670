"""Pieces of work in threads: order, errors, giving up."""

from __future__ import annotations

import threading
import time

import pytest

from hillsphere.threads import in_threads, processors


@pytest.mark.parametrize("workers", [1, 2, 5, None])
def test_results_come_in_order(workers: int | None) -> None:
    def slow_first(k: int) -> int:
        time.sleep(0.02 if k == 0 else 0.0)
        return k * k

    assert list(in_threads(slow_first, range(40), workers)) == [k * k for k in range(40)]


def test_work_is_done_at_the_same_time() -> None:
    meeting = threading.Barrier(3, timeout=10.0)
    assert list(in_threads(lambda k: (meeting.wait(), k)[1], range(3), 3)) == [0, 1, 2]


def test_an_error_comes_at_its_place_and_ends_the_rest() -> None:
    begun: list[int] = []

    def third_fails(k: int) -> int:
        begun.append(k)
        if k == 2:
            raise ValueError("the third")
        return k

    results = in_threads(third_fails, range(1000), 2)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(ValueError, match="the third"):
        next(results)
    assert len(begun) <= 10


def test_a_caller_that_stops_leaves_no_work_behind() -> None:
    begun: list[int] = []
    results = in_threads(begun.append, range(1000), 2)
    next(results)
    results.close()
    count = len(begun)
    assert count <= 8
    time.sleep(0.05)
    assert len(begun) == count
    assert not [t for t in threading.enumerate() if t.name.startswith("hillsphere")]


def test_there_is_a_processor() -> None:
    assert processors() >= 1
