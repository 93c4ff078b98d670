"""Layers of a mission: the file, the profile over it, and over both each ``--set``.

Tables are merged recursively; any other value is replaced as a whole. `false` in place of a named
table drops it, as do patterns under ``drop`` (`hillsphere.mission.drop`). The origin of every value
is recorded, so that messages name the line of the file or profile, or the setting.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hillsphere.base.problems import Key, MissionError, Problem, format_key
from hillsphere.mission.toml_source import Locations, parse_toml

__all__ = ["Layers", "Origin", "Setting", "parse_setting"]

_UNQUOTED = re.compile(r"[^\s\"'\[\]{}#=,](?:[^\"'\[\]{}#=,\n]*[^\s\"'\[\]{}#=,])?")


@dataclass(frozen=True)
class Origin:
    """Origin of a value; of two values for one quantity, the one of the higher layer is used.

    Parameters
    ----------
    layer : int
        0 for the file itself; profile and settings follow in order.
    locations : Locations or None
        Lines of the file; None for a setting.
    prefix : tuple
        Path of the profile in the file.
    source : str
        Name of the file or setting in messages.
    """

    layer: int
    locations: Locations | None
    prefix: Key
    source: str

    def problem(self, key: Key, message: str) -> Problem:
        """Return a problem located at a key of this layer."""
        line = None if self.locations is None else self.locations.line((*self.prefix, *key))
        return Problem(self.source, line, key, message)


@dataclass(frozen=True)
class Setting:
    """One ``--set a.b.c=value``.

    Parameters
    ----------
    text : str
        The setting as the user wrote it.
    key : tuple of str
        Path of the key.
    value : object
        Its new value.
    """

    text: str
    key: tuple[str, ...]
    value: Any

    @property
    def source(self) -> str:
        """Name of the setting in messages: ``--set a.b.c=…``."""
        return f"--set {format_key(self.key)}=…"


@dataclass
class Layers:
    """Tables of a mission with all layers applied, and the origin of their values.

    Parameters
    ----------
    tables : dict
        The mission file's tables; they are copied where a layer changes them.
    locations : Locations
        Lines of the tables and keys.
    """

    tables: dict[str, Any]
    locations: Locations
    _origins: dict[Key, Origin] = field(default_factory=dict)
    _switches: dict[Key, tuple[bool, Origin]] = field(default_factory=dict)
    _laid: dict[Key, Origin] = field(default_factory=dict)
    _drops: list[tuple[Origin, Any]] = field(default_factory=list)
    _replaced: dict[Key, dict[str, Any]] = field(default_factory=dict)
    _layer: int = 0

    def __post_init__(self) -> None:
        """Record the tables that the file itself drops."""
        if "drop" in self.tables:
            own = Origin(0, self.locations, (), self.locations.source)
            self._drops.append((own, self.tables["drop"]))

    def lay_profile(self, prefix: Key, tables: Mapping[str, Any]) -> None:
        """Merge a profile of the same file, whose path is `prefix`."""
        self._layer += 1
        origin = Origin(self._layer, self.locations, prefix, self.locations.source)
        self.tables = self._merged(self.tables, tables, (), origin)

    def lay_setting(self, setting: Setting) -> Problem | None:
        """Merge a setting; return a problem if its key is an item of an array, else None."""
        self._layer += 1
        origin = Origin(self._layer, None, (), setting.source)
        here: Any = self.tables
        for length, part in enumerate(setting.key[:-1], 1):
            here = here.get(part) if isinstance(here, dict) else None
            if isinstance(here, list):
                whole = format_key(setting.key[:length])
                return origin.problem(setting.key, f"{whole} is an array; set it whole")
        value: Any = setting.value
        for part in reversed(setting.key):
            value = {part: value}
        self.tables = self._merged(self.tables, value, (), origin)
        return None

    def _merged(self, below: Any, above: Any, path: Key, origin: Origin) -> Any:
        if path == ("drop",):
            self._drops.append((origin, above))
            return above
        if len(path) == 2 and isinstance(above, bool):
            # The text stays: other tables may be like it, and a later layer may take it back.
            self._switches[path] = above, origin
            if isinstance(below, dict):
                return below
        elif len(path) == 2 and isinstance(above, Mapping):
            self._laid[path] = origin
        if isinstance(below, dict) and isinstance(above, Mapping):
            table = dict(below)
            for key, value in above.items():
                table[key] = self._merged(below.get(key), value, (*path, key), origin)
            return table
        self._origins[path] = origin
        if isinstance(below, dict):
            self._replaced[path] = below
        return dict(above) if isinstance(above, Mapping) else above

    def drops(self) -> list[tuple[Origin, Any]]:
        """Return the ``drop`` of every layer: that of the file first."""
        return self._drops

    def switch(self, kind: str, name: str) -> tuple[bool, Origin] | None:
        """Return the last `false` or `true` that was given in place of a table, and its origin."""
        return self._switches.get((kind, name))

    def last_origin(self, kind: str, name: str) -> Origin | None:
        """Return the last layer that changes a table; None if only the file defines it."""
        return self._laid.get((kind, name))

    def replaced_table(self, key: Key) -> dict[str, Any] | None:
        """Return the table in whose place a layer puts another value; None if there is none."""
        return self._replaced.get(key)

    def layer(self, key: Key) -> int:
        """Return the layer of a key: 0 for the file, higher for later layers."""
        origin = self._origin(key)
        return origin.layer if origin else 0

    def problem(self, key: Key, message: str) -> Problem:
        """Return a problem at the line of the key, or of the nearest table around it."""
        origin = self._origin(key)
        if origin is not None:
            return origin.problem(key, message)
        return Problem(self.locations.source, self.locations.line(key), key, message)

    def _origin(self, key: Key) -> Origin | None:
        # Replacing a whole table leaves the older origins inside it behind: the latest one holds.
        heads = (self._origins.get(key[:length]) for length in range(len(key), 0, -1))
        origins = [origin for origin in heads if origin is not None]
        return max(origins, key=lambda origin: origin.layer, default=None)


def parse_setting(text: str) -> Setting:
    """Parse ``a.b.c=value``; the value is TOML, or a bare word, which is taken as a string.

    Parameters
    ----------
    text : str
        Argument of ``--set``.

    Returns
    -------
    Setting
        Key path and value.

    Raises
    ------
    MissionError
        If the key or the value cannot be read.
    """
    name, equals, written = text.partition("=")
    name, written = name.strip(), written.strip()
    source = f"--set {name[:80] if name.isprintable() else ascii(name)[:80]}=…"
    if not equals or not name:
        raise MissionError([Problem(source.removesuffix("=…"), None, (), "write key=value")])
    key = _parsed_key(name, source)
    if not written:
        message = 'no value; an empty string is written ""'
        raise MissionError([Problem(source, None, key, message)])
    if "\n" in written or "\r" in written:
        raise MissionError([Problem(source, None, key, "the value must be one line")])
    return Setting(text, key, _parsed_value(written, source, key))


def _parsed_key(name: str, source: str) -> tuple[str, ...]:
    if "\n" in name or "\r" in name:
        raise MissionError([Problem(source, None, (), "the key must be one line")])
    try:
        tables: Any = parse_toml(_encode(f"{name} = 0"), source)[0]
    except MissionError as error:
        message = error.problems[0].message
        raise MissionError([Problem(source, None, (), f"not a key: {message}")]) from None
    key: list[str] = []
    while isinstance(tables, dict):
        if len(tables) != 1:  # a comment, or the head of a table
            raise MissionError([Problem(source, None, (), f"not a key: {name!r}")])
        ((part, tables),) = tables.items()
        key.append(part)
    return tuple(key)


def _parsed_value(written: str, source: str, key: Key) -> Any:
    try:
        return parse_toml(_encode(f"value = {written}"), source)[0]["value"]
    except MissionError as error:
        message = error.problems[0].message
        is_word = _UNQUOTED.fullmatch(written) is not None
        if is_word and "not a value" in message:
            return written
        raise MissionError([Problem(source, None, key, message)]) from None


def _encode(text: str) -> bytes:
    # A command line may hold bytes that are not UTF-8; the reader refuses them by name.
    return text.encode("utf-8", "surrogateescape")
