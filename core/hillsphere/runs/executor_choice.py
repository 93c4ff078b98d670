"""Selection of an executor: by its type, its table, or as an object."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from hillsphere.base.errors import InputError
from hillsphere.base.problems import with_article
from hillsphere.plugins.plugin_files import plugin_files
from hillsphere.plugins.registry import Registry, validate

if TYPE_CHECKING:
    from hillsphere.interfaces.tasks import Executor

__all__ = ["ExecutorChoice", "executor_of", "executor_table"]

ExecutorChoice: TypeAlias = "str | Mapping[str, Any] | Executor"
"""A type, ``"pool"``; its table, ``{"type": "pool", "workers": 4}``; or the executor itself."""


def executor_table(choice: ExecutorChoice | None) -> dict[str, Any] | None:
    """Return a choice as a table that can be stored; ``None`` for an executor object."""
    if isinstance(choice, str):
        return {"type": choice}
    return dict(choice) if isinstance(choice, Mapping) else None


def executor_of(choice: ExecutorChoice, registry: Registry) -> Executor:
    """Return the chosen executor.

    Parameters
    ----------
    choice : str, mapping or Executor
        See `ExecutorChoice`.
    registry : Registry
        Registry of executors.

    Returns
    -------
    Executor
        The executor; it has not started any process yet.

    Raises
    ------
    InputError
        If there is no such executor, or its table has an unknown key; if it may work on other
        machines, which a plugin file of this process does not reach.
    """
    table = executor_table(choice)
    if plugin_files() and (table is None or table.get("type") not in ("serial", "pool")):
        raise InputError(
            "plugin files reach the processes of the executors serial and pool only; for others, "
            "make a package of them (hillsphere new plugin)"
        )
    if table is None:
        made: Any = choice
        if not callable(getattr(made, "crew", None)):
            raise InputError(
                f"an executor has a method crew, got {with_article(type(made).__name__)}; give a "
                "type such as 'pool', or a table with type and keys"
            )
        return made  # type: ignore[no-any-return]
    type_ = table.pop("type", None)
    if not isinstance(type_, str):
        raise InputError(f"the table of an executor needs a type, got {choice!r}")
    record = registry.get("executor", type_)
    spec = validate(record.load_spec(), table, where=f"executor {type_!r}")
    return record.load_target()(spec)  # type: ignore[no-any-return]
