"""The product codec: lossless both ways, and nothing but a product is ever read as one."""

from __future__ import annotations

import errno
import json
import math
import os
import subprocess
import sys
import zipfile
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hillsphere.errors import InputError, StageError
from hillsphere.products import Bifurcations, PeriodicOrbits, load_product, save_product
from hillsphere.runs.stage_cache import StageCache


@dataclass(frozen=True)
class Box:
    """Anything a product may hold."""

    content: Any
    file: Any = None


@dataclass(frozen=True)
class Grown:
    """A product class that gets another field after a file was written."""

    old: int


@dataclass
class Thawed:
    content: int


def orbits(n: int = 3) -> PeriodicOrbits:
    rng = np.random.default_rng(7)
    return PeriodicOrbits(
        frame="hill:phobos",
        states=("x", "y", "z", "vx", "vy", "vz"),
        x0=rng.normal(size=(6, n)),
        period_s=rng.normal(size=n),
        integral=np.full(n, np.nan),
        monodromy=np.asfortranarray(rng.normal(size=(6, 6, n))),
        residual=np.zeros(n),
        labels=tuple(f"Ω {i}" for i in range(n)),
        length_m=23864.25,
        time_s=4387.63,
    )


def same(a: Any, b: Any) -> bool:
    """Equal bit by bit: class, dtype, shape, nan and sign of zero included."""
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray | np.generic):
        return bool(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())
    if isinstance(a, float):
        return bool(a.hex() == b.hex())
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if hasattr(a, "__dataclass_fields__"):
        return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return bool(a == b)


def round_trip(tmp_path: Path, product: Any) -> Any:
    save_product(tmp_path / "p.npz", product)
    return load_product(tmp_path / "p.npz")


def test_nested_products_return_bit_by_bit(tmp_path: Path) -> None:
    product = Bifurcations(
        orbits(), ("planar",) * 3, (1, 1, 2), (3, 4, 2**80), np.array([0.0, -0.0, np.nan])
    )
    assert same(round_trip(tmp_path, product), product)


@pytest.mark.parametrize(
    "content",
    [
        None, True, 0, -(2**100), 0.1, -0.0, math.nan, math.inf, -math.inf, 1e-320, 1 - 2e-309j,
        "", "Φ\n\x00", "\ud800", (), ((1, (2.5, None)), "a"), np.float32(0.1), np.bool_(True),
        np.array(3.5), np.zeros((0, 4), dtype=np.int16), np.arange(6, dtype=">f8"),
        np.arange(12.0).reshape(3, 4)[:, ::2], np.array(["a", "ß"]), np.array([1j]),
        np.array([(1, 2.0)], dtype=[("a", "i4"), ("b", "f8")]), np.datetime64("2026-11-21"),
        Box(Box((np.ones(2), Box(1)))),
    ],
)  # fmt: skip
def test_every_kind_of_value_returns(tmp_path: Path, content: Any) -> None:
    assert same(round_trip(tmp_path, Box(content, file=content)), Box(content, file=content))


@settings(max_examples=100, deadline=None)
@given(
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.text()
        | hnp.arrays(
            hnp.integer_dtypes() | hnp.floating_dtypes() | hnp.complex_number_dtypes(),
            hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
        ),
        lambda inner: st.lists(inner, max_size=3).map(tuple) | inner.map(Box),
        max_leaves=6,
    )
)
def test_any_tree_of_values_returns(tmp_path_factory: pytest.TempPathFactory, content: Any) -> None:
    assert same(round_trip(tmp_path_factory.mktemp("p"), Box(content)), Box(content))


def test_file_is_a_plain_npz_and_the_same_every_time(tmp_path: Path) -> None:
    product = Bifurcations(orbits(), ("planar",) * 3, (1, 1, 2), (3, 4, 5), np.ones(3))
    save_product(tmp_path / "a.npz", product)
    save_product(tmp_path / "b.npz", product)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz", allow_pickle=False) as plain:
        np.testing.assert_array_equal(plain["orbits.x0"], product.orbits.x0)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ([1], "list"),
        ({"a": 1}, "dict"),
        (np.array([None]), "Python objects"),
        (np.ma.masked_array([1.0]), "MaskedArray"),
        (Thawed(1), "Thawed"),
        ((1, {2}), "set"),
    ],
)
def test_what_cannot_be_stored_is_named(tmp_path: Path, content: Any, word: str) -> None:
    with pytest.raises(InputError, match=rf"content.*{word}"):
        save_product(tmp_path / "p.npz", Box(content))
    assert list(tmp_path.iterdir()) == []


def test_product_must_be_a_frozen_dataclass_of_a_module(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Local:
        a: int

    for product, word in [(Thawed(1), "frozen"), (Box, "frozen"), (Local(1), "top level")]:
        with pytest.raises(InputError, match=word):
            save_product(tmp_path / "p.npz", product)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.npz: cannot be read: No such file"):
        load_product(tmp_path / "none.npz")
    with pytest.raises(InputError, match="cannot be read"):
        load_product(tmp_path)


@pytest.mark.parametrize("error", [OSError(errno.EIO, "Input/output error"), MemoryError()])
def test_what_cannot_be_read_just_now_is_not_damaged(
    tmp_path: Path, error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = StageCache(tmp_path)
    cache.save("p", Box(np.arange(3.0)))

    def failing(self: zipfile.ZipFile, name: Any, pwd: Any = None) -> bytes:
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(zipfile.ZipFile, "read", failing)
        with pytest.raises(
            StageError, match=r"p\.npz: (cannot be read: Input|there is too little)"
        ):
            load_product(tmp_path / "p.npz")
        with pytest.raises(StageError, match=r"p\.npz"):
            cache.load("p", Box)
    assert same(cache.load("p", Box), Box(np.arange(3.0)))


def test_torn_files_are_refused_at_every_length(tmp_path: Path) -> None:
    save_product(tmp_path / "p.npz", Box(np.arange(3.0)))
    whole = (tmp_path / "p.npz").read_bytes()
    torn = tmp_path / "torn.npz"
    for length in range(len(whole)):
        torn.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"torn\.npz"):
            load_product(torn)


def test_a_changed_byte_is_found_or_harmless(tmp_path: Path) -> None:
    product = Box(np.arange(4.0), "text")
    save_product(tmp_path / "p.npz", product)
    whole = (tmp_path / "p.npz").read_bytes()
    changed = tmp_path / "changed.npz"
    refused = 0
    for place in range(len(whole)):
        changed.write_bytes(whole[:place] + bytes([whole[place] ^ 0x21]) + whole[place + 1 :])
        try:
            loaded = load_product(changed)
        except InputError:
            refused += 1
        else:
            assert same(loaded, product), f"byte {place} changed the content unnoticed"
    assert refused > 0.7 * len(whole)


def header(root: Any, format_: int = 1) -> dict[str, Any]:
    text = json.dumps({"format": format_, "root": root}).encode()
    return {"__product__": np.frombuffer(text, dtype=np.uint8)}


FOREIGN = [
    ({}, "no entry"),
    ({"a": np.ones(3)}, "no entry"),
    ({"__product__": np.frombuffer(b"{", dtype=np.uint8)}, "damaged"),
    ({"__product__": np.frombuffer(b"[" * 100_000, dtype=np.uint8)}, "damaged"),
    (header(1, format_=9), "reads format 1"),
    (header({"product": "os.path:join", "fields": {}}), "not a frozen dataclass"),
    (header({"product": "os:", "fields": {}}), "not a product class"),
    (header({"product": f"{__name__}:Box.nothing", "fields": {}}), "not a frozen dataclass"),
    (header({"product": f"{__name__}:Thawed", "fields": {"content": 1}}), "not a frozen"),
    # Found in this module, but it belongs to another.
    (header({"product": f"{__name__}:PeriodicOrbits", "fields": {}}), "of the module named"),
    (header({"product": "antigravity:Box", "fields": {}}), "no installed plugin"),
    (header({"product": "hillsphere.nothing:Box", "fields": {}}), "cannot be imported"),
    (header({"product": f"{__name__}:Box", "fields": {"content": 1}}), "other fields"),
    (header({"product": f"{__name__}:Box", "fields": {"content": {"array": "a"}, "file": 1}}),
     "damaged"),
    (header({"product": f"{__name__}:Box", "fields": {"content": {"pickle": "a"}, "file": 1}}),
     "damaged"),
]  # fmt: skip


@pytest.mark.parametrize(("entries", "word"), FOREIGN)
def test_foreign_files_are_refused(tmp_path: Path, entries: dict[str, Any], word: str) -> None:
    np.savez(tmp_path / "p.npz", **entries)
    with pytest.raises(InputError, match=word):
        load_product(tmp_path / "p.npz")


def test_pickles_and_compressed_archives_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", allow_pickle=True, a=np.array([{}], dtype=object))
    with pytest.raises(InputError, match=r"p\.npz: not a product file"):
        load_product(tmp_path / "p.npz")
    with zipfile.ZipFile(tmp_path / "z.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("__product__.npy", b"0" * 1000)
    with pytest.raises(InputError, match="compressed"):
        load_product(tmp_path / "z.npz")


def test_a_file_does_not_choose_what_is_imported(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", **header({"product": "this:Zen", "fields": {}}))
    code = (
        "import sys\nfrom hillsphere.products import load_product\n"
        f"try: load_product({str(tmp_path / 'p.npz')!r})\n"
        "except ValueError: print('refused', 'this' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "refused False\n"


def test_class_that_changed_since(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_product(tmp_path / "p.npz", Grown(1))

    @dataclass(frozen=True)
    class Newer:
        old: int
        new: int = 0

    Newer.__qualname__ = "Grown"
    monkeypatch.setattr(sys.modules[__name__], "Grown", Newer)
    with pytest.raises(InputError, match="other fields now"):
        load_product(tmp_path / "p.npz")


def test_full_disk_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_product(tmp_path / "p.npz", Box(1))

    def full(*_: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    for call in ("fsync", "replace"):
        with monkeypatch.context() as patch:
            patch.setattr(os, call, full)
            with pytest.raises(OSError, match="No space left"):
                save_product(tmp_path / "p.npz", Box(2))
        assert [file.name for file in tmp_path.iterdir()] == ["p.npz"]
        assert load_product(tmp_path / "p.npz") == Box(1)


def test_orbits_are_chosen_by_place_label_and_part() -> None:
    whole = orbits(4)
    assert len(whole) == 4
    assert [one.labels for one in whole] == [("Ω 0",), ("Ω 1",), ("Ω 2",), ("Ω 3",)]
    assert np.array_equal(whole[-1].x0, whole.x0[:, 3:])
    assert np.array_equal(whole["Ω 2"].monodromy, whole.monodromy[:, :, 2:3])
    part = whole[1:3]
    assert part.labels == ("Ω 1", "Ω 2")
    assert np.array_equal(part.period_s, whole.period_s[1:3])
    assert repr(whole[:0]) == "<PeriodicOrbits: none, frame 'hill:phobos'>"
    assert "orbit 'Ω 1', period" in repr(whole[1])
    with pytest.raises(InputError, match="no orbit 'Ω 7'"):
        whole["Ω 7"]
    with pytest.raises(IndexError):
        whole[4]


def test_orbits_are_chosen_by_lists_and_masks() -> None:
    whole = orbits(4)
    for key in ([2, 0], np.array([2, -4]), ["Ω 2", "Ω 0"], np.array(["Ω 2", "Ω 0"])):
        assert whole[key].labels == ("Ω 2", "Ω 0")
    for mask in ([True, False, True, False], np.array([True, False, True, False])):
        assert whole[mask].labels == ("Ω 0", "Ω 2")
    assert whole[[]].labels == ()
    assert whole[np.int64(3)].labels == whole[np.str_("Ω 3")].labels == ("Ω 3",)
    bad: Any
    for bad in (True, np.True_, None, [None], [[0, 1], [2, 3]], 1.0, [0.5], (1, "Ω 0", 2.0), ...):
        with pytest.raises(InputError, match=r"orbits are chosen by|no orbit '1'"):
            whole[bad]
    with pytest.raises(InputError, match="no orbit 'b'"):
        whole[["Ω 0", "b"]]
    with pytest.raises(IndexError):
        whole[[True, False]]


def test_a_label_that_occurs_twice_chooses_no_orbit() -> None:
    doubled = replace(orbits(3), labels=("a", "b", "a"))
    assert doubled["b"].labels == ("b",)
    with pytest.raises(InputError, match="2 orbits have the label 'a'; choose one by its place"):
        doubled["a"]


def test_labels_are_looked_for_in_orbits() -> None:
    whole = orbits(2)
    assert "Ω 1" in whole
    assert "Ω 2" not in whole
    with pytest.raises(InputError, match="by label, a string, got an object of class Periodic"):
        assert whole[0] in whole
