"""The command line ``hillsphere``.

`main` is the entry point. `commands` and `run_commands` hold the commands, `plugin_commands` loads
those of plugins when they are called, `endings` turns an error into one message and an exit code,
`output` writes results. Numerical modules are imported only when a command needs them.
"""

from hillsphere.cli.endings import main

__all__ = ["main"]
