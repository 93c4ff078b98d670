from __future__ import annotations

import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat, savemat

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.exchange import Content, load_mat, save_mat


def system(order: int = 3, dt_s: float | None = None) -> LtiSystem:
    random = np.random.default_rng(order)
    return LtiSystem(
        random.normal(size=(order, order)), random.normal(size=(order, 8)),
        random.normal(size=(8, order)), random.normal(size=(8, 8)), dt_s,
        tuple(f"in{k}" for k in range(8)), (), tuple(f"x{k}" for k in range(order)),
    )  # fmt: skip


def same(first: LtiSystem, second: Content) -> bool:
    assert isinstance(second, LtiSystem)
    for name in "abcd":
        assert_array_equal(getattr(first, name), getattr(second, name))
    names = (first.inputs, first.outputs, first.states, first.dt_s)
    return names == (second.inputs, second.outputs, second.states, second.dt_s)


def test_everything_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "all.mat"
    structure = BlockStructure(
        [repeated_real(2, "mass"), repeated_complex(3, "lag"), full(2, 2, "flex"), full(1, 1)]
    )
    table: dict[str, Any] = {"omega_rad_s": np.array([[0.1, 1.0]]), "response": np.array([[1j, 2]])}
    contents: dict[str, Content] = {
        "plant": system(),
        "static": gain(np.ones((2, 3))),
        "sampled": system(2, 0.1),
        "uncertain": (system(4), structure),
        "k": np.arange(6.0).reshape(2, 3),
        "bounds": table,
    }
    save_mat(path, contents)
    found = load_mat(path)
    assert set(found) == set(contents)
    assert same(system(), found["plant"])
    assert same(gain(np.ones((2, 3))), found["static"])
    assert same(system(2, 0.1), found["sampled"])
    uncertain = found["uncertain"]
    assert isinstance(uncertain, tuple)
    assert same(system(4), uncertain[0])
    assert uncertain[1].blocks == structure.blocks
    assert_array_equal(found["k"], contents["k"])
    assert isinstance(found["bounds"], dict)
    assert_array_equal(found["bounds"]["response"], table["response"])
    assert_array_equal(found["bounds"]["omega_rad_s"], table["omega_rad_s"])


def test_layout_is_that_of_matlab(tmp_path: Path) -> None:
    """Ts of zero for continuous time, rows of mussv's block structure, names in a cell column."""
    path = tmp_path / "one.mat"
    blocks = BlockStructure([repeated_real(2), repeated_complex(1), full(3, 5)])
    save_mat(path, {"p": (system(), blocks)})
    p = loadmat(path, squeeze_me=True, struct_as_record=False)["p"]
    assert p.M.Ts == 0.0
    assert_array_equal(p.blocks, [[-2, 0], [1, 0], [3, 5]])
    assert list(p.M.InputName) == [f"in{k}" for k in range(8)]


def test_what_matlab_writes_differently_is_read(tmp_path: Path) -> None:
    """Integers, [] for no states, empty names, a real scalar as [−1 1]."""
    path = tmp_path / "matlab.mat"
    names = np.array([[""], [""]], dtype=object)
    m = {
        "a": np.zeros((0, 0)), "b": np.zeros((0, 0)), "c": np.zeros((0, 0)),
        "d": np.eye(2, dtype=np.int16), "InputName": names, "OutputName": names,
    }  # fmt: skip
    savemat(path, {"g": {"M": m, "blocks": np.array([[-1, 1], [1, 1]])}})
    found = load_mat(path)["g"]
    assert isinstance(found, tuple)
    assert same(gain(np.eye(2)), found[0])
    assert found[1].blocks == (repeated_real(1), full(1))


def test_struct_of_the_fields_of_ss_is_a_system(tmp_path: Path) -> None:
    """As get(P) has them, no delays, [] for E; and text beside it."""
    path = tmp_path / "get.mat"
    fields = {
        "A": -np.eye(1), "B": np.ones((1, 2)), "C": np.ones((1, 1)), "D": np.zeros((1, 2)),
        "E": np.zeros((0, 0)), "InputDelay": np.zeros((2, 1)), "TimeUnit": "seconds", "Ts": 0.1,
        "InputName": np.array([["u"], ["u"]], dtype=object), "Notes": np.zeros((0, 1)),
        "StateName": np.array([[""]], dtype=object),
    }  # fmt: skip
    savemat(path, {"p": fields, "author": "somebody", "empty": ""})
    found = load_mat(path)
    assert set(found) == {"p"}
    expected = LtiSystem(
        -np.eye(1), np.ones((1, 2)), np.ones((1, 1)), np.zeros((1, 2)), 0.1, ("u[1]", "u[2]")
    )
    assert same(expected, found["p"])


def test_descriptor_matrix_is_applied(tmp_path: Path) -> None:
    """E x' = A x + B u; rows and columns in whatever units."""
    path = tmp_path / "e.mat"
    plant, units = system(), np.diag([1e9, 1.0, 1e-9])
    e = units @ np.array([[2.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    written = {"a": e @ plant.a, "b": e @ plant.b, "c": plant.c, "d": plant.d, "e": e}
    savemat(path, {"p": written})
    found = load_mat(path)["p"]
    assert isinstance(found, LtiSystem)
    assert_allclose(found.a, plant.a, rtol=1e-12, atol=1e-14)
    assert_allclose(found.b, plant.b, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("u", "v", "u"), ("u[1]", "v", "u[2]")),
        (("u", "", ""), ("u", "input[1]", "input[2]")),
        (("", "", ""), ()),
    ],
)
def test_names_that_stand_twice(
    tmp_path: Path, names: tuple[str, ...], expected: tuple[str, ...]
) -> None:
    """MATLAB allows them, and empty ones."""
    path = tmp_path / "names.mat"
    static = {"a": [], "b": [], "c": [], "d": np.ones((1, 3))}
    savemat(path, {"p": {**static, "InputName": np.array(names, dtype=object)}})
    found = load_mat(path)["p"]
    assert isinstance(found, LtiSystem)
    assert found.inputs == expected


def test_what_is_not_plain_is_refused(tmp_path: Path) -> None:
    good = {name: np.eye(1) for name in "abcd"}
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"x": {"note": "text"}}, "neither a matrix"),
        ({"x": {**good, "e": np.zeros((1, 1))}}, r"x\.e, the descriptor matrix, is singular"),
        ({"x": {**good, "e": np.eye(2)}}, r"x\.e must be real and of the shape"),
        ({"x": {**good, "InputDelay": 3.0}}, r"x\.InputDelay: delays are not read"),
        ({"x": {**good, "OutputDelay": np.ones((1, 1))}}, r"x\.OutputDelay"),
        ({"x": {**good, "ioDelay": 1.0}}, r"x\.ioDelay"),
        ({"x": {**good, "TimeUnit": "hours"}}, r"x\.TimeUnit must be seconds"),
        ({"x": {**good, "A": np.eye(1)}}, "differ in case only"),
        ({"x": np.array([["a"], [np.eye(2)]], dtype=object)}, "neither a matrix"),
        ({"x": {"deep": {"deeper": np.eye(2)}}}, "x.deep is neither"),
        ({"x": {**good, "d": 1j * np.eye(1)}}, "must be real"),
        ({"x": {**good, "Ts": -1.0}}, r"without a period; set it in MATLAB .* P\.Ts = "),
        ({"x": {**good, "Ts": -2.0}}, "Ts must be a period"),
        ({"x": {**good, "b": np.eye(2)}}, "to fit the others"),
        ({"x": {**good, "InputName": np.eye(2)}}, "cell array of names"),
        ({"x": {"M": good, "blocks": np.array([[0, 2]])}}, "no block of mussv"),
        ({"x": {"M": good, "blocks": np.array([1, 2, 3])}}, "two columns"),
        ({"x": {"M": np.eye(2), "blocks": np.array([[1, 1]])}}, "must be a struct of a, b"),
    ]
    for k, (contents, message) in enumerate(wrong):
        path = tmp_path / f"{k}.mat"
        savemat(path, contents)
        with pytest.raises(InputError, match=message):
            load_mat(path)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_mat(tmp_path / "none.mat")
    path = tmp_path / "text.mat"
    path.write_text("this is no matrix, however long the text may become " * 10)
    with pytest.raises(InputError, match=r"is no \.mat file"):
        load_mat(path)
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124, b" ") + b"\x00\x02IM" + b"\x00" * 64)
    with pytest.raises(InputError, match=r"version 7\.3"):
        load_mat(path)


def test_what_matlab_could_not_read_back_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "no.mat"
    for contents, message in (
        ({"1st": np.eye(2)}, "no name for a variable"),
        ({"_x": np.eye(2)}, "no name for a variable"),
        ({"x": {"a": np.eye(1), "b": np.eye(1), "c": np.eye(1), "d": np.eye(1)}}, "as a system"),
        ({"x": {"A": np.eye(1), "B": np.eye(1), "C": np.eye(1), "D": np.eye(1)}}, "as a system"),
        ({"x": (gain(np.eye(1)), BlockStructure([full(2)]))}, "do not fit"),
    ):
        with pytest.raises(InputError, match=message):
            save_mat(path, contents)  # type: ignore[arg-type]
        assert not path.exists()


def test_blocks_larger_than_their_system_are_refused(tmp_path: Path) -> None:
    one = {"a": -1.0, "b": 1.0, "c": 1.0, "d": 0.0}
    savemat(tmp_path / "large.mat", {"L": {"M": one, "blocks": [[5, 5]]}})
    with pytest.raises(InputError, match=r"L\.blocks close 5 outputs and 5 inputs, but"):
        load_mat(tmp_path / "large.mat")
    with pytest.raises(InputError, match="there is no such file"):
        load_mat(tmp_path / "none.mat")
    with pytest.raises(InputError, match="cannot be written"):
        save_mat(tmp_path / "none" / "one.mat", {"one": np.eye(2)})


def test_a_file_that_unpacks_to_gigabytes_is_refused(tmp_path: Path) -> None:
    """A few MB that unpack to 1.1 GB: hundreds of zeros are one byte of zlib's."""
    packing = zlib.compressobj(1)
    body = b"".join(packing.compress(bytes(1 << 24)) for _ in range(66)) + packing.flush()
    tag = (15).to_bytes(4, "little") + len(body).to_bytes(4, "little")
    path = tmp_path / "bomb.mat"
    path.write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + tag + body)
    with pytest.raises(InputError, match="unpacks to more than 1073741824 bytes"):
        load_mat(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_no_fifo_is_waited_for_or_replaced(tmp_path: Path) -> None:
    path = tmp_path / "pipe.mat"
    os.mkfifo(path)
    with pytest.raises(InputError, match="it is a FIFO"):
        load_mat(path)
    with pytest.raises(InputError, match="it is a FIFO"):
        save_mat(path, {"a": np.eye(2)})
    assert path.is_fifo()
