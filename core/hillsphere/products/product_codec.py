"""Files of products: one generic, lossless npz codec for frozen dataclasses.

A product is a frozen dataclass whose fields are arrays, numbers, strings, ``None``, tuples of
these and further products. Its file is an ordinary ``.npz``: the name of every array is the path of
its field, so that ``numpy.load("family.npz")["orbits.x0"]`` works without this package, and the
entry ``__product__`` holds all other fields as JSON. No pickle is written or read. Columns that are
in files already (`hillsphere.products.columns`) stay there, in a folder beside: ``family.columns``.
"""

from __future__ import annotations

import errno
import importlib
import json
import math
import os
import re
import struct
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hillsphere.base.atomic import replacing
from hillsphere.base.errors import HillsphereError, InputError, StageError
from hillsphere.base.npz import read_arrays as read_members
from hillsphere.base.private_cache import is_private
from hillsphere.base.regular_files import open_regular
from hillsphere.products.columns import ColumnFiles, Columns, column_folder
from hillsphere.products.fields import dimension_sizes
from hillsphere.products.moved_classes import added_fields, current_class, current_field

__all__ = ["canonical", "load_product", "read_arrays", "read_fault", "save_product"]

T = TypeVar("T")

FORMAT = 1
"""Version of the file format; files of another version are refused."""
HEADER = "__product__"
_FILES = "__columns__"
"""Begin of the names of the arrays that say which files of columns belong to a product."""
_OF_FILES = ("counts", "sizes", "checks")
"""What is stored of `ColumnFiles`."""
_SPECIAL_FLOATS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
_MOST_BYTES = 1 << 30
"""Largest array in a compressed file, that of a square matrix of 11 585 rows. Without a limit a
small file could unpack to any size."""
_DAMAGES = (
    zipfile.BadZipFile, zlib.error, EOFError, LookupError, TypeError, ValueError, AttributeError,
    RuntimeError, ArithmeticError, AssertionError, SyntaxError, struct.error, tokenize.TokenError,
)  # fmt: skip
"""Errors of zipfile, json, and NumPy, which parses the headers of arrays as Python literals."""
_CLASS = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_][\w.]*")


def canonical(product: T) -> T:
    """Return a product with the memory layout that `load_product` gives it.

    NumPy adds in the order of memory, so that the last bits of a sum or of a matrix product depend
    on whether an array is in C or in Fortran order, or a view of a larger one. Code that continues
    with a product that may also have been read from a file (a later stage, a resumed search) uses
    this form, so that an interrupted run and an uninterrupted one have identical bits.

    Parameters
    ----------
    product : object
        As for `save_product`; it is not changed.

    Returns
    -------
    object
        An equal product with every array in C order; arrays may be shared with `product`.

    Raises
    ------
    InputError
        If it is not a product; the message names the field.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    copy: T = _decode(_encode_product(product, arrays), arrays, type(product).__name__)
    return copy


def save_product(path: str | Path, product: Any, *, own: bool = False) -> None:
    """Write a product to an ``.npz`` file.

    Parameters
    ----------
    path : str or Path
        The file, which is written atomically.
    product : object
        A frozen dataclass of arrays (any dtype but object), numbers, strings, ``None``, tuples of
        these and further such dataclasses. Its class stands at the top level of a module.
    own : bool
        Give only this user access to the file, independent of the umask.

    Raises
    ------
    InputError
        If the product holds anything else, or a field has another shape than its class declares
        (`hillsphere.products.fields`); the field is named.
    OSError
        If the file cannot be written.
    """
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    root = _encode_product(product, arrays)
    head: dict[str, Any] = {"format": FORMAT, "root": root}
    columns: dict[str, Any] = {key: a for key, a in arrays.items() if isinstance(a, Columns)}
    if columns:
        head["columns"] = {key: [one.field, one.rows] for key, one in columns.items()}
        files = next(iter(columns.values())).files
        if any(one.files is not files for one in columns.values()):
            raise InputError("the columns of a product must be in the same files")
        files.store(column_folder(Path(path)), own=own)
        arrays = {key: a for key, a in arrays.items() if key not in columns}
        for name in _OF_FILES:
            arrays[f"{_FILES}.{name}"] = getattr(files, name)
    # allow_nan is off on purpose: a special float that slipped through would not be JSON.
    text = json.dumps(head, allow_nan=False)
    header = np.frombuffer(text.encode("ascii"), dtype=np.uint8)
    # Not numpy.savez: it takes member names as keyword arguments, where "file" is taken.
    mode = 0o600 if own else None
    with replacing(Path(path), mode=mode) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in [(HEADER, header), *arrays.items()]:
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def load_product(path: str | Path, *, own: bool = False) -> Any:
    """Read a product that `save_product` wrote.

    Parameters
    ----------
    path : str or Path
        The ``.npz`` file.
    own : bool
        Refuse a link, a file of another user, and one that others may write to.

    Returns
    -------
    object
        The product, bit-identical to the saved one.

    Raises
    ------
    InputError
        If there is no such file, it is damaged or was not written by `save_product`, its class does
        not belong to the framework or an installed plugin, or the class has changed since; if a
        field has another shape than its class declares.
    StageError
        If the file exists but reading fails for a temporary reason: a disk that does not answer,
        too many open files, too little memory.

    Notes
    -----
    A file cannot cause the import of arbitrary modules: only those of the framework and of packages
    of registered plugins are imported.
    """
    place = Path(path)
    try:
        text, arrays = _members(place, own)
        head = json.loads(text)
        if head["format"] != FORMAT:
            raise InputError(
                f"{place.name}: written in product format {head['format']!r}; this version reads "
                f"format {FORMAT}"
            )
        if "columns" in head:
            facts = {name: arrays.pop(f"{_FILES}.{name}") for name in _OF_FILES}
            files = ColumnFiles(column_folder(place), own=own, **facts)
            files.verify()
            for key, (field, rows) in head["columns"].items():
                arrays[key] = Columns(files, field, rows)  # type: ignore[assignment]
        return _decode(head["root"], arrays, place.name)
    except (OSError, MemoryError) as error:
        raise read_fault(place, error) from error
    except InputError:
        raise
    except _DAMAGES as error:
        raise InputError(
            f"{place.name}: not a product file, or a damaged one "
            f"({type(error).__name__}: {error}); run the mission again"
        ) from error


def read_arrays(path: str | Path) -> dict[str, np.ndarray[Any, Any]]:
    """Read the arrays of any ``.npz`` file, such as ``numpy.savez`` and `save_product` write.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    dict of str to ndarray
        Name → array, in C order. Nothing is unpickled.

    Raises
    ------
    InputError
        If there is no such file, or it is damaged or not an ``.npz`` file.
    StageError
        If reading fails for a temporary reason, as for `load_product`.
    """
    place = Path(path)
    try:
        with open_regular(place) as stream:
            return read_members(stream, compressed=True)
    except (OSError, MemoryError) as error:
        raise read_fault(place, error) from error
    except InputError:
        raise
    except _DAMAGES as error:
        raise InputError(
            f"{place.name}: not an .npz file, or a damaged one ({type(error).__name__}: {error})"
        ) from error


def read_fault(path: Path, error: OSError | MemoryError) -> HillsphereError:
    """Return the named error for a file that could not be read.

    Parameters
    ----------
    path : Path
        The file.
    error : OSError or MemoryError
        Error of the operating system.

    Returns
    -------
    HillsphereError
        `InputError` if there is no such file or its content is invalid, `StageError` if the file
        may be intact but cannot be read at the moment.
    """
    if isinstance(error, MemoryError):
        return StageError(
            f"{path.name}: there is too little memory to read it; the file stands in "
            f"{str(path.parent)!r} as it was"
        )
    reason = error.strerror or error
    # A damaged directory of the archive refers to offsets outside the file.
    damaged = error.errno in (None, errno.EINVAL)
    if damaged or isinstance(error, FileNotFoundError | IsADirectoryError | NotADirectoryError):
        return InputError(f"{path.name}: cannot be read: {reason}")
    return StageError(
        f"{path.name}: cannot be read: {reason}; the file stands in {str(path.parent)!r} as it "
        "was: mend what keeps it from being read, and try again"
    )


def _members(path: Path, own: bool) -> tuple[str, dict[str, np.ndarray[Any, Any]]]:
    with open_regular(path, follow_links=not own) as stream:
        if own and not is_private(os.fstat(stream.fileno())):
            raise InputError(f"{path.name}: belongs to another user, or others may write to it")
        arrays = read_members(stream, compressed=False)
    if HEADER not in arrays:
        raise InputError(f"{path.name}: not a product file (it has no entry {HEADER})")
    return arrays.pop(HEADER).tobytes().decode("ascii"), arrays


def _is_product(value: Any) -> bool:
    return (
        is_dataclass(value)
        and not isinstance(value, type)
        and bool(value.__dataclass_params__.frozen)  # type: ignore[attr-defined]
    )


def _stored_fields(cls: type) -> Iterator[str]:
    return (field.name for field in fields(cls) if field.init)


def _encode_product(product: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """Convert a product to plain values, and put its arrays into `arrays`, in C order."""
    if not _is_product(product):
        raise InputError(
            f"a product must be a frozen dataclass, got {type(product).__name__}; "
            "decorate its class with @dataclass(frozen=True)"
        )
    return _encode(product, (), arrays)


def _encode(
    value: Any, where: tuple[str, ...], arrays: dict[str, np.ndarray[Any, Any]]
) -> dict[str, Any] | str | int | float | bool | None:
    if value is None or type(value) in (bool, int, str):
        return value  # type: ignore[no-any-return]
    if type(value) is float:
        # repr in JSON is exact for finite numbers; JSON has no others.
        return value if math.isfinite(value) else {"float": repr(value)}
    if type(value) is complex:
        return {"complex": [value.real.hex(), value.imag.hex()]}
    if type(value) is tuple:
        items = [_encode(item, (*where, str(i)), arrays) for i, item in enumerate(value)]
        return {"tuple": items}
    if isinstance(value, Columns):
        arrays[".".join(where)] = value  # type: ignore[assignment]
        return {"columns": ".".join(where)}
    if type(value) is np.ndarray or isinstance(value, np.generic):
        # One order in memory and in the file: see `canonical`. (Not `ascontiguousarray`, which
        # gives an array without axes one.)
        array = np.asarray(value, order="C")
        if array.dtype.hasobject:
            raise InputError(f"{'.'.join(where)}: an array of Python objects cannot be stored")
        key = ".".join(where)
        arrays[key] = array
        return {"array" if type(value) is np.ndarray else "scalar": key}
    if _is_product(value):
        cls = type(value)
        path = f"{cls.__module__}:{cls.__qualname__}"
        if not _CLASS.fullmatch(path):
            raise InputError(f"product class {path} must be defined at the top level of a module")
        dimension_sizes(value)  # every field has its declared shape
        table = {
            name: _encode(getattr(value, name), (*where, name), arrays)
            for name in _stored_fields(cls)
        }
        return {"product": path, "fields": table}
    raise InputError(
        f"{'.'.join(where)}: a {type(value).__name__} cannot be stored in a product; use arrays, "
        "numbers, strings, None, tuples of these, or a frozen dataclass"
    )


def _decode(node: Any, arrays: dict[str, np.ndarray[Any, Any]], file: str) -> Any:
    if not isinstance(node, dict):
        return node
    if "product" in node:
        cls = _product_class(node["product"], file)
        table = {
            current_field(node["product"], name): _decode(value, arrays, file)
            for name, value in node["fields"].items()
        }
        table = added_fields(cls) | table
        if set(table) != set(_stored_fields(cls)):
            raise InputError(
                f"{file}: {cls.__name__} has other fields now than when the file was written; "
                "run the mission again"
            )
        product = cls(**table)
        try:
            dimension_sizes(product)
        except InputError as error:
            raise InputError(f"{file}: {error}; run the mission again") from error
        return product
    ((tag, content),) = node.items()
    decoders: dict[str, Callable[[Any], Any]] = {
        "float": lambda text: _SPECIAL_FLOATS[text],
        "complex": lambda parts: complex(*(float.fromhex(part) for part in parts)),
        "tuple": lambda items: tuple(_decode(item, arrays, file) for item in items),
        "array": lambda key: arrays[key],
        "columns": lambda key: arrays[key],
        "scalar": lambda key: arrays[key][()],
    }
    return decoders[tag](content)


def _product_class(path: str, file: str) -> type:
    if not _CLASS.fullmatch(path):
        raise InputError(f"{file}: {path!r} is not a product class")
    module_name, _, name = current_class(path).partition(":")
    module = sys.modules.get(module_name)
    if module is None:
        if module_name.partition(".")[0] not in _trusted_packages():
            raise InputError(
                f"{file}: its class {path} belongs to no installed plugin; install the package "
                "that wrote the file, or import it first"
            )
        try:
            module = importlib.import_module(module_name)
        except ImportError as error:
            raise InputError(f"{file}: its class {path} cannot be imported: {error}") from error
    cls: Any = module
    for part in name.split("."):
        cls = getattr(cls, part, None)
    if (
        not isinstance(cls, type)
        or not is_dataclass(cls)
        or not cls.__dataclass_params__.frozen  # type: ignore[attr-defined]
        or cls.__module__ != module_name
        or cls.__qualname__ != name
    ):
        raise InputError(f"{file}: {path} is not a frozen dataclass of the module named")
    return cls


def _trusted_packages() -> set[str]:
    from hillsphere.plugins.registry import default_registry

    return {"hillsphere"} | {
        record.component.target.partition(":")[0].partition(".")[0] for record in default_registry()
    }
