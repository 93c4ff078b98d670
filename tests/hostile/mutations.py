"""Hostile contents and hostile files, drawn at random."""

from __future__ import annotations

import copy
import io
import json
import os
import pickle
import random
import socket
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tests.hostile.sentinel import CANARY

__all__ = ["Payloads", "damage", "mutate_json", "mutate_npz", "mutate_text", "replace_file"]


class Payloads:
    """What a stranger would like to be read, connected to, or run.

    Parameters
    ----------
    outside : Path
        Directory with ``secret.txt``, ``secret.toml``, ``passwd`` and ``pipe``, a FIFO. No case may
        name a real file of the system: these run as root in many a container, and a link that the
        user names is followed.
    port : int
        Where a listener would notice a connection.
    """

    def __init__(self, outside: Path, port: int) -> None:
        self.outside, self.port = outside, port

    def values(self) -> list[Any]:
        """Return values for any place in JSON or TOML."""
        out = self.outside
        return [
            None, True, -1, 0, 10**400, 1e308, -1e-320, "", "../../../../outside/passwd",
            str(out / "passwd"), str(out / "secret.txt"), str(out / "secret.toml"),
            str(out / "pipe"), "/dev/zero", f"tcp://127.0.0.1:{self.port}",
            f"{CANARY}:Canary", "os:system", "\x1b]0;owned\x07",
            "$(touch canary)", "a\0b", "\ud800", "x" * 70_000, [], {}, ["dask"], {"type": "dask"},
            [[[[]]]], {"../x": {}}, "<script>alert(1)</script>", "--help", "-", "serial", 1 << 64,
        ]  # fmt: skip

    def executors(self) -> list[dict[str, Any]]:
        """Return tables of executors that are not of this machine."""
        at = f"tcp://127.0.0.1:{self.port}"
        return [
            {"type": "dask", "scheduler": at}, {"type": "dask"}, {"type": "dask", "workers": 2},
            {"type": "pool", "workers": 10**6}, {"type": "pool", "scheduler": at},
            {"type": "serial", "scheduler": at}, {"type": CANARY}, {"type": f"{CANARY}:Canary"},
            {"type": "pool", "workers": 2.5}, {"type": "pool", "workers": True},
        ]  # fmt: skip


def nodes(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the place of everything in a JSON value."""
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(
        value, list) else ()  # fmt: skip
    for key, item in items:
        yield from nodes(item, (*path, key))


def mutate_json(chance: random.Random, data: bytes, payloads: Payloads) -> bytes:
    """Put hostile values into a JSON document, or spoil its text."""
    if chance.random() < 0.25:
        return mutate_text(chance, data)
    try:
        value = json.loads(data)
        places = list(nodes(value))
    except (ValueError, RecursionError):  # damaged before
        return mutate_text(chance, data)
    for _ in range(chance.choice([1, 1, 1, 2, 5])):
        path = chance.choice(places)
        new = chance.choice(payloads.values())
        if not path:
            value = new
            continue
        table = value
        try:
            for key in path[:-1]:
                table = table[key]
            if isinstance(table, dict) and chance.random() < 0.3:
                table[str(chance.choice(["../../escaped", "a\0", "", "..", "con/x"]))] = table.pop(
                    path[-1]
                )
            else:
                table[path[-1]] = copy.deepcopy(new)
        except (KeyError, IndexError, TypeError, AttributeError):
            continue
    return json.dumps(value).encode("utf-8", "surrogatepass")


def mutate_text(chance: random.Random, data: bytes) -> bytes:
    """Spoil a text or any other file."""
    at = chance.randrange(len(data)) if data else 0
    deep = chance.choice([100, 10_000, 200_000])
    changes: list[Callable[[], bytes]] = [
        lambda: data[:at],
        lambda: b"",
        lambda: data[:at] + bytes([chance.randrange(256)]) + data[at + 1 :],
        lambda: data[:at] + chance.randbytes(40) + data[at:],
        lambda: b"[" * deep,
        lambda: b'{"a":' * deep + b"1" + b"}" * deep,
        lambda: data.replace(b"1", b"NaN", 3),
        lambda: data.replace(b"0", b"1e999", 3),
        lambda: data.replace(b"0", b"9" * 5000, 1),
        lambda: b"\xff\xfe" + data.decode("utf-8", "replace").encode("utf-16-le"),
        lambda: data + data,
        lambda: bytes(chance.randrange(1, 3000)),
    ]
    return chance.choice(changes)()


class _Bomb:
    """Unpickled, it makes a file of the name of the canary and imports its module."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch {CANARY}-ran",)


def pickled() -> bytes:
    """Return a pickle that runs a command."""
    return pickle.dumps(_Bomb())


def _npy(array: Any, **claims: str) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array, allow_pickle=True)
    data = stream.getvalue()
    for old, new in claims.items():
        data = data.replace(old.encode(), new.encode(), 1)
    return data


def mutate_npz(chance: random.Random, data: bytes, payloads: Payloads) -> bytes:
    """Spoil an archive of arrays, or what is in it."""
    if chance.random() < 0.3:
        return mutate_text(chance, data)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except zipfile.BadZipFile:  # damaged before
        return mutate_text(chance, data)
    names = list(members)
    name = chance.choice(names)
    objects = np.empty(1, dtype=object)
    objects[0] = _Bomb()

    def header(change: Callable[[Any], Any]) -> None:
        content = np.lib.format.read_array(io.BytesIO(members["__product__.npy"]))
        text = json.dumps(change(json.loads(content.tobytes())))
        members["__product__.npy"] = _npy(np.frombuffer(text.encode(), dtype=np.uint8))

    def other_class(table: Any) -> Any:
        table["root"]["product"] = chance.choice(
            [f"{CANARY}:Canary", "os:system", "builtins:eval", "a" * 5000,
             "hillsphere.runs.earlier_run:EarlierRun", "hillsphere.model.spice:SpiceOrbit",
             "hillsphere.products:CaseTable",
             f"hillsphere.{CANARY}:X", "waves_plugin:Wave", "antigravity:X", "..:x"]
        )  # fmt: skip
        return table

    def other_value(table: Any) -> Any:
        return json.loads(mutate_json(random.Random(chance.random()), json.dumps(table).encode(),
                                      payloads).decode("utf-8", "replace"))  # fmt: skip

    method, changed = zipfile.ZIP_STORED, chance.randrange(9)
    if changed == 0:
        members[name] = _npy(objects)
    elif changed == 1:
        members[name] = pickled()
    elif changed == 2:
        members[name] = _npy(np.zeros(3), **{"(3,)": "(9999999999999,)"})
    elif changed == 3:
        method = zipfile.ZIP_DEFLATED
        members[name] = bytes(50_000_000)
    elif changed == 4:
        members[f"../../{CANARY}.npy"] = members.pop(name)
    elif changed == 5 and "__product__.npy" in members:
        header(other_class)
    elif changed == 6 and "__product__.npy" in members:
        with_value = members["__product__.npy"]
        try:
            header(other_value)
        except (ValueError, RecursionError):  # the value may be arrays in arrays without end
            members["__product__.npy"] = with_value[:-5]
    elif changed == 7:
        members[name] = _npy(np.full((2, 3), np.nan))
    else:
        members[name] = _npy(np.array(["text", "a\0b"]))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for key, content in members.items():
            archive.writestr(key, content)
    return stream.getvalue()


def compressed_mat(chance: random.Random) -> bytes:
    """Return a MATLAB file of 5 MB that unpacks to 5 GB, or one of noise."""
    head = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM"
    if chance.random() < 0.5:
        return head + chance.randbytes(3000)
    packing = zlib.compressobj(9)
    body = b"".join(packing.compress(bytes(1 << 24)) for _ in range(100)) + packing.flush()
    return head + (15).to_bytes(4, "little") + len(body).to_bytes(4, "little") + body


def replace_file(chance: random.Random, path: Path, outside: Path, *, links: bool = True) -> str:
    """Put something in the place of a file that is none, or not only one; say what.

    Links to files of others are left out for a path that the user has given: they are followed.
    Whether a mission may name a path is judged before, and a run directory may have no links.
    """
    if path.is_dir() and not path.is_symlink():
        path.rename(path.with_name(path.name + "-away"))
    else:
        path.unlink(missing_ok=True)
    kinds = ["link", "link to a FIFO", "link to a device", "FIFO", "directory", "socket", "sparse",
             "dangling", "circle", "link outside"]  # fmt: skip
    kinds += ["device"] * (os.geteuid() == 0)
    if not links:
        kinds = [kind for kind in kinds if kind not in ("link", "link outside")]
    kind = chance.choice(kinds)
    match kind:
        case "link":
            path.symlink_to(outside / "passwd")
        case "link outside":
            path.symlink_to(outside if chance.random() < 0.5 else outside / "secret.txt")
        case "link to a FIFO":
            path.symlink_to(outside / "pipe")
        case "link to a device":
            path.symlink_to("/dev/zero")
        case "FIFO":
            os.mkfifo(path)
        case "directory":
            path.mkdir()
        case "socket":
            here = os.getcwd()
            os.chdir(path.parent)  # the name of a socket is at most 107 bytes long
            with socket.socket(socket.AF_UNIX) as listener:
                listener.bind(path.name)
            os.chdir(here)
        case "sparse":
            with path.open("wb") as stream:
                stream.truncate(1 << 40)
        case "dangling":
            path.symlink_to("nowhere")
        case "circle":
            path.symlink_to(path.name)
        case "device":
            os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, 5))  # /dev/zero
    return kind


def damage(chance: random.Random, path: Path, payloads: Payloads, *, links: bool = True) -> str:
    """Spoil a file in whatever way suits it; say how. Of `links` see `replace_file`."""
    if chance.random() < 0.2:
        return replace_file(chance, path, payloads.outside, links=links)
    if path.stat().st_size > 1 << 28:  # it has been damaged before
        return "nothing more"
    data = path.read_bytes()
    if path.suffix == ".json":
        path.write_bytes(mutate_json(chance, data, payloads))
    elif path.suffix == ".npz":
        path.write_bytes(mutate_npz(chance, data, payloads))
    elif path.suffix == ".mat":
        path.write_bytes(compressed_mat(chance))
    else:
        path.write_bytes(mutate_text(chance, data))
    return "content"
