"""Examination of an installation: versions, extras, plugins, compile cache and a self-test."""

from __future__ import annotations

import os
import platform
import re
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Literal

from hillsphere.base.errors import HillsphereError
from hillsphere.base.paths import cache_directory
from hillsphere.plugins.registry import Registry, default_registry

__all__ = ["Finding", "examine"]

_NETWORK_FILE_SYSTEMS = ("nfs", "cifs", "smb", "lustre", "gpfs", "beegfs", "ceph", "fuse.sshfs")


@dataclass(frozen=True)
class Finding:
    """One line of the examination.

    Parameters
    ----------
    group, name : str
        Group and name of the examined item.
    state : {"ok", "absent", "fail"}
        ``"absent"``: an optional item is not installed.
    detail : str
        Result as text.
    """

    group: str
    name: str
    state: Literal["ok", "absent", "fail"]
    detail: str

    @property
    def ok(self) -> bool:
        """Whether the item did not fail."""
        return self.state != "fail"


def examine(
    registry: Registry | None = None, contested: Mapping[tuple[str, str], str] | None = None
) -> list[Finding]:
    """Examine this installation.

    Parameters
    ----------
    registry : Registry, optional
        Plugins to examine; by default all installed ones.
    contested : mapping, optional
        (kind, type) → message, for components that cannot be used since two plugins offer them; by
        default those of the registry.

    Returns
    -------
    list of Finding
        Results in the order of presentation.
    """
    registry = default_registry() if registry is None else registry
    contested = registry.contested if contested is None else contested
    return [
        *_versions(),
        *_plugins(registry),
        *(
            Finding("plugin", f"contested {kind} {type_}", "fail", message)
            for (kind, type_), message in contested.items()
        ),
        *_compile_cache(cache_directory() / "compiled"),
        *_self_test(),
    ]


def _versions() -> Iterator[Finding]:
    yield Finding("version", "python", "ok", f"{platform.python_version()} on {platform.machine()}")
    yield Finding("version", "hillsphere", "ok", metadata.version("hillsphere"))
    seen: set[str] = set()  # the extra "dev" holds all of the extra "test"
    for requirement in metadata.requires("hillsphere") or ():
        match = re.match(r"[A-Za-z0-9._-]+", requirement)
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)['\"]", requirement)
        if match is None or match.group() == "hillsphere" or match.group() in seen:
            continue
        seen.add(match.group())
        group = f"extra {extra.group(1)}" if extra else "version"
        try:
            yield Finding(group, match.group(), "ok", metadata.version(match.group()))
        except metadata.PackageNotFoundError:
            state: Literal["absent", "fail"] = "absent" if extra else "fail"
            remedy = f"pip install 'hillsphere[{extra.group(1)}]'" if extra else "pip install it"
            yield Finding(group, match.group(), state, f"not installed ({remedy})")


def _plugins(registry: Registry) -> Iterator[Finding]:
    counts: dict[str, int] = {}
    for record in registry:
        counts[record.plugin] = counts.get(record.plugin, 0) + 1
    for name, count in sorted(counts.items()):
        yield Finding("plugin", name, "ok", f"{count} component{'s' * (count != 1)}")
    for name, reason in sorted(registry.broken.items()):
        yield Finding("plugin", name, "fail", reason)
    for name in registry.disabled:
        yield Finding("plugin", name, "absent", "disabled by HILLSPHERE_DISABLE_PLUGINS")
    for record in registry:
        component = record.component
        for load in (record.load_spec, record.load_target):
            if component.kind == "command" and load == record.load_spec:
                continue
            try:
                load()
            except HillsphereError as error:
                yield Finding("plugin", f"{component.kind} {component.type}", "fail", str(error))
                break


def _compile_cache(directory: Path) -> Iterator[Finding]:
    name = "directory"
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass
    except OSError as error:
        yield Finding(
            "compile cache", name, "fail",
            f"{directory} cannot be written ({error.strerror}); set HILLSPHERE_CACHE to a "
            "directory that can",
        )  # fmt: skip
        return
    size = sum(entry.stat().st_size for entry in directory.rglob("*") if entry.is_file())
    yield Finding("compile cache", name, "ok", f"{directory}, writable, {size / 1e6:.1f} MB")
    kind = file_system(directory, Path("/proc/self/mounts"))
    if kind.startswith(_NETWORK_FILE_SYSTEMS):
        yield Finding(
            "compile cache", "file system", "fail",
            f"{kind}: locks are unsafe on a network file system; set HILLSPHERE_CACHE to a "
            "local directory",
        )  # fmt: skip
    else:
        yield Finding("compile cache", "file system", "ok", kind or "local (not determined)")


def file_system(path: Path, mounts: Path) -> str:
    """Return the type of the file system that contains a path.

    Parameters
    ----------
    path : Path
        Existing directory.
    mounts : Path
        The kernel's table of mounts, in the format of ``/proc/self/mounts``.

    Returns
    -------
    str
        For example ``"ext4"`` or ``"nfs4"``; empty if the platform has no such table.
    """
    if not mounts.exists():
        return ""
    inside = os.path.realpath(path)
    best, kind = "", ""
    for line in mounts.read_text(encoding="utf-8", errors="surrogateescape").splitlines():
        _, point, candidate, *_ = line.split(" ")
        point = re.sub(r"\\([0-7]{3})", lambda code: chr(int(code.group(1), 8)), point)
        held = inside == point or inside.startswith(point.rstrip("/") + "/")
        if held and len(point) >= len(best):
            best, kind = point, candidate
    return kind


def _self_test() -> Iterator[Finding]:
    try:
        from hillsphere.cli.self_test import CHECKS
    except (ImportError, OSError) as error:
        yield Finding("self-test", "compile layer", "fail", f"cannot be imported: {error}")
        return
    for name, check in CHECKS.items():
        yield _time_check(name, check)


def _time_check(name: str, check: Callable[[], str]) -> Finding:
    start = time.perf_counter()
    try:
        detail = check()
    except (HillsphereError, ImportError, OSError) as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return Finding("self-test", name, "fail", text)
    return Finding("self-test", name, "ok", f"{detail}, {time.perf_counter() - start:.2f} s")
