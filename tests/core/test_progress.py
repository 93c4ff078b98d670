"""Progress is drawn on a terminal only, and leaves it as it was."""

from __future__ import annotations

import io
import subprocess
import sys
from typing import NoReturn

import pytest

from hillsphere.base.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def run(progress: Progress) -> None:
    # Entered twice, as the command line and the pipeline do.
    with progress, progress:
        for number, name in enumerate(("family", "maps"), 1):
            with progress.stage(name, number, 2):
                advance = progress.track("members [bold]", 4)
                for _ in range(4):
                    advance(1)
                progress.track("endless")(1)
        assert progress.active == (progress._bars is not None)
    assert progress._bars is None


def test_a_terminal_shows_stage_bar_count_and_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    run(Progress(stream=stream))
    shown = stream.getvalue()
    for part in ("family", "maps", "members [bold]", "endless", "2/2", "0/4", "left"):
        assert part in shown
    # transient: the last thing is an erased line
    assert shown.rstrip().endswith("\x1b[2K")


@pytest.mark.parametrize(("stream", "quiet"), [(Terminal(), True), (io.StringIO(), False)])
def test_silent_when_quiet_or_no_terminal(stream: io.StringIO, quiet: bool) -> None:
    progress = Progress(quiet=quiet, stream=stream)
    run(progress)
    assert not progress.active
    assert stream.getvalue() == ""


def test_bars_end_with_an_error() -> None:
    progress = Progress(stream=Terminal())

    def stopped() -> NoReturn:
        with progress, progress.stage("family", 1, 1):
            progress.track("members")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    assert progress._bars is None


def test_advance_after_its_stage_is_harmless() -> None:
    progress = Progress(stream=Terminal())
    with progress:
        with progress.stage("family", 1, 1):
            late = progress.track("members", 2)
        late(1)


def test_nothing_is_imported_to_be_silent() -> None:
    code = (
        "import sys\nfrom hillsphere.base.progress import Progress\n"
        "with Progress() as p, p.stage('a', 1, 1): p.track('b', 3)(1)\n"
        "print([m for m in ('rich', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_a_note_is_what_it_is_when_the_bar_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    stream = Terminal()
    failed = 0
    with Progress(stream=stream) as progress, progress.stage("verify", 1, 1):
        advance = progress.track("cases", 3, lambda: f"{failed} failed [in all]")
        assert progress._bars is not None
        for failed in (0, 2):
            advance(1)
            progress._bars.refresh()
            assert f"{failed} failed [in all]" in stream.getvalue()
