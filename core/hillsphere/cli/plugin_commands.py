"""Commands of plugins, which ``--help`` lists and which are imported when they are called."""

from __future__ import annotations

from collections.abc import Container
from functools import cached_property
from typing import Any

from typer.core import TyperCommand, TyperGroup

from hillsphere.base.errors import PluginError
from hillsphere.plugins.registry import Registered, Registry, default_registry

__all__ = ["CommandGroup", "shadowed_commands"]


def shadowed_commands(registry: Registry, own: Container[str]) -> dict[tuple[str, str], str]:
    """Return the commands of plugins that cannot be reached.

    Parameters
    ----------
    registry : Registry
        The plugins.
    own : container of str
        Names of the framework's commands.

    Returns
    -------
    dict
        ("command", name) to a message, as in `Registry.contested`.
    """
    return {
        ("command", r.component.type): (
            f"command {r.component.type!r} of plugin {r.plugin!r} has the name of one of the "
            "framework's commands and cannot be called"
        )
        for r in registry.of_kind("command")
        if r.component.type in own
    }


class CommandGroup(TyperGroup):
    """The framework's own commands, followed by those of installed plugins.

    A plugin cannot replace a command of the framework. The error of a broken plugin is shown when
    its command is called; other commands are not affected.
    """

    def invoke(self, ctx: Any) -> Any:
        """Run a command; an error of a plugin's command is marked with the plugin's name."""
        try:
            return super().invoke(ctx)
        except Exception as error:
            name = ctx.invoked_subcommand
            if name in self._from_plugins:
                plugin = self._from_plugins[name].plugin
                error.add_note(f"plugin {plugin!r}: its command {name!r} failed")
            raise

    @cached_property
    def _from_plugins(self) -> dict[str, Registered]:
        offered = {r.component.type: r for r in default_registry().of_kind("command")}
        return {name: r for name, r in offered.items() if name not in self.commands}

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        return [*super().list_commands(ctx), *self._from_plugins]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command by name; a plugin's command is loaded when it is called."""
        own = super().get_command(ctx, cmd_name)
        if own is None and (message := default_registry().contested.get(("command", cmd_name))):
            raise PluginError(message)
        if own is not None or cmd_name not in self._from_plugins:
            return own
        return _Deferred(self._from_plugins[cmd_name])


class _Deferred(TyperCommand):
    """Proxy of a plugin's command: its summary is from the registry, the rest from the plugin."""

    def __init__(self, record: Registered) -> None:
        self._record = record
        component = record.component
        super().__init__(name=component.type, help=component.summary, rich_markup_mode=None)

    def make_context(self, info_name: Any, args: Any, parent: Any = None, **extra: Any) -> Any:
        """Import the plugin's typer application and delegate to it."""
        import typer

        application = self._record.load_target()
        if not isinstance(application, typer.Typer):
            component = self._record.component
            raise PluginError(
                f"plugin {self._record.plugin!r}: command {component.type!r}: {component.target} "
                f"must be a typer.Typer, got {type(application).__name__}"
            )
        command = typer.main.get_command(application)
        return command.make_context(info_name, args, parent=parent, **extra)
