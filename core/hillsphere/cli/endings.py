"""Ends of commands: one message on stderr and an `ExitCode`, never a traceback for the user."""

from __future__ import annotations

import atexit
import errno
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from hillsphere.base.algebra_threads import use_one_thread
from hillsphere.base.errors import HillsphereError, InputError, Interrupted, PluginError
from hillsphere.base.signals import STOPPING, end_in_time, ignore, interrupt
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.cli.streams import drop, flush_stdout, replace_closed, say

__all__ = ["main", "run"]

TRACEBACK_VARIABLE = "HILLSPHERE_TRACEBACK"
"""Set to 1, an internal error shows its traceback on stderr instead of logging it."""

COMPLETION_VARIABLE = "_HILLSPHERE_COMPLETE"
"""Set by the script of ``--show-completion``, with the shell's name, while a line is typed."""

_UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF)


def main() -> NoReturn:
    """Run the command line of this process and exit."""
    use_one_thread()
    _take_signals()
    end_in_time()
    atexit.register(_ignore_for_good)
    code: int = ExitCode.INTERRUPTED
    try:
        fault = _environment_fault()
        if fault:
            say(fault)
        code = ExitCode.BAD_INPUT if fault else run(sys.argv[1:])
    except KeyboardInterrupt:
        # A second signal arrived during the handling of the first.
        code = ExitCode.INTERRUPTED
    _ignore_signals()
    # CPython notes a KeyboardInterrupt that leaves an `exec` of text, even if it is caught farther
    # out, and would end the process by SIGINT; the next `exec` of text withdraws the note.
    exec("")
    # Interpreter shutdown flushes stdout once more, and would report an error of it by itself.
    code = _code_of_stdout(flush_stdout(), code)
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
        An `ExitCode`, or the exit code of a plugin's command.

    Notes
    -----
    Once a command was interrupted, further signals are ignored: the process is about to exit.
    """
    try:
        return _invoke(list(arguments))
    except (KeyboardInterrupt, Interrupted) as stop:
        _ignore_signals()
        say(str(stop) or "interrupted")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        drop(sys.stdout)
        return ExitCode.SUCCESS
    except OSError as error:
        # Errors of files other than stdout have a filename, or were converted where they arose.
        if error.filename is not None or error.errno not in _UNWRITABLE:
            return _internal(error)
        drop(sys.stdout)
        return _code_of_stdout(error, ExitCode.SUCCESS)
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
    if COMPLETION_VARIABLE in os.environ:
        return _complete(command)
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


def _complete(command: Any) -> int:
    """Write the completions for the line that the shell passes in the environment.

    The shell shows stderr amid the line that is being typed. So a fault, of a plugin's command for
    example, is not told; there are no completions then.
    """
    try:
        command.main([], prog_name="hillsphere", complete_var=COMPLETION_VARIABLE)
    except Exception:
        return ExitCode.BAD_INPUT
    return ExitCode.SUCCESS


def _usage_message(error: BaseException) -> str:
    format_message: Callable[[], str] = getattr(error, "format_message", error.__str__)
    context = getattr(error, "ctx", None)
    path = context.command_path if context is not None else "hillsphere"
    message = " ".join(format_message().split())
    return f"{path}: {message.rstrip('.')}; see '{path} --help'"


def _environment_fault() -> str:
    """Return the fault of the environment that prevents any command, or an empty text."""
    if "stdout" in replace_closed():
        return "standard output is closed; redirect it to /dev/null if it is not wanted"
    try:
        os.getcwd()
    except OSError as error:
        return f"the working directory cannot be used ({error.strerror}); change to another"
    return ""


def _code_of_stdout(error: OSError | None, code: int) -> int:
    """Return the exit code of a command that ended with `code`, given the error of stdout."""
    if error is None or isinstance(error, BrokenPipeError):
        return code  # a reader that has had enough is no fault
    say(f"standard output cannot be written: {error.strerror or error}")
    return code or ExitCode.BAD_INPUT


def _take_signals() -> None:
    """Let the signals that end a process interrupt it; under nohup SIGHUP stays ignored."""
    for number in STOPPING:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, interrupt)


def _ignore_signals() -> None:
    while True:
        try:
            for number in STOPPING:
                if signal.getsignal(number) is not signal.SIG_IGN:
                    signal.signal(number, ignore)
        except KeyboardInterrupt:
            continue  # one more that had already arrived
        return


def _ignore_for_good() -> None:
    """Ignore signals for good, since the shutdown of Python resets its handlers to the defaults."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)


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
    summary = " ".join(f"{_culprit(error)}: {type(error).__name__}: {error}".split())
    if os.environ.get(TRACEBACK_VARIABLE) == "1":
        say(f"{text}{summary}")
        return ExitCode.INTERNAL
    try:
        where = f"the traceback is in {_log(text)}"
    except OSError as unwritable:
        where = f"no log could be written ({unwritable}); see it with {TRACEBACK_VARIABLE}=1"
    say(f"{summary}; {where}")
    return ExitCode.INTERNAL


def _culprit(error: Exception) -> str:
    """Return the plugin that `CommandGroup.invoke` noted on an error, or ``"internal error"``."""
    notes: list[str] = getattr(error, "__notes__", [])
    return next((note for note in notes if note.startswith("plugin ")), "internal error")


def _log(text: str) -> str:
    from datetime import UTC, datetime

    from hillsphere.base.paths import cache_directory

    directory = cache_directory() / "logs"
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = directory / f"traceback-{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}-{os.getpid()}.txt"
    command = " ".join(sys.argv)
    # Mode "x" never writes to an existing file.
    with path.open("x", encoding="utf-8", errors="backslashreplace") as log:
        log.write(f"{command}\n\n{text}")
    return str(path)
