"""The signals that end a run: told to its threads at once, and given back afterwards."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from hillsphere.base.signals import STOPPING, interrupt, stop_signals


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in STOPPING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", STOPPING)
@pytest.mark.parametrize("handler", ["usual", "command line"])
def test_every_signal_sets_the_event_at_once(number: signal.Signals, handler: str) -> None:
    usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
    given: Any = usual if handler == "usual" else interrupt
    signal.signal(number, given)
    stopped = threading.Event()
    with stop_signals(stopped):
        with pytest.raises(KeyboardInterrupt) as told:
            signal.raise_signal(number)
        assert stopped.is_set()
    if given is not signal.default_int_handler:
        assert str(told.value) == f"interrupted by {number.name}"
    assert signal.getsignal(number) is given


@pytest.mark.parametrize("number", STOPPING)
def test_what_is_ignored_or_handled_elsewhere_stays_so(number: signal.Signals) -> None:
    heard: list[int] = []

    def own(number: int, frame: object) -> None:
        heard.append(number)

    stopped = threading.Event()
    for handler in (own, signal.SIG_IGN):
        signal.signal(number, handler)
        with stop_signals(stopped):
            signal.raise_signal(number)
        assert signal.getsignal(number) is handler
    assert heard == [number]
    assert not stopped.is_set()


def test_another_thread_takes_no_signals() -> None:
    def run() -> None:
        with stop_signals(threading.Event()):
            found.append([signal.getsignal(number) for number in STOPPING])

    found: list[Any] = []
    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert found == [[signal.getsignal(number) for number in STOPPING]]


def test_a_signal_that_meets_a_destructor_stops_the_run_without_noise(
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Closing:
        def __del__(self) -> None:
            signal.raise_signal(signal.SIGTERM)

    stopped = threading.Event()
    with stop_signals(stopped):
        Closing()
    assert stopped.is_set()
    assert capsys.readouterr().err == ""
