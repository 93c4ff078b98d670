"""Files of a cache: digests of their sources, and a limit on their total size."""

from __future__ import annotations

import shutil
from collections.abc import Collection
from hashlib import sha256
from pathlib import Path
from stat import S_ISDIR

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import open_regular

__all__ = ["drop_oldest", "file_digest", "tree_digest"]


def file_digest(path: Path, *, follow_links: bool = True) -> str:
    """Return the SHA-256 of a regular file's content.

    Parameters
    ----------
    path, follow_links
        As for `hillsphere.base.regular_files.open_regular`.
    """
    try:
        with open_regular(path, follow_links=follow_links) as stream:
            digest = sha256()
            while block := stream.read(1 << 20):
                digest.update(block)
    except OSError as error:
        raise InputError(f"{path.name}: cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()


def tree_digest(place: Path) -> str:
    """Return the SHA-256 of a source file, or of all files of a package, data included."""
    if place.is_file():
        return file_digest(place)
    digest = sha256()
    for path in sorted(place.rglob("*")):
        if "__pycache__" not in path.parts and path.is_file():
            digest.update(f"{path.relative_to(place).as_posix()}\0{file_digest(path)}\n".encode())
    return digest.hexdigest()


def drop_oldest(directory: Path, suffixes: Collection[str], max_bytes: int) -> None:
    """Remove the least recently used files and folders until the rest is within a size.

    Parameters
    ----------
    directory : Path
        Their directory; other processes may add and remove files at the same time.
    suffixes : collection of str
        Endings of the entries that count; others are left alone.
    max_bytes : int
        Largest total size of the entries that stay, a folder with all that is in it.
    """
    entries = []
    for path in directory.iterdir():
        if path.suffix not in suffixes:
            continue
        try:
            status = path.lstat()
            inside = path.iterdir() if S_ISDIR(status.st_mode) else ()
            size = status.st_size + sum(one.lstat().st_size for one in inside)
        except FileNotFoundError:  # another process removed it
            continue
        entries.append((status.st_mtime, size, path))
    total = sum(size for _, size, _ in entries)
    for _, size, path in sorted(entries, key=lambda entry: entry[0]):
        if total <= max_bytes:
            break
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        total -= size
