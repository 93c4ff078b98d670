"""Damaged files: whatever is wrong with one, a reader says so in a message that names the file."""

from __future__ import annotations

import ast
import importlib
import pkgutil
import re
import warnings
import zlib
from pathlib import Path

import pytest
from tests.core.mutations import damaged
from tests.core.readers import NO_READERS, READERS, Reader

from hillsphere.errors import HillsphereError

SAMPLE = 40
"""Damaged files for each reader in every run of the tests; all of them take about 10 s."""
MANY = 4000

OPENERS = {
    "read_text", "read_bytes", "open", "open_regular", "fdopen", "loadtxt", "genfromtxt",
    "fromfile", "loadmat", "reader", "DictReader", "ZipFile", "furnsh",
}  # fmt: skip
"""Names of calls that open a file or parse what stood in one."""
PARSERS = {"np", "json", "json_text", "ET", "tomllib", "pickle", "marshal", "yaml"}
"""Modules, as they are imported here, whose load, loads, parse and fromstring do so too."""


def _damage(reader: Reader, tmp_path: Path, first: int, count: int) -> None:
    path = tmp_path / reader.file
    reader.sound(path)
    reader.read(path)  # the sound one is read
    sound = path.read_bytes()
    faults = []
    for seed in range(first, first + count):
        path.unlink(missing_ok=True)
        path.write_bytes(damaged(sound, zlib.crc32(f"{reader.name} {seed}".encode())))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                reader.read(path)
        except HillsphereError as error:
            message = str(error)
            if path.name not in message and not reader.of_text:
                faults.append(f"seed {seed}: the message does not name the file: {message[:200]}")
            elif "\0" in message or len(message) > 20_000:
                faults.append(f"seed {seed}: not a readable message: {message[:200]!r}")
        except Exception as error:  # what this test is about: anything else is a fault
            faults.append(f"seed {seed}: {type(error).__name__}: {str(error)[:200]}")
    assert not faults, f"{len(faults)} of {count}:\n" + "\n".join(faults[:20])


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_refused_with_one_message(reader: Reader, tmp_path: Path) -> None:
    _damage(reader, tmp_path, 0, SAMPLE)


@pytest.mark.slow
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_many_damaged_files(reader: Reader, tmp_path: Path) -> None:
    _damage(reader, tmp_path, SAMPLE, MANY)


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_a_file_that_is_not_there_or_is_a_directory(reader: Reader, tmp_path: Path) -> None:
    if reader.name == "memory":
        pytest.skip("a memory that is not there yet is an empty one")
    folder = tmp_path / "folder" / reader.file
    folder.mkdir(parents=True)
    for path in (tmp_path / reader.file, folder):
        # A reader of text is given what its caller read: the error is the caller's to tell.
        expected = OSError if reader.of_text else HillsphereError
        with pytest.raises(expected, match=re.escape(path.name)):
            reader.read(path)


def _opens_files(path: Path) -> bool:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Attribute):
            of = getattr(node.func.value, "id", "")
            parses = node.func.attr in ("load", "loads", "parse", "fromstring") and of in PARSERS
            if parses or node.func.attr in OPENERS:
                return True
        elif getattr(node.func, "id", "") in OPENERS:
            return True
    return False


def test_every_module_that_opens_files_stands_in_the_table() -> None:
    """A new reader is found here: put it into `readers.READERS`, with a sound file."""
    known = {module for reader in READERS for module in reader.modules}
    missing = []
    for package in ("hillsphere", "controllers", "estimators", "gravity", "guidance", "orbits",
                    "plants", "sensors", "tracking", "campaigns", "flight", "dask"):  # fmt: skip
        name = package if package == "hillsphere" else f"hillsphere_{package}"
        root = importlib.import_module(name)
        for found in pkgutil.walk_packages(root.__path__, name + "."):
            spec = found.module_finder.find_spec(found.name, None)
            if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
                continue
            if _opens_files(Path(spec.origin)) and found.name not in known | set(NO_READERS):
                missing.append(found.name)
    assert missing == []
