"""Cache of compiled functions on the disk, under a key of everything that they depend on.

The compile layer has a cache of machine code, but its look-up first traverses the expressions,
which takes two seconds for a step of a Runge–Kutta formula with derivatives (32,000 terms). Here
whole functions are stored. The key is the SHA-256 of the equations, the options, the source files
that compose the function, and the compiled form of a small probe, which contains the compiler's
version, target and CPU features. A stored function has the same machine code as a fresh one, so
that results are bit-identical.

The cache lies beside the compile layer's own and is off if that is off. `--no-cache`, which
concerns results of stages, does not switch it off.

Entries are pickles, whose unpickling executes code. `hillsphere.symbolic._heyoka` has checked the
directory and those above it; of the files only those are read that belong to this user and that no
other user may write to. Who can create such a file can already run anything as this user.
"""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from time import monotonic
from typing import Any

from hillsphere.base.atomic import PART_SUFFIX, replacing
from hillsphere.base.cached_files import drop_oldest, tree_digest
from hillsphere.base.environment import package_versions
from hillsphere.base.private_cache import is_private
from hillsphere.base.regular_files import open_regular
from hillsphere.symbolic._heyoka import heyoka as _hy
from hillsphere.symbolic.expressions import Expr, variable

__all__ = ["kept_function"]

MAX_BYTES = 1 << 30
"""Largest size of the cache, 1 GB, and so of one entry; beyond it the entries that were not used
for longest are removed."""
WORTH_S = 0.1
"""A function that compiles faster than this is not stored: reading it back would save little."""

_PROTOCOL = 5
"""Version of the pickle format, fixed so that keys do not change with Python's default."""
_SUFFIX = ".function"
_DIGEST_BYTES = sha256().digest_size


def kept_function(
    options: Mapping[str, Any], equations: Iterable[Expr], make: Callable[[], Any]
) -> Any:
    """Return a compiled function from the cache, or compile and store it.

    Parameters
    ----------
    options : mapping
        Everything but the equations that `make` depends on, as values that JSON can write.
    equations : iterable of Expr
        The expressions that `make` starts from, in order. Expressions that it derives from these
        are not needed for the key.
    make : callable
        Compiles the function; its source is in `hillsphere.dynamics`, whose files are part of the
        key.

    Returns
    -------
    object
        The result of `make`, picklable. An entry that is damaged, belongs to another user or has
        another key is ignored, as is a directory that cannot be written.
    """
    if not _hy.llvm_state.get_diskcache_enabled():
        return make()
    key = _key(options, equations)
    path = _directory() / f"{key}{_SUFFIX}"
    function = _load(path, key)
    if function is None:
        begin = monotonic()
        function = make()
        if monotonic() - begin >= WORTH_S:
            # `hillsphere.symbolic._heyoka` has already warned of a directory that is not writable.
            with suppress(OSError):
                _save(path, key, function)
    return function


def _directory() -> Path:
    return Path(_hy.llvm_state.get_diskcache_path()) / "functions"


def _key(options: Mapping[str, Any], equations: Iterable[Expr]) -> str:
    digest = sha256(_maker().encode())
    digest.update(json.dumps(options, sort_keys=True).encode())
    for equation in equations:
        # One by one: a pickle of several depends on which objects they share. Printed, they would
        # be cut short.
        digest.update(sha256(pickle.dumps(equation, _PROTOCOL)).digest())
    return digest.hexdigest()


@cache
def _maker() -> str:
    """Return the digest of sources, package versions and compiler target, for cache keys."""
    here = Path(__file__).parents[1]
    x = variable("x")
    probe = _hy.cfunc([x + 1.0], vars=[x])
    facts = [
        tree_digest(here / "engine" / "dynamics"),
        tree_digest(here / "symbolic"),
        package_versions(("hillsphere", "heyoka")),
        [repr(state) for state in probe.llvm_states],  # target, CPU and its features, options
        sha256(pickle.dumps(probe, _PROTOCOL)).hexdigest(),  # holds the compiler's version
    ]
    return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def _load(path: Path, key: str) -> Any:
    """Return the function in a file, or None if there is no trusted one."""
    try:
        with open_regular(path, MAX_BYTES, follow_links=False) as stream:
            if not is_private(os.fstat(stream.fileno())):
                return None
            digest, content = stream.read(_DIGEST_BYTES), stream.read()
        if digest != _digest(key, content):
            return None
        function = pickle.loads(content)
    except Exception:  # what a foreign pickle raises, nobody knows
        return None
    with suppress(OSError):  # only its age in the cache
        os.utime(path)
    return function


def _save(path: Path, key: str, function: Any) -> None:
    content = pickle.dumps(function, _PROTOCOL)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with replacing(path, mode=0o600) as stream:  # whatever the umask, or it would not be read
        stream.write(_digest(key, content))
        stream.write(content)
    drop_oldest(path.parent, (_SUFFIX, PART_SUFFIX), MAX_BYTES)


def _digest(key: str, content: bytes) -> bytes:
    # With the key: an entry that was renamed is another function.
    return sha256(key.encode() + content).digest()
