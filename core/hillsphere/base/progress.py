"""Progress bars on the terminal.

A run shows one bar for its stages and, below it, one for the work of the running stage: the items
done, their total, the rate, and the time left. The bars go to the standard error stream, and only
if that is a terminal, so that the standard output holds results alone.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress as RichProgress
    from rich.progress import TaskID

__all__ = ["Progress"]


class Progress:
    """Bars on the standard error stream; a context manager.

    Parameters
    ----------
    quiet : bool
        Draw nothing.
    stream : TextIO, optional
        Where to draw; nothing is drawn if it is not a terminal. By default ``sys.stderr``.

    Notes
    -----
    rich is imported only when something will be drawn.
    """

    def __init__(self, *, quiet: bool = False, stream: TextIO | None = None) -> None:
        self._stream = stream if stream is not None else sys.stderr
        self.active = not quiet and self._stream.isatty()
        self._bars: RichProgress | None = None
        self._stages: TaskID | None = None
        self._open: list[TaskID] = []
        self._depth = 0

    def __enter__(self) -> Progress:
        # The command line and the pipeline both enter it; the outermost starts and stops.
        self._depth += 1
        if self.active and self._bars is None:
            self._bars = _bars(self._stream)
            self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._depth -= 1
        if self._bars is not None and self._depth == 0:
            self._bars.stop()
            self._bars = None
            self._stages = None

    @contextmanager
    def stage(self, name: str, number: int, total: int) -> Iterator[None]:
        """Show that a stage of the mission is running.

        Parameters
        ----------
        name : str
            Name of the stage.
        number, total : int
            Its position, from 1, and the number of all stages.
        """
        bars = self._bars
        if bars is None:
            yield
            return
        if self._stages is None:
            self._stages = bars.add_task(name, total=total)
        bars.update(self._stages, description=name, completed=number - 1)
        try:
            yield
        finally:
            while self._open:
                bars.update(self._open.pop(), visible=False)
            bars.update(self._stages, completed=number)

    def track(
        self, description: str, total: int | None = None, note: Callable[[], str] | None = None
    ) -> Callable[[int], None]:
        """Show a bar for a part of the running stage, until that stage ends.

        Parameters
        ----------
        description : str
            What is being done.
        total : int, optional
            Number of items; without it the bar pulses.
        note : callable, optional
            Returns a text to show behind the bar; called whenever the bar is drawn, in another
            thread.

        Returns
        -------
        callable
            ``advance(count)`` adds to the items done; cheap, and callable from any thread.
        """
        bars = self._bars
        if bars is None:
            return lambda count: None
        # Hidden, never removed: a late call from a thread must find its task.
        for task in bars.tasks:
            if task.finished and task.id != self._stages:
                bars.update(task.id, visible=False)
        # Markup is off (see _bars), so a description with brackets stays as it is.
        made = bars.add_task(f"  {description}", total=total, note=note)
        self._open.append(made)
        return lambda count: bars.advance(made, count)


def _bars(stream: TextIO) -> RichProgress:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        ProgressColumn,
        Task,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as RichProgress
    from rich.text import Text

    class Rate(ProgressColumn):
        """Items per second, or per minute where that is less than one."""

        def render(self, task: Task) -> Text:
            speed = task.finished_speed or task.speed
            if speed is None:
                return Text("")
            return Text(f"{speed:.3g}/s" if speed >= 1 else f"{60 * speed:.3g}/min")

    class Note(ProgressColumn):
        """The text of the running stage's `note`, evaluated when the bar is drawn."""

        def render(self, task: Task) -> Text:
            note = task.fields.get("note")
            return Text(note() if note is not None else "")

    return RichProgress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        Rate(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        Note(),
        console=Console(file=stream),
        transient=True,
    )
