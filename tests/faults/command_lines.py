"""The command line in processes with limits, for tests; see `run_server`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Any

__all__ = ["PLUGINS", "CommandLines", "Ended", "digests"]

ROOT = Path(__file__).parents[2]
PLUGINS = (
    ROOT / "tests/faults/plugins",
    ROOT / "tests/core/waves",
    ROOT / "examples/hillsphere-dumbbell/src",
)
"""Directories of the plugins that the missions of these tests use."""


@dataclass(frozen=True)
class Ended:
    """How a command ended; see `run_server.serve`."""

    code: int
    text: str
    seconds: float
    cpu_s: float
    signalled: bool
    after_s: float
    lost: list[str]


class CommandLines:
    """Runs commands one after the other in a directory; a context manager.

    Parameters
    ----------
    directory : Path
        Where the commands run, with the cache of compiled code.
    variables : mapping
        More variables of the environment.
    """

    def __init__(self, directory: Path, variables: Mapping[str, str] | None = None) -> None:
        self.directory = directory
        kept = {k: v for k, v in os.environ.items() if not k.startswith(("HILLSPHERE_", "HEYOKA_"))}
        path = os.pathsep.join(map(str, [ROOT, *PLUGINS, *filter(None, sys.path)]))
        self._server = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.run_server"],
            env={**kept, "PYTHONPATH": path, "OMP_NUM_THREADS": "1",
                 "HILLSPHERE_CACHE": str(directory / "cache"), **(variables or {})},
            cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, process_group=0,
        )  # fmt: skip

    def __call__(self, *arguments: object, **limits: Any) -> Ended:
        """Run a command and wait for its end.

        Parameters
        ----------
        *arguments : object
            Its command line.
        **limits
            See `run_server.serve`.
        """
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        log = self.directory / "written.txt"
        request = {
            "arguments": [*map(str, arguments)],
            "directory": str(self.directory),
            "log": str(log),
            **limits,
        }
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        answer: dict[str, Any] = json.loads(self._server.stdout.readline())
        return Ended(text=log.read_text("utf-8", "replace"), **answer)

    def __enter__(self) -> CommandLines:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        assert self._server.stdin is not None
        with self._server:
            self._server.stdin.close()


def digests(run: Path) -> dict[str, str]:
    """Return the SHA-256 of every product of a run."""
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in sorted(run.glob("*.npz"))}
