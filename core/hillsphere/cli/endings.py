"""How a command ends: one message on stderr and an exit code, never a traceback at a user.

=====  ==================================================================================
code   meaning
=====  ==================================================================================
0      success
1      the mission ran but a stage failed; a check of ``doctor`` failed
2      bad input: the command line, the mission, a plugin that cannot be used
3      internal error; the traceback stands in a log file that the message names
130    interrupted (SIGINT, SIGTERM); what was finished is kept
=====  ==================================================================================
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Sequence
from enum import IntEnum
from types import FrameType
from typing import NoReturn

from hillsphere.errors import HillsphereError, InputError, Interrupted, PluginError

__all__ = ["ExitCode", "main", "run", "say"]

TRACEBACK_VARIABLE = "HILLSPHERE_TRACEBACK"
"""Set to 1, an internal error shows its traceback on stderr instead of logging it."""


class ExitCode(IntEnum):
    """Exit codes of every command."""

    SUCCESS = 0
    FAILED = 1
    BAD_INPUT = 2
    INTERNAL = 3
    INTERRUPTED = 130


def main() -> NoReturn:
    """Run the command line of this process and exit."""
    signal.signal(signal.SIGTERM, _terminated)
    code = run(sys.argv[1:])
    # Interpreter shutdown flushes stdout once more; a reader that has gone must not show there.
    _flush_or_drop()
    sys.exit(int(code))


def run(arguments: Sequence[str]) -> int:
    """Run a command.

    Parameters
    ----------
    arguments : sequence of str
        Command line without the program's name.

    Returns
    -------
    int
        One of `ExitCode`, or what a plugin's command exits with.
    """
    try:
        return _invoke(list(arguments))
    except (KeyboardInterrupt, Interrupted) as stop:
        say(str(stop) or "interrupted")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        _drop_stdout()
        return ExitCode.SUCCESS
    except (InputError, PluginError) as error:
        say(str(error))
        return ExitCode.BAD_INPUT
    except HillsphereError as error:
        say(str(error))
        return ExitCode.FAILED
    except SystemExit as leaving:
        return _code_of(leaving)
    except Exception as error:
        return _internal(error)


def _invoke(arguments: list[str]) -> int:
    import typer

    from hillsphere.cli.commands import app

    # The base of typer's errors has moved between its versions; BadParameter, two below, has not.
    command_error: type[Exception] = typer.BadParameter.__mro__[2]
    command = typer.main.get_command(app)
    try:
        with command.make_context("hillsphere", arguments) as context:
            result = command.invoke(context)
    except typer.Exit as leaving:
        return leaving.exit_code
    except typer.Abort:
        return ExitCode.INTERRUPTED
    except command_error as error:
        say(_usage_message(error))
        return int(getattr(error, "exit_code", ExitCode.BAD_INPUT))
    return result if isinstance(result, int) else ExitCode.SUCCESS


def _usage_message(error: BaseException) -> str:
    format_message: Callable[[], str] = getattr(error, "format_message", error.__str__)
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "hillsphere"
    message = " ".join(format_message().split())
    return f"{path}: {message.rstrip('.')}; see '{path} --help'"


def _terminated(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt("interrupted by SIGTERM")


def _code_of(leaving: SystemExit) -> int:
    if leaving.code is None:
        return ExitCode.SUCCESS
    if isinstance(leaving.code, int):
        return leaving.code
    say(str(leaving.code))
    return ExitCode.FAILED


def _internal(error: Exception) -> int:
    import traceback

    text = "".join(traceback.format_exception(error))
    summary = " ".join(f"{type(error).__name__}: {error}".split())
    if os.environ.get(TRACEBACK_VARIABLE) == "1":
        say(f"{text}internal error: {summary}")
        return ExitCode.INTERNAL
    try:
        where = f"the traceback is in {_log(text)}"
    except OSError as unwritable:
        where = f"no log could be written ({unwritable}); see it with {TRACEBACK_VARIABLE}=1"
    say(f"internal error: {summary}; {where}")
    return ExitCode.INTERNAL


def _log(text: str) -> str:
    from datetime import UTC, datetime

    from hillsphere.paths import cache_directory

    directory = cache_directory() / "logs"
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / f"traceback-{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}-{os.getpid()}.txt"
    command = " ".join(sys.argv)
    path.write_text(f"{command}\n\n{text}", encoding="utf-8", errors="backslashreplace")
    return str(path)


def say(message: str) -> None:
    """Write a message to stderr.

    Parameters
    ----------
    message : str
        One or more lines.
    """
    # A message may quote a file name or key that the terminal's encoding cannot show.
    encoding = sys.stderr.encoding or "utf-8"
    shown = message.encode(encoding, "backslashreplace").decode(encoding)
    try:
        print(shown, file=sys.stderr, flush=True)  # noqa: T201 - the message is for the user
    except OSError:
        # Nobody reads stderr any more; the exit code still says what happened.
        return


def _flush_or_drop() -> None:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _drop_stdout()


def _drop_stdout() -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
