"""MATLAB's files of version 5: the same as SciPy reads, and no damage ends the process."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_array

from hillsphere_controllers.systems.mat_file import MatFileError, parse_mat

ROOT = Path(__file__).parents[3]


def contents() -> dict[str, Any]:
    cells = np.empty((2, 2), dtype=object)
    cells[:] = [["one", np.eye(2)], ["", np.zeros((0, 3))]]
    names = np.array([["u"], ["voltage"]], dtype=object)
    system = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.ones((2, 1)),
        "InputName": names,
        "Ts": 0.0,
    }
    made = {
        "numbers": np.arange(24.0).reshape(2, 3, 4), "waves": np.array([[1 + 2j, 3 - 1j]]),
        "flags": np.array([[True, False]]), "text": "orbit", "rows": np.array(["ab", "cd"]),
        "unicode": "µ≤1", "cells": cells, "system": system, "deep": {"of": {"it": system}},
        "several": np.array([(1.0, "x"), (2.0, "y")], dtype=[("n", object), ("s", object)]),
        "sparse": csc_array(np.array([[0.0, 1.5, 0.0], [2.5, 0.0, -1.0]])),
        "complex_sparse": csc_array(np.array([[0.0, 1j], [2.0, 0.0]])),
        "nothing": np.zeros((0, 0)), "v" * 31: np.ones((1, 1)),
    }  # fmt: skip
    return made | {
        f"of_{form}": np.array([[1, 2, 3]], dtype=form)
        for form in ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
    }


def file(compressed: bool) -> bytes:
    buffer = BytesIO()
    savemat(buffer, contents(), do_compression=compressed, long_field_names=True)
    return buffer.getvalue()


def assert_same(ours: Any, theirs: Any, where: str) -> None:
    if hasattr(theirs, "toarray"):
        theirs = theirs.toarray()
    assert ours.shape == theirs.shape, where
    if theirs.dtype.names:
        assert ours.dtype.names == theirs.dtype.names
        for name in theirs.dtype.names:
            assert_same(ours[name], theirs[name], f"{where}.{name}")
    elif theirs.dtype == object:
        for i, (a, b) in enumerate(zip(ours.ravel(), theirs.ravel(), strict=True)):
            assert_same(a, b, f"{where}[{i}]")
    else:
        assert ours.dtype.kind == theirs.dtype.kind, where
        np.testing.assert_array_equal(ours, theirs, where)


@pytest.mark.parametrize("compressed", [False, True])
def test_what_is_read_is_what_scipy_reads(compressed: bool) -> None:
    data = file(compressed)
    ours = parse_mat(data)
    theirs = loadmat(BytesIO(data))
    theirs = {k: v for k, v in theirs.items() if not k.startswith("__")}
    assert list(ours) == list(theirs)
    for name in ours:
        if theirs[name].dtype.kind == "U" and not theirs[name].size:
            assert not "".join(ours[name])  # an empty text: SciPy has no row, here there is one
        else:
            assert_same(ours[name], theirs[name], name)


def test_the_other_byte_order_is_read() -> None:
    """As a machine of big-endian numbers wrote it: ``x = 2.5``, whose name fills a small tag."""
    array = (
        struct.pack(">4I", 6, 8, 6, 0) + struct.pack(">2I2i", 5, 8, 1, 1)
        + struct.pack(">2H", 1, 1) + b"x\0\0\0" + struct.pack(">2Id", 9, 8, 2.5)
    )  # fmt: skip
    data = b"MATLAB 5.0".ljust(124) + b"\x01\x00MI" + struct.pack(">2I", 14, len(array)) + array
    np.testing.assert_array_equal(parse_mat(data)["x"], [[2.5]])
    np.testing.assert_array_equal(loadmat(BytesIO(data))["x"], [[2.5]])


@pytest.mark.parametrize(
    ("kind", "message"),
    [(3, "x is an object of MATLAB's"), (16, "holds objects"), (17, "holds objects"),
     (77, "unknown class 77"), (5, "sparse")],
)  # fmt: skip
def test_what_is_not_read_is_named(kind: int, message: str) -> None:
    array = (
        struct.pack("<4I", 6, 8, kind, 0) + struct.pack("<2I2i", 5, 8, 1, 1)
        + struct.pack("<2H", 1, 1) + b"x\0\0\0" + struct.pack("<2Id", 9, 8, 2.5)
    )  # fmt: skip
    data = b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + struct.pack("<2I", 14, len(array)) + array
    with pytest.raises(MatFileError, match=message):
        parse_mat(data)


PROGRAM = """
import random, sys, warnings
from pathlib import Path
from hillsphere.errors import InputError
from hillsphere_controllers.systems.exchange import load_mat
warnings.simplefilter("error")
path = Path(sys.argv[1])
sound, refused = path.read_bytes(), 0
for seed in range(int(sys.argv[2])):
    chance, data = random.Random(seed), bytearray(sound)
    for _ in range(chance.choice([1, 1, 4, 32])):
        data[chance.randrange(116, len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data[: chance.randrange(len(data))] if chance.random() < 0.1 else data)
    try:
        load_mat(path)
    except InputError as error:
        assert path.name in str(error), str(error)
        refused += 1
print("refused", refused)
"""


@pytest.mark.parametrize("compressed", [False, True])
def test_no_damage_ends_the_process(compressed: bool, tmp_path: Path) -> None:
    """Of 600 files with flipped bits SciPy's reader ended the process at some."""
    path = tmp_path / "damaged.mat"
    path.write_bytes(file(compressed))
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(path), "600"], capture_output=True, text=True,
        timeout=300, cwd=ROOT, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout.split()[1]) > 100
