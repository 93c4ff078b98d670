"""Differences between two runs in the facts that their results depend on."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from hillsphere.base.environment import NUMERICAL
from hillsphere.base.problems import Key, format_key

__all__ = ["differences"]

_TEXT = ("name", "title", "description")
_DIGITS = 12
"""Hexadecimal digits shown of a digest: 48 bits, enough to tell any two files of a run apart."""


def differences(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the differences of two manifests that concern results.

    Parameters
    ----------
    then, now : mapping
        Contents of ``manifest.json``.

    Returns
    -------
    list of str
        One line per difference: ``"stage.first.count: 3 -> 4"``. Name, title and description are
        ignored.
    """
    missions = [
        {k: v for k, v in manifest["mission"].items() if k not in _TEXT} for manifest in (then, now)
    ]
    lines = [f"{format_key(key)}: {a} -> {b}" for key, a, b in _unequal(missions[0], missions[1])]
    lines += [
        f"{key} (content of {file}): {_short(a)} -> {_short(b)}"
        for key, file, a, b in _files(then.get("inputs", {}), now.get("inputs", {}))
    ]
    versions = [
        {
            "python": manifest["versions"].get("python"),
            **{
                k: v
                for k, v in manifest["versions"].get("packages", {}).items()
                if k in ("hillsphere", *NUMERICAL)
            },
            **manifest["versions"].get("plugins", {}),
        }
        for manifest in (then, now)
    ]
    lines += [
        f"version of {format_key(key)}: {a} -> {b}"
        for key, a, b in _unequal(versions[0], versions[1])
    ]
    sources = [manifest.get("sources", {}) for manifest in (then, now)]
    lines += [
        f"source files of {key}: {_short(sources[0].get(key))} -> {_short(sources[1].get(key))}"
        for key in sorted({*sources[0], *sources[1]})
        if sources[0].get(key) != sources[1].get(key)
    ]
    for key in ("system", "machine", "c_library"):
        a, b = then["platform"].get(key), now["platform"].get(key)
        lines += [f"{key}: {a} -> {b}"] * (a != b)
    kernels = [manifest["platform"].get("kernels", {}) for manifest in (then, now)]
    lines += [f"variable {format_key(key)}: {a} -> {b}" for key, a, b in _unequal(*kernels)]
    features = [set(manifest["platform"].get("cpu_features", ())) for manifest in (then, now)]
    if features[0] != features[1]:
        lost, new = (", ".join(sorted(a - b)) or "none" for a, b in (features, features[::-1]))
        lines.append(f"CPU features that only one has: {lost} -> {new}")
    return lines or _keys(then["stages"], now["stages"])


def _keys(then: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return a line for each stage whose key has changed for a reason that is not recorded."""
    lines = []
    for name, stage in now.items():
        a, b = then.get(name, {}).get("key"), stage.get("key")
        if b is None:
            lines.append(f"stage.{name}: depends on code in no file, which may be another one now")
        elif a is not None and a != b:
            lines.append(f"stage.{name}: key {_short(a)} -> {_short(b)}")
    return lines


def _unequal(then: Any, now: Any, key: Key = ()) -> Iterator[tuple[Key, str, str]]:
    """Yield (key, then, now) of every value that differs."""
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys((*then, *now)):
            yield from _unequal(then.get(name), now.get(name), (*key, name))
    elif isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        for index, (a, b) in enumerate(zip(then, now, strict=True)):
            yield from _unequal(a, b, (*key, index))
    elif then != now:
        yield key, _plain(then), _plain(now)


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _files(
    then: Mapping[str, Any], now: Mapping[str, Any]
) -> Iterator[tuple[str, str, str | None, str | None]]:
    for key in sorted({*then, *now}):
        a, b = then.get(key, {}), now.get(key, {})
        if a.get("sha256") != b.get("sha256"):
            yield key, b.get("file") or a.get("file"), a.get("sha256"), b.get("sha256")


def _short(digest: str | None) -> str:
    return digest[:_DIGITS] if digest else "none"
