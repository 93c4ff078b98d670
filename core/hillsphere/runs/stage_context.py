"""The context of a running stage: seeds, log, progress, request to stop, workspace, executor."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hillsphere.base.errors import Interrupted
from hillsphere.base.progress import Progress
from hillsphere.base.seeds import name_key
from hillsphere.base.stray_processes import end_child_of
from hillsphere.runs.store import RunDirectory

if TYPE_CHECKING:
    from hillsphere.interfaces.tasks import Executor

__all__ = ["StageContext"]


class StageContext:
    """The context of one stage, see `hillsphere.interfaces.Context`.

    Parameters
    ----------
    stage : str
        Name of the stage.
    seed : int
        Root seed of the mission.
    directory : RunDirectory
        Run directory with the log.
    progress : Progress
        Progress bars.
    stopped : threading.Event
        Set when the run was asked to stop.
    fingerprint : str
        Key of the stage.
    executor : Executor
        Executor for campaigns and for other divided work.
    """

    def __init__(
        self,
        stage: str,
        seed: int,
        directory: RunDirectory,
        progress: Progress,
        stopped: threading.Event,
        fingerprint: str,
        executor: Executor,
    ) -> None:
        self._stage = stage
        self._seed = seed
        self._directory = directory
        self._progress = progress
        self._stopped = stopped
        self._fingerprint = fingerprint
        self._executor = executor
        self._process = os.getpid()

    @property
    def fingerprint(self) -> str:
        """SHA-256 of everything that the stage's result depends on, in hexadecimal digits.

        If the stage depends on code outside any file (a class defined at a prompt), the digits are
        random, so that no other run uses its stored data.
        """
        return self._fingerprint

    @property
    def executor(self) -> Executor:
        """Executor for blocks of campaigns and for work divided by `hillsphere.runs.workers`."""
        end_child_of(self._process)
        return self._executor

    def workspace(self) -> Path:
        """Return a directory for data that the stage needs if the run is resumed.

        Returns
        -------
        Path
            An existing directory, which is removed once the stage's product is stored. A resumed
            run finds the files of the interrupted one in it.

        Raises
        ------
        StageError
            If it cannot be made.
        """
        return self._directory.workspace(self._stage)

    @property
    def seed(self) -> int:
        """Root seed of the mission."""
        return self._seed

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a random generator, seeded by the mission's seed, the stage and the stream.

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

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Show progress.

        Parameters
        ----------
        description : str
            Name of the work.
        total : int, optional
            Number of items.
        note : callable, optional
            Returns an additional text (``"3 failed"``); called each time the bar is drawn, in
            another thread.

        Returns
        -------
        callable
            ``advance(count)``; raises `Interrupted` if the run was asked to stop, so that a stage
            that works in threads of its own stops too.
        """
        draw = self._progress.track(description, total, note)

        def advance(count: int) -> None:
            end_child_of(self._process)
            if self._stopped.is_set():
                raise Interrupted("the run was asked to stop")
            draw(count)

        return advance
