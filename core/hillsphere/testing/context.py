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
    """What a stage is given when it runs outside a pipeline; it keeps what the stage says.

    Parameters
    ----------
    seed : int
        Root seed.
    executor : Executor, optional
        Where campaigns do their work; by default this process.
    workspace : Path, optional
        Directory that the stage finds what it kept in; by default a temporary one, which goes with
        the context.

    Attributes
    ----------
    messages : list of str
        What the stage wrote to the log.
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
        """The one that was given, or the serial one."""
        if self._executor is None:
            from hillsphere.cases.executors.serial import Serial
            from hillsphere.cases.executors.specs import SerialSpec

            self._executor = Serial(SerialSpec())
        return self._executor

    def workspace(self) -> Path:
        """Return the directory that was given, or a temporary one."""
        if self._workspace is None:
            self._workspace = Path(tempfile.mkdtemp(prefix="hillsphere-"))
            weakref.finalize(self, shutil.rmtree, self._workspace, ignore_errors=True)
        self._workspace.mkdir(parents=True, exist_ok=True)
        return self._workspace

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a generator that depends on seed and stream only."""
        key = int.from_bytes(sha256(stream.encode()).digest()[:8], "big")
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(key,)))

    def info(self, message: str) -> None:
        """Keep the message."""
        self.messages.append(message)

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Return an advance that shows nothing; the note is evaluated, as a bar would."""

        def advance(count: int) -> None:
            if note is not None:
                note()

        return advance
