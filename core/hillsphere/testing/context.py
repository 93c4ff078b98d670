"""A stage's context without a pipeline."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256

import numpy as np

__all__ = ["RecordingContext"]


class RecordingContext:
    """What a stage is given when it runs outside a pipeline; it keeps what the stage says.

    Parameters
    ----------
    seed : int
        Root seed.

    Attributes
    ----------
    messages : list of str
        What the stage wrote to the log.
    """

    def __init__(self, seed: int = 1) -> None:
        self.seed = seed
        self.messages: list[str] = []

    def rng(self, stream: str = "") -> np.random.Generator:
        """Return a generator that depends on seed and stream only."""
        key = int.from_bytes(sha256(stream.encode()).digest()[:8], "big")
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(key,)))

    def info(self, message: str) -> None:
        """Keep the message."""
        self.messages.append(message)

    def track(self, description: str, total: int | None = None) -> Callable[[int], None]:
        """Return an advance that shows nothing."""
        return lambda count: None
