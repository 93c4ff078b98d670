"""Systems, uncertain systems and tables in MATLAB's .mat files.

A system is a struct of ``a``, ``b``, ``c``, ``d``, ``Ts`` (0 in continuous time) and, where it has
names, ``InputName``, ``OutputName``, ``StateName``: in MATLAB ``P = ss(s.a, s.b, s.c, s.d, s.Ts)``,
and ``struct('a', P.A, …, 'Ts', P.Ts)`` for the other way. In a system, fields may be in upper case
(``struct('A', P.A, …)``, ``get(P)``), and a regular descriptor matrix ``e`` is applied: E⁻¹A, E⁻¹B.
Delays, and a unit of time other than seconds, are refused. Of signals of one name, MATLAB's allows
them, ``u`` twice becomes ``u[1]`` and ``u[2]``. An uncertain system is a struct of ``M``,
such a system, and ``blocks``, the block structure of ``mussv``, one row each: [−r 0] a real scalar
repeated r times, [r 0] a complex one, [r c] a full block of r by c; and ``BlockName``. A table is a
struct of arrays. Nothing else is written or read: no objects, no functions; a variable of text is
passed over.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from hillsphere.base.atomic import replacing
from hillsphere.base.regular_files import read_bytes
from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import Block, BlockStructure, full
from hillsphere_controllers.systems.mat_file import MatFileError, parse_mat

__all__ = ["Content", "load_mat", "save_mat"]

Numbers = NDArray[np.float64] | NDArray[np.complex128]
Content = LtiSystem | tuple[LtiSystem, BlockStructure] | Numbers | dict[str, Numbers]
"""A system, M and the structure of Δ, a matrix, or a table."""

_NAME = re.compile(r"[A-Za-z]\w{0,62}", re.ASCII)
_SYSTEM = {"a", "b", "c", "d"}
_REGULAR = 1e-12
"""Inverse condition number of the equilibrated descriptor matrix below which it counts as
singular."""
_MOST_BYTES = 256 << 20
"""Most bytes of a file: thirty systems of 1000 states."""
_NAMES = (("InputName", "inputs"), ("OutputName", "outputs"), ("StateName", "states"))


def save_mat(path: Path, contents: Mapping[str, Content], *, follow_links: bool = True) -> None:
    """Write systems, uncertain systems, matrices and tables to a file of MATLAB's version 5.

    Parameters
    ----------
    path : Path
        The file, written over if it exists. It is whole or not there.
    contents : mapping of str to Content
        By variable name: letters, digits and ``_``, at most 63, a letter first.
    follow_links : bool
        Whether a link is followed; else the file takes its place.

    Raises
    ------
    InputError
        If a name does not do, something is of no kind that is written, or the file cannot be.
    """
    written = {_name(name): _encode(name, content) for name, content in contents.items()}
    try:
        with replacing(path, follow_links=follow_links) as stream:
            savemat(stream, written, appendmat=False, long_field_names=True, do_compression=True)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error


def load_mat(path: Path) -> dict[str, Content]:
    """Read systems and matrices from a .mat file of `save_mat`, or of MATLAB in the same form.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    dict of str to Content
        By variable name, without those of text. Vectors are matrices of one row or column, as in
        MATLAB.

    Raises
    ------
    InputError
        If the file cannot be read, or holds anything but plain arrays, structs of them and text;
        or a system has delays, a singular descriptor matrix, a period that is left open (−1), or
        another unit of time than seconds.
    """
    try:
        data = read_bytes(path, _MOST_BYTES)
    except FileNotFoundError:
        raise InputError(f"{path} cannot be read: there is no such file") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error
    try:
        variables = parse_mat(data)
    except MatFileError as error:
        raise InputError(f"{path} is no .mat file that can be read: {error}") from error
    try:
        return {
            name: _decode(value, name)
            for name, value in variables.items()
            if value.dtype.kind != "U"
        }
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise InputError(f"{name!r} is no name for a variable of MATLAB's")
    return name


def _encode(name: str, content: Content) -> Any:
    if isinstance(content, LtiSystem):
        return _encode_system(content)
    if isinstance(content, tuple):
        kinds = [type(part) for part in content]
        if kinds != [LtiSystem, BlockStructure]:
            raise InputError(f"{name}: of tuples, a system and its block structure are written")
        system, structure = content
        fits = structure.shape
        if not (system.shape[0] >= fits[0] and system.shape[1] >= fits[1]):
            raise InputError(f"{name}: blocks of {fits} do not fit a system of {system.shape}")
        return {
            "M": _encode_system(system),
            "blocks": np.array([_row(block) for block in structure.blocks], dtype=float),
            "BlockName": _cell(tuple(block.name for block in structure.blocks)),
        }
    if isinstance(content, Mapping):
        if {key.lower() for key in content} >= _SYSTEM or "M" in content:
            raise InputError(f"{name}: a table with these columns would be read as a system")
        return {_name(key): _matrix(value, f"{name}.{key}") for key, value in content.items()}
    return _matrix(content, name)


def _encode_system(system: LtiSystem) -> dict[str, Any]:
    made: dict[str, Any] = {name: getattr(system, name) for name in "abcd"}
    made["Ts"] = 0.0 if system.dt_s is None else system.dt_s
    for field, attribute in _NAMES:
        if getattr(system, attribute):
            made[field] = _cell(getattr(system, attribute))
    return made


def _cell(names: tuple[str, ...]) -> NDArray[np.object_]:
    cell = np.empty((len(names), 1), dtype=object)
    cell[:, 0] = names
    return cell


def _row(block: Block) -> tuple[int, int]:
    if block.kind == "full":
        return block.rows, block.columns
    return (-block.rows if block.kind == "real" else block.rows), 0


def _decode(value: Any, where: str) -> Content:
    if isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        fields = {name: value[name].ravel()[0] for name in value.dtype.names}
        if {name.lower() for name in fields} >= _SYSTEM:
            return _decode_system(fields, where)
        if "M" in fields and "blocks" in fields:
            system = _decode(fields["M"], f"{where}.M")
            if not isinstance(system, LtiSystem):
                raise InputError(f"{where}.M must be a struct of a, b, c, d and Ts")
            structure = _decode_blocks(fields, where)
            (p, m), (out, into) = system.shape, structure.shape
            if out > p or into > m:
                raise InputError(
                    f"{where}.blocks close {out} outputs and {into} inputs, but {where}.M is "
                    f"{p} × {m}"
                )
            return system, structure
        return {name: _matrix(entry, f"{where}.{name}") for name, entry in fields.items()}
    return _matrix(value, where)


def _decode_system(written: Mapping[str, Any], where: str) -> LtiSystem:
    fields = {name.lower(): value for name, value in written.items()}
    if len(fields) < len(written):
        raise InputError(f"{where} has fields that differ in case only: {', '.join(written)}")
    _check_time(written, where)
    a, b, c, d = (_matrix(fields[name], f"{where}.{name}") for name in "abcd")
    if any(np.iscomplexobj(matrix) for matrix in (a, b, c, d)):
        raise InputError(f"{where}: the matrices of a system must be real")
    (p, m), n = d.shape, len(a)
    # MATLAB writes [] where a dimension is zero
    b, c = (b if b.size else np.zeros((n, m))), (c if c.size else np.zeros((p, n)))
    if "e" in fields:
        a, b = _explicit(a, b, _matrix(fields["e"], f"{where}.e"), f"{where}.e")
    period = _matrix(fields.get("ts", 0.0), f"{where}.Ts")
    if period.size == 1 and period.flat[0] == -1.0:
        raise InputError(
            f"{where}.Ts is −1, which is discrete time without a period; set it in MATLAB before "
            "saving: P.Ts = 0.1, in seconds"
        )
    if period.size != 1 or np.iscomplexobj(period) or not float(period.flat[0]) >= 0.0:
        raise InputError(
            f"{where}.Ts must be a period in seconds, 0 in continuous time, got {period}"
        )
    names = {
        attribute: _decode_names(fields[field.lower()], f"{where}.{field}")
        for field, attribute in _NAMES
        if field.lower() in fields
    }
    given = {key: _unique(value, key[:-1]) if any(value) else () for key, value in names.items()}
    dt_s = float(period.flat[0]) or None
    return LtiSystem(np.real(a), np.real(b), np.real(c), np.real(d), dt_s, **given)


def _check_time(fields: Mapping[str, Any], where: str) -> None:
    """Raise `InputError` for delays, which `LtiSystem` has none of, and units of time."""
    for name, value in fields.items():
        if name.lower().endswith("delay") and np.any(_matrix(value, f"{where}.{name}")):
            raise InputError(
                f"{where}.{name}: delays are not read; in MATLAB, replace them by states before "
                "saving: P = pade(P, 3), or in discrete time P = absorbDelay(P)"
            )
        if name.lower() == "timeunit" and set(_decode_names(value, f"{where}.{name}")) - {
            "",
            "seconds",
        }:
            raise InputError(
                f"{where}.{name} must be seconds; in MATLAB: P = chgTimeUnit(P, 'seconds')"
            )


def _explicit(a: Numbers, b: Numbers, e: Numbers, where: str) -> tuple[Numbers, Numbers]:
    """Return E⁻¹ A and E⁻¹ B."""
    if e.size == 0:  # what MATLAB writes for the identity
        return a, b
    if e.shape != a.shape or np.iscomplexobj(e):
        raise InputError(f"{where} must be real and of the shape of a, {a.shape}, got {e.shape}")
    # the units of equations and states change the singular values, not what is singular
    rows = np.abs(e).max(axis=1, keepdims=True)
    even = e / np.where(rows > 0.0, rows, 1.0)
    columns = np.abs(even).max(axis=0, keepdims=True)
    even = even / np.where(columns > 0.0, columns, 1.0)
    if not np.isfinite(even).all() or not 1.0 / np.linalg.cond(even) > _REGULAR:
        raise InputError(
            f"{where}, the descriptor matrix, is singular; in MATLAB, bring the system to a form "
            "without it before saving: P = ss(P, 'explicit'), or minreal(P)"
        )
    into = np.linalg.solve(np.real(e), np.hstack([np.real(a), np.real(b)]))
    return into[:, : len(a)], into[:, len(a) :]


def _unique(names: tuple[str, ...], otherwise: str) -> tuple[str, ...]:
    """Return unique names: repeated ones get numbers, from one on."""
    filled = [name or otherwise for name in names]
    count: dict[str, int] = {}
    made = []
    for name, given in zip(filled, names, strict=True):
        count[name] = count.get(name, 0) + 1
        several = not given or filled.count(name) > 1
        made.append(f"{name}[{count[name]}]" if several else name)
    return tuple(made)


def _decode_blocks(fields: Mapping[str, Any], where: str) -> BlockStructure:
    rows = _matrix(fields["blocks"], f"{where}.blocks")
    if rows.ndim != 2 or rows.shape[1] != 2 or np.iscomplexobj(rows):
        raise InputError(f"{where}.blocks must have two columns, those of mussv's block structure")
    names = (
        _decode_names(fields["BlockName"], f"{where}.BlockName")
        if "BlockName" in fields
        else ("",) * len(rows)
    )
    if len(names) != len(rows):
        raise InputError(f"{where}: {len(rows)} blocks with {len(names)} names")
    return BlockStructure(
        [_block(float(r), float(c), name, where) for (r, c), name in zip(rows, names, strict=True)]
    )


def _block(r: float, c: float, name: str, where: str) -> Block:
    if r == int(r) and c == int(c) and r != 0.0:
        times = abs(int(r))
        if r < 0.0 and (c == 0.0 or (r, c) == (-1.0, 1.0)):
            return Block("real", times, times, name)
        if r > 0.0 and c == 0.0:
            return Block("complex", times, times, name)
        if r > 0.0 and c > 0.0:
            return full(times, int(c), name)
    raise InputError(f"{where}.blocks: [{r:g} {c:g}] is no block of mussv's")


def _decode_names(value: Any, where: str) -> tuple[str, ...]:
    cells = [value] if isinstance(value, str) else list(np.ravel(value))
    names = []
    for cell in cells:
        text = np.ravel(np.asarray(cell))
        if text.dtype.kind != "U" or text.size > 1:
            raise InputError(f"{where} must be a cell array of names")
        names.append(str(text[0]) if text.size else "")
    return tuple(names)


def _matrix(value: Any, where: str) -> Numbers:
    made = np.asarray(value)
    if made.dtype.kind not in "biufc":
        raise InputError(
            f"{where} is neither a matrix of numbers, nor a system, nor a table of matrices; save "
            "plain arrays and structs of them"
        )
    if made.dtype.kind == "c":
        return np.array(made, dtype=complex)
    return np.array(made, dtype=float)
