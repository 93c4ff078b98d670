"""Files that somebody else may have written: regular ones only, and not larger than is bearable."""

from __future__ import annotations

import errno
import os
import stat
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.base.atomic import output_place, replacing, write_text
from hillsphere.base.json_files import MAX_DEPTH, parse_json, read_json
from hillsphere.base.npz import read_arrays
from hillsphere.base.regular_files import NotRegularError, open_regular, read_bytes, read_text
from hillsphere.errors import InputError

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")


@pytest.fixture
def fifo(tmp_path: Path) -> Path:
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def test_a_fifo_is_not_opened(fifo: Path) -> None:
    with pytest.raises(NotRegularError, match="it is a FIFO, not a regular file"):
        open_regular(fifo)


def test_a_device_is_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "link").symlink_to("/dev/null")

    def refuse(*arguments: object) -> int:
        raise AssertionError("it was opened")

    monkeypatch.setattr(os, "open", refuse)
    for path in ("/dev/null", tmp_path / "link"):
        with pytest.raises(NotRegularError, match="it is a device"):
            open_regular(path)


def test_what_is_opened_is_judged_not_its_name(
    fifo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The name leads to a file when it is looked at, and to a FIFO when it is opened."""
    (tmp_path / "file").write_text("x")
    status = os.stat(tmp_path / "file")
    monkeypatch.setattr(os, "stat", lambda *arguments, **options: status)
    with pytest.raises(NotRegularError, match="FIFO"):  # and it does not wait for a writer
        open_regular(fifo)


def test_links_are_followed_only_where_that_is_meant(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    (tmp_path / "link").symlink_to("file")
    assert read_text(tmp_path / "link") == "x"
    with pytest.raises(NotRegularError, match="it is a link"):
        open_regular(tmp_path / "link", follow_links=False)


def test_an_interrupt_right_after_the_opening_stays_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_bytes(b"1")
    opened = os.fdopen

    def interrupted(descriptor: int, mode: str) -> None:
        opened(descriptor, mode).close()
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fdopen", interrupted)
    with pytest.raises(KeyboardInterrupt):
        open_regular(tmp_path / "a")


def test_size_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(OSError, match="larger than 4 bytes") as told:
        read_bytes(path, 4)
    assert told.value.errno == errno.EFBIG
    with path.open("r+b") as stream:
        stream.truncate(1 << 40)  # a terabyte, of which nothing is on the disk
    with pytest.raises(OSError, match="larger than 16384 MiB"):
        open_regular(path)


def test_directories_and_names_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(OSError, match="null"):
        open_regular("a\0b")


# --- outputs


def test_an_output_follows_a_link_and_leaves_it(tmp_path: Path) -> None:
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to("target")
    write_text(tmp_path / "link", "new", follow_links=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"
    (tmp_path / "dangling").symlink_to("later")
    write_text(tmp_path / "dangling", "new", follow_links=True)
    assert (tmp_path / "later").read_text() == "new"


@pytest.mark.parametrize("follow_links", [True, False])
def test_a_fifo_or_device_is_not_replaced(fifo: Path, follow_links: bool) -> None:
    """Root replaced /dev/null by a file of text."""
    link = fifo.with_name("link")
    link.symlink_to("pipe")
    # Never the system's own: were it replaced, as by root it was, the machine would suffer.
    device = fifo.with_name("device")
    if os.geteuid() == 0:
        os.mknod(device, 0o666 | stat.S_IFCHR, os.makedev(1, 3))
    for path in (fifo, *([device] if device.exists() else []), *([link] if follow_links else [])):
        with pytest.raises(NotRegularError, match=r"it is a (FIFO|device)"):
            write_text(path, "text", follow_links=follow_links)
    assert fifo.is_fifo()
    assert not device.exists() or device.is_char_device()
    assert {path.name for path in fifo.parent.iterdir()} <= {"device", "link", "pipe"}


def test_an_output_that_is_a_circle_of_links_or_a_directory(tmp_path: Path) -> None:
    (tmp_path / "circle").symlink_to("circle")
    with pytest.raises(OSError, match="it is a link"):
        output_place(tmp_path / "circle")
    with pytest.raises(IsADirectoryError):
        output_place(tmp_path)


def test_a_mode_holds_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        with replacing(tmp_path / "file", mode=0o600) as stream:
            stream.write(b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o600


# --- JSON


def test_json_is_bounded_in_depth() -> None:
    assert parse_json("[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1))
    for depth in (MAX_DEPTH + 1, 100_000):  # the second exceeds Python's own limit
        with pytest.raises(ValueError, match="nested deeper than 64 levels"):
            parse_json("[" * depth + "]" * depth)


@pytest.mark.parametrize("text", ["NaN", "[Infinity]", "{", "\ud800"])
def test_json_that_is_none(text: str, tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(InputError, match=r"x\.json: is damaged"):
        read_json(path, 1000)


# --- archives of arrays


def archive(path: Path, *members: tuple[str, bytes], compressed: bool = False) -> Path:
    how = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", how) as file:
        for name, data in members:
            file.writestr(name, data)
    return path


def npy(array: np.ndarray[Any, Any]) -> bytes:
    stream = BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


def claiming(shape: str, dtype: str = "<f8") -> bytes:
    """Return an array of one number whose header claims to have another shape."""
    text = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(8)


@pytest.mark.parametrize(
    ("member", "message"),
    [
        (claiming("(1000000000000,)"), "is cut off"),
        (claiming("(1000000000000,)", "|V0"), "is cut off"),
        (claiming("(-1,)"), "is cut off"),
        (claiming("(1,)", "|O"), "Object arrays cannot be loaded"),
        (npy(np.array([{}], dtype=object)), "Object arrays cannot be loaded"),
        (b"\x93NUMPY\x09\x00", "header of version"),
        (b"", "magic"),
    ],
)
def test_arrays_that_claim_what_they_do_not_hold(
    tmp_path: Path, member: bytes, message: str
) -> None:
    path = archive(tmp_path / "a.npz", ("x.npy", member))
    with open_regular(path) as stream, pytest.raises(ValueError, match=message):
        read_arrays(stream, compressed=False)


def test_archives_that_unpack_to_too_much(tmp_path: Path) -> None:
    bomb = archive(tmp_path / "bomb.npz", ("x.npy", bytes(1 << 20)), compressed=True)
    with open_regular(bomb) as stream, pytest.raises(ValueError, match="compressed"):
        read_arrays(stream, compressed=False)
    # The directory of the archive says how long a member is when it is unpacked: 2 GiB.
    data = bytearray(bomb.read_bytes())
    at = data.index(b"PK\x01\x02") + 24
    data[at : at + 4] = (2 << 30).to_bytes(4, "little")
    bomb.write_bytes(data)
    with open_regular(bomb) as stream, pytest.raises(zipfile.BadZipFile, match="2147483648 bytes"):
        read_arrays(stream, compressed=True)


def test_members_that_lie_over_each_other(tmp_path: Path) -> None:
    """Of n members at one place in the file each is as long as the file: n times its size."""
    data = npy(np.zeros(100))
    path = archive(tmp_path / "a.npz", *((f"x{i}.npy", data) for i in range(3)))
    content = bytearray(path.read_bytes())
    at = content.index(b"PK\x01\x02")
    for _ in range(3):  # all members are at the first one's place, and the rest is cut away
        content[at + 42 : at + 46] = (0).to_bytes(4, "little")
        at = content.find(b"PK\x01\x02", at + 4)
    second = content.index(b"PK\x03\x04", 4)
    directory = content.index(b"PK\x01\x02")
    end = content.index(b"PK\x05\x06")
    content[end + 16 : end + 20] = second.to_bytes(4, "little")
    path.write_bytes(content[:second] + content[directory:])
    with open_regular(path) as stream, pytest.raises(zipfile.BadZipFile):
        read_arrays(stream, compressed=False)
