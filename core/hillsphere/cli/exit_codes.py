"""Exit codes of every command.

=====  ==================================================================================
code   meaning
=====  ==================================================================================
0      success
1      the mission ran but a stage failed; a check of ``doctor`` failed
2      bad input: the command line, the mission, a plugin that cannot be used; an environment in
       which no command can work (stdout closed or full, no working directory)
3      internal error, or one of a plugin's command, which is named then; the traceback stands in
       a log file that the message names
4      the mission ran, and a requirement is not met or undecided; two compared runs differ
130    interrupted (SIGINT, SIGTERM, SIGHUP); what was finished is kept
=====  ==================================================================================
"""

from __future__ import annotations

from enum import IntEnum

__all__ = ["ExitCode"]


class ExitCode(IntEnum):
    """Exit codes of every command."""

    SUCCESS = 0
    FAILED = 1
    BAD_INPUT = 2
    INTERNAL = 3
    NOT_MET = 4
    INTERRUPTED = 130
