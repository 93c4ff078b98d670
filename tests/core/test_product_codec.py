"""What a product file may hold and whose classes it may name."""

from __future__ import annotations

import json
import struct
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.products.product_codec import _trusted_packages, load_product, save_product


@dataclass(frozen=True)
class Pair:
    """A product."""

    a: Any
    b: float


class Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> Any:
        return Path.mkdir, (self.folder,)


def test_a_pickle_in_a_sound_file_is_not_loaded(tmp_path: Path) -> None:
    """The header is that of a product, one of its arrays a pickle that would act."""
    path, folder = tmp_path / "pair.npz", tmp_path / "made"
    save_product(path, Pair(np.arange(3.0), 1.5))
    with np.load(path) as sound:
        header = sound["__product__"]
    trap = np.array([Trap(folder)], dtype=object)
    np.savez(path, __product__=header, a=trap, allow_pickle=True)
    with pytest.raises(InputError, match=r"pair\.npz: not a product file, or a damaged one"):
        load_product(path)
    assert not folder.exists()
    # the trap is one: read with pickles it acts
    with np.load(path, allow_pickle=True) as poor:
        poor["a"]
    assert folder.exists()


def test_a_pickle_as_header_is_not_loaded(tmp_path: Path) -> None:
    path, folder = tmp_path / "pair.npz", tmp_path / "made"
    np.savez(path, __product__=np.array([Trap(folder)], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="not a product file"):
        load_product(path)
    assert not folder.exists()


def test_classes_of_plugins_are_trusted_and_no_others() -> None:
    """Of a target "hillsphere_gravity.ellipsoid:Ellipsoid" the package is hillsphere_gravity."""
    trusted = _trusted_packages()
    assert {"hillsphere", "hillsphere_gravity", "hillsphere_orbits"} <= trusted
    assert {name for name in trusted if not name.startswith("hillsphere")} == set()
    assert not any("." in name or ":" in name for name in trusted)


def test_a_module_of_a_plugin_is_imported_and_another_is_not(tmp_path: Path) -> None:
    """Neither is loaded yet; of the first the class is looked for, the second stays unimported."""
    for module, message in (
        ("hillsphere_gravity.no_such_module", "cannot be imported: No module named"),
        ("antigravity", "belongs to no installed plugin; install the package"),
    ):
        path = tmp_path / "one.npz"
        root = {"product": f"{module}:One", "fields": {}}
        text = json.dumps({"format": 1, "root": root}).encode()
        np.savez(path, __product__=np.frombuffer(text, dtype=np.uint8))
        with pytest.raises(InputError, match=message):
            load_product(path)


def test_members_may_be_longer_than_two_gigabytes(tmp_path: Path) -> None:
    """Each local header bears the extra field 1 of 16 bytes, which holds sizes of 64 bits."""
    path = tmp_path / "pair.npz"
    save_product(path, Pair(np.arange(3.0), 1.5))
    raw = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    assert [member.filename for member in members] == ["__product__.npy", "a.npy"]
    for member in members:
        at = member.header_offset
        name, extra = struct.unpack("<HH", raw[at + 26 : at + 30])
        assert (name, extra) == (len(member.filename), 20)
        assert struct.unpack("<HH", raw[at + 30 + name : at + 34 + name]) == (1, 16)


def test_values_and_types_return(tmp_path: Path) -> None:
    path = tmp_path / "pair.npz"
    for a in (np.arange(6).reshape(2, 3).T, np.array(2.5), np.empty((0, 3)), np.float32(0.1)):
        save_product(path, Pair(a, float("-inf")))
        found = load_product(path)
        assert type(found) is Pair
        assert type(found.a) is type(a)
        assert (found.a.dtype, found.a.shape) == (a.dtype, a.shape)
        np.testing.assert_array_equal(found.a, a)
        assert found.b == float("-inf")
