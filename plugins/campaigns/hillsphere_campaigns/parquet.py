"""Tables as Apache Parquet, written by pyarrow a part at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any, BinaryIO

from hillsphere.errors import InputError

__all__ = ["check_pyarrow", "write_parquet"]

_TYPES = {
    "case": "int64", "draw": "int64", "point": "int64", "failed": "bool", "status": "string",
    "cause": "string", "class": "string", "point_label": "string", "message": "string",
}  # fmt: skip
"""Types of the columns that are no doubles."""


def check_pyarrow() -> None:
    """Raise `InputError` if pyarrow is not installed."""
    if find_spec("pyarrow") is None:
        raise InputError(
            "the format parquet needs pyarrow, which is not installed: "
            "pip install 'hillsphere[parquet]'"
        )


def write_parquet(
    stream: BinaryIO,
    columns: Sequence[tuple[str, str]],
    parts: Iterable[Sequence[Sequence[Any]]],
    about: Mapping[str, str],
) -> None:
    """Write a table of cases, a row group for each part.

    Parameters
    ----------
    stream : BinaryIO
        The open file.
    columns : sequence of (str, str)
        Name and unit of each column; ``""`` for no unit.
    parts : iterable of sequence
        The columns of some rows each.
    about : mapping of str to str
        Metadata of the file.

    Raises
    ------
    InputError
        If pyarrow is not installed.
    """
    check_pyarrow()
    import pyarrow as pa
    from pyarrow import parquet

    fields = [
        pa.field(name, _TYPES.get(name, "float64"), metadata={"unit": unit} if unit else None)
        for name, unit in columns
    ]
    schema = pa.schema(
        fields, metadata={f"hillsphere.{key}": _sound(text) for key, text in about.items()}
    )
    with parquet.ParquetWriter(stream, schema) as writer:
        for part in parts:
            arrays = [
                pa.array([_sound(v) for v in values] if field.type == pa.string() else values)
                .cast(field.type)
                for field, values in zip(schema, part, strict=True)
            ]  # fmt: skip
            writer.write_table(pa.Table.from_arrays(arrays, schema=schema))


def _sound(text: str) -> str:
    """Return a text that UTF-8 can hold; a lone surrogate becomes an escape."""
    return text.encode("utf-8", errors="backslashreplace").decode()
