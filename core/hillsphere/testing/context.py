"""A stage's context without a pipeline."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from hillsphere.interfaces.tasks import Executor

__all__ = ["RecordingContext"]


class RecordingContext:
    """A context for a stage outside a pipeline, which records its messages.

    Parameters
    ----------
    seed : int
        Root seed.
    executor : Executor, optional
        Executor of campaigns; by default this process.
    workspace : Path, optional
        Directory for the stage's stored data; by default a temporary one, which is removed with the
        context.

    Attributes
    ----------
    messages : list of str
        Messages of the stage to the log.
    """

    def __init__(
        self, seed: int = 1, executor: Executor | None = None, workspace: Path | None = None
    ) -> None:
        self.seed = seed
        self.messages: list[str] = []
        self._executor = executor
        self._workspace = workspace

    @property
    def fingerprint(self) -> str:
        """64 hexadecimal digits that depend on the seed only."""
        return sha256(str(self.seed).encode()).hexdigest()

    @property
    def executor(self) -> Executor:
        """The given executor, or the serial one."""
        if self._executor is None:
            from hillsphere.cases.executors.serial import Serial
            from hillsphere.cases.executors.specs import SerialSpec

            self._executor = Serial(SerialSpec())
        return self._executor

    def workspace(self) -> Path:
        """Return the given directory, or a temporary one."""
        if self._workspace is None:
            self._workspace = Path(tempfile.mkdtemp(prefix="hillsphere-"))
            weakref.finalize(self, shutil.rmtree, self._workspace, ignore_errors=True)
        self._workspace.mkdir(parents=True, exist_ok=True)
        return self._workspace

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a random generator, seeded by the seed and the stream."""
        key = int.from_bytes(sha256(stream.encode()).digest()[:8], "big")
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(key,)))

    def info(self, message: str) -> None:
        """Record the message."""
        self.messages.append(message)

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Return an `advance` without display; the note is evaluated as for a bar."""

        def advance(count: int) -> None:
            if note is not None:
                note()

        return advance
