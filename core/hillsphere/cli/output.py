"""Output of commands to stdout: aligned text for users, JSON for scripts."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from hillsphere.cli.streams import harmless

__all__ = ["number", "write", "write_json", "write_table"]


def write(text: str) -> None:
    """Write lines to stdout; control characters and those outside its encoding are escaped."""
    encoding = sys.stdout.encoding or "utf-8"
    sys.stdout.write(harmless(text).encode(encoding, "backslashreplace").decode(encoding) + "\n")
    sys.stdout.flush()


def write_json(value: Any) -> None:
    """Write one JSON document to stdout; NaN and infinities, which JSON lacks, become null."""
    write(json.dumps(_finite(value), indent=2, ensure_ascii=False, allow_nan=False))


def write_table(rows: Iterable[Sequence[str]], header: Sequence[str] = ()) -> None:
    """Write rows of text in columns, all but the last of equal width; nothing without rows."""
    body = [list(row) for row in rows]
    if not body:
        return
    lines = [list(header), *body] if header else body
    widths = [max(len(line[i]) for line in lines) for i in range(len(lines[0]))]
    for line in lines:
        cells = [cell.ljust(width) for cell, width in zip(line, widths, strict=True)]
        write("  ".join(cells).rstrip())


def number(value: Any) -> str:
    """Format a metric's value with ten significant digits, without trailing zeros."""
    if isinstance(value, bool) or not isinstance(value, float):
        return "-" if value is None else str(value)
    return f"{value:.10g}"


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if value - value == 0.0 else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
