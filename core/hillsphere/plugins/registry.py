"""Registry of components, which pluggy discovers among the installed plugins.

A plugin package has one entry point in the group ``hillsphere``. It names a module with a function
``hillsphere_components``, marked with `hookimpl`, which returns `Component` records: kind, type and
the import paths of class and Spec. Specs are imported when a mission is validated, classes when a
mission first uses them.
"""

from __future__ import annotations

import ast
import os
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module, metadata
from importlib.util import find_spec
from types import MappingProxyType, ModuleType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import pluggy

from hillsphere.base.errors import InputError, PluginError, UnknownComponentError
from hillsphere.base.problems import did_you_mean, format_key, with_article

if TYPE_CHECKING:
    from hillsphere.interfaces import (
        ArrayGravityModel,
        Compensator,
        Estimator,
        GravityModel,
        Guidance,
        OrbitFamily,
        Plant,
        Sensor,
        Stage,
        Tracker,
    )
    from hillsphere.spec.base import Spec

T = TypeVar("T")

API_VERSION = 1
"""Version of the plugin interface. It rises when a plugin written for it would no longer work."""
ENTRY_POINT_GROUP = "hillsphere"
"""Group of the package metadata in which a plugin package names its module."""
KINDS = (
    "body",
    "gravity",
    "shape",
    "plant",
    "orbit_family",
    "guidance",
    "compensator",
    "estimator",
    "sensor",
    "tracker",
    "dispersions",
    "stage",
    "requirement",
    "claim",
    "executor",
    "format",
    "command",
)
"""All kinds of components: the names of the tables in a mission."""

OUTCOME_KINDS = ("requirement", "claim")
"""Kinds that are judged after the stages; they may refer to a stage that a profile drops."""
DEFAULT_TYPES = {"requirement": "value", "claim": "statement"}
"""Types of the tables that may leave theirs out, by kind: what most of them are."""

hookspec = pluggy.HookspecMarker("hillsphere")
"""Marks the declaration of a hook that plugins may implement."""

hookimpl = pluggy.HookimplMarker("hillsphere")
"""Marks a plugin package's ``hillsphere_components``."""


@dataclass(frozen=True)
class Component:
    """One component that a plugin offers.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    type : str
        Name by which a mission asks for it (``type = "ellipsoid"``); unique within its kind.
    target : str
        Import path of the class, ``"package.module:Class"``; it is called with the bound Spec.
    spec : str
        Import path of its `hillsphere.spec.Spec`; ``""`` for a command, whose target is a typer
        application.
    summary : str
        One line for lists and help.
    api : int
        Version of this interface that the plugin was written for.
    """

    kind: str
    type: str
    target: str
    spec: str
    summary: str
    api: int = API_VERSION


class _Hooks:
    @hookspec
    def hillsphere_components(self) -> Iterable[Component]:  # type: ignore[empty-body]
        """Return the `Component` records of a plugin package."""


@dataclass(frozen=True)
class Registered:
    """A component with the plugin that brought it.

    Parameters
    ----------
    component : Component
        The component.
    plugin : str
        Name of the plugin: that of its entry point, or of its file.
    distribution : str
        Name and version of its distribution; ``""`` for the framework's own components.
    """

    component: Component
    plugin: str
    distribution: str

    def load_spec(self) -> type[Spec]:
        """Import and return the Spec class; `PluginError` names the plugin if that fails."""
        from hillsphere.spec.base import Spec

        loaded = self._load(self.component.spec)
        if not (isinstance(loaded, type) and issubclass(loaded, Spec)):
            raise PluginError(
                f"plugin {self.plugin!r}: {self.component.kind} {self.component.type!r}: "
                f"{self.component.spec} is not a subclass of hillsphere.spec.Spec"
            )
        return loaded

    def load_target(self) -> Any:
        """Import and return the class; `PluginError` names the plugin if that fails."""
        return self._load(self.component.target)

    def fault(self) -> str:
        """Return why its class or its Spec cannot be used, on one line; ``""`` if they can.

        Both are imported, which may take seconds.
        """
        try:
            if self.component.spec:
                self.load_spec()
            target = self.load_target()
        except PluginError as error:
            return " ".join(str(error).split())
        return self._fault_of_target(target)

    def missing(self) -> str:
        """Return why its class cannot be there, on one line; ``""`` if it seems to be.

        Nothing numerical is imported: the source of a module that is not loaded is read for the
        name. What fails at its import is found by `fault` only.
        """
        module, _, name = self.component.target.partition(":")
        if module in sys.modules:
            try:
                target = getattr(sys.modules[module], name)
            except AttributeError as error:
                return self._cannot_import(self.component.target, error)
            return self._fault_of_target(target)
        try:
            spec = find_spec(module)
            if spec is None:
                raise ModuleNotFoundError(f"No module named {module!r}")
            source = getattr(spec.loader, "get_source", lambda _: None)(module)
            if source and not _may_define(source, name):
                raise AttributeError(f"module {module!r} has no attribute {name!r}")
        except (Exception, SystemExit) as error:  # the package above it is imported
            return self._cannot_import(self.component.target, error)
        return ""

    def _fault_of_target(self, target: object) -> str:
        if self.component.kind == "command" or callable(target):
            return ""
        return (
            f"plugin {self.plugin!r}: {self.component.kind} {self.component.type!r}: "
            f"{self.component.target} is no class, got {with_article(type(target).__name__)}"
        )

    def _cannot_import(self, path: str, error: BaseException) -> str:
        return (
            f"plugin {self.plugin!r}: {self.component.kind} {self.component.type!r} "
            f"({path}) cannot be imported: {_one_line(error)}"
        )

    def _load(self, path: str) -> Any:
        try:
            return load_object(path)
        except (Exception, SystemExit) as error:  # a plugin's module may do anything
            raise PluginError(self._cannot_import(path, error)) from error


def _may_define(source: str, name: str) -> bool:
    """Return whether a module's source may bind a name: by a statement, ``*`` or __getattr__."""
    bound: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            bound.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            bound.add(node.id)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            bound |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
    return not bound.isdisjoint({name.partition(".")[0], "*", "__getattr__"})


def kind_words(kind: str) -> str:
    """Return the name of a kind in messages: ``"orbit family"``.

    Parameters
    ----------
    kind : str
        One of `KINDS`.

    Returns
    -------
    str
        Its words, in the singular.
    """
    names = {"dispersions": "distribution", "format": "file format"}
    return names.get(kind, kind.replace("_", " "))


def load_object(path: str) -> Any:
    """Import ``"package.module:name"``.

    Parameters
    ----------
    path : str
        Import path.

    Returns
    -------
    object
        The imported object.
    """
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)


class _Manager(pluggy.PluginManager):
    """Looks for hooks among the names that a module has, and loads none that it offers lazily."""

    def parse_hookimpl_opts(self, plugin: object, name: str) -> pluggy.HookimplOpts | None:
        """Return the options of a hook, None if the name is no hook."""
        if isinstance(plugin, ModuleType) and name not in vars(plugin):
            return None
        return super().parse_hookimpl_opts(plugin, name)


@dataclass
class Registry:
    """The components of all plugins that loaded, and the faults of those that did not.

    Parameters
    ----------
    strict : bool
        Raise at the first broken plugin instead of recording it in `broken`.
    broken : dict
        Name of a broken plugin → reason, on one line.
    disabled : tuple of str
        Plugins that are to be left out.
    unknown_disabled : tuple of str
        Names in `disabled` that are not installed, most likely misspelt.
    """

    strict: bool = False
    broken: dict[str, str] = field(default_factory=dict)
    disabled: tuple[str, ...] = ()
    unknown_disabled: tuple[str, ...] = ()
    _offers: dict[tuple[str, str], list[Registered]] = field(default_factory=dict)

    def add_plugin(self, name: str, plugin: object, distribution: str = "") -> None:
        """Register the components of a plugin module or object.

        Parameters
        ----------
        name : str
            Name of the plugin (its entry point).
        plugin : object
            Module or object with a `hookimpl` ``hillsphere_components``.
        distribution : str, optional
            Name and version of its distribution, for lists.

        Raises
        ------
        PluginError
            If the plugin is broken and the registry is strict.
        """
        manager = _Manager("hillsphere")
        manager.add_hookspecs(_Hooks)
        try:
            manager.register(plugin, name)
            manager.check_pending()
            offered = [c for group in manager.hook.hillsphere_components() for c in group]
            if not offered:
                raise PluginError("it offers no component (is hillsphere_components marked?)")
            seen: set[tuple[str, str]] = set()
            for component in offered:
                _check(component)
                if (component.kind, component.type) in seen:
                    raise PluginError(f"it offers {component.kind} {component.type!r} twice")
                seen.add((component.kind, component.type))
        except (Exception, SystemExit) as error:
            self._set_aside(name, error)
            return
        for component in offered:
            self._add(Registered(component, name, distribution))

    def _add(self, new: Registered) -> None:
        key = (new.component.kind, new.component.type)
        self._offers.setdefault(key, []).append(new)
        if self.strict and key in self.contested:
            raise PluginError(self.contested[key])

    def _set_aside(self, name: str, error: BaseException) -> None:
        if self.strict:
            raise PluginError(f"plugin {name!r} is broken: {_one_line(error)}") from error
        self.broken[name] = _one_line(error)

    @property
    def contested(self) -> Mapping[tuple[str, str], str]:
        """Components that several plugins offer, and so none provides: (kind, type) → message."""
        texts = {}
        for (kind, type_), offers in sorted(self._offers.items()):
            if len(offers) > 1:
                *others, last = (repr(offer.plugin) for offer in offers)
                number = "two" if len(offers) == 2 else str(len(offers))
                texts[kind, type_] = (
                    f"{kind} {type_!r} is offered by {number} plugins, {', '.join(others)} and "
                    f"{last}; disable {'one' if len(offers) == 2 else 'all but one'} with "
                    "HILLSPHERE_DISABLE_PLUGINS"
                )
        return MappingProxyType(texts)

    def get(self, kind: str, type_: str) -> Registered:
        """Return the component of this kind and type.

        Parameters
        ----------
        kind : str
            One of `KINDS`.
        type_ : str
            Its type.

        Returns
        -------
        Registered
            The record; nothing is imported.

        Raises
        ------
        UnknownComponentError
            If it is not installed; the message gives the nearest type and the broken and disabled
            plugins.
        PluginError
            If several plugins offer it.
        """
        key = (kind, type_)
        offers = self._offers.get(key, [])
        if len(offers) > 1:
            raise PluginError(self.contested[key])
        if offers:
            return offers[0]
        types = [offered for of_kind, offered in sorted(self._offers) if of_kind == kind]
        text = f"no {kind_words(kind)} of type {type_[:60]!r}"
        hint = did_you_mean(type_, types, otherwise="installed")
        text += hint or f"; no plugin brings {with_article(kind_words(kind))}"
        files = sys.modules.get("hillsphere.plugins.plugin_files")
        if files is None or not files.plugin_files():
            text += " (one of a plugin file is found with --plugin FILE)"
        if self.broken:
            text += f" (set aside as broken: {', '.join(sorted(self.broken))})"
        if absent := [name for name in self.disabled if name not in self.unknown_disabled]:
            text += f" (disabled: {', '.join(absent)})"
        raise UnknownComponentError(text)

    def of_kind(self, kind: str) -> Iterator[Registered]:
        """Yield the components of a kind, sorted by type; not the `contested` ones."""
        return (record for record in self if record.component.kind == kind)

    def __iter__(self) -> Iterator[Registered]:
        """Yield the components, sorted by kind and type; not the `contested` ones."""
        for _, offers in sorted(self._offers.items()):
            if len(offers) == 1:
                yield offers[0]


def _one_line(error: BaseException) -> str:
    """Return an error as one line, for lists and messages with one line per fault."""
    return " ".join(f"{type(error).__name__}: {error}".split())


_TYPE_NAME = re.compile(r"[a-z][a-z0-9_-]*")


def _check(component: object) -> None:
    if not isinstance(component, Component):
        raise PluginError(f"must return Component records, got {type(component).__name__}")
    for name in ("kind", "type", "target", "spec", "summary", "api"):
        value, expected = getattr(component, name), int if name == "api" else str
        if not isinstance(value, expected) or isinstance(value, bool):
            raise PluginError(
                f"a Component's {name} must be {'an' if expected is int else 'a'} "
                f"{expected.__name__}, got {type(value).__name__}"
            )
    if component.api != API_VERSION:
        raise PluginError(
            f"{component.kind} {component.type!r} was written for plugin API {component.api}; "
            f"this is API {API_VERSION}"
        )
    if component.kind not in KINDS:
        hint = did_you_mean(component.kind, KINDS, otherwise="kinds")
        raise PluginError(f"{component.type!r} is of unknown kind {component.kind!r}{hint}")
    if not _TYPE_NAME.fullmatch(component.type):
        raise PluginError(
            f"{component.kind} {component.type!r}: a type is named with small letters, digits, "
            "'_' and '-', beginning with a letter"
        )
    paths = (
        [component.target] if component.kind == "command" else [component.target, component.spec]
    )
    for path in paths:
        module, _, name = path.partition(":")
        if not module or not name:
            raise PluginError(f"{component.type!r}: {path!r} is not 'package.module:Class'")


def discover(*, strict: bool = False, disabled: Iterable[str] | None = None) -> Registry:
    """Find all installed plugins.

    Parameters
    ----------
    strict : bool
        Raise at the first broken plugin.
    disabled : iterable of str, optional
        Plugins to leave out; by default the comma-separated HILLSPHERE_DISABLE_PLUGINS.

    Returns
    -------
    Registry
        The framework's own components, those of every entry point in the group ``hillsphere`` and
        those of the plugin files that this process has loaded.
    """
    if disabled is None:
        disabled = os.environ.get("HILLSPHERE_DISABLE_PLUGINS", "").split(",")
    left_out = {name.strip() for name in disabled if name.strip()}
    registry = Registry(strict=strict, disabled=tuple(sorted(left_out)))
    registry.add_plugin("hillsphere", import_module("hillsphere.plugins.builtin"))
    points = sorted(metadata.entry_points(group=ENTRY_POINT_GROUP), key=lambda point: point.name)
    registry.unknown_disabled = tuple(sorted(left_out - {point.name for point in points}))
    for point in dict.fromkeys(points):
        if point.name in left_out:
            continue
        try:
            module = point.load()
        except (Exception, SystemExit) as error:
            registry._set_aside(point.name, error)
            continue
        dist = f"{point.dist.name} {point.dist.version}" if point.dist else ""
        registry.add_plugin(point.name, module, dist)
    if files := sys.modules.get("hillsphere.plugins.plugin_files"):
        files.offer_plugin_files(registry)
    return registry


@cache
def default_registry() -> Registry:
    """Return the registry of all installed plugins, which is made once per process."""
    return discover()


@overload
def create(kind: str, type_: str, class_: type[T], /, **keys: Any) -> T: ...
@overload
def create(kind: Literal["plant"], type_: str, /, **keys: Any) -> Plant: ...
@overload
def create(
    kind: Literal["gravity"], type_: str, /, **keys: Any
) -> GravityModel | ArrayGravityModel: ...
@overload
def create(kind: Literal["compensator"], type_: str, /, **keys: Any) -> Compensator: ...
@overload
def create(kind: Literal["estimator"], type_: str, /, **keys: Any) -> Estimator: ...
@overload
def create(kind: Literal["sensor"], type_: str, /, **keys: Any) -> Sensor: ...
@overload
def create(kind: Literal["orbit_family"], type_: str, /, **keys: Any) -> OrbitFamily: ...
@overload
def create(kind: Literal["guidance"], type_: str, /, **keys: Any) -> Guidance: ...
@overload
def create(kind: Literal["tracker"], type_: str, /, **keys: Any) -> Tracker[Any]: ...
@overload
def create(kind: Literal["stage"], type_: str, /, **keys: Any) -> Stage: ...
@overload
def create(kind: str, type_: str, /, **keys: Any) -> Any: ...
def create(kind: str, type_: str, class_: type | None = None, /, **keys: Any) -> Any:
    """Make one component from Python, with the same keys as a mission table.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    type_ : str
        Its type.
    class_ : type, optional
        Class of the component, which is checked, and is then the type that a type checker sees;
        without it that is the interface of the kind.
    **keys
        Keys and values of the mission's table, unit suffixes included; a reference takes the object
        itself.

    Returns
    -------
    object
        The component.

    Raises
    ------
    UnknownComponentError
        If no such component is installed.
    InputError
        If a key is unknown, missing, or of the wrong kind; the message lists every fault. If the
        component is not of the given class.

    Examples
    --------
    >>> from hillsphere import create
    >>> create("gravity", "point_mass", gm_km3_s2=7.0875e-4).frame
    'body'
    """
    record = default_registry().get(kind, type_)
    spec = validate(record.load_spec(), keys, where=f"{kind} {type_!r}")
    made = record.load_target()(spec)
    if class_ is not None and not isinstance(made, class_):
        raise InputError(f"{kind} {type_!r} is a {type(made).__name__}, no {class_.__name__}")
    return made


def validate(spec: type[Spec], keys: Mapping[str, Any], *, where: str) -> Spec:
    """Check keys given in Python against a Spec.

    Parameters
    ----------
    spec : type
        The Spec class.
    keys : mapping
        Keys and values as in a mission's table.
    where : str
        Name of the component, for the message.

    Returns
    -------
    Spec
        The validated, frozen Spec.

    Raises
    ------
    InputError
        If a key is unknown, missing or invalid; the message has a line for each fault.
    """
    from hillsphere.mission.faults import faults_of

    made, faults = faults_of(spec, keys)
    if made is None:
        lines = [
            f"{where}: {format_key(f.key)}: {f.message}" if f.key else f"{where}: {f.message}"
            for f in faults
        ]
        raise InputError("\n".join(lines))
    return made
