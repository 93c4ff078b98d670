"""Toy work in pieces that a worker process can import."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hillsphere.errors import ConvergenceError, InputError

ROOT = Path(__file__).parents[2]
"""On `sys.path` of the tests that start workers: these import this module by its full name."""


class AwkwardError(Exception):
    """Cannot be made again from what pickle keeps of it."""

    def __init__(self, first: str, second: str) -> None:
        super().__init__(f"{first} and {second}")


@dataclass(frozen=True)
class Squares:
    """Squares with the number of the process that computed them; some pieces go wrong."""

    faults: tuple[tuple[int, str], ...] = ()
    scratch: str = ""
    prepared: bool = True

    def prepare(self) -> Callable[[int], tuple[int, int]]:
        if not self.prepared:
            raise InputError("no squares today")
        return self._square

    def _square(self, item: int) -> tuple[int, int]:
        match dict(self.faults).get(item, ""):
            case "raises":
                raise ConvergenceError(f"{item} does not converge")
            case "awkward":
                raise AwkwardError("one", "other")
            case "slow":
                time.sleep(0.5)
            case "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            case "dies once":
                mark = Path(self.scratch) / str(item)
                if not mark.exists():
                    mark.touch()
                    os.kill(os.getpid(), signal.SIGKILL)
            case "unsendable":
                return item, lambda: item  # type: ignore[return-value]
        return item * item, os.getpid()


@dataclass(frozen=True)
class Closed:
    """Work that no other process can be given."""

    function: Callable[[int], Any]

    def prepare(self) -> Callable[[int], Any]:
        return self.function
