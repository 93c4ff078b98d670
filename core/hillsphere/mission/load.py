"""Loading of missions: TOML text becomes validated Specs, linked and in order."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from hillsphere.base.paths import missions_directory
from hillsphere.base.problems import Key, MissionError, Problem, did_you_mean, format_value
from hillsphere.mission.each import expand_tables
from hillsphere.mission.layers import Layers, parse_setting
from hillsphere.mission.likes import Derived, resolve_likes
from hillsphere.mission.links import check_links, check_report, resolve_data_paths, topological
from hillsphere.mission.report_spec import ReportSpec
from hillsphere.mission.tables import (
    FORMAT,
    MISSION_KINDS,
    MOST_PROBLEMS,
    TOP_KEYS,
    Tables,
    unknown_top_key,
    validate_tables,
)
from hillsphere.mission.toml_source import Locations, parse_toml, read_toml
from hillsphere.mission.toml_text import settings_of, toml_text
from hillsphere.plugins.registry import Registered, Registry, default_registry
from hillsphere.spec.base import Spec

__all__ = ["FORMAT", "Mission", "MissionError", "load_mission", "packaged_missions"]


@dataclass(frozen=True)
class Mission:
    """A validated mission, ready to be run.

    Parameters
    ----------
    format : int
        Version of the file format.
    name : str
        Short name; usable as the name of a directory.
    title : str
        One line that says what it is about.
    seed : int
        Root seed of all random numbers.
    description : str
        Description for the report; may be empty.
    report : ReportSpec
        What the report asks, answers and shows.
    path : Path
        The mission file.
    directory : Path
        Its directory.
    text : str
        Its text.
    profile : str or None
        The selected profile, if any.
    sets : tuple of str
        The settings of ``--set``.
    profiles : tuple of str
        Names of all profiles that the file has.
    specs : mapping
        Kind → name → Spec, in the order of the file.
    components : mapping
        Kind → name → record of the component in the registry.
    places : mapping
        (kind, name) → ``"file:line"`` of the table, for messages; (kind, name, key …) → that of
        each key that is written in it, or names an input file.
    """

    format: int
    name: str
    title: str
    seed: int
    description: str
    report: ReportSpec
    path: Path
    directory: Path
    text: str = field(repr=False)
    profile: str | None
    sets: tuple[str, ...]
    profiles: tuple[str, ...]
    specs: Mapping[str, Mapping[str, Spec]] = field(repr=False)
    components: Mapping[str, Mapping[str, Registered]] = field(repr=False)
    places: Mapping[Key, str] = field(repr=False)

    @classmethod
    def load(
        cls,
        name_or_path: str | os.PathLike[str],
        *,
        set: Mapping[str, Any] | None = None,  # noqa: A002 - the word of the command line
        profile: str | None = None,
        allow_path: bool = False,
        registry: Registry | None = None,
    ) -> Mission:
        """Read a mission; as `load_mission`, with settings as values.

        Parameters
        ----------
        name_or_path : str or path
            Name of a packaged mission, or path of a mission file.
        set : mapping, optional
            Settings by key: ``{"stage.family.x_amplitudes_km": [90]}``. Arrays are taken too.
        profile, allow_path, registry : optional
            As for `load_mission`.

        Raises
        ------
        MissionError
            As `load_mission`.
        """
        return load_mission(
            name_or_path, sets=settings_of(set), profile=profile, allow_path=allow_path,
            registry=registry,
        )  # fmt: skip

    @classmethod
    def from_dict(
        cls,
        tables: Mapping[str, Any],
        *,
        directory: str | os.PathLike[str] = ".",
        set: Mapping[str, Any] | None = None,  # noqa: A002 - the word of the command line
        profile: str | None = None,
        allow_path: bool = False,
        registry: Registry | None = None,
    ) -> Mission:
        """Make a mission from the tables of a mission file.

        Parameters
        ----------
        tables : mapping
            What the file would hold, by key; ``format`` is 1 and ``name`` is ``"mission"`` if they
            are left out.
        directory : str or path
            Directory in which its input files are.
        set, profile, allow_path, registry : optional
            As for `load`.

        Raises
        ------
        MissionError
            As `load_mission`; lines are those of the text of the mission.
        """
        text = toml_text({"format": FORMAT, "name": "mission", **tables})
        path = Path(os.path.abspath(directory)) / "mission.toml"
        read = parse_toml(text.encode(), "mission.toml (from Python)")
        return _load(read, path, settings_of(set), profile, registry, allow_path)

    def with_(
        self,
        *,
        set: Mapping[str, Any] | None = None,  # noqa: A002 - the word of the command line
        profile: str | None = None,
        registry: Registry | None = None,
        allow_path: bool = False,
    ) -> Mission:
        """Return the mission with other settings.

        Parameters
        ----------
        set : mapping, optional
            Settings by key, applied after those that the mission has.
        profile : str, optional
            Another profile; by default the same.
        registry, allow_path : optional
            As for `load_mission`.

        Raises
        ------
        MissionError
            As `load_mission`.
        """
        read = parse_toml(self.text.encode(), str(self.path))
        sets = (*self.sets, *settings_of(set))
        profile = self.profile if profile is None else profile
        return _load(read, self.path, sets, profile, registry, allow_path)

    def __repr__(self) -> str:
        changes = "".join(f", {text}" for text in (self.profile, *self.sets) if text)
        return f"<Mission {self.name!r}: {len(self.specs['stage'])} stages{changes}>"

    def order(self) -> list[str]:
        """Return the names of the stages, each after those it needs, else in file order."""
        stages = self.specs["stage"]
        nodes = topological((("stage", name) for name in stages), self.specs)
        return [name for kind, name in nodes if kind == "stage"]

    def resolved(self) -> dict[str, Any]:
        """Return the mission as plain tables in SI, with defaults, profile and settings applied.

        The keys are those of a mission file, so that the result, written as TOML, is a mission
        again. Input files have absolute paths.
        """
        tables: dict[str, Any] = {
            "format": self.format, "name": self.name, "title": self.title, "seed": self.seed,
        }  # fmt: skip
        if self.description:
            tables["description"] = self.description
        if self.report != ReportSpec():
            tables["report"] = self.report.model_dump(mode="json", exclude_defaults=True)
        for kind, specs in self.specs.items():
            tables[kind] = {
                name: {
                    "type": self.components[kind][name].component.type,
                    **spec.model_dump(mode="json", exclude_none=True),
                }
                for name, spec in specs.items()
            }
        return tables


def load_mission(
    name_or_path: str | os.PathLike[str],
    *,
    sets: Sequence[str] = (),
    profile: str | None = None,
    registry: Registry | None = None,
    allow_path: bool = False,
) -> Mission:
    """Read a mission file and validate everything in it; nothing numerical is imported.

    Parameters
    ----------
    name_or_path : str or path
        Name of a packaged mission, or path of a mission file: a path object, or text that ends in
        ``.toml`` or contains a separator.
    sets : sequence of str
        Settings ``"stage.family.x_max_km=90"``, applied in order after the profile.
    profile : str, optional
        Name of a ``[profile.NAME]`` in the file whose keys override those of the file.
    registry : Registry, optional
        Components to choose from; by default all that are installed.
    allow_path : bool
        Accept input files outside the directory of the mission and the packaged data.

    Returns
    -------
    Mission
        The validated mission.

    Raises
    ------
    MissionError
        With every problem. An unreadable file, invalid TOML, an unknown format and invalid lists
        and `for` are reported alone, since nothing else can be checked then.

    Examples
    --------
    >>> load_mission("phobos-qso", sets=["stage.family.x_amplitudes_km=[90]"]).name
    'phobos-qso'
    """
    path, source = _find(name_or_path)
    return _load(
        read_toml(path, source), Path(os.path.abspath(path)), sets, profile, registry, allow_path
    )


def _load(
    read: tuple[dict[str, Any], Locations, str],
    path: Path,
    sets: Sequence[str],
    profile: str | None,
    registry: Registry | None,
    allow_path: bool,
) -> Mission:
    """Validate the tables of a mission's text, which need not be that of its file."""
    tables, locations, text = read
    source = locations.source
    registry = default_registry() if registry is None else registry
    problems: list[Problem] = []
    profiles = _profiles(tables, locations, problems)
    layers = Layers({key: tables[key] for key in tables if key != "profile"}, locations)
    if profile is not None:
        _lay_profile(profile, profiles, layers, problems)
    for text_of_setting in sets:
        _lay_setting(text_of_setting, layers, problems)
    each = expand_tables(layers, MISSION_KINDS)
    if each.problems:
        raise MissionError(_sort_and_limit(problems + each.problems, source))
    written = resolve_likes(each, MISSION_KINDS)
    validated = validate_tables(written, registry)
    check_links(validated, written)
    check_report(validated, written)
    directory = os.path.dirname(os.path.realpath(path))
    resolve_data_paths(validated, written, directory, allow_path=allow_path)
    problems += written.problems + validated.problems
    if problems or validated.head is None:
        raise MissionError(_sort_and_limit(problems, source))
    return Mission(
        format=FORMAT,
        name=validated.head.name,
        title=validated.head.title,
        seed=validated.head.seed,
        description=validated.head.description,
        report=validated.head.report,
        path=path,
        directory=Path(directory),
        text=text,
        profile=profile,
        sets=tuple(sets),
        profiles=tuple(profiles),
        specs=validated.specs,
        components=validated.components,
        places=_places(validated, written),
    )


def packaged_missions() -> list[tuple[str, str]]:
    """Return (name, title) of the packaged missions, sorted by name; only their heads are read.

    The title of an invalid file is its fault.

    Returns
    -------
    list of tuple of str
        Name and title of each.
    """
    missions = []
    for path in sorted(missions_directory().glob("*.toml")):
        try:
            title = read_toml(path, path.name)[0].get("title", "")
        except MissionError as error:
            title = f"(unreadable: {error.problems[0]})"
        missions.append((path.stem, title if isinstance(title, str) else ""))
    return missions


def _find(name_or_path: str | os.PathLike[str]) -> tuple[Path, str]:
    """Return the path of a mission file and its name in messages."""
    given = os.fsdecode(name_or_path)
    separators = [os.sep, *filter(None, [os.altsep])]
    if not isinstance(name_or_path, str) or given.endswith(".toml") or any(
        separator in given for separator in separators
    ):  # fmt: skip
        return Path(given), given if given.isprintable() else ascii(given)
    path = missions_directory() / f"{given}.toml"
    names = [mission.stem for mission in sorted(missions_directory().glob("*.toml"))]
    if given not in names:
        source = given if given.isprintable() else ascii(given)
        hint = did_you_mean(given, names, otherwise="packaged missions")
        message = f"no packaged mission has this name{hint} (an own one: path/to/file.toml)"
        raise MissionError([Problem(source or '""', None, (), message)])
    return path, os.path.relpath(path) if path.is_relative_to(Path.cwd()) else str(path)


def _profiles(
    tables: Mapping[str, Any], locations: Locations, problems: list[Problem]
) -> dict[str, dict[str, Any]]:
    """Return the valid part of every profile, and add the problems of all profiles."""

    def refuse(key: Key, message: str) -> None:
        problems.append(Problem(locations.source, locations.line(key), key, message))

    given = tables.get("profile", {})
    if not isinstance(given, dict):
        refuse(("profile",), f"expected tables [profile.NAME], got {format_value(given)}")
        return {}
    profiles: dict[str, dict[str, Any]] = {}
    for name, profile in given.items():
        if not isinstance(profile, dict):
            refuse(
                ("profile", name), f"expected a table [profile.NAME], got {format_value(profile)}"
            )
            continue
        profiles[name] = {}
        for key, value in profile.items():
            if key in ("format", "profile"):
                refuse(("profile", name, key), f"a profile cannot change {key!r}")
            elif key not in TOP_KEYS and key not in MISSION_KINDS:
                refuse(("profile", name, key), unknown_top_key(key))
            else:
                profiles[name][key] = value
            if len(problems) > MOST_PROBLEMS:
                return profiles
    return profiles


def _lay_profile(
    name: str, profiles: Mapping[str, dict[str, Any]], layers: Layers, problems: list[Problem]
) -> None:
    if name in profiles:
        layers.lay_profile(("profile", name), profiles[name])
        return
    hint = did_you_mean(name, profiles, otherwise="it has") or "; it has none"
    source = layers.locations.source
    problems.append(Problem(source, None, (), f"has no profile {name[:60]!r}{hint}"))


def _lay_setting(text: str, layers: Layers, problems: list[Problem]) -> None:
    try:
        setting = parse_setting(text)
    except MissionError as error:
        problems.extend(error.problems)
        return
    head = setting.key[0]
    if head == "profile":
        message = "a profile is chosen with --profile, not set"
    elif head not in TOP_KEYS and head not in MISSION_KINDS:
        message = unknown_top_key(head)
    else:
        problem = layers.lay_setting(setting)
        if problem is not None:
            problems.append(problem)
        return
    problems.append(Problem(setting.source, None, setting.key, message))


def _places(tables: Tables, written: Derived) -> dict[Key, str]:
    """Return where the tables, and the keys in them, were written."""
    keys: list[Key] = []
    for kind, name, spec in tables:
        keys += [(kind, name), *((kind, name, *where) for where, _ in spec.data_paths())]
        keys += _keys_of(written.tables.get(kind, {}).get(name), (kind, name))
    return {key: written.problem(key, "").place for key in keys}


def _keys_of(table: Any, key: Key) -> Iterator[Key]:
    """Yield the keys of a table and of the tables in it, arrays left out."""
    if isinstance(table, Mapping):
        for name, value in table.items():
            yield (*key, name)
            yield from _keys_of(value, (*key, name))


def _sort_and_limit(problems: list[Problem], source: str) -> list[Problem]:
    """Sort by line, the file before the settings, remarks last; cut a list that is too long."""
    # A fault that a table passes on by `like`, or that it has for several values of `for`, is
    # reported once: for the table itself, unless it is dropped, and for the first value.
    alike: dict[Problem, list[Problem]] = {}
    for problem in sorted(problems, key=lambda p: p.user != ""):
        alike.setdefault(replace(problem, user="", given=""), []).append(problem)
    ordered = sorted(
        (_merge_alike(some) for some in alike.values()),
        key=lambda p: (p.is_remark, p.source != source, p.line or 0),
    )
    if sum(not problem.is_remark for problem in ordered) > MOST_PROBLEMS:
        more = Problem(source, None, (), "there are more problems than are listed", True)
        return [*ordered[:MOST_PROBLEMS], more]
    return ordered


def _merge_alike(alike: list[Problem]) -> Problem:
    """Return the first of several problems with one cause, with the number of affected values."""
    values = {problem.given for problem in alike} - {""}
    if len(values) < 2 or not alike[0].given:
        return alike[0]
    return replace(alike[0], given=f"{alike[0].given} and {len(values) - 1} more")
