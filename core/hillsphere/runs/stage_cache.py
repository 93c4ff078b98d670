"""Cache of stages' products between runs, under a key of everything that they depend on.

The key of a stage is the SHA-256 of: its type and Spec, the types and Specs of the components it
refers to (and those that they refer to), the contents of its data files, the keys of the stages it
takes products from, its name and the mission's seed (which make its random numbers), the source
files of the packages that provide all these and of the framework, and the versions and CPU
features that fix the last bit of a result; and all plugin files of this process.

Files that a plugin reads by itself at run time, and further packages that it imports, cannot be
listed and are not in the key; for these use `--no-cache`.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hillsphere.base.atomic import PART_SUFFIX
from hillsphere.base.cached_files import drop_oldest, file_digest, tree_digest
from hillsphere.base.environment import environment
from hillsphere.base.errors import InputError
from hillsphere.base.paths import cache_directory
from hillsphere.plugins.plugin_files import plugin_files
from hillsphere.products.columns import column_folder
from hillsphere.products.product_codec import load_product, save_product
from hillsphere.spec.base import Ref, Spec

if TYPE_CHECKING:
    from hillsphere.mission.load import Mission

__all__ = ["StageCache", "StageKeys", "file_digest", "plain_spec", "source_digest"]

FORMAT = 1
"""Version of the layout of an entry; it is part of every key, so that others are never read."""
MAX_BYTES = 2 << 30
"""Largest size of the cache, 2 GB by default; then the entries unused for longest are removed."""


class StageCache:
    """A directory of products, bounded in size.

    Parameters
    ----------
    directory : Path, optional
        By default ``stages`` in the framework's cache directory.
    max_bytes : int
        Largest total size; beyond it the least recently used entries are removed.
    """

    def __init__(self, directory: Path | None = None, max_bytes: int = MAX_BYTES) -> None:
        self.directory = directory or cache_directory() / "stages"
        self.max_bytes = max_bytes

    def _path(self, key: str) -> Path:
        return self.directory / f"{key}.npz"

    def load(self, key: str, expected: type) -> Any:
        """Return the product under a key, or ``None`` without one.

        Raises
        ------
        InputError
            If the entry is damaged, holds another class, or another user may have written it; the
            entry is removed.
        StageError
            If reading fails for another reason; the entry stays.
        """
        path = self._path(key)
        if not path.exists():
            return None
        try:
            product = load_product(path, own=True)
            if not isinstance(product, expected):
                raise InputError(f"{path.name}: holds a {type(product).__name__}")
        except InputError:
            path.unlink(missing_ok=True)
            raise
        with suppress(OSError):  # only its age in the cache
            os.utime(path)
            if (folder := column_folder(path)).exists():
                os.utime(folder)
        return product

    def save(self, key: str, product: Any) -> None:
        """Store a product, and remove the least recently used ones beyond `max_bytes`.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        self.directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        save_product(self._path(key), product, own=True)
        suffixes = (".npz", column_folder(self._path(key)).suffix, PART_SUFFIX)
        drop_oldest(self.directory, suffixes, self.max_bytes)


class StageKeys:
    """Keys of the stages of one mission.

    Parameters
    ----------
    mission : Mission
        The mission.
    """

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._keys: dict[str, str | None] = {}
        self._sources: dict[str, str] = {}

    @property
    def sources(self) -> dict[str, str]:
        """Package → SHA-256 of its source files, for all packages in the keys made so far."""
        return dict(sorted(self._sources.items()))

    def of(self, stage: str) -> str | None:
        """Return the key of a stage.

        Parameters
        ----------
        stage : str
            Its name; the stages it needs are in the mission.

        Returns
        -------
        str or None
            64 hexadecimal digits; ``None`` if the stage depends on code outside any file (a class
            defined at a prompt), so that its product cannot be stored.
        """
        if stage not in self._keys:
            self._keys[stage] = self._key(stage)
        return self._keys[stage]

    def _key(self, stage: str) -> str | None:
        tables: dict[str, Any] = {}
        modules: set[str] = {"hillsphere"}
        inputs: dict[str, str] = {}
        waiting = [("stage", stage)]
        while waiting:
            kind, name = waiting.pop()
            if f"{kind}.{name}" in tables:
                continue
            spec: Spec = self._mission.specs[kind][name]
            record = self._mission.components[kind][name]
            tables[f"{kind}.{name}"] = {
                "type": record.component.type,
                "target": record.component.target,
                "distribution": record.distribution,
                "spec": plain_spec(spec),
            }
            paths = [record.component.target, record.component.spec, getattr(spec, "produces", "")]
            modules |= {path.partition(":")[0] for path in paths if path}
            for where, other, ref in spec.references():
                if other == "stage":
                    key = self.of(ref.name)
                    if key is None:
                        return None
                    inputs[".".join(map(str, where))] = key
                else:
                    waiting.append((other, ref.name))
        sources: dict[str, str] = {}
        files = {file.module: file.sha256 for file in plugin_files()}
        for module in sorted(modules):
            source = _source_of(module)
            if source is None:
                return None
            package, place = source
            if package not in self._sources:
                executed = files.get(package)
                self._sources[package] = tree_digest(place) if executed is None else executed
            sources[module] = self._sources[package]
        facts = {
            "format": FORMAT,
            "name": stage,
            "seed": self._mission.seed,
            "tables": tables,
            "inputs": inputs,
            "sources": sources,
            "environment": environment(),
        }
        if files:
            # All, since a file can change what the components of others do.
            facts["plugin_files"] = files
        return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def plain_spec(spec: Spec) -> dict[str, Any]:
    """Return a Spec as plain values, SI, the same on every machine.

    Parameters
    ----------
    spec : Spec
        A validated Spec.

    Returns
    -------
    dict
        References by name; a data file as ``{"file": name, "sha256": digest}``.

    Raises
    ------
    InputError
        If a data file cannot be read.
    """
    return {
        name: _plain(getattr(spec, name), bool(type(spec).schema_extra(name).get("x-path")))
        for name in type(spec).model_fields
    }


def _plain(value: Any, is_path: bool) -> Any:
    if isinstance(value, Ref):
        return value.name
    if isinstance(value, Spec):
        return plain_spec(value)
    if isinstance(value, str) and is_path:
        return {"file": Path(value).name, "sha256": file_digest(Path(value))}
    if isinstance(value, tuple | list):
        return [_plain(item, is_path) for item in value]
    if isinstance(value, Mapping):
        return {str(key): _plain(item, is_path) for key, item in value.items()}
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return str(value)


def _source_of(module: str) -> tuple[str, Path] | None:
    """Return name and path of a module's outermost regular package, or of the module itself."""
    parts = module.split(".")
    for depth in range(1, len(parts) + 1):
        name = ".".join(parts[:depth])
        loaded = sys.modules.get(name)
        if loaded is not None:
            file = getattr(loaded, "__file__", None)
        else:
            module_spec = find_spec(name)
            file = (
                module_spec.origin if module_spec is not None and module_spec.has_location else None
            )
        if file is not None:
            place = Path(file)
            return name, place.parent if place.name == "__init__.py" else place
    return None


def source_digest(module: str) -> tuple[str, str] | None:
    """Return the package that a module belongs to and the SHA-256 of its source files.

    Parameters
    ----------
    module : str
        Name of an importable module.

    Returns
    -------
    tuple of str or None
        Name and digest; ``None`` if the module is in no file.
    """
    source = _source_of(module)
    return None if source is None else (source[0], tree_digest(source[1]))
