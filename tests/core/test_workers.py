"""Pieces of a stage's work in worker processes: order, errors, deaths, what is done here."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.core.pieces import ROOT, AwkwardError, Closed, Squares

from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import PoolSpec, SerialSpec
from hillsphere.errors import ConvergenceError, InputError, StageError
from hillsphere.interfaces.tasks import Crew, Executor, Work
from hillsphere.runs import workers
from hillsphere.runs.workers import Workers
from hillsphere.testing import RecordingContext

POOL = Pool(PoolSpec(workers=2))
SERIAL = Serial(SerialSpec())


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT))


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is done in this process while there is another."""
    monkeypatch.setattr(workers, "HERE_S", 0.0)


def results(work: Squares, count: int = 6, executor: Executor = POOL) -> Iterator[tuple[int, int]]:
    with Workers(RecordingContext(executor=executor), work) as crew:
        yield from crew.map(range(count))


@pytest.mark.usefixtures("at_once")
def test_results_come_in_order_from_other_processes() -> None:
    found = list(results(Squares(faults=((0, "slow"),)), 7))
    assert [value for value, _ in found] == [k * k for k in range(7)]
    processes = {process for _, process in found}
    assert len(processes) == 2
    assert os.getpid() not in processes


@pytest.mark.parametrize("executor", [SERIAL, Pool(PoolSpec(workers=1))])
def test_without_others_all_is_done_here(
    executor: Executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "HERE_S", 0.0)
    assert list(results(Squares(), 5, executor)) == [(k * k, os.getpid()) for k in range(5)]


def test_what_is_quickly_done_needs_no_other_process() -> None:
    class Nobody:
        def crew(self, work: Work) -> Crew:
            raise AssertionError("no worker was needed")

    assert list(results(Squares(), 5, Nobody())) == [(k * k, os.getpid()) for k in range(5)]


def test_the_last_pieces_are_done_here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "HERE_S", 0.2)
    found = list(results(Squares(faults=((5, "slow"),)), 6))
    assert [value for value, _ in found] == [k * k for k in range(6)]
    assert [process == os.getpid() for _, process in found] == [False] * 5 + [True]


@pytest.mark.usefixtures("at_once")
def test_workers_are_kept_for_what_comes_next() -> None:
    with Workers(RecordingContext(executor=POOL), Squares()) as crew:
        first = list(crew.map(range(4)))
        second = list(crew.map(range(4, 6)))
        assert list(crew.map([])) == []
    assert [value for value, _ in first + second] == [k * k for k in range(6)]
    assert {process for _, process in second} <= {process for _, process in first}


@pytest.mark.usefixtures("at_once")
def test_an_error_is_raised_at_its_place_as_what_it_is() -> None:
    found = results(Squares(faults=((0, "slow"), (2, "raises"))))
    assert [next(found)[0], next(found)[0]] == [0, 1]
    with pytest.raises(ConvergenceError) as caught:
        next(found)
    assert str(caught.value) == "2 does not converge"
    assert "in _square" in "".join(caught.value.__notes__)


def test_an_error_of_this_process_is_raised_at_its_place() -> None:
    found = results(Squares(faults=((2, "raises"), (4, "awkward"))), executor=SERIAL)
    assert [next(found)[0], next(found)[0]] == [0, 1]
    with pytest.raises(ConvergenceError, match=r"^2 does not converge$"):
        next(found)
    with pytest.raises(AwkwardError):
        list(results(Squares(faults=((4, "awkward"),)), executor=SERIAL))


@pytest.mark.usefixtures("at_once")
def test_an_error_that_cannot_be_sent_is_told() -> None:
    with pytest.raises(StageError) as caught:
        list(results(Squares(faults=((1, "awkward"),))))
    assert str(caught.value) == "AwkwardError: one and other"
    assert "in _square" in "".join(caught.value.__notes__)


@pytest.mark.usefixtures("at_once")
def test_a_result_that_cannot_be_sent_is_told() -> None:
    with pytest.raises(StageError, match="pickle"):
        list(results(Squares(faults=((1, "unsendable"),))))


@pytest.mark.parametrize("executor", [SERIAL, POOL])
@pytest.mark.usefixtures("at_once")
def test_work_that_cannot_be_prepared(executor: Executor) -> None:
    with pytest.raises(InputError) as caught:
        list(results(Squares(prepared=False), executor=executor))
    assert str(caught.value) == "no squares today"


@pytest.mark.usefixtures("at_once")
def test_a_piece_whose_worker_dies_is_done_again(tmp_path: Path) -> None:
    found = list(results(Squares(faults=((1, "dies once"),), scratch=str(tmp_path)), 4))
    assert [value for value, _ in found] == [0, 1, 4, 9]
    assert [mark.name for mark in tmp_path.iterdir()] == ["1"]


@pytest.mark.usefixtures("at_once")
def test_a_piece_that_kills_its_workers_ends_the_stage() -> None:
    with pytest.raises(StageError, match=r"^3 workers ended .* \(signal 9 \(SIGKILL\)\)$"):
        list(results(Squares(faults=((0, "dies"),)), 2))


@pytest.mark.usefixtures("at_once")
def test_work_that_cannot_be_sent_is_done_here() -> None:
    ctx = RecordingContext(executor=POOL)
    with Workers(ctx, Closed(lambda k: (k, os.getpid()))) as crew:
        assert list(crew.map(range(3))) == [(k, os.getpid()) for k in range(3)]
    (message,) = ctx.messages
    assert message.startswith("done in the process of the run: the work cannot be sent")


@pytest.mark.usefixtures("at_once")
def test_a_caller_that_stops_leaves_no_process_behind() -> None:
    processes: set[int] = set()

    def stops() -> None:
        work = Squares(faults=((5, "slow"),))
        with Workers(RecordingContext(executor=POOL), work) as crew:
            for value, process in crew.map(range(1000)):
                processes.add(process)
                if value == 9:
                    raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stops()
    for process in processes:
        with pytest.raises(ProcessLookupError):
            os.kill(process, 0)
