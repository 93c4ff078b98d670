"""Columns in files: read back to the last bit, a part at a time, and never wrong in silence."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from numpy.typing import NDArray

from hillsphere.base.cached_files import drop_oldest
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array
from hillsphere.products import load_product, save_product
from hillsphere.products.columns import ColumnFile, ColumnFiles, Columns, write_columns
from hillsphere.products.fields import Shape
from hillsphere.products.product_codec import canonical

COUNTS = (5, 64, 1, 30)
ROWS = 3


@dataclass(frozen=True)
class Product:
    """A product with columns in files."""

    names: Annotated[tuple[str, ...], Shape("rows")]
    values: Annotated[Array | Columns, Shape("rows", "cases")]


def written(directory: Path) -> tuple[ColumnFiles, Array]:
    """Write four files, the third without rows; return them and what a reader must find."""
    directory.mkdir()
    values = np.random.default_rng(3).normal(size=(ROWS, sum(COUNTS)))
    values[1, 7] = np.nan
    sizes, checks, first = [], [], 0
    for number, count in enumerate(COUNTS):
        part = values[:, first : first + count]
        if number == 2:
            part[:] = np.nan
        rows = part[:0] if number == 2 else part
        path = directory / ColumnFiles.name(number)
        columns: dict[str, NDArray[Any]] = {
            "values": rows, "case": np.arange(first, first + count),
            "status": np.full(count, number, dtype=np.uint16), "failed": np.zeros(count, bool),
        }  # fmt: skip
        write_columns(path, columns, {"words": ["größe"], "number": number})
        with ColumnFile(path) as file:
            checks.append(file.check)
        sizes.append(path.stat().st_size)
        first += count
    counts, of_files, crcs = (np.array(a, dtype=np.int64) for a in (COUNTS, sizes, checks))
    files = ColumnFiles(directory, counts, of_files, crcs)
    return files, values


def test_every_way_to_read_gives_the_bits_that_were_written(tmp_path: Path) -> None:
    files, values = written(tmp_path / "a")
    columns = Columns(files, "values", range(ROWS))
    assert (columns.shape, len(columns), columns.ndim, columns.dtype.char) == ((3, 100), 3, 2, "d")
    assert_array_equal(np.asarray(columns), values)
    assert_array_equal(list(columns), values)
    mask = np.arange(100) % 7 == 0
    some = np.array([99, 0, 69, 70, 70])
    keys: list[Any] = [
        1, -1, np.int64(2), (0, slice(None)), (1, slice(3, 71)), (2, 69), (2, -1), (1, mask),
        (0, some), (slice(None), slice(60, 75)), (slice(None), 4), (slice(1, None), mask),
        ([0, 2], slice(5)), (slice(None), slice(0, 100, 9)), ([0, 2, 2], [1, 99, 5]),
        (slice(None), slice(200, 300)),
    ]  # fmt: skip
    for key in keys:
        assert_array_equal(columns[key], values[key], err_msg=str(key))
        assert columns[key].shape == values[key].shape
    chosen = columns[[2, 0]]
    assert isinstance(chosen, Columns)
    assert_array_equal(np.asarray(chosen[1:]), values[[0]])
    with pytest.raises(IndexError):
        columns[3]
    with pytest.raises(IndexError):
        columns[0, 100]
    assert_array_equal(files.read("case"), np.arange(100))
    assert files.read("status").dtype == np.uint16


def test_numpy_alone_reads_a_file(tmp_path: Path) -> None:
    _, values = written(tmp_path / "a")
    record = np.load(tmp_path / "a" / "cases-0000001.npy", mmap_mode="r", allow_pickle=False)
    assert_array_equal(record["values"][0], values[:, 5:69])
    assert_array_equal(record["case"][0], np.arange(5, 69))


def test_a_part_reads_no_more_files_than_it_needs(tmp_path: Path) -> None:
    files, values = written(tmp_path / "a")
    for number in (0, 3):
        (tmp_path / "a" / ColumnFiles.name(number)).unlink()
    columns = Columns(files, "values", range(ROWS))
    assert_array_equal(columns[:, 5:69], values[:, 5:69])
    with pytest.raises(InputError, match=r"cases-0000000\.npy: is not there"):
        columns[0]


@pytest.mark.parametrize("field", ["values", "facts", "checks", "head"])
def test_a_flipped_bit_is_found(tmp_path: Path, field: str) -> None:
    files, _ = written(tmp_path / "a")
    path = tmp_path / "a" / ColumnFiles.name(1)
    data = bytearray(path.read_bytes())
    record = np.load(path, mmap_mode="r")
    begin = len(data) - record.dtype.itemsize
    data[20 if field == "head" else begin + record.dtype.fields[field][1]] ^= 1
    path.write_bytes(data)
    files.verify()
    with pytest.raises(InputError, match=r"cases-0000001\.npy"):
        Columns(files, "values", range(ROWS))[0]


def test_other_files_are_refused(tmp_path: Path) -> None:
    files, _ = written(tmp_path / "a")
    first, second = (tmp_path / "a" / ColumnFiles.name(number) for number in (0, 1))
    whole = second.read_bytes()
    for wrong in (
        b"",
        whole[:-1],
        whole + b"0",
        first.read_bytes(),
        b"\x93NUMPY\x01\x00" + b"\xff" * 9,
    ):
        second.write_bytes(wrong)
        with pytest.raises(InputError, match=r"cases-0000001\.npy"):
            Columns(files, "values", range(ROWS))[1]
    np.save(second, np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"cases-0000001\.npy"):
        ColumnFile(second)
    second.unlink()
    second.symlink_to(first)
    with pytest.raises(HillsphereError, match="is a link"):
        Columns(files, "values", range(ROWS))[1]


@pytest.mark.parametrize("own", [False, True])
def test_a_product_finds_its_columns_beside_it(tmp_path: Path, own: bool) -> None:
    files, values = written(tmp_path / "work")
    product = Product(("a", "b"), Columns(files, "values", (2, 0)))
    assert canonical(product).values is product.values
    path = tmp_path / "many.npz"
    save_product(path, product, own=own)
    folder = tmp_path / "many.columns"
    assert files.directory == folder  # what is in memory reads what is stored
    for file in (tmp_path / "work").iterdir():
        assert own or file.samefile(folder / file.name)  # a link: nothing is written twice
        file.unlink()
    loaded = load_product(path, own=own)
    assert_array_equal(np.asarray(loaded.values), values[[2, 0]])
    save_product(path, loaded, own=own)
    assert_array_equal(np.asarray(load_product(path).values), values[[2, 0]])
    again = tmp_path / "again.npz"
    save_product(again, loaded)
    assert_array_equal(np.asarray(load_product(again).values), values[[2, 0]])
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "again.columns", "again.npz", "many.columns", "many.npz", "work"
    ]  # fmt: skip
    (folder / ColumnFiles.name(3)).unlink()
    with pytest.raises(InputError, match=r"cases-0000003\.npy.*restore it, or run the mission"):
        load_product(path)


def test_columns_that_others_may_write_to_are_not_trusted(tmp_path: Path) -> None:
    files, _ = written(tmp_path / "work")
    save_product(tmp_path / "a.npz", Product(("a",), Columns(files, "values", (0,))), own=True)
    os.chmod(tmp_path / "a.columns" / ColumnFiles.name(0), 0o666)
    with pytest.raises(InputError, match="others may write to it"):
        load_product(tmp_path / "a.npz", own=True).values[0]


def test_the_cache_drops_a_folder_of_columns_as_a_whole(tmp_path: Path) -> None:
    files, _ = written(tmp_path / "work")
    for age, name in enumerate("abc"):
        save_product(tmp_path / f"{name}.npz", Product(("a",), Columns(files, "values", (0,))))
        for path in (tmp_path / f"{name}.npz", tmp_path / f"{name}.columns"):
            os.utime(path, (age, age))
    size = sum(p.stat().st_size for p in (tmp_path / "a.columns").iterdir())
    folder = (tmp_path / "a.columns").stat().st_size
    drop_oldest(
        tmp_path, (".npz", ".columns"), 2 * (size + folder + (tmp_path / "a.npz").stat().st_size)
    )
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "b.columns", "b.npz", "c.columns", "c.npz", "work"
    ]  # fmt: skip
