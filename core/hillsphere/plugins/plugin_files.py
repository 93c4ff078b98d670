"""Plugins of one file, which the user of a mission names on the command line.

A plugin package is installed and found by its entry point. A plugin file needs no installation: it
is a Python module with a ``hillsphere_components`` of its own, named by ``--plugin FILE`` or given
to `add_plugin_file`. Nothing else loads one: neither a mission, nor the record of a run, nor a web
page may name a program. Its source is read once, so that the digest is that of the executed code;
the workers of a pool are sent that source. The digests of all loaded files are in the keys of all
stages, since a file can change what others do. What a file imports is in no key: a module beside it
is therefore refused, as far as the file imports it when it is loaded.
"""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Iterable
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from hashlib import sha256
from importlib.machinery import ModuleSpec
from importlib.util import module_from_spec
from pathlib import Path

from hillsphere.base.errors import PluginError
from hillsphere.base.regular_files import open_regular
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
    module : str
        Name of its module in this process.
    source : bytes
        What was executed.
    """

    path: str
    module: str
    source: bytes = field(repr=False)

    @property
    def sha256(self) -> str:
        """Digest of the source, 64 hexadecimal digits."""
        return sha256(self.source).hexdigest()

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


def add_plugin_file(path: str | Path, expected: str | None = None) -> PluginFile:
    """Execute a plugin file and add its components to those that are installed.

    They stay for the life of the process, and the file is named in the record of its later runs.

    Parameters
    ----------
    path : str or Path
        The file. Its components name their classes by ``f"{__name__}:Class"``. Only a file that you
        trust: its code runs with your rights.
    expected : str, optional
        SHA-256 of its source, in hexadecimal digits; another source is not executed.

    Returns
    -------
    PluginFile
        The loaded file; that of before if it was added already and is unchanged.

    Raises
    ------
    PluginError
        If it cannot be read or executed (the message has file and line), is another than was
        expected, imports a module beside it, offers no component or one that is installed already,
        or if another file of this name was added.
    """
    place = Path(os.path.abspath(path))  # not resolved: a link is known by its own name
    file = PluginFile(str(place), _PREFIX + re.sub(r"\W", "_", place.stem), _read(Path(path)))
    if expected is not None and file.sha256 != expected:
        raise PluginError(
            f"the plugin file {file.name!r} is another than that of the run: SHA-256 "
            f"{file.sha256[:12]}…, in the run {expected[:12]}…"
        )
    _load(file)
    return file


def load_plugin_files(files: Iterable[PluginFile]) -> None:
    """Load the plugin files of another process, whose work names their classes.

    Parameters
    ----------
    files : iterable of PluginFile
        The files, whose sources are not read again.

    Raises
    ------
    PluginError
        If one cannot be loaded.
    """
    for file in files:
        _load(file)


def offer_plugin_files(registry: Registry) -> None:
    """Add the components of the loaded files to a registry.

    Parameters
    ----------
    registry : Registry
        The registry of the installed plugins.
    """
    for file in _loaded.values():
        _offer(file, registry)


def _read(path: Path) -> bytes:
    try:
        with open_regular(path, _MOST_BYTES) as stream:
            return stream.read(_MOST_BYTES + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or error
        raise PluginError(f"plugin file {str(path)!r} cannot be read: {reason}") from error


def _load(file: PluginFile) -> None:
    """Execute a file and offer its components, unless that has been done."""
    known = _loaded.get(file.module)
    if known == file:
        return
    if known is not None:
        raise PluginError(
            f"plugin file {file.path!r} has changed since it was loaded: start a new process"
            if known.path == file.path
            else f"plugin file {file.path!r}: {known.path!r} was loaded under this name before"
        )
    before = set(sys.modules)
    try:
        _execute(file)
        _check(file)
        _check_imports(file, set(sys.modules) - before)
    except BaseException:  # an interrupt, too, leaves no half of a module behind
        sys.modules.pop(file.module, None)
        raise
    _loaded[file.module] = file
    _offer(file, default_registry())


def _execute(file: PluginFile) -> None:
    spec = ModuleSpec(file.module, None, origin=file.path)
    spec.has_location = True
    module = module_from_spec(spec)
    sys.modules[file.module] = module
    try:
        # What it prints must not come between the results of a command.
        with redirect_stdout(sys.stderr):
            # The user named this program. Its annotations are its own, not as in this module.
            exec(compile(file.source, file.path, "exec", dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        raise PluginError(
            f"{_place(file.path, error)}: the plugin file cannot be loaded: "
            f"{type(error).__name__}: {getattr(error, 'msg', None) or error}"
        ) from error


def _check_imports(file: PluginFile, modules: set[str]) -> None:
    """Refuse modules beside the file: the stages' keys would not see them change."""
    found = [name for name in sorted(modules - {file.module}) if _is_beside(name, file)]
    # The next file that imports them is to be refused too; all other modules stay.
    for name in found:
        del sys.modules[name]
    if found:
        raise PluginError(
            f"{file.path}: it imports {found[0]!r} from beside it, which no key of a stage would "
            "know: put all into one file, or make a package (hillsphere new plugin)"
        )


def _is_beside(name: str, file: PluginFile) -> bool:
    """Return whether a module, or the package that it is in, stands in the folder of a file."""
    top = sys.modules.get(name.partition(".")[0])
    place = Path(getattr(top, "__file__", None) or os.sep)
    folder = Path(file.path).parent
    return place.parent == folder or (place.name == "__init__.py" and place.parent.parent == folder)


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
        if key[0] == "command":
            raise PluginError(f"{file.path}: a command needs a package (hillsphere new plugin)")
        if key in installed:
            raise PluginError(
                f"{file.path}: {key[0]} {key[1]!r} is already offered by plugin {installed[key]!r}"
            )


def _offer(file: PluginFile, registry: Registry) -> None:
    # A part of the digest stands where a package has its version, in lists and in stages' keys.
    registry.add_plugin(file.name, sys.modules[file.module], f"{file.name} {file.sha256[:12]}")
