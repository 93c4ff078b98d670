"""Named exceptions of the framework, all under `HillsphereError`.

The command line turns each of them into one message without a traceback: `InputError` and its
children exit with code 2, `StageError` with code 1, `Interrupted` with 130.
"""

from __future__ import annotations


def describe_error(error: BaseException) -> str:
    """Return the message of an error on one line, with its class if it is none of ours."""
    text = " ".join(str(error).split())
    if isinstance(error, HillsphereError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class HillsphereError(Exception):
    """Base of every error that the framework raises on purpose."""


class InputError(HillsphereError, ValueError):
    """The caller gave something that cannot be used; the message says what and how to mend it."""


class PluginError(HillsphereError):
    """A plugin could not be loaded, or two plugins claim the same name."""


class UnknownComponentError(InputError, LookupError):
    """No component of the asked kind and type is installed."""


class PropagationError(HillsphereError, ArithmeticError):
    """A propagation met a NaN, a collapsed step or a body's interior."""


class ConvergenceError(HillsphereError, ArithmeticError):
    """An iteration did not reach its tolerance."""


class StageError(HillsphereError, RuntimeError):
    """A stage of a mission failed; the earlier stages' results stand in the run directory."""


class Interrupted(HillsphereError):  # noqa: N818 - a state of affairs, not a fault
    """The run was asked to stop; what was finished is kept.

    Parameters
    ----------
    message : str
        What was stopped.
    kept : str
        What the stage that was stopped has already, part of a sentence for the user.
    """

    def __init__(self, message: str = "", *, kept: str = "") -> None:
        super().__init__(message)
        self.kept = kept
