"""The command line ``hillsphere``.

`main` is the entry point. `commands` holds the commands, `plugin_commands` loads those of
plugins when they are called, `endings` turns what went wrong into one message and an exit code,
`output` writes results. Nothing numerical is imported before a command needs it.
"""

from hillsphere.cli.endings import main

__all__ = ["main"]
