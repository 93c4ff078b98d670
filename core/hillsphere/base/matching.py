"""Matching of names with patterns that contain ``*``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean

__all__ = ["match_names"]


def match_names(
    patterns: Sequence[str], names: Sequence[str], where: str, what: str = "quantity"
) -> tuple[str, ...]:
    """Return the names that match patterns: pattern by pattern, each in the order of `names`.

    Parameters
    ----------
    patterns : sequence of str
        Whole names; ``*`` stands for any characters.
    names : sequence of str
        All names.
    where : str
        Owner of the names, for the message.
    what : str
        Noun for a named item, for the message.

    Returns
    -------
    tuple of str
        Each name once, at the first pattern that it matches.

    Raises
    ------
    InputError
        If a pattern matches no name; the message gives the nearest name.
    """
    matched: dict[str, None] = {}
    for pattern in patterns:
        form = _compile_pattern(pattern)
        hits = [name for name in names if form.fullmatch(name)]
        if not hits:
            hint = did_you_mean(pattern, names, otherwise="there are") or "; it offers none"
            raise InputError(f"{where} has no {what} {pattern[:60]!r}{hint}")
        matched.update(dict.fromkeys(hits))
    return tuple(matched)


def _compile_pattern(pattern: str) -> re.Pattern[str]:
    """Return a regular expression that takes linear time, whatever the number of ``*``."""
    if "*" not in pattern:
        return re.compile(re.escape(pattern))
    first, *middle, last = (re.escape(part) for part in re.split(r"\*+", pattern))
    # Atomic groups: each part stands at the first place where it fits, and no other is tried.
    within = "".join(f"(?>.*?{part})" for part in middle)
    return re.compile(f"{first}{within}.*{last}", re.DOTALL)
