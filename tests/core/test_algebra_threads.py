"""Linear algebra in one thread: by default, never against the user's choice, and in time."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from hillsphere.base.algebra_threads import ONE_THREAD, use_one_thread


@pytest.fixture
def without_numpy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "numpy", raising=False)
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "")  # restored after the test
        monkeypatch.delenv(name)


@pytest.mark.usefixtures("without_numpy")
def test_one_thread_unless_the_user_has_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    use_one_thread()
    assert "OPENBLAS_NUM_THREADS" not in os.environ
    assert os.environ["OMP_NUM_THREADS"] == "8"
    monkeypatch.delenv("OMP_NUM_THREADS")
    use_one_thread()
    assert {os.environ[name] for name in ONE_THREAD} == {"1"}


def test_the_command_sets_it_before_numpy_is_loaded() -> None:
    """What the variables say is what the library does: a product starts no thread."""
    code = """
import os, sys
import hillsphere.cli.endings as endings

def threads():
    return len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 1

def multiply(arguments):
    assert "numpy" not in sys.modules
    before = threads()
    import numpy
    a = numpy.ones((600, 600))
    a @ a
    print(threads() - before)
    return 0

endings.run = multiply
endings.main()
"""
    kept = {k: v for k, v in os.environ.items() if k not in ONE_THREAD}
    done = subprocess.run(
        [sys.executable, "-c", code], env=kept, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == 0
