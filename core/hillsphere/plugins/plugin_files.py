"""Plugins of one file, which the user of a mission names on the command line.

A plugin package is installed and found by its entry point. A plugin file needs no installation: it
is a Python module with a ``hillsphere_components`` of its own, named by ``--plugin FILE`` or given
to `add_plugin_file`. Nothing else loads one: neither a mission, nor the record of a run, nor a web
page may name a program. Its source is read once, so that the digest is that of the executed code;
the workers of a pool execute the same or refuse.
"""

from __future__ import annotations

import re
import sys
import traceback
from dataclasses import dataclass
from hashlib import sha256
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path

from hillsphere.base.errors import PluginError
from hillsphere.plugins.registry import Registry, default_registry

__all__ = [
    "PluginFile", "add_plugin_file", "load_plugin_files", "offer_plugin_files",
    "plugin_files",
]  # fmt: skip

_PREFIX = "hillsphere_plugin_file_"
"""Beginning of the modules' names: no installed module is shadowed by a file of its name."""
_MOST_BYTES = 10 << 20
"""Largest size of a file: far above that of a module, and far below the memory."""


@dataclass(frozen=True)
class PluginFile:
    """A loaded plugin file.

    Parameters
    ----------
    path : str
        Its absolute path.
    sha256 : str
        Digest of the source that was executed.
    module : str
        Name of its module in this process.
    """

    path: str
    sha256: str
    module: str

    @property
    def name(self) -> str:
        """Name of the file, by which lists and messages call the plugin."""
        return Path(self.path).name


_loaded: dict[str, PluginFile] = {}
"""Loaded files by the name of their module, in the order in which they were given."""


def plugin_files() -> tuple[PluginFile, ...]:
    """Return the plugin files of this process.

    Returns
    -------
    tuple of PluginFile
        In the order in which they were added.
    """
    return tuple(_loaded.values())


def add_plugin_file(path: str | Path) -> PluginFile:
    """Execute a plugin file and add its components to those that are installed.

    Parameters
    ----------
    path : str or Path
        The file. Its components name their classes by ``f"{__name__}:Class"``. Only a file that you
        trust: its code runs with your rights.

    Returns
    -------
    PluginFile
        The loaded file; that of before if it was added already and is unchanged.

    Raises
    ------
    PluginError
        If it cannot be read or executed (the message has file and line), offers no component or one
        that is installed already, or if another file of this name was added.
    """
    source, digest = _read(Path(path))
    place = Path(path).resolve()
    module = _PREFIX + re.sub(r"\W", "_", place.stem)
    file = PluginFile(str(place), digest, module)
    if module in _loaded:
        if _loaded[module] == file:
            return file
        raise PluginError(
            f"plugin file {str(path)!r}: {_loaded[module].path!r} was loaded under this name before"
        )
    _execute(file, source)
    try:
        _check(file)
    except PluginError:
        del sys.modules[module]
        raise
    _loaded[module] = file
    _offer(file, default_registry())
    return file


def load_plugin_files(files: list[list[str]]) -> None:
    """Load the plugin files of another process, whose work names their classes.

    Parameters
    ----------
    files : list of [path, sha256]
        Path and digest of each.

    Raises
    ------
    PluginError
        If one cannot be loaded, or has changed since.
    """
    for path, digest in files:
        if add_plugin_file(path).sha256 != digest:
            raise PluginError(f"plugin file {path!r}: it has changed since the run began")


def offer_plugin_files(registry: Registry) -> None:
    """Add the components of the loaded files to a registry.

    Parameters
    ----------
    registry : Registry
        The registry of the installed plugins.
    """
    for file in _loaded.values():
        _offer(file, registry)


def _read(path: Path) -> tuple[bytes, str]:
    try:
        with path.open("rb") as stream:
            source = stream.read(_MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise PluginError(f"plugin file {str(path)!r} cannot be read: {reason}") from error
    if len(source) > _MOST_BYTES:
        raise PluginError(f"plugin file {str(path)!r} is larger than {_MOST_BYTES >> 20} MB")
    return source, sha256(source).hexdigest()


def _execute(file: PluginFile, source: bytes) -> None:
    spec = ModuleSpec(file.module, None, origin=file.path)
    spec.has_location = True
    module = module_from_spec(spec)
    sys.modules[file.module] = module
    try:
        exec(compile(source, file.path, "exec"), vars(module))  # the user named this program
    except (Exception, SystemExit) as error:
        del sys.modules[file.module]
        raise PluginError(
            f"{_place(file.path, error)}: the plugin file cannot be loaded: "
            f"{type(error).__name__}: {getattr(error, 'msg', None) or error}"
        ) from error


def _place(path: str, error: BaseException) -> str:
    """Return ``file:line`` of an error in a file, as far as the line is known."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == path
    ]
    if isinstance(error, SyntaxError) and error.filename == path:
        lines.append(error.lineno)
    return f"{path}:{lines[-1]}" if lines and lines[-1] else path


def _check(file: PluginFile) -> None:
    """Refuse a file without a component, or with one that is installed already."""
    try:
        offered = Registry(strict=True)
        _offer(file, offered)
    except PluginError as error:
        raise PluginError(f"{file.path}: {error}") from error
    installed = {(r.component.kind, r.component.type): r.plugin for r in default_registry()}
    for record in offered:
        key = (record.component.kind, record.component.type)
        if key in installed:
            raise PluginError(
                f"{file.path}: {key[0]} {key[1]!r} is already offered by plugin {installed[key]!r}"
            )


def _offer(file: PluginFile, registry: Registry) -> None:
    # A part of the digest stands where a package has its version, in lists and in stages' keys.
    registry.add_plugin(file.name, sys.modules[file.module], f"{file.name} {file.sha256[:12]}")
