"""What the pipeline gives a running stage: random numbers, a log, progress, and the stop sign."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from types import FrameType

import numpy as np

from hillsphere.errors import Interrupted
from hillsphere.progress import Progress
from hillsphere.seeds import name_key
from hillsphere.store import RunDirectory

__all__ = ["StageContext", "stop_signals"]


class StageContext:
    """The context of one stage, see `hillsphere.interfaces.Context`.

    Parameters
    ----------
    stage : str
        Name of the stage.
    seed : int
        Root seed of the mission.
    directory : RunDirectory
        Where the log is.
    progress : Progress
        Where progress is shown.
    stopped : threading.Event
        Set when the run was asked to stop.
    """

    def __init__(
        self,
        stage: str,
        seed: int,
        directory: RunDirectory,
        progress: Progress,
        stopped: threading.Event,
    ) -> None:
        self._stage = stage
        self._seed = seed
        self._directory = directory
        self._progress = progress
        self._stopped = stopped

    @property
    def seed(self) -> int:
        """Root seed of the mission."""
        return self._seed

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a generator that depends on the mission's seed, the stage and the stream only.

        Parameters
        ----------
        stream : str
            Two streams of one stage are independent; the same stream starts anew at each call.

        Returns
        -------
        numpy.random.Generator
            PCG64 seeded by ``SeedSequence(seed, spawn_key=(hash of stage, hash of stream))``, each
            hash the first 8 bytes of the SHA-256 of the name.
        """
        key = (name_key(self._stage), name_key(stream))
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))

    def info(self, message: str) -> None:
        """Write a line to the run's log."""
        stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        self._directory.log(f"{stamp} {self._stage}: " + message.replace("\n", "\n    "))

    def track(self, description: str, total: int | None = None) -> Callable[[int], None]:
        """Show progress.

        Parameters
        ----------
        description : str
            What is being done.
        total : int, optional
            Number of items.

        Returns
        -------
        callable
            ``advance(count)``; raises `Interrupted` if the run was asked to stop, so that a stage
            that works in threads of its own stops too.
        """
        draw = self._progress.track(description, total)

        def advance(count: int) -> None:
            if self._stopped.is_set():
                raise Interrupted("the run was asked to stop")
            draw(count)

        return advance


@contextmanager
def stop_signals(stopped: threading.Event) -> Iterator[None]:
    """Turn SIGTERM and SIGINT into a `KeyboardInterrupt` and set the event, within the block.

    A process whose SIGINT is ignored (as under nohup) or handled by its own code keeps that; so
    does any thread but the main one, where Python allows no handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()
        raise KeyboardInterrupt

    taken = {}
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    try:
        for number, default in usual.items():
            if signal.getsignal(number) is default:
                taken[number] = signal.signal(number, stop)
        yield
    finally:
        for number, handler in taken.items():
            signal.signal(number, handler)
