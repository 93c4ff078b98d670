"""Names of a stage's results, as far as they are known before it runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from fnmatch import fnmatchcase

__all__ = ["ResultNames", "is_named", "nearest_name"]

PUBLISHED = "_paper"
"""End of the name of a column with published values, which a reference file brings."""


@dataclass(frozen=True)
class ResultNames:
    """Names of the metrics and tables that a stage may present.

    A name may hold ``*`` where it depends on other keys, such as the names of stations. All that a
    stage presents must be listed, also what it presents only sometimes: a requirement on any other
    name is refused before the run.

    Parameters
    ----------
    metrics : tuple of str
        Names of the metrics.
    tables : mapping
        Name of a table → names of its columns; ``()`` if they are known only after the run. Columns
        of published values (``NAME_paper``) need not be listed.
    """

    metrics: tuple[str, ...] = ()
    tables: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def with_label(self, label: str) -> ResultNames:
        """Return the names with a stage's option `label` appended, as the stage appends it."""
        if not label:
            return self
        return ResultNames(
            tuple(f"{name}_{label}" for name in self.metrics),
            {f"{name}_{label}": columns for name, columns in self.tables.items()},
        )

    def columns_of(self, table: str) -> tuple[str, ...]:
        """Return the columns of a table; empty if they are not known."""
        return next((c for name, c in self.tables.items() if is_named(table, (name,))), ())


def is_named(name: str, names: Iterable[str]) -> bool:
    """Return whether a name is one of these, which may be patterns."""
    return any(fnmatchcase(name, one) for one in names)


def nearest_name(name: str, names: Iterable[str]) -> str:
    """Return the hint of a message: the nearest name, and all that there are.

    Parameters
    ----------
    name : str
        The unknown name.
    names : iterable of str
        Those that there are, with patterns.
    """
    listed = list(names)
    near = get_close_matches(name[:100], [one for one in listed if "*" not in one], n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"{hint} It has: {', '.join(listed)}" if hint else f"; it has: {', '.join(listed)}"
