"""Named exceptions of the framework, all under `HillsphereError`.

The command line turns each of them into one message without a traceback: `InputError` and its
children exit with code 2, `StageError` with code 1, `Interrupted` with 130.
"""

from __future__ import annotations


def describe_error(error: BaseException) -> str:
    """Return the message of an error on one line; its class as well, unless it is ours.

    Parameters
    ----------
    error : BaseException
        Any error.

    Returns
    -------
    str
        One line of text.
    """
    text = " ".join(str(error).split())
    if isinstance(error, HillsphereError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class HillsphereError(Exception):
    """Base class of all errors that the framework raises itself."""


class InputError(HillsphereError, ValueError):
    """An argument, a key or a file cannot be used; the message says why and gives the remedy."""


class PluginError(HillsphereError):
    """A plugin could not be loaded, or two plugins claim the same name."""


class UnknownComponentError(InputError, LookupError):
    """No installed component has the requested kind and type."""


class PropagationError(HillsphereError, ArithmeticError):
    """A propagation met a NaN, a collapsed step or a body's interior."""


class ConvergenceError(HillsphereError, ArithmeticError):
    """An iteration did not reach its tolerance."""


class StageError(HillsphereError, RuntimeError):
    """A stage of a mission failed; the run directory holds the results of the stages before."""


class Interrupted(HillsphereError):  # noqa: N818 - a state of affairs, not a fault
    """The run was asked to stop; finished work is kept.

    Parameters
    ----------
    message : str
        Names the stopped stage or command.
    kept : str
        The part of the interrupted stage's work that is kept, as part of a sentence for the user.
    """

    def __init__(self, message: str = "", *, kept: str = "") -> None:
        super().__init__(message)
        self.kept = kept
