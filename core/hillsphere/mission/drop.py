"""Dropping of tables from a mission: by `false` in place of a table, or by patterns of `drop`."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase

from hillsphere.base.problems import Key, Problem, did_you_mean, format_value
from hillsphere.mission.layers import Layers, Origin

__all__ = ["find_dropped"]

_MOST_PATTERNS = 1000
"""Patterns of one `drop`: each is tried on every table."""


def find_dropped(
    layers: Layers, nodes: Mapping[tuple[str, str], str]
) -> tuple[dict[tuple[str, str], tuple[Origin, Key]], list[Problem]]:
    """Find the tables that are dropped.

    A later layer overrides an earlier one. `false` or `true` for a single table overrides the value
    for the table with `for` from which it is expanded.

    Parameters
    ----------
    layers : Layers
        The mission's tables with profile and settings laid over them.
    nodes : mapping
        (kind, name) of every table → name of the table with `for` that it comes from, else its own.

    Returns
    -------
    dropped : dict
        (kind, name) → the layer that drops the table, and the key there.
    problems : list of Problem
        Patterns that match no table, and values of `drop` that are not lists of patterns.
    """
    dropped: dict[tuple[str, str], tuple[Origin, Key]] = {}
    problems: list[Problem] = []
    full = {
        (kind, name): dict.fromkeys((f"{kind}.{name}", f"{kind}.{source}"))
        for (kind, name), source in nodes.items()
    }
    for origin, given in layers.drops():
        fault = ""
        if not isinstance(given, list) or not all(isinstance(item, str) for item in given):
            fault = (
                f'expected patterns of tables, such as ["stage.wide_*"]; got {format_value(given)}'
            )
        elif len(given) > _MOST_PATTERNS:
            fault = f"must have at most {_MOST_PATTERNS} patterns, got {len(given)}"
        if fault:
            problems.append(origin.problem(("drop",), fault))
            continue
        for index, pattern in enumerate(given):
            matching = [node for node in nodes if any(fnmatchcase(n, pattern) for n in full[node])]
            dropped.update(dict.fromkeys(matching, (origin, ("drop", index))))
            if not matching:
                every = dict.fromkeys(name for names in full.values() for name in names)
                hint = did_you_mean(pattern, every, otherwise="there are")
                message = f"no table matches {pattern[:60]!r}{hint}"
                problems.append(origin.problem(("drop", index), message))
    for (kind, name), source in nodes.items():
        written = name if layers.switch(kind, name) is not None else source
        switch = layers.switch(kind, written)
        drop = dropped.get((kind, name))
        if switch is None or (drop is not None and switch[1].layer < drop[0].layer):
            continue
        stays, origin = switch
        dropped.pop((kind, name), None)
        if not stays:
            dropped[kind, name] = origin, (kind, written)
    return dropped, problems
